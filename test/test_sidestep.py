"""Sidesteps: there are places on all sides."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.sidestep import places_beside

HERE = np.array([0.4, -0.1, 0.3])


def test_there_are_places_on_all_sides_the_nearer_ones_first() -> None:
    away = places_beside(HERE) - HERE
    lengths = np.linalg.norm(away, axis=1)
    assert np.all(np.diff(lengths) > -1e-12)
    for length in np.unique(np.round(lengths, 9)):
        beside = away[np.isclose(lengths, length)] / length
        for direction in np.random.default_rng(0).normal(size=(50, 3)):
            assert np.max(beside @ direction) / np.linalg.norm(direction) > np.cos(np.radians(30.0))
