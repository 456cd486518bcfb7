"""What the hand holds: search and certificate count it, from the tick on in which it is taken, and not after."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.skill.skill import Skill

TICK, PATIENCE = 0.02, 0.2
SKILLS = ("panda_pouring", "panda_reach_to_grasp")
#: A bottle of 3 cm x 20 cm, across the hand and away from where that grasps it.
RADIUS, HEIGHT = 0.03, 0.2
BOTTLE = HeldObject("bottle", "cylinder", (RADIUS, HEIGHT), (0.05, 0.0, 0.02), (0.5**0.5, 0.0, 0.5**0.5, 0.0))
#: Of the sphere in its path [m].
SPHERE = 0.03


@pytest.fixture(scope="module", params=SKILLS)
def shared(request: pytest.FixtureRequest) -> ReactivePlanner:
    return ReactivePlanner(Skill.load(request.param), PlannerSettings(patience=PATIENCE), scene=DeclaredScene.empty())


@pytest.fixture
def planner(shared: ReactivePlanner) -> ReactivePlanner:
    """One that stands at its skill's start, with empty hands, no obstacles and no goal."""
    shared.clear_goal()
    shared.take_obstacles(Obstacles.none())
    assert shared.hold(()).ok
    shared.stand_at(nominal(shared)[0], 0.0)
    return shared


def nominal(planner: ReactivePlanner) -> np.ndarray:
    """Configurations (n, 7) a tick apart of the motion from the skill's start to its goal."""
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    reference = planner.plan(start[:3], start[3:], goal[:3], goal[3:]).reference
    assert reference is not None
    return reference.samples(np.arange(0.0, reference.duration, TICK))[0]


def ask(planner: ReactivePlanner) -> None:
    goal = planner.skill.goal_pose
    assert planner.set_goal(goal[:3], goal[3:]).ok


class Played:
    """Ticks a planner from 0 s on, and where the arm was."""

    def __init__(self, planner: ReactivePlanner) -> None:
        self.planner, self.now = planner, 0.0
        self.postures: list[np.ndarray] = []

    def run(self, seconds: float) -> list[Plan]:
        plans = []
        for _ in range(round(seconds / TICK)):
            plans.append(self.planner.tick(self.now))
            self.now += TICK
            commanded = self.planner.commanded_state(self.now)
            assert commanded is not None
            self.postures.append(commanded[0])
        return plans

    def run_to_rest(self) -> list[Plan]:
        """Until the arm stands, though the planner has had its patience; for 15 s at most."""
        plans, end, moved = [], self.now + 15.0, self.now
        while self.now < min(end, moved + PATIENCE + 1.0):
            plans += self.run(0.1)
            moved = self.now if np.ptp(self.postures[-5:], axis=0).any() else moved
        return plans

    @property
    def at_goal(self) -> bool:
        goal = self.planner.skill.goal_pose[:3]
        return float(np.linalg.norm(self.planner.robot.forward(self.postures[-1])[0] - goal)) < 1e-3


def bottle_distances(planner: ReactivePlanner, postures: Sequence[np.ndarray], centre: np.ndarray) -> np.ndarray:
    """Exact signed distances (n,) [m] of the bottle, a cylinder, from the sphere about a centre (3,)."""
    distances = []
    for posture in postures:
        position, quaternion = planner.robot.forward(posture)
        in_tool = to_rotation(quaternion).inv().apply(centre - position)
        x, y, z = to_rotation(np.array(BOTTLE.quaternion)).inv().apply(in_tool - np.array(BOTTLE.position))
        beside, beyond = np.hypot(x, y) - RADIUS, abs(z) - 0.5 * HEIGHT
        outside = np.hypot(max(beside, 0.0), max(beyond, 0.0))
        distances.append(outside + min(max(beside, beyond), 0.0) - SPHERE)
    return np.array(distances)


def arm_clearance(planner: ReactivePlanner, postures: Sequence[np.ndarray], obstacles: Obstacles) -> float:
    """Of the arm alone [m]."""
    arm = CollisionModel.named(planner.skill.robot)
    return min(obstacle_clearance(arm, planner.robot, posture, obstacles)[0] for posture in postures)


def beside_the_bottle(planner: ReactivePlanner, share: float = 0.5) -> Obstacles:
    """A sphere that the bottle meets at a share of the motion, and the arm does not."""
    postures = nominal(planner)
    position, quaternion = planner.robot.forward(postures[int(share * len(postures))])
    far_end = np.array(BOTTLE.position) + np.array([0.5 * HEIGHT, 0.0, 0.0])
    return Obstacles.of_spheres(position + to_rotation(quaternion).apply(far_end)[None], np.array([SPHERE]))


def test_a_certified_path_keeps_the_held_bottle_clear_where_the_arm_alone_would_not_care(planner) -> None:
    obstacles = beside_the_bottle(planner)
    centre = obstacles.centres[0]
    planner.take_obstacles(obstacles)
    ask(planner)
    control = Played(planner)
    control.run(len(nominal(planner)) * TICK + 1.0)
    assert control.at_goal
    assert np.min(bottle_distances(planner, control.postures, centre)) < -0.01
    assert arm_clearance(planner, control.postures, obstacles) > 0.0

    assert planner.hold([BOTTLE]).ok
    assert planner.held == (BOTTLE,)
    planner.stand_at(control.postures[0], 0.0)
    played = Played(planner)
    plans = played.run_to_rest()
    assert played.at_goal
    assert plans[-1].verdict.ok
    assert np.min(bottle_distances(planner, played.postures, centre)) > 0.0
    assert arm_clearance(planner, played.postures, obstacles) > 0.0


