"""Stream and Situation: one trajectory takes over from the other without a jump, and a stop is certified and keeps to
the path.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.certification.certificate import ArmCertifier, JudgedTrajectory
from geodesic_motion_ros.contract.mode import Mode, Purpose
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.played import FollowedPlan, PlayedTrajectory
from geodesic_motion_ros.motion.stream import Stream
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

ROBOT, SETTINGS = Robot.named("panda"), PlannerSettings()
LIMITS, MODEL = JointLimits.of(ROBOT), CollisionModel.named("panda")
CERTIFIER = ArmCertifier(ROBOT, MODEL)
#: Of a query a situation asks only whether it is the same, and a stream whether it is of rounds.
QUERY = SimpleNamespace(round_frame=None)
#: To the side, by the first joint.
TURN = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
OK, NO_PATH = Verdict(), Refusal(VerdictCode.NO_FEASIBLE_PATH, "no path")


def judged(reference: JointReference, obstacles: Obstacles | None = None) -> JudgedTrajectory:
    return CERTIFIER.judge(reference, CERTIFIER.certify(reference, obstacles or Obstacles.none(), 1.6))


def timed(start: np.ndarray, goal: np.ndarray, *motion: np.ndarray) -> JointReference | None:
    """The straight line from a state of motion to a goal (eta,); None where the limits leave no motion along it."""
    share = np.linspace(0.0, 1.0, 60)[:, None]
    return timed_joint_reference(start + share * (goal - start), np.hstack([1.0 - share, share]), LIMITS, *motion)


def straight(start: np.ndarray, goal: np.ndarray, *motion: np.ndarray) -> JudgedTrajectory:
    """A trajectory from a state of motion to a goal (eta,)."""
    reference = timed(start, goal, *motion)
    assert reference is not None
    return judged(reference)


def at(
    stream: Stream,
    now: float,
    obstacles: Obstacles | None = None,
    handover_deadline: Deadline = NEVER,
    settings: PlannerSettings = SETTINGS,
) -> Situation:
    assert stream.played is not None
    return Situation(
        settings, LIMITS, CERTIFIER, stream.played, stream.followed, now, obstacles or Obstacles.none(),
        handover_deadline=handover_deadline,
    )  # fmt: skip


def going(
    settings: PlannerSettings = SETTINGS,
    clearance: float = np.inf,
    purpose: Purpose = Purpose.GOAL,
    now: float = 0.0,
) -> Stream:
    """A stream that turns to the side from a time [s] on."""
    stream = Stream(CERTIFIER)
    stream.stand(judged(JointReference.standing(ROBOT.ready, np.zeros(2))), now)
    plan = Plan(straight(ROBOT.ready, ROBOT.ready + TURN), now, OK.with_figures(clearance=clearance))
    start = at(stream, now, settings=settings)
    stream.commit(start.hand_out(plan, FollowedPlan.of(QUERY, plan, start.obstacles, start.now, purpose)), now)
    return stream


def stopped(stream: Stream, situation: Situation) -> Plan:
    return stream.commit(situation.begin_stop(NO_PATH), situation.now)


def ball(posture: np.ndarray, velocity: np.ndarray | None = None, radius: float = 0.05) -> Obstacles:
    """A sphere around the tool of a posture (eta,)."""
    hand, _ = ROBOT.forward(posture)
    return Obstacles.of_spheres(hand[None], np.array([radius]), None if velocity is None else velocity[None], time=0.0)


def test_a_switch_is_no_nearer_to_a_knot_than_knots_may_be() -> None:
    played = PlayedTrajectory(straight(ROBOT.ready, ROBOT.ready + TURN), 2.0, CERTIFIER)
    knot = 2.0 + played.reference.times[5]
    assert played.knot_before(knot + 1e-4) == knot
    assert played.switch_time(knot + 1e-4) == pytest.approx(knot + 1e-3)
    assert played.switch_time(knot + 2e-3) == knot + 2e-3
    assert played.switch_time(played.end + 1.0) == played.knot_before(played.end + 1.0) == played.end + 1.0


def test_one_path_takes_over_from_another_in_its_state_of_motion_and_the_past_is_remembered() -> None:
    stream = going()
    before, situation = stream.played, at(stream, 0.4)
    state = situation.state
    assert np.max(np.abs(state.velocity)) > 0.1
    goal = ROBOT.ready + 0.7 * TURN + 0.1
    plan = Plan(straight(state.position, goal, state.velocity, state.acceleration), state.time, OK)
    handed = stream.commit(situation.hand_out(plan, FollowedPlan.of(QUERY, plan, situation.obstacles, 0.4)), 0.4)
    assert handed.begin == before.knot_before(0.4)
    assert handed.trajectory is stream.played.trajectory
    times = np.arange(0.3, stream.played.end, 0.001)
    played = np.array([stream.commanded_state(time) for time in times])
    assert np.max(np.abs(np.diff(played[:, 0], axis=0))) < 0.001 * 1.001 * np.max(LIMITS.velocity)
    assert np.max(np.abs(np.diff(played[:, 2], axis=0))) < 0.001 * 1.001 * np.max(LIMITS.jerk)
    # Before the new trajectory begins the one before it counts.
    np.testing.assert_array_equal(played[0], before.reference.sample(times[0]))
    np.testing.assert_allclose(stream.commanded_state(stream.played.end)[0], goal, atol=1e-9)
    rest, knot = stream.remaining_motion(0.5)
    assert knot <= 0.5
    np.testing.assert_allclose(rest.sample(0.5 - knot)[0], stream.commanded_state(0.5)[0], atol=1e-12)
    assert stream.remaining_motion(stream.played.end) is None


@pytest.mark.parametrize("clock", [0.0, 1.8e9])
def test_what_is_joined_keeps_the_limits_and_the_motion_by_any_clock(clock) -> None:
    """Floats near 1.8e9 s, as of today's clock, are 0.24 us apart; knots are a millisecond apart, or more."""
    random, now, stream, shortest = np.random.default_rng(0), clock, going(now=clock), np.inf
    for _ in range(200):
        now += random.choice([0.001, 0.01, 0.0137, 0.02, 0.033]) + random.uniform(0.0, 1e-3)
        before, situation = stream.played, at(stream, now)
        state = situation.state
        goal = ROBOT.ready + random.uniform(-1.0, 1.0) * TURN + random.uniform(-0.2, 0.2, 7)
        new = timed(state.position, goal, state.velocity, state.acceleration) or situation.stop.reference
        plan = Plan(judged(new), state.time, OK)
        followed = FollowedPlan.of(QUERY, plan, situation.obstacles, now)
        handed = stream.commit(situation.hand_out(plan, followed), now)
        assert handed.reference.keeps(LIMITS)
        shortest = min(shortest, np.min(np.diff(handed.reference.times)))
        at_times = np.linspace(now, state.time, 20)
        expected, found = (played.reference.samples(at_times - played.begin) for played in (before, stream.played))
        np.testing.assert_allclose(found[0], expected[0], atol=1e-12)
        np.testing.assert_allclose(found[1], expected[1], atol=1e-9)
        np.testing.assert_allclose(found[2], expected[2], atol=1e-5)
    assert shortest < 1.001e-3


