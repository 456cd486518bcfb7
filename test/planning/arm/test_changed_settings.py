"""Settings that change while the arm moves: the motion goes on without a jump, and soon keeps the new ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import CHANGEABLE, PlannerSettings
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.timing import tool_limit_ratio
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import RobotError
from test.planning.arm.conftest import Stream

#: Of positions [rad], velocities and accelerations where one trajectory takes over from another.
ROUNDING = 1e-6


@pytest.fixture
def stream(reach_skill: Skill, planner: ReactivePlanner, start: np.ndarray, goal: np.ndarray) -> Stream:
    """With settings that are its own: they change."""
    planner.take_obstacles(Obstacles.none())
    assert planner.change_settings(**{name: getattr(PlannerSettings(), name) for name in CHANGEABLE}).ok
    result = Stream(planner)
    result.stand_at(start)
    assert planner.set_goal_configuration(goal).ok
    return result


def in_fast_motion(stream: Stream, nominal: JointReference) -> None:
    """Tick until the arm is halfway."""
    stream.run(0.5 * nominal.duration)
    assert stream.planner.commanded_state(stream.now)[1].any()


def until_rest(stream: Stream, goal: np.ndarray, longest: float) -> float:
    """Tick until the arm rests at the goal; after how long [s]."""
    begin = stream.now
    while stream.off(goal) > 1e-6:
        assert stream.now - begin < longest, f"{stream.off(goal)} from the goal"
        stream.run(0.1)
    return stream.now - begin


def speeds(stream: Stream, seconds: float) -> list[float]:
    """The largest share of the joints' own velocity limits that is commanded in each tick."""
    shares, own = [], stream.planner.robot.velocity_limits
    for _ in range(round(seconds / stream.period)):
        stream.run(stream.period)
        shares.append(float(np.max(np.abs(stream.state()[1]) / own)))
    return shares


def limits(planner: ReactivePlanner, **changes: float) -> JointLimits:
    settings = replace(planner.settings, **changes)
    return JointLimits.of(planner.robot, settings.joint_speed_scale, settings.acceleration_scale)


@pytest.mark.parametrize(
    "changes",
    [
        {"speed_scale": 0.05},
        {"acceleration_scale": 0.05},
        {"speed_scale": 0.03, "acceleration_scale": 0.02},
        {"speed_override": 0.05 / 0.3},
    ],
    ids=["velocity", "acceleration", "both", "override"],
)
def test_slower_in_fast_motion_it_slows_down_on_its_path_and_keeps_the_lower_limits_from_then_on(
    stream, nominal, goal, changes
):
    in_fast_motion(stream, nominal)
    planner, before = stream.planner, stream.planner.limits
    path = nominal.positions
    assert planner.change_settings(**changes).ok
    lower = planner.limits
    handed = len(stream.handed)
    plans = stream.run(0.1)
    # In the next tick.
    assert plans[0].reference is not None
    assert plans[0].verdict.ok
    first = plans[0].reference
    # The old, faster motion goes on until the new one takes over, and that slows down within the old limits.
    assert first.keeps(before)
    assert not first.keeps(lower)
    assert first.rest(1.5).keeps(lower)
    # It is the same path.
    away = [np.min(np.linalg.norm(path - q, axis=1)) for q in first.positions]
    assert max(away) < np.max(np.linalg.norm(np.diff(path, axis=0), axis=1))
    assert until_rest(stream, goal, 120.0) > 0.5 * nominal.duration + 0.3
    assert max(stream.jumps) < ROUNDING
    assert all(reference.keeps(before) for reference in stream.handed[handed:])
    assert stream.handed[-1].keeps(lower)
    assert planner.played_limits is lower


def test_control_unchanged_it_is_as_fast_as_before_and_another_instance_of_the_same_settings_changes_nothing(
    stream, nominal, goal
):
    in_fast_motion(stream, nominal)
    assert stream.planner.change_settings(speed_scale=stream.planner.settings.speed_scale).ok
    assert until_rest(stream, goal, 20.0) == pytest.approx(0.5 * nominal.duration, abs=0.2)
    assert max(stream.jumps) < ROUNDING


