"""The stream, replanned every tick, keeps the arm's accelerations whatever happens to goal and obstacles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from geodesic_motion_ros.planner import Plan, PlannerSettings, ReactivePlanner
from geodesic_motion_ros.quaternions import rotation_vector_between
from geodesic_motion_ros.reference import ReferenceFollower
from geodesic_motion_ros.verdict import VerdictCode

PERIOD = 0.01
#: A way that is entered in motion may need a tenth more (`_STRAIN`), and segments are checked at three points each.
ALLOWED = 1.4
Event = Callable[[int, ReactivePlanner, ReferenceFollower, Plan | None], None]


@pytest.fixture(scope="module")
def shared(fan_skill) -> ReactivePlanner:
    return ReactivePlanner(fan_skill)


@pytest.fixture
def planner(shared) -> ReactivePlanner:
    shared.set_obstacles(np.empty((0, 3)), np.empty(0))
    shared.clear_goal()
    return shared


def follow(planner: ReactivePlanner, ticks: int, event: Event) -> tuple[np.ndarray, np.ndarray, list[Plan]]:
    """Velocities (ticks, 6), positions (ticks + 1, 3) and plans of a stream from start to goal, as a cycle runs it."""
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    follower = ReferenceFollower(planner.settings.speed)
    follower.reset(start[:3], start[3:])
    assert planner.set_goal(goal[:3], goal[3:]).ok
    positions, quaternions, plans = [follower.position], [follower.quaternion], []
    plan = None
    for tick in range(ticks):
        event(tick, planner, follower, plan)
        plan = planner.tick(follower.position, follower.quaternion, follower.speed)
        if plan.reference is None:
            follower.hold()
        else:
            follower.accept(plan.reference)
        follower.advance(PERIOD)
        positions.append(follower.position)
        quaternions.append(follower.quaternion)
        plans.append(plan)
    turns = rotation_vector_between(np.array(quaternions[:-1]), np.array(quaternions[1:]))
    return np.concatenate([np.diff(positions, axis=0), turns], axis=1) / PERIOD, np.array(positions), plans


def nothing(tick: int, planner: ReactivePlanner, follower: ReferenceFollower, plan: Plan | None) -> None:
    """No event."""


def largest(velocities: np.ndarray) -> tuple[float, float]:
    """Largest acceleration [m/s^2] and angular acceleration [rad/s^2]."""
    changes = np.diff(np.concatenate([np.zeros((1, 6)), velocities]), axis=0) / PERIOD
    return np.linalg.norm(changes[:, :3], axis=1).max(), np.linalg.norm(changes[:, 3:], axis=1).max()


def assert_smooth(planner: ReactivePlanner, velocities: np.ndarray) -> None:
    acceleration, angular = largest(velocities)
    limits = planner.settings.limits
    assert acceleration <= ALLOWED * limits.acceleration
    assert angular <= ALLOWED * limits.angular_acceleration


def test_an_undisturbed_stream_is_the_single_plan(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    single = planner.plan(start[:3], start[3:], goal[:3], goal[3:]).reference
    velocities, positions, plans = follow(planner, int(single.duration / PERIOD) + 10, nothing)
    assert_smooth(planner, velocities)
    assert {plan.verdict.code for plan in plans} == {VerdictCode.OK}
    expected = np.array([single.sample(PERIOD * tick)[0] for tick in range(len(positions))])
    np.testing.assert_allclose(positions, expected, atol=1e-4)


@pytest.mark.parametrize("tick", [15, 60, 150])
def test_a_goal_behind_the_arm_is_reached_after_a_stop(planner, tick):
    start = planner.skill.start_pose

    def turn_back(now: int, planner: ReactivePlanner, follower: ReferenceFollower, plan: Plan | None) -> None:
        if now == tick:
            assert planner.set_goal(start[:3], start[3:]).ok

    velocities, positions, plans = follow(planner, 2 * tick + 150, turn_back)
    assert_smooth(planner, velocities)
    stopping = [plan for plan in plans if plan.turning]
    assert stopping
    assert all("stopping first" in plan.verdict.reason and not plan.verdict.ok for plan in stopping)
    assert all(plan.reference is not None for plan in stopping)
    assert plans[-1].verdict.ok
    np.testing.assert_allclose(positions[-1], start[:3], atol=1e-4)
    # It did stop: as control, the speed before the turn was well above what one tick can take away.
    speeds = np.linalg.norm(velocities[:, :3], axis=1)
    assert speeds[tick - 1] > 5.0 * ALLOWED * planner.settings.acceleration * PERIOD
    assert speeds[tick:-50].min() < planner.settings.acceleration * PERIOD


def test_a_goal_a_little_aside_is_gone_to_without_a_stop(planner):
    goal = planner.skill.goal_pose

    def shift(now: int, planner: ReactivePlanner, follower: ReferenceFollower, plan: Plan | None) -> None:
        if now in (60, 120):
            assert planner.set_goal(goal[:3] + [0.02 * (now == 60), 0.0, 0.02], goal[3:]).ok

    velocities, positions, plans = follow(planner, 500, shift)
    assert_smooth(planner, velocities)
    assert not any(plan.turning for plan in plans)
    speeds = np.linalg.norm(velocities[50:200, :3], axis=1)
    assert speeds.min() > 0.5 * planner.settings.speed
    np.testing.assert_allclose(positions[-1], goal[:3] + [0.0, 0.0, 0.02], atol=1e-4)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_obstacle_that_appears_is_passed_smoothly_and_would_have_been_hit(fan_skill, planner, side):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    direct = planner.plan(start[:3], start[3:], goal[:3], goal[3:]).reference.positions
    centre = direct[int(0.7 * len(direct))] + side * 0.01 * np.array([0.8, 0.0, 0.6])

    def appear(now: int, planner: ReactivePlanner, follower: ReferenceFollower, plan: Plan | None) -> None:
        if now == 70:
            planner.set_obstacles([centre], [0.02])

    velocities, positions, _ = follow(planner, 600, appear)
    assert_smooth(planner, velocities)
    assert np.linalg.norm(positions - centre, axis=1).min() > 0.06
    np.testing.assert_allclose(positions[-1], goal[:3], atol=1e-4)
    assert np.linalg.norm(direct - centre, axis=1).min() < 0.06


def test_an_obstacle_that_keeps_moving_does_not_shake_the_arm(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    direct = planner.plan(start[:3], start[3:], goal[:3], goal[3:]).reference.positions

    def approach(now: int, planner: ReactivePlanner, follower: ReferenceFollower, plan: Plan | None) -> None:
        away = 0.03 + max(0.0, 0.12 - 0.0005 * now)
        planner.set_obstacles([direct[int(0.7 * len(direct))] + away * np.array([0.8, 0.0, 0.6])], [0.02])

    velocities, positions, _ = follow(planner, 600, approach)
    assert_smooth(planner, velocities)
    np.testing.assert_allclose(positions[-1], goal[:3], atol=1e-4)


def test_the_plan_is_kept_while_nothing_changes_and_dropped_when_a_better_one_appears(planner):
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    direct = planner.plan(start[:3], start[3:], goal[:3], goal[3:]).reference.positions
    obstacle = [direct[int(0.5 * len(direct))]], [0.06]
    lasting = []

    def come_and_go(now: int, planner: ReactivePlanner, follower: ReferenceFollower, plan: Plan | None) -> None:
        if now == 0:
            planner.set_obstacles(*obstacle)
        if now == 10:
            # Told again, and another one far away: no reason for another way.
            planner.set_obstacles(*obstacle)
        if now == 20:
            planner.set_obstacles([obstacle[0][0], [0.5, 0.0, 2.0]], [0.06, 0.1])
        if now == 30:
            planner.set_obstacles(np.empty((0, 3)), np.empty(0))
        if plan is not None:
            lasting.append(PERIOD * now + plan.reference.duration - PERIOD)

    follow(planner, 120, come_and_go)
    ends = np.array(lasting)
    np.testing.assert_allclose(ends[:29], ends[0], atol=1e-4)
    assert ends[35] < ends[0] - 0.05


def test_a_stream_that_was_stopped_by_hand_starts_from_rest(planner):
    def halt(now: int, planner: ReactivePlanner, follower: ReferenceFollower, plan: Plan | None) -> None:
        if now == 80:
            follower.hold()

    velocities, positions, plans = follow(planner, 500, halt)
    assert plans[80].reference.rate(0.0) == 0.0
    # The hold itself is a jump; after it the motion is smooth again.
    assert_smooth(planner, velocities[80:])
    np.testing.assert_allclose(positions[-1], planner.skill.goal_pose[:3], atol=1e-4)


@pytest.mark.parametrize("acceleration", [0.1, 2.0])
def test_the_setting_is_what_bounds_the_stream(fan_skill, acceleration):
    planner = ReactivePlanner(fan_skill, PlannerSettings(acceleration=acceleration))
    velocities, positions, _ = follow(planner, 800, nothing)
    assert_smooth(planner, velocities)
    assert largest(velocities)[0] > 0.9 * acceleration
    np.testing.assert_allclose(positions[-1], planner.skill.goal_pose[:3], atol=1e-4)