def test_another_one_takes_over_at_a_knot_that_would_follow_at_once() -> None:
    """A motion that began less than a microsecond before a knot would begin there, later than it is said to."""
    played = PlayedTrajectory(straight(ROBOT.ready, ROBOT.ready + TURN), 1.8e9, CERTIFIER)
    knot = played.knot_before(1.8e9 + played.reference.times[9] + 1e-3)
    assert knot - 1.8e9 == pytest.approx(played.reference.times[9], abs=2.4e-7)
    assert knot - 1.8e9 >= played.reference.times[9] - 1e-13
    assert played.switch_time(np.nextafter(knot, 0.0)) == knot
    assert played.switch_time(knot - 1e-4) == knot - 1e-4


def test_a_stop_keeps_to_the_path_and_is_handed_out_once() -> None:
    stream = going()
    path, situation = stream.played, at(stream, 0.5)
    assert situation.mode(situation.begin_stop(NO_PATH)) is Mode.STOPPING
    plan = stopped(stream, situation)
    assert plan.verdict.reason == "no path"
    position, velocity, acceleration = plan.reference.sample(plan.reference.duration)
    assert np.max(np.abs(velocity)) == np.max(np.abs(acceleration)) == 0.0
    passed = path.reference.samples(np.linspace(0.0, path.reference.duration, 5000))[0]
    assert np.min(np.linalg.norm(passed - position, axis=1)) < 1e-3
    assert 0.05 < position[0] - ROBOT.ready[0] < 1.1
    assert stream.motion_to_goal() is None
    assert stopped(stream, at(stream, 0.52)).trajectory is None