@pytest.mark.parametrize("attached_after", [0.05, 0.2, 0.35])
def test_what_is_attached_in_motion_is_not_run_into_anything(planner, attached_after: float) -> None:
    obstacles = beside_the_bottle(planner, 0.6)
    planner.take_obstacles(obstacles)
    ask(planner)
    played = Played(planner)
    played.run(attached_after * len(nominal(planner)) * TICK)
    before = len(played.postures)
    moved = np.ptp(played.postures, axis=0).max()
    assert moved > 1e-3
    assert planner.hold([BOTTLE]).ok
    played.run_to_rest()
    assert np.min(bottle_distances(planner, played.postures[before - 1 :], obstacles.centres[0])) > 0.0
    assert arm_clearance(planner, played.postures, obstacles) > 0.0
    # Neither the position nor the velocity jumps where it is taken.
    steps = np.diff(played.postures, axis=0)
    assert np.max(np.abs(np.diff(steps, axis=0))) < 5e-3


def test_a_path_that_the_held_object_does_not_touch_is_kept(planner) -> None:
    ask(planner)
    played = Played(planner)
    played.run(0.3)
    assert planner.hold([BOTTLE]).ok
    plans = played.run(len(nominal(planner)) * TICK + 0.5)
    assert all(plan.verdict.ok for plan in plans)
    assert all(plan.trajectory is None for plan in plans[:3])
    assert played.at_goal


def test_after_it_is_detached_the_first_path_is_planned_again_byte_for_byte(planner) -> None:
    obstacles = beside_the_bottle(planner)
    planner.take_obstacles(obstacles)
    start = nominal(planner)[0]

    def bytes_of() -> list[bytes]:
        planner.stand_at(start, 0.0)
        ask(planner)
        plans = Played(planner).run(1.0)
        return [plan.reference.positions.tobytes() for plan in plans if plan.reference is not None]

    first = bytes_of()
    assert planner.hold([BOTTLE]).ok
    assert bytes_of() != first
    assert planner.hold(()).ok
    assert planner.held == ()
    assert bytes_of() == first


def test_a_goal_prepared_before_an_object_was_taken_is_reached_with_it(planner) -> None:
    obstacles = beside_the_bottle(planner)
    planner.take_obstacles(obstacles)
    goal = planner.skill.goal_pose
    prepared = planner.prepare_goal(goal[:3], goal[3:])
    assert planner.hold([BOTTLE]).ok
    assert planner.take_goal(prepared).ok
    played = Played(planner)
    played.run_to_rest()
    assert played.at_goal
    assert np.min(bottle_distances(planner, played.postures, obstacles.centres[0])) > 0.0


def test_objects_are_prepared_in_another_thread_while_ticks_go_on(planner) -> None:
    obstacles = beside_the_bottle(planner, 0.6)
    planner.take_obstacles(obstacles)
    ask(planner)
    played = Played(planner)
    played.run(0.1)
    with ThreadPoolExecutor(1) as background:
        preparing = background.submit(planner.prepare_arm, [BOTTLE])
        played.run(0.1)
        prepared = preparing.result()
    # Meanwhile another goal was taken: what was carried to the one before is of no use.
    goal = planner.skill.goal_pose
    assert planner.set_goal(goal[:3] + np.array([0.0, 0.0, 0.01]), goal[3:]).ok
    played.run(0.05)
    before = len(played.postures)
    assert planner.take_arm(prepared).ok
    played.run_to_rest()
    assert np.min(bottle_distances(planner, played.postures[before - 1 :], obstacles.centres[0])) > 0.0


@pytest.mark.parametrize(
    ("objects", "reason"),
    [
        ([BOTTLE, HeldObject("bottle", "sphere", (0.02,))], "two held objects are called 'bottle'"),
        ([HeldObject("wall", "box", (4.0, 3.0, 0.1))], "'wall' reaches 2.50 m"),
    ],
)
def test_what_cannot_be_held_is_refused_and_nothing_changes(planner, objects, reason: str) -> None:
    assert planner.hold([BOTTLE]).ok
    collision = planner.collision
    ask(planner)
    played = Played(planner)
    played.run(0.2)
    verdict = planner.hold(objects)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert reason in verdict.reason
    assert planner.held == (BOTTLE,)
    assert planner.collision is collision
    played.run_to_rest()
    assert played.at_goal


def test_an_object_that_touches_the_arm_stops_it_by_name(planner) -> None:
    ask(planner)
    played = Played(planner)
    played.run(0.2)
    # As long as the forearm, beside it.
    rods = [
        HeldObject(f"rod{i}", "box", (0.02, 0.02, 0.7), (x, y, -0.2))
        for i, (x, y) in enumerate([(-0.1, 0.0), (0.1, 0.0), (0.0, 0.1), (0.0, -0.1)])
    ]
    assert planner.hold(rods).ok
    plans = played.run(1.0)
    assert not plans[-1].verdict.ok
    assert "'rod" in plans[-1].verdict.reason
    np.testing.assert_allclose(played.postures[-1], played.postures[-2])
