"""The occupied cubes of a cloud, against the plain way to find them."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.nodes.cubes import doubled, occupied_cubes


@pytest.mark.parametrize("count", [0, 1, 7, 5000])
@pytest.mark.parametrize("edge", [0.005, 0.04, 1.0])
def test_are_those_of_numpy(count: int, edge: float) -> None:
    points = np.random.default_rng(count).normal(scale=0.3, size=(count, 3))
    expected = np.unique(np.floor(points / edge), axis=0)
    np.testing.assert_array_equal(occupied_cubes(points, edge), expected)


def test_doubled_cubes_hold_the_same_points() -> None:
    points = np.random.default_rng(1).normal(scale=0.3, size=(3000, 3))
    np.testing.assert_array_equal(doubled(occupied_cubes(points, 0.05)), occupied_cubes(points, 0.1))


def test_the_furthest_cubes_are_told_apart() -> None:
    corners = 1000.0 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    np.testing.assert_array_equal(occupied_cubes(corners, 0.005), np.unique(np.floor(corners / 0.005), axis=0))