@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_a_stop_that_is_met_is_the_sooner_one_where_that_is_met_less_deep(share: float) -> None:
    """Of an obstacle that appears where the arm would come to stand. The control comes from behind, and is met deeper
    by an arm that stands sooner: the stop keeps to the path, as it does where nothing is met.
    """
    stream = going()
    now = share * stream.played.reference.duration
    along = at(stream, now).stop.reference
    assert at(stream, now).widest_stop.reference.duration == along.duration
    ahead = at(stream, now, ball(along.positions[-1], radius=0.03))
    chosen = ahead.widest_stop
    assert chosen.reference.duration < along.duration
    assert chosen.reference.keeps(LIMITS)
    assert np.min(chosen.certificate.clearance) > np.min(ahead.stop.certificate.clearance)
    assert np.min(ahead.stop.certificate.clearance) < 0.0
    (before, _), (after, _) = (ROBOT.forward(along.sample(time)[0]) for time in (0.0, 0.01))
    velocity = 100.0 * (after - before)
    behind = at(stream, now, replace(ball(along.positions[0] - 0.2 * TURN, 0.5 * velocity), time=now))
    assert np.min(behind.stop.certificate.clearance) < 0.0
    assert behind.widest_stop.reference.duration == along.duration
    plan = stopped(stream, ahead)
    assert plan.verdict.figures.clearance == np.min(chosen.certificate.clearance)
    np.testing.assert_allclose(plan.reference.positions[-1], chosen.reference.positions[-1], atol=1e-12)


def test_a_stop_states_what_is_met_while_stopping_and_its_certificate_is_honest() -> None:
    met = ball(ROBOT.ready + 0.35 * TURN)
    stream = going()
    plan = stopped(stream, at(stream, 0.5, met))
    assert "while stopping, 'panda_" in plan.verdict.reason
    assert plan.trajectory.nearest == plan.verdict.figures.clearance < 0.0
    assert len(plan.trajectory.clearance) == len(plan.reference.times) - 1
    blind = replace(SETTINGS, avoidance=False)
    stream = going(blind)
    assert stopped(stream, at(stream, 0.5, met, settings=blind)).verdict.reason == "no path"


def test_an_assessment_changes_nothing() -> None:
    """Steps are values: what is not taken leaves the stream as it was."""
    stream = going()
    before = stream.played, stream.followed
    situation = at(stream, 0.5, ball(ROBOT.ready + 0.35 * TURN, np.array([0.0, 0.0, 0.1])))
    situation.free_path(QUERY)
    situation.begin_stop(NO_PATH)
    assert (stream.played, stream.followed) == before


def test_what_is_found_too_late_changes_nothing() -> None:
    stream = going()
    played, followed = stream.played, stream.followed
    plan = stopped(stream, at(stream, 0.5, handover_deadline=Deadline(-np.inf)))
    assert plan.verdict.code is VerdictCode.DEADLINE_MISSED
    assert "latency" in plan.verdict.reason
    assert plan.trajectory is None
    assert stream.played is played
    assert stream.followed is followed


def test_a_path_is_free_from_where_the_arm_is_on() -> None:
    stream = going()
    assert at(stream, 0.1).free_path(QUERY).verdict.figures.clearance == np.inf
    assert at(stream, 0.1).free_path(SimpleNamespace()) is None
    obstacles = ball(ROBOT.ready)
    assert at(stream, 0.0, obstacles).free_path(QUERY) is None
    assert at(stream, 0.8 * stream.played.end, obstacles).free_path(QUERY).verdict.figures.clearance > 0.0
    blind = replace(SETTINGS, avoidance=False)
    assert at(going(blind), 0.0, obstacles, settings=blind).free_path(QUERY).verdict.figures.clearance < 0.0


