"""From a path through the graph to a motion: it begins where the arm is as it moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.certification.certificate import ArmCertifier
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.motion.path_timer import JointCurve, PathTimer, TimedPath, meet_ends
from geodesic_motion_ros.motion.plan import MotionState
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.search import LatentPath, cheapest_path
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool, ToolLimits
from geodesic_motion_studies.benchmarks.engine import mark
from geodesic_motion_studies.benchmarks.stages import SkillBench


@pytest.fixture(scope="module")
def bench(reach_skill) -> SkillBench:
    return SkillBench(reach_skill)


@pytest.fixture(scope="module")
def path(bench: SkillBench) -> LatentPath:
    free = mark(bench.problem, Obstacles.none())
    found = cheapest_path(bench.planner.graph, bench.query, bench.query.start_latent, free, 0.0)
    assert isinstance(found, LatentPath)
    return found


@pytest.fixture
def timer(bench: SkillBench) -> PathTimer:
    planner = bench.planner
    tool = LimitedTool(planner.robot, planner.settings.tool_limits(ToolLimits()))
    certifier = ArmCertifier(planner.robot, planner.collision)
    return PathTimer(planner.graph, 1.0, planner.settings, planner.limits, tool, certifier)


def resting(bench: SkillBench) -> MotionState:
    still = np.zeros(len(bench.query.start))
    return MotionState(0.0, bench.query.start, still, still, None)


def timed_path(
    timer: PathTimer, bench: SkillBench, state: MotionState, path: LatentPath, to_goal=True, longest=math.inf
):
    """Return the motion along a path."""
    return timer.time_curve(state, timer.joint_curve(bench.query, state.position, path, to_goal), longest, to_goal)


def in_motion(timed: TimedPath, time: float) -> MotionState:
    return MotionState(time, *timed.reference.sample(time), timed.reference.latent_at(time))


def test_a_motion_begins_in_the_state_that_it_takes_over_and_ends_at_rest_at_the_goal(bench, timer, path) -> None:
    first = timed_path(timer, bench, resting(bench), path)
    state = in_motion(first, 0.1)
    second = timed_path(timer, bench, state, path)
    for timed, begun in ((first, resting(bench)), (second, state)):
        reference = timed.reference
        assert reference.keeps(bench.planner.limits)
        begin, end = reference.sample(0.0), reference.sample(reference.duration)
        for found, expected in zip(begin, (begun.position, begun.velocity, begun.acceleration), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-9)
        np.testing.assert_allclose(end, [bench.query.goal, *np.zeros((2, len(bench.query.goal)))], atol=1e-9)


def test_a_motion_to_the_goal_is_as_fast_as_was_shown_and_one_that_evades_as_fast_as_can_be(bench, path) -> None:
    """The demonstrations took 40 s, most of them for the second half."""
    planner = bench.planner
    tool = LimitedTool(planner.robot, planner.settings.tool_limits(ToolLimits()))
    parts = planner.graph, 1.0, planner.settings, planner.limits, tool, ArmCertifier(planner.robot, planner.collision)
    pace = np.interp(np.linspace(0.0, 1.0, 100), [0.0, 0.5, 1.0], [0.0, 10.0, 40.0])
    halves = {}
    for shown in (None, pace):
        for to_goal in (True, False):
            timed = timed_path(PathTimer(*parts, shown), bench, resting(bench), path, to_goal)
            progress, _ = planner.graph.progress_map(timed.reference.latent)
            first = float(np.interp(0.5, np.maximum.accumulate(progress), timed.reference.times))
            halves[shown is not None, to_goal] = first, timed.reference.duration - first
    assert halves[True, False] == halves[False, False]
    # What the progress of the ends lacks to 0 and 1 is not waited for.
    first, second = halves[True, True]
    assert max(halves[False, True]) < 5.0 < 8.0 < first < 12.0
    assert 24.0 < second < 34.0


def test_a_path_that_does_not_lead_to_the_goal_ends_where_it_ends(bench, timer, path) -> None:
    """The control: the same half of a path, moved so that it ends at the goal."""
    half = replace(path, polyline=path.polyline[: len(path.polyline) // 2])
    ends = []
    for to_goal in (False, True):
        found = timer.joint_curve(bench.query, bench.query.start, half, to_goal)
        assert isinstance(found, JointCurve)
        ends.append(found.configurations[-1])
    assert np.linalg.norm(ends[0] - bench.query.goal) > 0.1
    np.testing.assert_allclose(ends[1], bench.query.goal, atol=1e-12)


def test_what_takes_longer_than_would_be_a_gain_is_not_timed_and_says_so(bench, timer, path) -> None:
    whole = timed_path(timer, bench, resting(bench), path)
    short = timed_path(timer, bench, resting(bench), path, longest=0.2 * whole.reference.duration)
    assert isinstance(short, Refusal)
    assert "no gain" in short.reason
    long = timed_path(timer, bench, resting(bench), path, longest=2.0 * whole.reference.duration)
    np.testing.assert_array_equal(long.reference.positions, whole.reference.positions)


def test_an_arm_that_stands_is_not_asked_to_stop_first(bench, timer) -> None:
    """What takes a joint past its limit has no timing, from rest nor from a motion, which alone is stopped first."""
    state, upper = resting(bench), bench.planner.limits.upper[3]
    curve = np.linspace(state.position, state.position, 30)
    curve[:, 3] = np.linspace(state.position[3], upper + 0.1, 30)
    latent = np.zeros((30, 3))
    standing = timer.time_curve(state, JointCurve(curve, latent, 0.0))
    assert isinstance(standing, Refusal)
    joint = bench.planner.robot.joint_names[3]
    assert standing.reason == f"the path to the goal leads beyond the limit of joint '{joint}', by 0.100 rad"
    moves = replace(state, velocity=np.full(len(state.position), 0.1))
    moving = timer.time_curve(moves, JointCurve(curve, latent, 0.0))
    assert isinstance(moving, Refusal)
    assert moving.reason.startswith("stopping first: ")
    # the control: the same path, as far as the joint goes
    curve[:, 3] = np.linspace(state.position[3], upper - 0.1, 30)
    assert isinstance(timer.time_curve(state, JointCurve(curve, latent, 0.0)), TimedPath)


def test_a_curve_is_moved_onto_its_ends_and_says_by_how_much() -> None:
    curve = np.linspace([0.0, 0.0], [1.0, 0.0], 11)
    moved = meet_ends(curve, curve, np.array([0.0, 0.1]), np.array([1.0, -0.3]))
    np.testing.assert_allclose(moved.configurations[[0, 5, -1]], [[0.0, 0.1], [0.5, -0.1], [1.0, -0.3]], atol=1e-12)
    assert moved.correction == pytest.approx(0.3)
    np.testing.assert_array_equal(meet_ends(curve, curve, curve[0], curve[-1]).configurations, curve)
