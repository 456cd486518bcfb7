"""Stream: one reference takes over from the other without a jump, and a stop is certified and keeps to the way."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.arm_certificate import ArmCertifier
from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_reference import JointReference
from geodesic_motion_ros.joint_timing import timed_joint_reference
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.planning.solver import Plan
from geodesic_motion_ros.planning.stream import Followed, Moment, Played, Stream
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.verdict import Verdict, VerdictCode

ROBOT, SETTINGS = Robot.panda(), PlannerSettings()
LIMITS, MODEL = JointLimits.of(ROBOT), CollisionModel.named("panda")
CERTIFIER = ArmCertifier(ROBOT, MODEL)
#: Of a query the stream asks only whether it is the same.
QUERY = SimpleNamespace()
#: To the side, by the first joint.
TURN = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
OK, NO_WAY = Verdict(VerdictCode.OK), Verdict(VerdictCode.NO_FEASIBLE_PATH, "no way")


def straight(start: np.ndarray, goal: np.ndarray, *motion: np.ndarray) -> JointReference:
    """A reference from a state of motion to a goal (eta,)."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    reference = timed_joint_reference(start + share * (goal - start), np.hstack([1.0 - share, share]), LIMITS, *motion)
    assert reference is not None
    return reference


def moment(now: float, obstacles: Obstacles | None = None, late: Deadline = NEVER) -> Moment:
    return Moment(now, obstacles or Obstacles.none(), late)


def going(settings: PlannerSettings = SETTINGS, clearance: float = np.inf) -> Stream:
    """A stream that turns to the side from time 0 on."""
    stream = Stream(settings, LIMITS, CERTIFIER)
    stream.stand(JointReference.standing(ROBOT.ready, np.zeros(2)), 0.0)
    plan = Plan(straight(ROBOT.ready, ROBOT.ready + TURN), 0.0, replace(OK, clearance=clearance))
    stream.play(plan, Followed.begun(QUERY, plan, moment(0.0)), moment(0.0))
    return stream


def ball(posture: np.ndarray, velocity: np.ndarray | None = None, radius: float = 0.05) -> Obstacles:
    """A sphere around the tool of a posture (eta,)."""
    hand, _ = ROBOT.forward(posture)
    return Obstacles.of_spheres(hand[None], np.array([radius]), None if velocity is None else velocity[None])


def test_a_switch_is_no_nearer_to_a_knot_than_knots_may_be() -> None:
    played = Played(straight(ROBOT.ready, ROBOT.ready + TURN), 2.0)
    knot = 2.0 + played.reference.times[5]
    assert played.knot_before(knot + 1e-4) == knot
    assert played.switch(knot + 1e-4) == pytest.approx(knot + 1e-3)
    assert played.switch(knot + 2e-3) == knot + 2e-3
    assert played.switch(played.end + 1.0) == played.knot_before(played.end + 1.0) == played.end + 1.0


def test_one_way_takes_over_from_another_in_its_state_of_motion_and_the_past_is_remembered() -> None:
    stream = going()
    before = stream.played
    state = before.state_at_switch(0.4 + SETTINGS.latency, stream.followed)
    assert np.max(np.abs(state.velocity)) > 0.1
    goal = ROBOT.ready + 0.7 * TURN + 0.1
    new = straight(state.position, goal, state.velocity, state.acceleration)
    plan = Plan(new, state.time, OK)
    handed = stream.play(plan, Followed.begun(QUERY, plan, moment(0.4)), moment(0.4))
    assert handed.begin == before.knot_before(0.4)
    times = np.arange(0.3, stream.played.end, 0.001)
    played = np.array([stream.commanded(time) for time in times])
    assert np.max(np.abs(np.diff(played[:, 0], axis=0))) < 0.001 * 1.001 * np.max(LIMITS.velocity)
    assert np.max(np.abs(np.diff(played[:, 2], axis=0))) < 0.001 * 1.001 * np.max(LIMITS.jerk)
    # Before the handed reference begins that from before is told.
    np.testing.assert_array_equal(played[0], before.reference.sample(times[0]))
    np.testing.assert_allclose(stream.commanded(stream.played.end)[0], goal, atol=1e-9)
    rest, knot = stream.playing(0.5)
    assert knot <= 0.5
    np.testing.assert_allclose(rest.sample(0.5 - knot)[0], stream.commanded(0.5)[0], atol=1e-12)
    assert stream.playing(stream.played.end) is None


def test_a_stop_keeps_to_the_way_and_is_handed_out_once() -> None:
    stream = going()
    way = stream.played
    plan = stream.stopped(NO_WAY, moment(0.5))
    assert plan.verdict.reason == "no way"
    position, velocity, acceleration = plan.reference.sample(plan.reference.duration)
    assert np.max(np.abs(velocity)) == np.max(np.abs(acceleration)) == 0.0
    passed = way.reference.samples(np.linspace(0.0, way.reference.duration, 5000))[0]
    assert np.min(np.linalg.norm(passed - position, axis=1)) < 1e-3
    assert 0.05 < position[0] - ROBOT.ready[0] < 1.1
    assert stream.way() is None
    assert stream.stopped(NO_WAY, moment(0.52)).reference is None


