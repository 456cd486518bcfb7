"""Evasion: an arm evades where something comes to it, and there alone; it does not search for that all the time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from geodesic_motion_ros.certification.certificate import ArmCertifier
from geodesic_motion_ros.contract.mode import Mode, Purpose
from geodesic_motion_ros.contract.requirement import Requirements
from geodesic_motion_ros.contract.settings import EVASION_DISPLACED_WITHIN, SEARCH_PERIOD, PlannerSettings
from geodesic_motion_ros.contract.status import Figures, Refusal, Verdict, VerdictCode
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.retry import PastSearch, Workings
from geodesic_motion_ros.motion.stream import Stream
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.memory import AttemptMemory
from geodesic_motion_ros.planning.proposers.evasion import Evasion
from geodesic_motion_ros.planning.proposers.turn import Turn
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
QUERY = SimpleNamespace(round_frame=None)
NO_PATH = Refusal(VerdictCode.NO_FEASIBLE_PATH, "no path")


@dataclass
class OneEvasionPath:
    """In the place of the searches of evasions: a turn to the side, on the graph or beside it, where there is one, and
    how often it is asked for, and the time [s] of the tick, which each search takes whole.
    """

    found: bool = True
    found_beside: bool = False
    asked: int = 0
    asked_beside: int = 0
    passed: float = 0.0

    def evade(
        self,
        solver: object,
        query: object,
        state: MotionState,
        obstacles: Obstacles,
        stop: JointReference,
        workings: Workings,
        deadline: Deadline,
    ) -> Plan | None:
        self.asked += 1
        self.passed = 1.0
        return self._turn(state, obstacles, SETTINGS.prediction) if self.found else None

    def evade_displaced(
        self,
        solver: object,
        query: object,
        state: MotionState,
        obstacles: Obstacles,
        stop: JointReference,
        reach: float,
        workings: Workings,
        deadline: Deadline,
    ) -> Plan | None:
        self.asked_beside += 1
        soon = Requirements.of(SETTINGS).beside_graph.horizon
        return self._turn(state, obstacles, soon) if self.found_beside else None

    def _turn(self, state: MotionState, obstacles: Obstacles, horizon: float) -> Plan:
        share = np.linspace(0.0, 1.0, 30)[:, None]
        path = state.position + share * np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        reference = timed_joint_reference(path, np.hstack([1.0 - share, share]), LIMITS)
        certificate = CERTIFIER.certify(reference, obstacles, horizon, stand_after_horizon=False)
        trajectory = CERTIFIER.judge(reference, certificate)
        return Plan(trajectory, state.time, Verdict(figures=Figures(clearance=0.01)))


class Arm:
    """One that stands, has no path, and may evade."""

    def __init__(self, settings: PlannerSettings = SETTINGS) -> None:
        self.settings, self.solver, self.stream = settings, OneEvasionPath(), Stream(CERTIFIER)
        self.asked: dict[str, PastSearch] = {}
        self.reach = 0.0
        standing = JointReference.standing(ROBOT.ready, np.zeros(2))
        self.stream.stand(CERTIFIER.judge(standing, CERTIFIER.certify(standing, Obstacles.none(), 1.0)), 0.0)

    def plan(
        self, now: float, obstacles: Obstacles, verdict: Verdict = NO_PATH, handover_deadline: Deadline = NEVER
    ) -> Plan | None:
        turn = self.evasion.propose(self.turn(self.situation(now, obstacles, handover_deadline), verdict))
        self.asked = turn.memory.past_searches
        return None if turn.step is None else self.stream.commit(turn.step, now)

    @property
    def evasion(self) -> Evasion:
        return Evasion(self.solver.evade, self.solver.evade_displaced)

    def turn(self, situation: Situation, verdict: Refusal = NO_PATH) -> Turn:
        memory, guarded = AttemptMemory(past_searches=self.asked), SimpleNamespace(solver=self.solver)
        return Turn(guarded, situation, None, QUERY, QUERY, memory, verdict=verdict)

    def is_due(self, situation: Situation) -> bool:
        return self.evasion.takes_the_tick(self.turn(situation))

    def go_on_evading(self, now: float, obstacles: Obstacles) -> Plan | None:
        step = self.situation(now, obstacles).go_on_evading()
        return None if step is None else step.plan

    def situation(
        self, now: float, obstacles: Obstacles, handover_deadline: Deadline = NEVER, deadline: Deadline = NEVER
    ) -> Situation:
        stream = self.stream
        self.solver.passed = 0.0
        return Situation(
            self.settings, LIMITS, CERTIFIER, stream.played, stream.followed, now, obstacles, deadline,
            handover_deadline=handover_deadline, reach=self.reach,
        )  # fmt: skip


def coming(after: float, time: float = 0.0) -> Obstacles:
    """A sphere that meets the tool of the standing arm so many seconds after a time [s], from below."""
    hand, _ = ROBOT.forward(ROBOT.ready)
    velocity = np.array([[0.0, 0.0, 0.2]])
    return Obstacles.of_spheres(hand[None] - after * velocity, np.array([0.03]), velocity, time)


def test_an_arm_evades_what_is_coming_and_says_so() -> None:
    arm = Arm()
    situation = arm.situation(0.0, coming(1.0))
    step = arm.evasion.propose(arm.turn(situation)).step
    assert situation.mode(step) is Mode.EVADING
    plan = arm.stream.commit(step, 0.0)
    assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
    assert plan.verdict.reason == "no path; evading what is coming"
    assert plan.verdict.figures.clearance == 0.01
    assert arm.stream.followed.purpose is Purpose.EVASION
    assert arm.stream.commanded_state(arm.stream.played.end)[0][0] == pytest.approx(ROBOT.ready[0] + 0.6)


def test_nothing_is_searched_where_nothing_comes_or_something_else_is_wrong() -> None:
    passing = replace(coming(1.0), centres=coming(1.0).centres + [0.0, 1.0, 0.0])
    standing = replace(coming(0.0), velocities=np.zeros((1, 3)))
    late = Refusal(VerdictCode.DEADLINE_MISSED, "out of time")
    for obstacles, verdict in ((passing, NO_PATH), (standing, NO_PATH), (coming(1.0), late)):
        arm = Arm()
        assert arm.plan(0.0, obstacles, verdict) is None
        assert not arm.solver.asked
    blind = Arm(replace(SETTINGS, avoidance=False))
    assert blind.plan(0.0, coming(1.0)) is None
    assert not blind.solver.asked


def test_what_comes_later_than_is_predicted_is_left_to_later_ticks() -> None:
    """The control: sooner than that."""
    for after, asked in ((0.8 * SETTINGS.prediction, 1), (2.0 * SETTINGS.prediction, 0)):
        arm = Arm()
        arm.plan(0.0, coming(after))
        assert arm.solver.asked == asked


def test_where_no_path_was_found_none_is_searched_in_every_tick() -> None:
    """Whether one is searched is known before, so that little else is done in the same tick."""
    arm = Arm()
    arm.solver.found = False
    for now in (0.0, 0.01, 0.5 * SEARCH_PERIOD, SEARCH_PERIOD):
        searched, before = arm.is_due(arm.situation(now, coming(1.0))), arm.solver.asked
        assert arm.plan(now, coming(1.0)) is None
        assert searched is (arm.solver.asked > before)
        assert arm.solver.asked == (2 if now == SEARCH_PERIOD else 1)
    arm.asked, arm.solver.found = {}, True
    assert arm.plan(SEARCH_PERIOD, coming(1.0)).trajectory is not None


def test_beside_the_graph_an_arm_evades_what_is_near_where_it_may_and_must() -> None:
    """The controls: it may not leave what was demonstrated, what comes is not that near, or the graph has a place."""
    soon = EVASION_DISPLACED_WITHIN
    cases = ((0.5 * soon, 0.25, False, True), (0.5 * soon, 0.0, False, False), (2.0 * soon, 0.25, False, False),
             (0.5 * soon, 0.25, True, False))  # fmt: skip
    for after, reach, found, beside in cases:
        arm = Arm()
        arm.reach, arm.solver.found, arm.solver.found_beside = reach, found, True
        plan = arm.plan(0.0, coming(after))
        assert arm.solver.asked_beside == beside
        assert (plan is not None) is (beside or found)


def test_an_arm_goes_on_evading_beside_the_graph_while_nothing_comes_near() -> None:
    """It comes to where the evasion path ends, but later; the control: at once."""
    arm = Arm()
    arm.reach, arm.solver.found, arm.solver.found_beside = 0.25, False, True
    arm.plan(0.0, coming(0.5 * EVASION_DISPLACED_WITHIN))
    hand, _ = ROBOT.forward(arm.stream.commanded_state(arm.stream.played.end)[0])
    velocity = np.array([[0.0, 0.0, 0.2]])
    for after, asked in ((1.5, 1), (0.3, 2)):
        meeting = Obstacles.of_spheres(hand - (0.1 + after) * velocity, np.array([0.03]), velocity, 0.1)
        arm.asked = {}
        plan = arm.plan(0.1, meeting)
        assert arm.solver.asked_beside == asked
        assert (plan.trajectory is None) is (asked == 1)


def test_where_what_comes_late_cannot_be_evaded_what_comes_soon_is_evaded_at_once_all_the_same() -> None:
    """What comes late is not searched for in every tick meanwhile."""
    arm = Arm()
    arm.reach, arm.solver.found = 0.25, False
    for now in (0.0, 0.01, 0.02):
        assert arm.plan(now, coming(1.0, now)) is None
    assert (arm.solver.asked, arm.solver.asked_beside) == (1, 0)
    arm.plan(0.03, coming(0.3, 0.03))
    assert (arm.solver.asked, arm.solver.asked_beside) == (1, 1)


def test_a_search_that_ends_late_is_over_and_the_next_tick_searches_beside_the_graph() -> None:
    """However slow the machine: otherwise every tick would search the graph anew, and nothing beside it."""
    arm = Arm()
    arm.solver, arm.reach = OneEvasionPath(found=False), 0.2
    deadline = Deadline(0.5, lambda: arm.solver.passed)
    for tick in range(3):
        turn = arm.evasion.propose(arm.turn(arm.situation(0.01 * tick, coming(0.4), deadline=deadline)))
        arm.asked = turn.memory.past_searches
        assert (arm.solver.asked, arm.solver.asked_beside) == (1, min(tick, 1))


def test_no_evasion_path_is_searched_where_no_time_is_left_or_nothing_comes() -> None:
    """The control: in time, where something comes, one is."""
    arm, passed = Arm(), Deadline(-np.inf)
    assert arm.is_due(arm.situation(0.0, coming(1.0)))
    assert not arm.is_due(arm.situation(0.0, coming(1.0), handover_deadline=passed))
    assert not arm.is_due(replace(arm.situation(0.0, coming(1.0)), deadline=passed))
    assert not arm.is_due(arm.situation(0.0, coming(3.0 * SETTINGS.prediction)))


def test_an_arm_goes_on_evading_while_that_is_free() -> None:
    """Nothing new is handed out, but no stop either."""
    arm = Arm()
    begun = arm.plan(0.0, coming(1.0))
    plan = arm.plan(0.1, coming(0.9, 0.1))
    assert plan.trajectory is None
    assert plan.verdict.reason == begun.verdict.reason
    assert arm.solver.asked == 1


def test_out_of_time_an_arm_goes_on_evading_while_that_is_free_and_it_can_stop(monkeypatch) -> None:
    """The controls: it does not evade, it is met where that leads, it could not stop, or nothing moves."""
    arm, obstacles = Arm(), coming(0.9, 0.1)
    assert arm.go_on_evading(0.1, obstacles) is None
    arm.plan(0.0, coming(1.0))
    stated = arm.stream.followed.verdict.reason
    plan = arm.go_on_evading(0.1, obstacles)
    assert plan.trajectory is None
    assert plan.verdict.reason == stated
    assert plan.verdict.figures.clearance > 0.0
    hand, _ = ROBOT.forward(arm.stream.commanded_state(arm.stream.played.end)[0])
    meeting = replace(obstacles, centres=obstacles.centres + hand - ROBOT.forward(ROBOT.ready)[0])
    assert arm.go_on_evading(0.1, meeting) is None
    assert arm.go_on_evading(0.1, replace(obstacles, velocities=np.zeros((1, 3)))) is None
    monkeypatch.setattr(Situation, "may_follow", lambda *_: False)
    assert arm.go_on_evading(0.1, obstacles) is None
    assert arm.solver.asked == 1