@pytest.mark.parametrize(
    ("age", "speed", "avoidance", "goes_on"),
    [
        (0.2, 0.4, True, False),
        (0.0, 0.4, True, True),  # it has passed, as was detected
        (0.2, 0.0, True, True),  # it stands there
        (0.2, 0.4, False, True),
    ],
)
def test_what_has_passed_since_it_was_last_detected_may_have_halted_right_beyond_the_path(
    age: float, speed: float, avoidance: bool, goes_on: bool
) -> None:
    """A sphere falls past where the tool is a little beyond the place where the arm would stop; it is below it now."""
    settings = replace(SETTINGS, avoidance=avoidance)
    stream = going(settings)
    crossing = ball(ROBOT.ready + 0.82 * TURN, np.array([0.0, 0.0, -speed]))
    time = 0.3
    passed = replace(crossing, centres=crossing.centres - [0.0, 0.0, 0.1], ages=np.array([age]), time=time)
    situation = at(stream, time - SETTINGS.latency, passed, settings=settings)
    assert situation.may_follow(stream.played) is goes_on
    assert (situation.free_path(QUERY) is not None) is goes_on
    rest = judged(stream.played.reference.rest(situation.state.time))
    assert situation.require_a_stop(Plan(rest, situation.state.time, OK)).verdict.ok is goes_on


@pytest.mark.parametrize(("error", "goes_on"), [(0.0, True), (0.15, False)])
def test_what_may_turn_towards_the_path_is_not_passed(error: float, goes_on: bool) -> None:
    """A sphere moves along beside the path of the tool, 5 cm off the hand at least, and does not come nearer."""
    stream = going()
    beside = ball(ROBOT.ready + TURN)
    hand, outwards = beside.centres[0], beside.centres[0] * [1.0, 1.0, 0.0]
    passing = replace(
        beside, centres=(hand + 0.2 * outwards / np.linalg.norm(outwards))[None],
        velocities=np.array([[0.0, 0.0, 0.15]]), velocity_errors=np.array([error]),
    )  # fmt: skip
    assert (at(stream, 0.1, passing).free_path(QUERY) is not None) is goes_on


@pytest.mark.parametrize(
    ("optimistic", "longer", "gain"),
    [
        (False, 1.0, False),
        (False, 0.9, True),  # clearly sooner there
        (False, 0.97, False),
        (True, 2.0, True),  # the old path counts on what moves to have left
    ],
)
def test_a_new_path_is_a_gain_where_it_takes_clearly_less_time_or_the_old_one_was_optimistic(
    optimistic: bool, longer: float, gain: bool
) -> None:
    stream = going()
    situation = at(stream, -SETTINGS.latency)
    reference = stream.played.reference
    slower = judged(replace(reference, times=longer * reference.times))
    plan = Plan(slower, 0.0, OK)
    followed = replace(stream.followed, optimistic=optimistic)
    assert situation.is_gain(plan, followed) is gain
    assert not gain or plan.reference.duration < situation.longest_worthwhile(followed)
    assert not situation.is_gain(replace(plan, trajectory=None), followed)


@pytest.mark.parametrize("purpose", list(Purpose))
def test_an_arm_that_brakes_by_itself_is_on_no_path_and_the_reason_is_kept(purpose: Purpose) -> None:
    stream = going(purpose=purpose)
    situation = at(stream, 0.5)
    stop = situation.stop.reference
    stream.record_braking(judged(stop), situation.state.time, NO_PATH)
    assert stream.motion_to_goal() is None
    assert at(stream, 0.5).followed_to(QUERY) is None
    assert (stream.followed.verdict, stream.followed.purpose) == (NO_PATH, Purpose.STOP)
    np.testing.assert_allclose(stream.commanded_state(situation.state.time + 5.0)[0], stop.positions[-1])
    stream.forget()
    assert stream.commanded_state(1.0) is None
    assert stream.motion_to_goal() is None
