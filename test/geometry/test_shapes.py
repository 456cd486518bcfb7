"""Signed distances of boxes, capsules and what is between them: against dense samples of their surfaces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.shapes import (
    bounding_radii,
    no_solids,
    solid_approach,
    solid_distance,
    solid_distances,
    solid_rows,
    solids_moved,
    thicknesses,
)

#: Half extents [m] and radius [m].
SHAPES = {
    "box": ([0.10, 0.05, 0.02], 0.0),
    "capsule": ([0.0, 0.0, 0.15], 0.04),
    "sphere": ([0.0, 0.0, 0.0], 0.1),
    "rounded plate": ([0.1, 0.1, 0.0], 0.03),
    "rounded box": ([0.08, 0.05, 0.03], 0.02),
}


def solid(shape: str, seed: int = 0) -> np.ndarray:
    random = np.random.default_rng(seed)
    extents, radius = SHAPES[shape]
    turn = Rotation.random(random_state=seed).as_matrix()
    return solid_rows(random.uniform(-0.3, 0.3, (1, 3)), turn[None], np.array([extents]), np.array([radius]))


def core(row: np.ndarray, step: float = 0.002) -> np.ndarray:
    """Points (n, 3) all over the faces of the box that is rounded."""
    axes = [np.linspace(-h, h, int(np.ceil(2.0 * h / step)) + 1 if h > 0.0 else 1) for h in row[3:6]]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    faces = grid[np.any(np.abs(grid) == row[3:6], axis=1)]
    return faces @ row[7:].reshape(3, 3).T + row[:3]


@pytest.mark.parametrize("shape", SHAPES)
def test_the_distance_is_that_of_the_nearest_point_of_the_surface(shape):
    row, random = solid(shape), np.random.default_rng(1)
    points = row[0, :3] + random.uniform(-0.3, 0.3, (3000, 3))
    local = np.abs((points - row[0, :3]) @ row[0, 7:].reshape(3, 3))
    inside = np.all(local < row[0, 3:6], axis=1)
    sampled, _ = cKDTree(core(row[0])).query(points)
    expected = np.where(inside, -sampled, sampled) - row[0, 6]
    np.testing.assert_allclose(solid_distances(points, row), expected, atol=1.5e-3)


def test_a_capsule_and_a_sphere_have_their_closed_forms():
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (1000, 3))
    ball, capsule = solid("sphere"), solid("capsule", seed=3)
    np.testing.assert_allclose(
        solid_distances(points, ball), np.linalg.norm(points - ball[0, :3], axis=1) - 0.1, atol=1e-12
    )
    axis = capsule[0, 7:].reshape(3, 3)[:, 2]
    along = np.clip((points - capsule[0, :3]) @ axis, -0.15, 0.15)
    gaps = np.linalg.norm(points - capsule[0, :3] - along[:, None] * axis, axis=1) - 0.04
    np.testing.assert_allclose(solid_distances(points, capsule), gaps, atol=1e-12)


def test_of_several_solids_the_nearest_counts_and_without_any_nothing_is_near():
    points = np.random.default_rng(3).uniform(-0.5, 0.5, (200, 3))
    solids = np.concatenate([solid(shape, seed) for seed, shape in enumerate(SHAPES)])
    each = np.array([solid_distances(points, row[None]) for row in solids])
    np.testing.assert_array_equal(solid_distances(points, solids), each.min(axis=0))
    assert np.all(np.isinf(solid_distances(points, no_solids())))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("length", [0.0, 1e-4, 0.02, 0.5])
def test_an_approach_is_never_optimistic_and_half_a_millimetre_too_small_at_most(shape, length):
    row, random = solid(shape), np.random.default_rng(4)
    shares = np.linspace(0.0, 1.0, 2001)[:, None]
    for _ in range(60):
        begin = row[0, :3] + random.uniform(-0.25, 0.25, 3)
        direction = random.normal(size=3)
        end = begin + length * direction / np.linalg.norm(direction)
        sampled = solid_distances(begin + shares * (end - begin), row).min()
        bound = solid_approach(begin, end, row, 0, np.inf)
        assert bound <= sampled + 1e-12
        assert bound >= sampled - 5e-4 - length / 4000.0
        assert solid_approach(begin, end, row, 0, bound - 1e-3) >= bound - 1e-3


def test_bounding_spheres_hold_their_solids_and_inner_ones_fit():
    for seed, shape in enumerate(SHAPES):
        row = solid(shape, seed)
        assert np.max(np.linalg.norm(core(row[0]) - row[0, :3], axis=1)) + row[0, 6] == pytest.approx(
            bounding_radii(row)[0]
        )
        assert solid_distance(*row[0, :3], row, 0) == pytest.approx(-thicknesses(row)[0])


def test_moved_solids_are_as_far_from_moved_points():
    solids = np.concatenate([solid(shape, seed) for seed, shape in enumerate(SHAPES)])
    points = np.random.default_rng(5).uniform(-0.5, 0.5, (100, 3))
    rotation, translation = Rotation.random(random_state=9).as_matrix(), np.array([0.3, -0.2, 0.5])
    moved = solids_moved(solids, rotation, translation)
    np.testing.assert_allclose(
        solid_distances(points @ rotation.T + translation, moved), solid_distances(points, solids), atol=1e-12
    )
