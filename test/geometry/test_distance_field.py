"""The field of a cloud is never optimistic, loses what it says, is continuous, and stays small."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.distance_field import REACH, DistanceField, field_approach, field_distances
from geodesic_motion_ros.utils.errors import PlanningError

RADIUS, THICKNESS = 0.015, 0.05


def cloud(seed: int, count: int, spread: float = 0.4) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-spread, spread, (count, 3)) + [0.4, 0.0, 0.5]


def around(points: np.ndarray, seed: int = 1, count: int = 2000) -> np.ndarray:
    """Points from within the cloud to beyond the field."""
    random = np.random.default_rng(seed)
    return random.uniform(points.min(axis=0) - 0.5, points.max(axis=0) + 0.5, (count, 3))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3000), st.floats(0.005, 0.1), st.floats(0.001, 0.5))
def test_the_field_is_never_optimistic_and_loses_a_cube_at_most(seed, count, edge, spread):
    points = cloud(seed, count, spread)
    field = DistanceField.of(points, edge, RADIUS, THICKNESS)
    places = around(points, seed)
    computed = field_distances(places, *field)
    true = np.minimum(cKDTree(points).query(places)[0], REACH) - RADIUS
    assert np.all(computed <= true + 1e-9)
    # The cube's half diagonal to and fro, and what interpolation loses, which is less than that.
    assert np.all(computed >= true - 1.5 * np.sqrt(3.0) * field.edge - 1e-9)
    assert np.median(true - computed) < np.sqrt(3.0) * field.edge


def test_at_the_middles_of_cubes_it_is_the_distance_transform():
    points = cloud(0, 500)
    field = DistanceField.of(points, 0.02, RADIUS, THICKNESS)
    exact = distance_transform_edt(field.squares > 0.0)
    np.testing.assert_allclose(np.sqrt(field.squares), np.minimum(exact, REACH / 0.02), atol=1e-6)
    nearest, _ = cKDTree(field.occupied).query(points)
    assert np.max(nearest) <= 0.5 * np.sqrt(3.0) * field.edge
    assert field.surface == pytest.approx(RADIUS + 0.5 * np.sqrt(3.0) * 0.02)


def test_it_is_continuous_from_the_cloud_to_beyond_its_rim():
    field = DistanceField.of(cloud(1, 40), 0.02, RADIUS, THICKNESS)
    for seed in range(20):
        begin, end = around(cloud(1, 40), seed, 2)
        line = begin + np.linspace(0.0, 1.0, 20001)[:, None] * (end - begin)
        steps = np.abs(np.diff(field_distances(line, *field)))
        # The root of what is interpolated is steep where that begins, inside a cube that holds points.
        assert np.max(steps) < 0.002
        assert np.median(steps) <= np.linalg.norm(end - begin) / 20000.0 + 1e-12


def test_far_away_it_tells_its_reach():
    field = DistanceField.of(cloud(2, 100), 0.02, RADIUS, THICKNESS)
    computed = field_distances(np.array([[5.0, 5.0, 5.0], [-9.0, 0.0, 0.0]]), *field)
    np.testing.assert_allclose(computed, REACH - field.surface, atol=field.edge)
    assert np.all(computed <= REACH - field.surface)


@pytest.mark.parametrize("length", [0.0, 0.003, 0.05, 0.6])
def test_an_approach_is_never_optimistic_and_costs_a_millimetre(length):
    points, random = cloud(3, 60), np.random.default_rng(3)
    field, tree = DistanceField.of(points, 0.02, RADIUS, THICKNESS), cKDTree(points)
    shares = np.linspace(0.0, 1.0, 1001)[:, None]
    for begin in around(points, 4, 150):
        direction = random.normal(size=3)
        end = begin + length * direction / np.linalg.norm(direction)
        line = begin + shares * (end - begin)
        bound = field_approach(begin, end, *field, np.inf)
        assert bound <= np.min(tree.query(line)[0]) - RADIUS + 1e-9
        computed = np.min(field_distances(line, *field))
        assert bound >= computed - 1e-3 - 1e-9
        assert field_approach(begin, end, *field, bound - 0.01) == bound - 0.01


def test_a_moved_field_is_as_far_from_moved_points():
    points = cloud(4, 200)
    field = DistanceField.of(points, 0.02, RADIUS, THICKNESS)
    rotation, translation = Rotation.random(random_state=5).as_matrix(), np.array([0.3, -0.2, 0.5])
    moved = field.moved(rotation, translation)
    places = around(points)
    there = field_distances(places @ rotation.T + translation, *moved)
    np.testing.assert_allclose(there, field_distances(places, *field), atol=1e-9)
    np.testing.assert_allclose(moved.occupied, field.occupied @ rotation.T + translation, atol=1e-9)
    assert moved.same_as(field.moved(rotation, translation))
    assert not moved.same_as(field)


def test_a_scene_that_stands_has_the_same_cubes_in_every_cloud():
    points, random = 0.02 * np.random.default_rng(6).integers(-10, 10, (50, 3)), np.random.default_rng(7)
    seen = [DistanceField.of(points + random.uniform(-0.008, 0.008, points.shape), 0.02, RADIUS, THICKNESS)
            for _ in range(2)]  # fmt: skip
    np.testing.assert_array_equal(seen[0].squares, seen[1].squares)


def test_a_wide_cloud_has_larger_cubes_and_is_still_not_optimistic():
    points = np.random.default_rng(8).uniform(-3.0, 3.0, (100_000, 3))
    field = DistanceField.of(points, 0.01, RADIUS, THICKNESS)
    assert field.squares.size < 1.5e6
    assert field.edge > 0.05
    places = np.random.default_rng(9).uniform(-3.0, 3.0, (1000, 3))
    assert np.all(field_distances(places, *field) <= cKDTree(points).query(places)[0] - RADIUS + 1e-9)


@pytest.mark.parametrize("spread", [0.3, 3.0], ids=["cubes as they are", "cubes made larger"])
def test_a_field_of_cubes_holds_every_point_in_them(spread):
    edge, random = 0.02, np.random.default_rng(10)
    points = random.uniform(-spread, spread, (20_000, 3))
    places = np.unique(np.floor(points / edge + 0.5).astype(np.int64), axis=0)
    field = DistanceField.of_cubes(places, edge, RADIUS, THICKNESS)
    assert (field.edge > edge) is (spread > 1.0)
    near = points[:1000] + random.normal(0.0, 0.03, (1000, 3))
    assert np.all(field_distances(near, *field) <= cKDTree(points).query(near)[0] - RADIUS + 1e-9)
    # A corner of a cube is of it as its middle is.
    corners = edge * (places[:1000] + 0.5 * random.choice([-1.0, 1.0], (1000, 3)))
    assert np.all(field_distances(corners, *field) <= -RADIUS + 1e-9)


def test_a_field_of_cubes_is_that_of_points_at_their_middles():
    places = np.random.default_rng(11).integers(-10, 10, (50, 3))
    ours, other = (
        DistanceField.of_cubes(places, 0.02, RADIUS, THICKNESS),
        DistanceField.of(0.02 * places, 0.02, RADIUS, THICKNESS),
    )
    np.testing.assert_array_equal(ours.squares, other.squares)
    np.testing.assert_array_equal(ours.placing, other.placing)
    occupied = np.rint(ours.occupied / 0.02).astype(int)
    assert set(map(tuple, occupied)) == set(map(tuple, places))
    assert DistanceField.of_cubes(places[:0], 0.02, RADIUS, THICKNESS).squares.size == 0


def test_a_cloud_without_points_is_no_field():
    assert DistanceField.of(np.empty((0, 3)), 0.02, RADIUS, THICKNESS).squares.size == 0
    assert DistanceField.none().occupied.shape == (0, 3)
    assert DistanceField.none().moved(np.eye(3), np.ones(3)).same_as(DistanceField.none())


@pytest.mark.parametrize(
    ("points", "numbers", "said"),
    [
        ([[np.nan, 0.0, 0.0]], (0.02, 0.02, 0.05), "finite"),
        ([[0.0, 0.0, 0.0]], (0.0, 0.02, 0.05), "edge 0.0"),
        ([[0.0, 0.0, 0.0]], (0.02, np.inf, 0.05), "radius inf"),
        ([[0.0, 0.0, 0.0]], (0.02, 0.02, -1.0), "thickness -1.0"),
    ],
)
def test_what_gives_no_field_is_refused(points, numbers, said):
    with pytest.raises(PlanningError, match=said):
        DistanceField.of(np.array(points), *numbers)