def test_a_stop_says_what_is_met_while_stopping() -> None:
    stopping = moment(0.5, ball(ROBOT.ready + 0.35 * TURN))
    assert "while stopping, 'panda_" in going().stopped(NO_WAY, stopping).verdict.reason
    assert going(replace(SETTINGS, avoidance=False)).stopped(NO_WAY, stopping).verdict.reason == "no way"


def test_what_is_found_too_late_changes_nothing() -> None:
    stream = going()
    played, followed = stream.played, stream.followed
    plan = stream.stopped(NO_WAY, moment(0.5, late=Deadline(-np.inf)))
    assert plan.verdict.code is VerdictCode.DEADLINE_MISSED
    assert "latency" in plan.verdict.reason
    assert plan.reference is None
    assert stream.played is played
    assert stream.followed is followed


def test_a_way_is_free_from_where_the_arm_is_on() -> None:
    stream = going()
    assert stream.free_way(QUERY, 0.1, Obstacles.none()).verdict.clearance == np.inf
    assert stream.free_way(SimpleNamespace(), 0.1, Obstacles.none()) is None
    obstacles = ball(ROBOT.ready)
    assert stream.free_way(QUERY, 0.0, obstacles) is None
    assert stream.free_way(QUERY, 0.8 * stream.played.end, obstacles).verdict.clearance > 0.0
    blind = going(replace(SETTINGS, avoidance=False))
    assert blind.free_way(QUERY, 0.0, obstacles).verdict.clearance < 0.0


@pytest.mark.parametrize(
    ("age", "speed", "avoidance", "goes_on"),
    [
        (0.2, 0.4, True, False),
        (0.0, 0.4, True, True),  # it has passed, as was seen
        (0.2, 0.0, True, True),  # it stands there
        (0.2, 0.4, False, True),
    ],
)
def test_what_has_passed_since_it_was_last_seen_may_have_come_to_a_stand_right_beyond_the_way(
    age: float, speed: float, avoidance: bool, goes_on: bool
) -> None:
    """A sphere falls past where the tool is a little beyond the place where the arm would stop; it is below it now."""
    stream, time = going(replace(SETTINGS, avoidance=avoidance)), 0.3
    crossing = ball(ROBOT.ready + 0.82 * TURN, np.array([0.0, 0.0, -speed]))
    passed = replace(crossing, centres=crossing.centres - [0.0, 0.0, 0.1], age=age)
    assert stream.can_still_stop(stream.played, time, passed) is goes_on
    assert (stream.free_way(QUERY, time, passed) is not None) is goes_on
    plan = Plan(stream.played.reference.rest(time), time, OK)
    assert stream.stoppable(plan, passed).verdict.ok is goes_on


@pytest.mark.parametrize(
    ("clearance", "nearest", "trusting", "longer", "gain"),
    [
        (0.2, 0.1, False, 1.0, False),  # further off, but the old way is far enough
        (0.02, 0.01, False, 1.0, True),
        (0.005, 0.01, False, 1.0, False),
        (0.1, 0.1, False, 0.9, True),  # clearly sooner there
        (0.1, 0.1, False, 0.97, False),
        (0.1, 0.1, True, 2.0, True),  # the old way trusts that what moves will be gone
    ],
)
def test_a_new_way_is_a_gain_where_it_is_safer_or_takes_clearly_less_time(
    clearance: float, nearest: float, trusting: bool, longer: float, gain: bool
) -> None:
    stream = going()
    reference = stream.played.reference
    plan = Plan(replace(reference, times=longer * reference.times), 0.0, replace(OK, clearance=clearance))
    followed = replace(stream.followed, verdict=replace(OK, clearance=nearest), trusting=trusting)
    assert stream.gains(plan, followed, 0.0) is gain
    assert not stream.gains(replace(plan, reference=None), followed, 0.0)


def test_what_comes_nearer_than_was_promised_is_stopped_for_where_a_stop_keeps_further_off() -> None:
    ahead = ball(ROBOT.ready + TURN, np.array([1e-3, 0.0, 0.0]))
    for promised, obstacles, goes_on in (
        (0.02, ahead, False),
        (1e-4, ahead, True),
        (0.02, replace(ahead, velocities=np.zeros((1, 3))), True),
    ):
        stream = going()
        followed = replace(stream.followed, promised=promised, verdict=replace(OK, clearance=1e-3))
        plan = stream.continued(followed, moment(0.3, obstacles))
        assert (plan.reference is None) is goes_on
        assert plan.verdict.ok is goes_on


def test_an_arm_that_brakes_by_itself_is_on_no_way_and_the_reason_is_kept() -> None:
    stream = going()
    stop, begin, _ = stream.soonest_stop(moment(0.5))
    stream.braked(stop, begin, NO_WAY)
    assert stream.way() is None
    assert stream.following(QUERY) is None
    assert stream.followed.verdict is NO_WAY
    np.testing.assert_allclose(stream.commanded(begin + 5.0)[0], stop.positions[-1])
    stream.forget()
    assert stream.commanded(1.0) is None
    assert stream.way() is None
