"""What an arm does in a tick: decided from its situation, its mission and its memory alone, and nothing is changed."""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.certification.certificate import ArmCertifier
from geodesic_motion_ros.contract.mode import Mode, Purpose
from geodesic_motion_ros.contract.settings import ATTEMPTS, SEARCH_PERIOD, Attempt, PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.motion.detour import Detour
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.stream import Stream
from geodesic_motion_ros.motion.worker import Job
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.arbiter import Arbiter, Decision, _begins_smoothly
from geodesic_motion_ros.planning.guarded_arm import GuardedArm
from geodesic_motion_ros.planning.memory import AttemptMemory, DetourRequest, DetourSearch
from geodesic_motion_ros.planning.mission import Mission
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

ROBOT, MODEL, SETTINGS = Robot.named("panda"), CollisionModel.named("panda"), PlannerSettings()
LIMITS, CERTIFIER = JointLimits.of(ROBOT), ArmCertifier(ROBOT, MODEL)
NO_PATH = Refusal(VerdictCode.NO_FEASIBLE_PATH, "no path")
CAUTIOUS = tuple(attempt for attempt in ATTEMPTS if not attempt.optimistic)
TICK, REACH, TURN = 0.01, 0.25, 0.6


def query_at(position: np.ndarray) -> SimpleNamespace:
    return SimpleNamespace(start=position, round_frame=None, start_latent=np.zeros(2))


@dataclass
class Searches:
    """In the place of a Solver: a turn about the first axis where there is a path, and what was searched, how."""

    free: bool = True
    late: bool = False
    pace: float = 1.0
    attempts: tuple[Attempt, ...] = ATTEMPTS
    cautious_attempts: tuple[Attempt, ...] = CAUTIOUS
    made: list[tuple[SimpleNamespace, tuple[Attempt, ...]]] = field(default_factory=list)

    def solve(
        self, query: SimpleNamespace, state: MotionState, obstacles: Obstacles, attempts: tuple[Attempt, ...], *_: float
    ) -> Plan:
        self.made.append((query, attempts))
        if self.late:
            return Plan(None, state.time, Refusal(VerdictCode.DEADLINE_MISSED, "out of time"))
        return self.turn(state, obstacles) if self.free else Plan(None, state.time, NO_PATH)

    def turn(self, state: MotionState, obstacles: Obstacles) -> Plan:
        share = np.linspace(0.0, 1.0, 30)[:, None]
        path = state.position + share * (ROBOT.ready + TURN * np.eye(7)[0] - state.position)
        limits = JointLimits.of(ROBOT, self.pace, self.pace)
        reference = timed_joint_reference(path, np.hstack([1.0 - share, share]), limits)
        trajectory = CERTIFIER.judge(reference, CERTIFIER.certify(reference, obstacles, SETTINGS.prediction))
        return Plan(trajectory, state.time, Verdict(VerdictCode.OK, "turns"))


@dataclass
class Postures:
    """In the place of a query builder: so many other postures, or why the goal is refused."""

    others: list[SimpleNamespace] = field(default_factory=list)
    refusal: Refusal | None = None

    def build(self, position: np.ndarray, goal: object, again: bool = False) -> SimpleNamespace | Refusal:
        return self.refusal or query_at(position)

    def build_beside(
        self, query: SimpleNamespace, position: np.ndarray, latent: np.ndarray, goal: object
    ) -> SimpleNamespace | Refusal:
        return self.build(position, goal)

    def redirect(self, *_: object) -> None:
        return None

    def first_posture(self, query: SimpleNamespace) -> SimpleNamespace:
        return query

    def other_posture(self, query: SimpleNamespace) -> SimpleNamespace | None:
        tried = [number for number, other in enumerate(self.others) if other is query]
        return next(iter(self.others[tried[0] + 1 if tried else 0 :]), None)