def test_slower_before_it_sets_out_it_never_exceeds_the_lower_limits(stream, nominal, goal):
    assert stream.planner.change_settings(speed_scale=0.05).ok
    shares = speeds(stream, 2.0 * nominal.duration)
    assert 0.04 < max(shares) <= 0.05 + ROUNDING
    until_rest(stream, goal, 60.0)


def test_faster_in_motion_it_is_timed_anew_and_arrives_sooner(stream, nominal, goal):
    assert stream.planner.change_settings(speed_scale=0.05).ok
    slow = stream.run(1.0)[0].reference
    assert stream.planner.change_settings(speed_scale=0.3).ok
    until_rest(stream, goal, 0.5 * slow.duration)
    assert max(stream.jumps) < ROUNDING
    assert all(reference.keeps(stream.planner.limits) for reference in stream.handed)


@pytest.mark.parametrize(("before", "after"), [("fastest", "demonstrated"), ("demonstrated", "fastest")])
def test_another_timing_in_motion_is_another_duration_of_the_rest(reach_skill, nominal, start, goal, before, after):
    """The demonstrations took three times as long as the limits would. The control: the timing from before."""
    count, samples = reach_skill.codes.shape[:2]
    times = np.tile(np.linspace(0.0, 3.0 * nominal.duration, samples), (count, 1))
    skill = replace(reach_skill, canonical=replace(reach_skill.canonical, times=times))
    took = {}
    for timing in (before, after):
        planner = ReactivePlanner(skill, PlannerSettings(grid_shape=(30, 30, 30), timing=before))
        stream = Stream(planner)
        stream.stand_at(start)
        assert planner.set_goal_configuration(goal).ok
        stream.run(0.4 * nominal.duration)
        assert planner.change_settings(timing=timing).ok
        took[timing] = until_rest(stream, goal, 4.0 * nominal.duration)
        assert max(stream.jumps) < ROUNDING
        assert all(reference.keeps(planner.limits) for reference in stream.handed)
    assert took["demonstrated"] > 1.6 * took["fastest"]


def test_changed_again_and_again_in_motion_it_arrives_without_a_jump(stream, goal):
    random = np.random.default_rng(5)
    widest = limits(stream.planner, speed_scale=1.0, acceleration_scale=1.0)
    scales = {"speed_scale": 0.3, "acceleration_scale": 0.2}
    for _ in range(40):
        name = random.choice(list(scales))
        scales[name] = float(random.uniform(0.03, 0.9))
        assert stream.planner.change_settings(**{str(name): scales[name]}).ok
        stream.run(0.05)
    assert stream.planner.change_settings(speed_scale=0.3, acceleration_scale=0.2).ok
    until_rest(stream, goal, 30.0)
    assert max(stream.jumps) < ROUNDING
    assert all(reference.keeps(widest) for reference in stream.handed)
    assert stream.handed[-1].rest(1.5).keeps(stream.planner.limits)


def test_a_slower_tool_is_one_too(stream, nominal, goal):
    in_fast_motion(stream, nominal)
    planner = stream.planner
    assert planner.change_settings(speed=0.03, angular_speed=0.2, acceleration=0.3).ok
    stream.run(0.1)
    until_rest(stream, goal, 120.0)
    assert max(stream.jumps) < ROUNDING
    last = stream.handed[-1]
    ratio = tool_limit_ratio(planner.arm.solver.tool, last.rest(0.5 * last.duration), 0.0)
    assert np.max(ratio) < 1.02


def test_a_stop_while_it_slows_down_is_one_within_the_limits_from_before(stream, nominal, goal):
    in_fast_motion(stream, nominal)
    planner, before = stream.planner, stream.planner.limits
    assert planner.change_settings(speed_scale=0.03, acceleration_scale=0.02).ok
    stream.run(0.05)
    assert planner.played_limits is not planner.limits
    planner.clear_goal()
    plan = stream.run(stream.period)[0]
    assert plan.verdict.code is VerdictCode.NO_GOAL
    assert plan.reference.keeps(before)
    # It takes what a stop takes at that speed, not what one within the lower limits would take.
    assert plan.reference.duration < 1.0
    stream.run(1.5)
    assert not stream.planner.commanded_state(stream.now)[1].any()
    assert max(stream.jumps) < ROUNDING


