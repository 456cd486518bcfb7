"""PoseGivingWay: a tool goes aside where something comes to it, there alone, and does not look for that all the time.

That it is not touched then is tested with the planner (`planner/`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np

from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.pose_giving_way import PoseGivingWay
from geodesic_motion_ros.pose_solver import AT_REST, Plan, Scene
from geodesic_motion_ros.query import Pose
from geodesic_motion_ros.sidestep import SOON
from geodesic_motion_ros.task_frame import TaskFrame
from geodesic_motion_ros.verdict import Verdict, VerdictCode

SETTINGS = PlannerSettings()
NO_WAY = Verdict(VerdictCode.NO_FEASIBLE_PATH, "no way")
ASIDE, LEFT, STOP = SimpleNamespace(), SimpleNamespace(), SimpleNamespace()


@dataclass
class OneWayAside:
    """In the place of a PoseSolver: whatever is not aside is touched after a time [s]; how long [s] was asked for."""

    touched_after: float
    found: bool = True
    asked: list[float] = field(default_factory=list)
    sidesteps: list[float] = field(default_factory=list)

    def clearance_until(self, reference: object, start: Pose, obstacles: Obstacles, horizon: float) -> float:
        return -0.01 if reference is not ASIDE and horizon >= self.touched_after else 0.02

    def aside(self, *arguments: object) -> Plan | None:
        self.asked.append(arguments[5])
        found = self.found and arguments[6](ASIDE)
        return Plan(ASIDE, Verdict(VerdictCode.OK, clearance=0.01)) if found else None


    def sidestep(self, *arguments: object) -> Plan | None:
        self.sidesteps.append(arguments[3])
        return Plan(ASIDE, Verdict(VerdictCode.OK, clearance=0.01)) if arguments[5](ASIDE) else None


@dataclass
class Gone:
    """In the place of a PoseStream: whether what is gone leads aside, and what leaves the tool a stop."""

    gives_way: bool = False
    leaving_a_stop: tuple[object, ...] = (ASIDE, LEFT)
    just_leaving_one: tuple[object, ...] = ()
    followed: object = field(default_factory=lambda: SimpleNamespace(verdict=NO_WAY))

    def leaves_a_stop(self, reference: object, start: Pose, obstacles: Obstacles, share: float = 1.0) -> bool:
        return reference in self.leaving_a_stop or (share < 1.0 and reference in self.just_leaving_one)


def tool(
    touched_after: float, settings: PlannerSettings = SETTINGS, stream: Gone | None = None
) -> tuple[PoseGivingWay, OneWayAside]:
    solver = OneWayAside(touched_after)
    return PoseGivingWay(settings, solver, stream or Gone(), lambda _: True), solver


def asked(
    giving_way: PoseGivingWay,
    now: float = 0.0,
    speed: float = 0.1,
    verdict: Verdict = NO_WAY,
    stop: object = None,
    going: object = None,
    deadline: Deadline = NEVER,
    moves: float = 0.0,
) -> Plan | None:
    """What is answered at a time [s] among one sphere with a speed [m/s]."""
    sphere = Obstacles.of_spheres(np.ones((1, 3)), np.array([0.03]), np.array([[speed, 0.0, 0.0]]), now)
    scene, start = Scene.of(TaskFrame.identity(), sphere), Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    motion = replace(AT_REST, speed=moves, rest=going)
    return giving_way.plan(None, start, np.zeros(2), scene, motion, verdict, stop, deadline)


def test_a_tool_gives_way_to_what_is_coming_and_says_so() -> None:
    for stop in (None, STOP):
        giving_way, _ = tool(1.0)
        plan = asked(giving_way, stop=stop)
        assert plan.reference is ASIDE
        assert plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH
        assert plan.verdict.reason == "no way; giving way to what is coming"
        assert plan.verdict.clearance == 0.01


def test_nothing_is_looked_for_where_nothing_comes_or_something_else_is_wrong() -> None:
    late = Verdict(VerdictCode.DEADLINE_MISSED, "out of time")
    blind = replace(SETTINGS, avoidance=False)
    for touched_after, speed, verdict, settings in (
        (np.inf, 0.1, NO_WAY, SETTINGS), (1.0, 0.0, NO_WAY, SETTINGS), (1.0, 0.1, late, SETTINGS),
        (1.0, 0.1, NO_WAY, blind),
    ):  # fmt: skip
        giving_way, solver = tool(touched_after, settings)
        assert asked(giving_way, speed=speed, verdict=verdict) is None
        assert not solver.asked


def test_what_comes_late_is_seen_beyond_the_time_of_a_stop() -> None:
    """The control: what comes later still is left to later ticks."""
    prediction = SETTINGS.prediction
    for after, looked_for in ((1.8 * prediction, [2.0 * prediction]), (3.0 * prediction, [])):
        giving_way, solver = tool(after)
        asked(giving_way)
        assert solver.asked == looked_for


def test_a_way_that_was_looked_for_in_vain_is_not_looked_for_in_every_tick() -> None:
    giving_way, solver = tool(1.0)
    solver.found = False
    for now in (0.0, 0.01, 0.04):
        assert asked(giving_way, now) is None
    assert solver.asked == [2.0 * SETTINGS.prediction, SETTINGS.prediction]
    asked(giving_way, 0.05)
    assert len(solver.asked) == 4
    asked(giving_way, 0.11, deadline=Deadline(-np.inf))
    assert len(solver.asked) == 4
    solver.found = True
    assert asked(giving_way, 0.06) is None
    giving_way.forget()
    assert asked(giving_way, 0.06) is not None


def test_a_tool_that_gives_way_goes_on_doing_so_while_that_is_free_and_leaves_it_a_stop() -> None:
    giving_way, solver = tool(1.0, stream=Gone(gives_way=True))
    assert asked(giving_way, going=ASIDE).reference is ASIDE
    assert not solver.asked
    assert asked(giving_way, going=LEFT).reference is ASIDE
    assert len(solver.asked) == 1
    giving_way, solver = tool(1.0, stream=Gone(True, leaving_a_stop=()))
    assert asked(giving_way, going=ASIDE) is None
    assert solver.asked


def test_a_tool_that_stops_where_nothing_comes_stops() -> None:
    giving_way, solver = tool(1.0)
    assert asked(giving_way, stop=ASIDE, going=LEFT) is None
    assert not solver.asked


def test_a_way_aside_that_leaves_no_stop_is_not_gone() -> None:
    giving_way, solver = tool(1.0, stream=Gone(leaving_a_stop=()))
    assert asked(giving_way) is None
    assert solver.asked


def test_a_tool_that_is_about_to_be_touched_where_it_stands_and_finds_no_way_aside_steps_aside() -> None:
    giving_way, solver = tool(0.5 * SOON)
    solver.found = False
    assert asked(giving_way).reference is ASIDE
    assert (len(solver.asked), solver.sidesteps) == (2, [SETTINGS.prediction])
    # In vain is not every tick, as with ways aside.
    giving_way, solver = tool(0.5 * SOON, stream=Gone(leaving_a_stop=()))
    for now in (0.0, 0.01, 0.04):
        assert asked(giving_way, now) is None
    assert solver.sidesteps == [SETTINGS.prediction, SOON]
    asked(giving_way, 0.05)
    assert len(solver.sidesteps) == 4
    # The controls: it is touched later, there is another way aside, it moves.
    for touched_after, found, moves in ((2.0 * SOON, False, 0.0), (0.5 * SOON, True, 0.0), (0.5 * SOON, False, 0.1)):
        giving_way, solver = tool(touched_after)
        solver.found = found
        asked(giving_way, moves=moves)
        assert not solver.sidesteps


def test_a_sidestep_is_gone_on_while_it_is_free_soon_and_leaves_just_a_stop() -> None:
    for just, goes_on in (((LEFT,), True), ((), False)):
        stream = Gone(True, leaving_a_stop=(), just_leaving_one=just)
        giving_way, solver = tool(2.0 * SOON, stream=stream)
        solver.found = False
        plan = asked(giving_way, stop=STOP, going=LEFT, moves=0.1)
        assert (plan is not None and plan.reference is LEFT) is goes_on
    # The controls: it is met before that; the stop is free for longer.
    stream = Gone(True, (), (LEFT,))
    assert asked(tool(0.5 * SOON, stream=stream)[0], stop=STOP, going=LEFT, moves=0.1) is None
    giving_way, solver = tool(2.0 * SOON, stream=stream)
    solver.found = False
    assert asked(giving_way, stop=ASIDE, going=LEFT, moves=0.1) is None


def test_out_of_time_a_tool_goes_on_giving_way_while_that_is_free_and_leaves_it_a_stop() -> None:
    """The controls: what it follows is met, leaves no stop, does not lead aside, or is not known; nothing moves."""
    start = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    for going, stream, speed, goes_on in (
        (ASIDE, Gone(True), 0.1, True), (ASIDE, Gone(True, (), (ASIDE,)), 0.1, True),
        (LEFT, Gone(True), 0.1, False), (ASIDE, Gone(True, ()), 0.1, False),
        (ASIDE, Gone(False), 0.1, False), (None, Gone(True), 0.1, False), (ASIDE, Gone(True), 0.0, False),
    ):  # fmt: skip
        giving_way, solver = tool(0.5 * SOON, stream=stream)
        sphere = Obstacles.of_spheres(np.ones((1, 3)), np.array([0.03]), np.array([[speed, 0.0, 0.0]]), 0.0)
        scene = Scene.of(TaskFrame.identity(), sphere)
        plan = giving_way.gone_on(start, replace(AT_REST, rest=going), scene)
        assert (plan is not None) is goes_on
        assert not solver.asked
        if goes_on:
            assert plan == Plan(ASIDE, replace(NO_WAY, clearance=0.02))