class Arm:
    """One that stands and has a goal; `tick` commits what is decided, as a planner does."""

    def __init__(self) -> None:
        self.searches, self.postures, self.reach = Searches(), Postures(), 0.0
        detours = SimpleNamespace(plan=lambda detour, state, obstacles: self.searches.turn(state, obstacles))
        self.guarded = GuardedArm(MODEL, (), MODEL, self.searches, self.postures, detours)
        self.stream, self.memory = Stream(CERTIFIER), AttemptMemory()
        self.mission = Mission(active=SimpleNamespace(goal=SimpleNamespace(), request=None))
        standing = JointReference.standing(ROBOT.ready, np.zeros(2))
        self.stream.stand(CERTIFIER.judge(standing, CERTIFIER.certify(standing, Obstacles.none(), 1.0)), 0.0)
        self.situation: Situation | None = None

    def decided(
        self, now: float, obstacles: Obstacles, deadline: Deadline = NEVER, unchanged_since: float = 0.0
    ) -> Decision:
        self.situation = Situation(
            SETTINGS, LIMITS, CERTIFIER, self.stream.played, self.stream.followed, now, obstacles, deadline,
            reach=self.reach, unchanged_since=unchanged_since,
        )  # fmt: skip
        return Arbiter(self.guarded, self.situation, self.mission, self.memory).decide()

    def tick(self, now: float, obstacles: Obstacles, **more: float) -> Decision:
        decision = self.decided(now, obstacles, **more)
        self.mission, self.memory = replace(self.mission, query=decision.query), decision.memory
        self.stream.commit(decision.step, now)
        return decision

    def runs_blocked(self, until: float) -> float:
        """Tick among what stands and leaves no path until a time [s]; returns that of the next tick."""
        self.searches.free = False
        times = TICK * np.arange(round(until / TICK))
        for now in times:
            self.tick(now, sphere())
        return float(times[-1]) + TICK


@pytest.fixture
def arm() -> Arm:
    return Arm()


def sphere(centre: tuple[float, float, float] = (0.0, 0.0, 3.0)) -> Obstacles:
    """One that stands, far from the arm where nothing else is said."""
    return Obstacles.of_spheres(np.array([centre]), np.array([0.05]))


def where_it_turns() -> Obstacles:
    hand, _ = ROBOT.forward(ROBOT.ready + TURN * np.eye(7)[0])
    return sphere(tuple(hand))


def detour_search(request: DetourRequest, result: Detour | Refusal) -> DetourSearch:
    """One that is done."""
    future: Future[Detour | Refusal] = Future()
    future.set_result(result)
    return DetourSearch(Job(future, None), request)


def test_without_a_goal_nothing_is_searched(arm: Arm) -> None:
    """What was blocked before is not any more, and the query is dropped. The control: with a goal."""
    arm.memory = replace(arm.memory, blocked_since=0.0)
    for mission in (Mission(), replace(arm.mission, active=None, query=query_at(ROBOT.ready))):
        arm.mission, given = mission, arm.mission
        decision = arm.decided(1.0, sphere())
        assert decision.step.plan.verdict.code is VerdictCode.NO_GOAL
        assert (decision.query, decision.memory.blocked_since) == (None, np.inf)
        assert not arm.searches.made
        arm.mission = given
    assert arm.decided(1.0, sphere()).step.plan.verdict.ok


def test_a_goal_is_searched_with_all_attempts_at_first_and_its_path_is_followed(arm: Arm) -> None:
    decision = arm.decided(0.0, sphere())
    assert arm.searches.made == [(decision.query, ATTEMPTS)]
    assert decision.step.plan.verdict.reason == "turns"
    assert decision.step.followed.query is decision.query
    assert arm.situation.mode(decision.step) is Mode.FOLLOWING


def test_a_goal_that_no_query_leads_to_is_refused_with_its_reason(arm: Arm) -> None:
    arm.postures.refusal = Refusal(VerdictCode.START_OUT_OF_SUPPORT, "too far")
    decision = arm.decided(0.0, sphere())
    assert decision.step.plan.verdict is arm.postures.refusal
    assert (decision.query, arm.searches.made) == (None, [])


