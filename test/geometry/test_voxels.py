"""Cubes around a place: they hold the ball, and one at the rim holds nothing of it; all clouds have the same ones."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.geometry.voxels import VoxelGrid


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 1.0), st.floats(0.02, 0.5))
def test_a_ball_is_in_the_cubes_and_not_in_those_at_the_rim(seed, radius, edge):
    random = np.random.default_rng(seed)
    centre, directions = random.uniform(-1.0, 1.0, 3), random.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # The six outermost places of the ball too.
    directions = np.concatenate([directions, np.eye(3), -np.eye(3)])
    grid = VoxelGrid.around(centre, radius, edge)
    for share in (1.0, 0.5):
        cubes = np.floor((centre + share * radius * directions) / edge + 0.5) - grid.first
        assert np.all(cubes >= 1)
        assert np.all(cubes <= np.array(grid.shape) - 2)


def test_each_cube_has_its_number_and_all_others_none():
    grid = VoxelGrid.around(np.array([0.3, -0.2, 0.5]), 0.2, 0.02)
    random = np.random.default_rng(0)
    places = grid.first + np.unique(random.integers(0, grid.shape, (50, 3)), axis=0)
    cubes = grid.numbered(places)
    np.testing.assert_array_equal(cubes[tuple((places - grid.first).T)], np.arange(1, len(places) + 1))
    assert np.count_nonzero(cubes) == len(places)
    assert np.count_nonzero(grid.numbers()) == np.count_nonzero(grid.numbered(places[:0])) == 0
