"""Radial-basis-function networks: the compiled sum is the plain one."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.radial_basis import radial_basis


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_sum_is_that_of_all_kernels(dimension):
    random = np.random.default_rng(dimension)
    latent, centres = random.normal(size=(50, dimension)), random.normal(size=(30, dimension))
    weights = random.uniform(0.1, 3.0, (4, 30))
    kernels = np.exp(-1.7 * np.sum((latent[:, None] - centres) ** 2, axis=-1))
    np.testing.assert_allclose(radial_basis(latent, centres, 1.7, weights), kernels @ weights.T, rtol=1e-12)


def test_what_is_left_out_far_away_is_below_rounding():
    """Kernels far from a point add nothing beside those near it, and nothing at all far from all."""
    centres, weights = np.array([[0.0, 0.0], [100.0, 0.0]]), np.ones((1, 2))
    at_first = radial_basis(np.zeros((1, 2)), centres, 1.0, weights)
    np.testing.assert_array_equal(at_first, 1.0)
    assert radial_basis(np.array([[50.0, 0.0]]), centres, 1.0, weights)[0, 0] == 0.0


def test_views_of_other_memory_layouts_are_taken():
    random = np.random.default_rng(5)
    latent, centres, weights = random.normal(size=(40, 4))[::2, ::2], random.normal(size=(6, 2)), random.random((6, 3))
    given = radial_basis(latent, centres, 1.0, weights.T)
    np.testing.assert_array_equal(given, radial_basis(latent.copy(), centres, 1.0, weights.T.copy()))


def test_many_points_are_worked_out_as_few_are() -> None:
    random = np.random.default_rng(5)
    centres, weights = random.normal(size=(20, 3)), random.uniform(size=(7, 20))
    latent = random.normal(size=(30_001, 3))
    few = np.concatenate([radial_basis(part, centres, 2.0, weights) for part in np.array_split(latent, 7)])
    np.testing.assert_array_equal(radial_basis(latent, centres, 2.0, weights), few)