def test_to_decide_changes_nothing(arm: Arm) -> None:
    """Twice the same is decided, on a path and without one; the planner alone commits."""
    arm.tick(0.0, sphere())
    for free in (True, False):
        arm.searches.free = free
        before = arm.mission, arm.memory, arm.stream.played, arm.stream.followed
        first, second = (arm.decided(0.3, where_it_turns()) for _ in range(2))
        assert all(now is then for now, then in zip((arm.mission, arm.memory, arm.stream.played, arm.stream.followed),
                                                     before, strict=True))  # fmt: skip
        assert first.step.plan.verdict == second.step.plan.verdict
        positions = (decision.step.plan.reference.positions for decision in (first, second))
        np.testing.assert_array_equal(*positions)


def test_while_nothing_changes_a_path_is_followed_without_another_search(arm: Arm) -> None:
    """The control: an obstacle that stands elsewhere, as soon as a search is due; what is free stays until then."""
    query = arm.tick(0.0, sphere()).query
    assert arm.tick(3.0 * SEARCH_PERIOD, sphere()).step.plan.trajectory is None
    assert len(arm.searches.made) == 1
    arm.tick(4.0 * SEARCH_PERIOD, sphere((0.0, 0.0, 3.1)))
    assert arm.searches.made[1:] == [(query, ATTEMPTS[:1])]
    arm.tick(4.5 * SEARCH_PERIOD, sphere((0.0, 0.0, 3.2)))
    assert len(arm.searches.made) == 2


@pytest.mark.parametrize("late", [True, False], ids=["out of time", "in time"])
def test_a_search_of_a_better_path_that_was_out_of_time_is_made_again(arm: Arm, late: bool) -> None:
    """Among obstacles that stand, and as the arm goes on along its path; not sooner than others are."""
    arm.tick(0.0, sphere())
    arm.searches.late, other = late, sphere((0.0, 0.0, 3.1))
    made = []
    for periods in (1.0, 1.5, 2.0):
        assert arm.tick(periods * SEARCH_PERIOD, other).step.followed.verdict.ok
        made.append(len(arm.searches.made) - 1)
    assert made == ([1, 1, 2] if late else [1, 1, 1])


@pytest.mark.parametrize("pace", [0.5, 1.0], ids=["slow", "fast"])
def test_another_path_is_taken_where_it_leads_to_the_goal_clearly_sooner_alone(arm: Arm, pace: float) -> None:
    arm.searches.pace = 0.5
    arm.tick(0.0, sphere())
    arm.searches.pace = pace
    decision = arm.tick(SEARCH_PERIOD, sphere((0.0, 0.0, 3.1)))
    assert len(arm.searches.made) == 2
    assert (decision.step.plan.trajectory is not None) is (pace > 0.5)
    assert decision.step.followed.verdict.ok


def test_an_arm_whose_path_is_blocked_stops_along_it_where_there_is_no_other(arm: Arm) -> None:
    """All attempts are made at once. The control: there is another path, and that is taken."""
    query = arm.tick(0.0, sphere()).query
    taken = arm.decided(0.3, where_it_turns())
    assert taken.step.plan.verdict.ok
    arm.searches.free = False
    stopped = arm.decided(0.3, where_it_turns())
    assert arm.searches.made[1:] == 2 * [(query, ATTEMPTS)]
    assert stopped.step.plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert stopped.step.followed.purpose is Purpose.STOP
    assert arm.situation.mode(stopped.step) is Mode.STOPPING
    assert stopped.step.plan.reference.duration < taken.step.plan.reference.duration
    assert stopped.memory.blocked_since == 0.3


