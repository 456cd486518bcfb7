"""Groups in the latent space: clusters count as such, mixed ones do not, and no demonstration vouches for itself."""

from __future__ import annotations

import numpy as np

from geodesic_motion_studies.experiments.clusters import share_in_own_group


def test_groups_that_are_apart_are_clusters_and_mixed_ones_are_not() -> None:
    lines = np.stack([np.linspace(0.0, 1.0, 20), np.zeros(20)], axis=1)
    places = np.array([0.0, 0.1, 5.0, 5.1])
    codes = lines + np.stack([np.zeros(4), places], axis=1)[:, None]
    numbers = np.arange(4)
    assert share_in_own_group(codes, np.array([0, 0, 1, 1]), numbers) == 1.0
    assert share_in_own_group(codes, np.array([0, 1, 0, 1]), numbers) == 0.0
    assert share_in_own_group(codes, np.array([0, 0, 0, 1]), numbers) == 0.5


def test_curves_of_one_demonstration_are_not_one_another_s_neighbours() -> None:
    codes = np.array([0.0, 0.1, 5.0, 5.1])[:, None, None] * np.ones((1, 3, 2))
    groups = np.array([True, False, True, False])
    assert share_in_own_group(codes, groups, np.array([0, 0, 1, 1])) == 0.5