def test_where_the_slower_arm_would_be_met_it_does_not_go_on_along_its_path(stream, nominal):
    """A sphere comes to where the arm is, a second after a fast one has left."""
    in_fast_motion(stream, nominal)
    planner = stream.planner
    velocity = np.array([-0.3, 0.0, 0.0])
    here = planner.robot.forward(planner.commanded_state(stream.now)[0])[0]
    planner.set_obstacles((here - 1.2 * velocity)[None], np.array([0.05]), velocity[None], stream.now)
    assert stream.run(stream.period)[0].verdict.ok  # the control: as fast as before it is not met
    assert planner.change_settings(speed_scale=0.01).ok
    plan = stream.run(stream.period)[0]
    assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert "slowed down on its path it would meet what moves" in plan.verdict.reason
    stream.run(1.0)
    assert max(stream.jumps) < ROUNDING


@pytest.mark.parametrize("covered", [False, True], ids=["control: less than the clearance", "more than the clearance"])
def test_a_larger_position_error_counts_in_the_next_tick(stream, nominal, covered):
    planner = stream.planner
    stream.run(0.3)
    beside = planner.robot.forward(nominal.sample(0.7 * nominal.duration)[0])[0] + np.array([0.0, 0.0, 0.4])
    planner.set_obstacles(beside[None], np.array([0.05]))
    stream.run(0.05)
    clearance = planner.tick(stream.now).verdict.figures.clearance
    assert 0.02 < clearance < 0.5
    error = clearance + (0.02 if covered else -0.01)
    assert planner.change_settings(obstacle_position_error=error).ok
    plan = stream.run(stream.period)[0]
    if covered:
        # It stops, or goes another path.
        assert plan.reference is not None
    else:
        assert plan.verdict.ok
    stream.run(0.5)
    assert max(stream.jumps) < ROUNDING


def test_a_larger_margin_leads_the_arm_by_another_path(stream, goal, on_elbow):
    planner = stream.planner
    planner.set_obstacles(*on_elbow)
    first = stream.run(0.3)[0]
    assert first.verdict.ok
    handed = len(stream.handed)
    near = planner.tick(stream.now).verdict.figures.clearance
    assert planner.change_settings(obstacle_margin=0.03).ok
    stream.run(0.3)
    assert len(stream.handed) > handed
    new = planner.tick(stream.now).verdict
    assert new.ok
    assert new.figures.clearance > near
    until_rest(stream, goal, 20.0)
    assert max(stream.jumps) < ROUNDING


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"speed_scale": 0.0}, "speed_scale"),
        ({"speed_scale": 1.5}, "speed_scale"),
        ({"obstacle_margin": -0.1}, "obstacle_margin"),
        ({"obstacle_position_error": float("nan")}, "obstacle_position_error"),
        ({"prediction": 3.0}, "setting prediction cannot be changed any more; those that can: obstacle_margin"),
    ],
)
def test_a_change_that_cannot_be_is_refused_and_changes_nothing(stream, changes, reason):
    stream.run(0.3)
    before, limits_before = stream.planner.settings, stream.planner.limits
    verdict = stream.planner.change_settings(**changes)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert reason in verdict.reason
    assert stream.planner.settings is before
    assert stream.planner.limits is limits_before
    assert stream.run(0.05)[-1].verdict.ok


def test_an_arm_whose_servo_would_overshoot_its_limits_takes_no_larger_scale_at_start_nor_later():
    skill = Skill.load("fr3_reach_to_grasp")
    with pytest.raises(RobotError, match=r"speed_scale is 0\.9: it must be in \(0, 0\.8\]: above that a servo"):
        ReactivePlanner(skill, PlannerSettings(speed_scale=0.9))
    planner = ReactivePlanner(skill, PlannerSettings(speed_scale=0.8))
    verdict = planner.change_settings(speed_scale=0.9)
    assert verdict.code is VerdictCode.BAD_INPUT
    assert "a servo that overshoots breaks limits at which the arm stops itself" in verdict.reason
    assert planner.settings.speed_scale == 0.8