def test_an_arm_at_rest_tries_every_posture_once_and_then_nothing_until_something_changes(arm: Arm) -> None:
    arm.postures.others = [query_at(ROBOT.ready), query_at(ROBOT.ready)]
    arm.runs_blocked(0.3)
    tried = [id(query) for query, _ in arm.searches.made]
    assert [*dict.fromkeys(tried)][1:] == [id(other) for other in arm.postures.others]
    assert tried == sorted(tried, key=[*dict.fromkeys(tried)].index)
    searched = len(arm.searches.made)
    assert arm.tick(0.3, sphere()).step.plan.verdict == NO_PATH
    assert len(arm.searches.made) == searched
    arm.tick(0.31, sphere((0.0, 0.0, 3.1)))
    assert len(arm.searches.made) == searched + 1


def test_a_detour_is_requested_where_an_arm_at_rest_has_had_no_path_for_long_enough(arm: Arm) -> None:
    """Or where the obstacles have stood for so long. The controls: neither, or it may not leave the demonstrations."""
    now, patience = arm.runs_blocked(0.5 * SETTINGS.patience), SETTINGS.patience
    arm.reach = REACH
    assert arm.decided(now, sphere()).detour is None
    request = arm.decided(now, sphere(), unchanged_since=now - patience).detour
    assert request.reach == REACH
    np.testing.assert_array_equal(request.position, ROBOT.ready)
    arm.memory = replace(arm.memory, blocked_since=now - patience)
    assert arm.decided(now, sphere(), unchanged_since=now).detour is not None
    arm.reach = 0.0
    assert arm.decided(now, sphere(), unchanged_since=now - patience).detour is None


def found(query: SimpleNamespace, displacement: float = 0.1) -> Detour:
    still = np.repeat(ROBOT.ready[None], 2, axis=0)
    return Detour(query, still, still, np.zeros((2, 2)), displacement, 0.0, 0.0, 1.0, 1)


def test_a_detour_that_was_found_is_followed_and_one_that_leads_too_far_off_is_not(arm: Arm) -> None:
    arm.reach = REACH
    now = arm.runs_blocked(SETTINGS.patience + 0.1)
    request = arm.decided(now, sphere()).detour
    for displacement, reach in ((0.1, REACH), (0.1, 0.15), (0.2, 0.15)):
        arm.reach = reach
        detour = found(request.query, displacement)
        arm.memory = replace(arm.memory, detour=detour_search(request, detour))
        decision = arm.decided(now, sphere())
        assert decision.step.plan.verdict.ok is (displacement <= reach)
        assert (decision.memory.detour is None) is (displacement <= reach)


def test_why_there_is_no_detour_is_said_beside_why_there_is_no_path(arm: Arm) -> None:
    """It is not searched again. The control: another goal, for which that does not count."""
    arm.reach = REACH
    now = arm.runs_blocked(SETTINGS.patience + 0.1)
    request = arm.decided(now, sphere()).detour
    arm.memory = replace(arm.memory, detour=detour_search(request, Refusal(VerdictCode.NO_FEASIBLE_PATH, "too narrow")))
    decision = arm.decided(now, sphere())
    assert decision.step.plan.verdict.reason == "no path; no detour of up to 25 cm: too narrow"
    assert decision.detour is None
    arm.mission = replace(arm.mission, active=SimpleNamespace(goal=SimpleNamespace(), request=None))
    other = arm.decided(now, sphere())
    assert other.step.plan.verdict == NO_PATH
    assert other.detour is not None


def test_a_motion_that_begins_with_a_jolt_is_another_than_one_that_does_not() -> None:
    """It winds more and more; the jolt is an acceleration that is taken up within a knot."""
    share = np.linspace(0.0, 1.0, 200)[:, None]
    path = ROBOT.ready + 2.0 * share * np.eye(7)[0] + 0.1 * share**2 * np.sin(12.0 * np.pi * share) * np.eye(7)[1]
    smooth = timed_joint_reference(path, np.hstack([1.0 - share, share]), LIMITS, shown=6.0 * share[:, 0])
    later = smooth.rest(0.2 * smooth.duration)
    assert _begins_smoothly(later)
    accelerations = later.accelerations.copy()
    accelerations[0] += 1.0
    assert not _begins_smoothly(replace(later, accelerations=accelerations))
