"""Scenes of obstacles: what is refused, what is the same, where they are later, and seen from elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.shapes import solid_distances, solid_rows
from geodesic_motion_ros.manifold.ambient_metric import obstacle_clearances
from geodesic_motion_ros.obstacles.obstacles import Obstacles, nearness


def scene(seed: int = 0) -> Obstacles:
    random = np.random.default_rng(seed)
    turns = Rotation.random(2, random_state=seed).as_matrix()
    return Obstacles(
        random.uniform(-0.5, 0.5, (3, 3)),
        random.uniform(0.05, 0.1, 3),
        random.normal(size=(3, 3)),
        solid_rows(random.uniform(-0.5, 0.5, (2, 3)), turns, random.uniform(0.02, 0.2, (2, 3)), np.array([0.0, 0.03])),
        random.normal(size=(2, 3)),
        DistanceField.of(random.uniform(-0.5, 0.5, (20, 3)), 0.02, 0.02, 0.05),
        1.0,
        velocity_errors=random.uniform(0.0, 0.3, 3),
        solid_velocity_errors=random.uniform(0.0, 0.3, 2),
    )


def clearances(obstacles: Obstacles, places: np.ndarray) -> np.ndarray:
    return obstacle_clearances(places[:, None], np.zeros(1), obstacles, np.inf)


PLACES = np.random.default_rng(1).uniform(-0.8, 0.8, (300, 3))


def test_points_of_a_cloud_stand_and_are_as_near_as_they_are_to_their_cubes():
    """No farther than the nearest point, and no nearer by more than 1.7 edges and the radius."""
    points, edge, radius = np.random.default_rng(2).uniform(-0.5, 0.5, (200, 3)), 0.02, 0.004
    cloud = Obstacles.of_cloud(points, voxel=edge, radius=radius)
    assert cloud.objection() == ""
    assert cloud.is_static
    nearest = np.linalg.norm(PLACES[:, None] - points, axis=-1).min(axis=1) - radius
    near = nearest < 0.1
    assert np.any(near)
    found = clearances(cloud, PLACES)
    assert np.all(found[near] <= nearest[near] + 1e-6)
    assert np.all(found[near] >= nearest[near] - 1.75 * edge)
    assert np.all(clearances(Obstacles.of_cloud(np.empty((0, 3))), PLACES) == np.inf)


def test_a_scene_has_nothing_to_object_to():
    assert scene().objection() == ""
    assert Obstacles.none().objection() == ""


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"time": np.nan}, "time of the obstacles [s] is nan"),
        ({"time": np.inf}, "time of the obstacles [s] is inf"),
        ({"time": 1.8e18}, "between -4e+09 and 4e+09"),
        ({"time": "x"}, "time of the obstacles [s] is 'x': a real number is needed"),
        ({"time": None}, "time of the obstacles [s] is None"),
        ({"ages": np.array([0.0, np.nan, 0.0])}, "ages of obstacles must be finite"),
        ({"solid_ages": np.array([0.0, np.inf])}, "ages of obstacles must be finite"),
        ({"centres": np.zeros((2, 3))}, "centres of 3 obstacles have shape (2, 3): expected (3, 3)"),
        ({"velocities": np.zeros((3, 4))}, "velocities of 3 obstacles have shape (3, 4): expected (3, 3)"),
        ({"centres": [[0.0, 0.0, 0.0]] * 3}, "centres of 3 obstacles have list"),
        ({"solid_velocities": np.zeros((3, 3))}, "solid_velocities of 2 obstacles have shape (3, 3)"),
        ({"cloud": None}, "a DistanceField is needed"),
    ],
)
def test_a_time_and_shapes_are_judged_too(change, said):
    objection = replace(scene(), **change).objection()
    assert said in objection


@pytest.mark.parametrize(
    ("name", "index", "value", "said"),
    [
        ("centres", (1, 0), np.nan, "obstacle 1"),
        ("radii", 2, 0.0, "obstacle 2"),
        ("velocities", (0, 1), np.inf, "obstacle 0"),
        ("velocities", (0, 1), 1e160, "at most 1000"),
        ("radii", 0, 1e9, "obstacle 0"),
        ("solids", (1, 2), np.nan, "solid 1"),
        ("solids", (0, 0), -1e9, "at most 1000"),
        ("solids", (0, 3), 0.0, "solid 0"),
        ("solids", (1, 4), -0.1, "not negative"),
        ("solids", (1, 6), -0.01, "not negative"),
        ("solids", (0, 7), 2.0, "rotation"),
        ("solid_velocities", (1, 0), np.nan, "solid 1"),
        ("velocity_errors", 1, -0.1, "not negative"),
        ("solid_velocity_errors", 1, np.inf, "solid 1"),
    ],
)
def test_what_is_no_obstacle_is_named(name, index, value, said):
    obstacles = scene()
    getattr(obstacles, name)[index] = value
    assert said in obstacles.objection()


def test_scenes_are_the_same_where_all_places_are():
    one, other = scene(), scene()
    assert one.same_places(one)
    assert not one.same_places(other)  # a newer cloud, if one that looks alike
    other = replace(other, cloud=one.cloud)
    assert one.same_places(other)
    other.solids[0, 0] += 1e-6
    assert not one.same_places(other)
    assert Obstacles.none().same_places(Obstacles.none())


def test_what_is_published_twice_is_one_obstacle():
    one = scene()
    twice = replace(
        one,
        centres=np.tile(one.centres, (2, 1)), radii=np.tile(one.radii, 2), velocities=np.tile(one.velocities, (2, 1)),
        solids=np.tile(one.solids, (2, 1)), solid_velocities=np.tile(one.solid_velocities, (2, 1)),
        velocity_errors=np.tile(one.velocity_errors, 2), solid_velocity_errors=np.tile(one.solid_velocity_errors, 2),
        ages=np.zeros(6), solid_ages=np.zeros(4),
    )  # fmt: skip
    distinct = twice.distinct()
    assert (len(distinct.radii), len(distinct.solids)) == (3, 2)
    np.testing.assert_array_equal(np.sort(distinct.velocities, axis=0), np.sort(one.velocities, axis=0))
    np.testing.assert_array_equal(np.sort(distinct.solid_velocities, axis=0), np.sort(one.solid_velocities, axis=0))
    np.testing.assert_array_equal(clearances(distinct, PLACES), clearances(one, PLACES))


def test_obstacles_move_on_linearly_and_not_for_ever():
    obstacles = replace(scene(), cloud=DistanceField.none())
    later = obstacles.at(1.2, prediction=0.5)
    np.testing.assert_allclose(later.centres, obstacles.centres + 0.2 * obstacles.velocities)
    np.testing.assert_allclose(later.solids[:, :3], obstacles.solids[:, :3] + 0.2 * obstacles.solid_velocities)
    np.testing.assert_array_equal(later.solids[:, 7:], obstacles.solids[:, 7:])
    np.testing.assert_allclose(later.radii, obstacles.radii + 0.2 * obstacles.velocity_errors)
    np.testing.assert_allclose(later.solids[:, 6], obstacles.solids[:, 6] + 0.2 * obstacles.solid_velocity_errors)
    assert later.time == 1.2
    assert obstacles.at(9.0, 0.5).same_places(obstacles.at(1.5, 0.5))
    swept = obstacles.swept(0.4)
    assert swept.is_static
    passed = [clearances(obstacles.at(1.0 + elapsed, 0.4), PLACES) for elapsed in (0.0, 0.2, 0.4)]
    np.testing.assert_allclose(clearances(swept, PLACES), np.min(passed, axis=0), atol=1e-12)
    standing = Obstacles.of_spheres(obstacles.centres, obstacles.radii)
    assert standing.swept(0.4) is standing


def test_what_covers_a_while_covers_all_places_of_it_and_leaves_what_stands() -> None:
    moving = replace(
        Obstacles.one_of_each(np.array([0.1, 0.2, 0.3]), np.array([0.3, 0.0, -0.4]), 1.0),
        velocity_errors=np.array([0.1]), solid_velocity_errors=np.array([0.2]),
    )  # fmt: skip
    covering = moving.throughout(0.2)
    points = np.random.default_rng(0).uniform(-0.5, 0.8, (200, 3))
    for time in np.linspace(1.0, 1.2, 5):
        there, covered = moving.at(time, 1.0), covering.at(1.0, 1.0)
        spheres = [np.linalg.norm(points - one.centres, axis=1) - one.radii for one in (there, covered)]
        assert np.all(spheres[1] <= spheres[0] + 1e-9)
        solids = [solid_distances(points, one.solids) for one in (there, covered)]
        assert np.all(solids[1] <= solids[0] + 1e-9)
    # Not more than that: it is larger by what it moves in half of the time, and by the error.
    np.testing.assert_allclose(covering.radii, moving.radii + 0.5 * 0.2 * 0.5 + 0.2 * 0.1)
    standing = Obstacles.of_spheres(np.zeros((1, 3)), np.ones(1))
    assert standing.throughout(0.2) is standing


def test_moved_obstacles_are_as_far_from_moved_places():
    rotation, translation = Rotation.random(random_state=2).as_matrix(), np.array([0.1, 0.2, -0.3])
    moved = scene().moved(rotation, translation)
    assert moved.objection() == ""
    np.testing.assert_allclose(
        clearances(moved, PLACES @ rotation.T + translation), clearances(scene(), PLACES), atol=1e-9
    )
    np.testing.assert_allclose(moved.solid_velocities, scene().solid_velocities @ rotation.T)


def test_what_stands_and_what_moves_are_all_there_is():
    obstacles = scene()
    obstacles.velocities[1] = obstacles.solid_velocities[0] = 0.0
    standing, moving = obstacles.static_subset, obstacles.moving_subset
    assert (len(standing.radii), len(moving.radii)) == (1, 2)
    assert (len(standing.solids), len(moving.solids)) == (1, 1)
    assert standing.is_static
    assert moving.cloud.squares.size == 0
    both = np.minimum(clearances(standing, PLACES), clearances(moving, PLACES))
    np.testing.assert_array_equal(both, clearances(obstacles, PLACES))


@pytest.mark.parametrize("seed", range(10))
def test_places_where_what_moves_may_stop_leave_nothing_out_since_it_was_seen(seed):
    random = np.random.default_rng(seed)
    centres, velocities = random.normal(size=(2, 3, 3))
    box = solid_rows(random.normal(size=(1, 3)), np.eye(3)[None], np.full((1, 3), 0.04), np.full(1, 0.01))
    obstacles = Obstacles(
        centres, random.uniform(0.02, 0.06, 3), velocities, box, random.normal(size=(1, 3)), DistanceField.none(), 2.0,
        velocity_errors=random.uniform(0.0, 0.2, 3), solid_velocity_errors=random.uniform(0.0, 0.2, 1),
    ).at(2.2, 1.0)  # fmt: skip
    seen = obstacles.radii - 0.2 * obstacles.velocity_errors
    np.testing.assert_allclose(obstacles.ages, 0.2)
    places = obstacles.stopping_places(0.4, 6)
    assert places.is_static
    for time in np.linspace(-0.2, 0.4, 101):
        out = random.normal(size=(50, 3, 3))
        out *= (seen + (0.2 + time) * obstacles.velocity_errors)[:, None] / np.linalg.norm(out, axis=2, keepdims=True)
        on = obstacles.centres + time * velocities + out
        gaps = np.linalg.norm(on.reshape(-1, 1, 3) - places.centres, axis=2) - places.radii
        assert np.max(np.min(gaps, axis=1)) < 1e-9
        middle = obstacles.solids[0, :3] + time * obstacles.solid_velocities[0]
        inside = middle + random.uniform(-0.04, 0.04, (50, 3))
        assert np.max(solid_distances(inside, places.solids)) < 1e-9
    # No more than needed: a place is enlarged by less than half of what is between two of them.
    apart = np.linalg.norm(velocities, axis=1) * 0.6 / 5
    grown = np.linspace(0.0, 0.6, 6)[:, None] * obstacles.velocity_errors
    assert np.all(places.radii.reshape(6, 3) <= seen + grown + 0.5 * apart + 1e-12)
    assert obstacles.static_subset.stopping_places(0.4, 6).centres.size == 0


def test_where_an_obstacle_may_stop_does_not_depend_on_when_others_were_seen() -> None:
    """A sphere just detected, beside one of a slow camera that is far away."""
    near = replace(
        Obstacles.of_spheres(np.zeros((1, 3)), np.array([0.05]), np.array([[0.3, 0.0, 0.0]]), time=0.0),
        ages=np.array([0.005]), velocity_errors=np.array([0.3]),
    )  # fmt: skip
    both = replace(
        Obstacles.of_spheres(
            [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]], [0.05, 0.05], [[0.3, 0.0, 0.0], [0.1, 0.0, 0.0]],
            0.0,
        ),
        ages=np.array([0.005, 0.8]), velocity_errors=np.array([0.3, 0.0]),
    )  # fmt: skip
    alone, beside = near.stopping_places(0.3, 12), both.stopping_places(0.3, 12)
    np.testing.assert_allclose(beside.radii[::2], alone.radii)
    np.testing.assert_allclose(beside.centres[::2], alone.centres)
    assert alone.radii[-1] < 0.05 + 0.31 * 0.3 + 0.01


@pytest.mark.parametrize(
    ("clearance", "said"),
    [(0.012, "comes within 0.012 m of an obstacle"), (-0.054, "goes 0.054 m into an obstacle")],
)
def test_nearness_is_a_distance_or_a_depth_never_negative(clearance, said):
    assert nearness(clearance) == said
