"""The arm is taken out of clouds, all of it and no more than the padding; what touches it stays for a moment."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import FilteredCloud, Remembered, SelfFilter
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

PADDING, EDGE, PERIOD = 0.02, 0.02, 1.0 / 30.0
BOTTLE = HeldObject("bottle", "cylinder", (0.04, 0.25), (0.0, 0.0, 0.05))


@pytest.fixture(scope="module", params=["panda", "ur5"])
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def robot(name: str) -> Robot:
    return Robot.named(name)


@pytest.fixture(scope="module")
def arm(name: str, robot: Robot) -> SelfFilter:
    return SelfFilter(robot, CollisionModel.named(name))


@pytest.fixture(scope="module")
def geometry(name: str) -> Iterator[CollisionGeometry]:
    with CollisionGeometry(name) as geometry:
        yield geometry


def filtered(
    arm: SelfFilter,
    points: np.ndarray,
    joints: np.ndarray,
    held: tuple[HeldObject, ...] = (),
    time: float = 0.0,
    before: Remembered | None = None,
    padding: float = PADDING,
) -> FilteredCloud:
    return arm.remove(points, joints, held, padding, EDGE, time, before or Remembered.nothing())


def gaps(arm: SelfFilter, points: np.ndarray, joints: np.ndarray, held: tuple[HeldObject, ...] = ()) -> np.ndarray:
    """Signed distances (n,) [m] of points from the nearest sphere, without a cube."""
    centres, radii = arm.spheres(joints, held)
    return np.min(cdist(points, centres) - radii, axis=1)


def around(arm: SelfFilter, joints: np.ndarray, random: np.random.Generator, count: int = 20000) -> np.ndarray:
    """Points (count, 3) [m] on the arm, near it and far from it."""
    centres, radii = arm.spheres(joints, ())
    chosen = random.integers(len(radii), size=count)
    directions = random.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distances = radii[chosen] + random.choice([-0.02, 0.0, PADDING, 0.1, 0.5], count) + random.normal(0.0, 0.01, count)
    return centres[chosen] + distances[:, None] * directions


def test_the_points_of_its_meshes_are_all_dropped(robot, arm, geometry):
    random = np.random.default_rng(0)
    for joints in robot.sample(10, random):
        rotations, origins = robot.link_frames(joints)
        points = []
        for part in geometry.parts:
            link = robot.link_names.index(part.link)
            points.append(part.vertices @ rotations[link].T + origins[link])
        result = filtered(arm, np.concatenate(points), joints, padding=0.0)
        assert len(result.points) == 0
        assert result.of_arm == sum(map(len, points))


@pytest.mark.parametrize("padding", [0.0, 0.02, 0.07])
@pytest.mark.parametrize("held", [(), (BOTTLE,)], ids=["empty hand", "bottle"])
def test_what_is_within_the_padding_is_dropped_and_all_else_is_kept(robot, arm, padding, held):
    random = np.random.default_rng(1)
    for joints in robot.sample(20, random):
        points = around(arm, joints, random)
        outside = gaps(arm, points, joints, held) > padding
        result = filtered(arm, points, joints, held, padding=padding)
        np.testing.assert_array_equal(result.points, points[outside])
        assert result.of_arm == np.count_nonzero(~outside)
        assert 0 < result.of_arm < len(points)


def test_a_held_object_is_dropped_as_long_as_it_is_held(robot, arm):
    position, _ = robot.forward(robot.ready)
    centre = position + 0.15 * (robot.link_frames(robot.ready)[0][-1] @ np.array([0.0, 0.0, 1.0]))
    points = centre + np.random.default_rng(2).uniform(-0.01, 0.01, (500, 3))
    assert filtered(arm, points, robot.ready).of_arm == 0
    assert filtered(arm, points, robot.ready, (BOTTLE,)).of_arm == len(points)


def test_clouds_without_points_and_of_large_cubes(robot, arm):
    nothing = filtered(arm, np.zeros((0, 3)), robot.ready)
    assert (len(nothing.points), nothing.of_arm, nothing.remembered) == (0, 0, 0)
    points = around(arm, robot.ready, np.random.default_rng(3))
    fine = arm.remove(points, robot.ready, (), PADDING, 1e-4, 0.0, Remembered.nothing())
    coarse = arm.remove(points, robot.ready, (), PADDING, 0.1, 0.0, Remembered.nothing())
    np.testing.assert_array_equal(fine.points, coarse.points)


class TestMemory:
    """A pebble beside the forearm, or what else the arm has of that kind."""

    @pytest.fixture
    def side(self, robot, arm) -> tuple[np.ndarray, np.ndarray]:
        """A place on a sphere in the middle of the arm that no other sphere covers, and the direction out."""
        centres, radii = arm.spheres(robot.ready, ())
        random = np.random.default_rng(4)
        while True:
            sphere, direction = random.integers(len(radii) // 3, len(radii)), random.normal(size=3)
            direction /= np.linalg.norm(direction)
            place = centres[sphere] + radii[sphere] * direction
            steps = place + np.outer([0.01, 0.03, 0.06, 0.12], direction)
            if np.allclose(gaps(arm, steps, robot.ready), [0.01, 0.03, 0.06, 0.12], atol=1e-6):
                return place, direction

    @pytest.fixture
    def pebble(self, side):
        """Points of a pebble (40, 3) [m], its middle so far from the arm [m]."""
        cluster = np.random.default_rng(5).uniform(-0.005, 0.005, (40, 3))

        def at(distance: float) -> np.ndarray:
            return side[0] + distance * side[1] + cluster

        return at

    def test_what_comes_within_the_padding_stays_for_a_moment_where_it_was_seen(self, robot, arm, pebble):
        """At half a metre a second, until it is on the arm: no farther than it moves in a period."""
        memory, time, distance, last_seen = Remembered.nothing(), 0.0, 0.1, 0.0
        while distance > 0.0:
            result = filtered(arm, pebble(distance), robot.ready, time=time, before=memory)
            assert len(result.points)
            assert np.min(gaps(arm, result.points, robot.ready)) > PADDING
            memory, last_seen = result.memory, time if result.of_arm < 40 else last_seen
            time, distance = time + PERIOD, distance - 0.5 * PERIOD
        while time < last_seen + MOMENT:
            result = filtered(arm, pebble(0.0), robot.ready, time=time, before=memory)
            assert result.remembered == len(result.points) > 0
            assert np.min(gaps(arm, result.points, robot.ready)) < PADDING + 0.5 * PERIOD + 0.01
            memory, time = result.memory, time + PERIOD
        # An obstacle that stays within the padding for longer is lost: the page says so.
        result = filtered(arm, pebble(0.0), robot.ready, time=last_seen + MOMENT + 1e-3, before=memory)
        assert len(result.points) == 0

    def test_what_the_arm_comes_to_stays_too(self, robot, arm, pebble):
        """The pebble stands, and the arm's padding grows over it, as the tracking error does."""
        before = filtered(arm, pebble(0.06), robot.ready)
        after = filtered(arm, pebble(0.06), robot.ready, time=PERIOD, before=before.memory, padding=0.08)
        assert after.of_arm == 40
        assert after.remembered == len(after.points) > 0

    @pytest.mark.parametrize("distance", [0.06, 0.12])
    def test_what_leaves_and_does_not_touch_the_arm_is_forgotten_at_once(self, robot, arm, pebble, distance):
        before = filtered(arm, pebble(distance), robot.ready)
        assert len(before.points) == 40
        assert filtered(arm, pebble(1.0), robot.ready, time=PERIOD, before=before.memory).remembered == 0

    def test_what_is_seen_again_is_not_remembered_beside_itself(self, robot, arm, pebble):
        before = filtered(arm, pebble(0.03), robot.ready)
        again = filtered(arm, pebble(0.03), robot.ready, time=PERIOD, before=before.memory)
        assert (len(again.points), again.remembered) == (40, 0)
        assert np.all(again.memory.seen == PERIOD)

    def test_what_was_grasped_is_not_remembered_as_an_obstacle(self, robot, arm, pebble):
        before = filtered(arm, pebble(0.03), robot.ready)
        assert filtered(arm, pebble(1.0), robot.ready, time=PERIOD, before=before.memory).remembered > 0
        grasped = filtered(arm, pebble(1.0), robot.ready, (BOTTLE,), time=PERIOD, before=before.memory)
        assert grasped.remembered == 0

    def test_a_cloud_of_before_remembers_nothing_of_later(self, robot, arm, pebble):
        before = filtered(arm, pebble(0.03), robot.ready, time=1.0)
        assert filtered(arm, pebble(1.0), robot.ready, time=0.9, before=before.memory).remembered == 0
