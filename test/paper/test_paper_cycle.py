"""Cycles of the paper's planner: commands without jumps, rest where they must, one verdict for what is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput
from geodesic_motion_ros.obstacles.tracker import ObstacleSet
from geodesic_motion_ros.paper.follower import STIFFNESS
from geodesic_motion_ros.paper.paper_cycle import PaperCycle
from geodesic_motion_ros.paper.paper_planner import CAUTION, PaperPlanner, PaperSettings
from geodesic_motion_ros.paper.streams import PoseStream, TrajectoryStream
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference

PERIOD, LATENCY = 0.01, 0.03
NOTHING = ObstacleSet(np.zeros((0, 3)), np.zeros(0), (), 0, np.zeros((0, 3)), np.zeros(0), np.zeros(0))
OFFSETS = 0.1, 0.5
#: Cycles after which the sphere has left: the paper's path goes round it on this side and on that, for as long as it
#: moves.
LEFT = 750
#: Cycles that the mass has to come to rest after the leading point: e^-35 of what it was behind is left.
SETTLED = 400


@pytest.fixture(scope="module", params=["paper_pouring", "paper_reach"])
def planner(request) -> PaperPlanner:
    skill = Skill.load(request.param)
    shape, strength = ((16, 16, 16), 1e3) if skill.space == "joint" else ((40, 40), 1e9)
    return PaperPlanner(skill, PaperSettings(strength), shape)


@pytest.fixture
def arm(planner: PaperPlanner) -> np.ndarray:
    """Where a demonstration begins: a configuration."""
    code = planner.skill.codes[0, :1]
    if planner.skill.space == "joint":
        return planner.skill.decoder.configurations(code)[0]
    decoded = planner.skill.decoder.decode(code)
    return solve(planner.robot, decoded.positions[0], normalise(decoded.quaternions[0]))


@pytest.fixture
def cycle(planner: PaperPlanner) -> PaperCycle:
    planner.clear_goal()
    poses = planner.skill.space == "task"
    stream = PoseStream(planner, (0.05, 0.35)) if poses else TrajectoryStream(planner, 0.1, LATENCY)
    return PaperCycle(planner, stream, 0.25, 1.0, OFFSETS, clock=lambda: 0.0)


@pytest.fixture
def inputs(planner: PaperPlanner, arm: np.ndarray) -> CycleInputs:
    goal = GoalRequest(Pose(*np.split(planner.skill.goal_pose, [3])))
    return CycleInputs(measured=arm, state_age=0.0, goal=goal, goal_number=1, obstacles=NOTHING)


class Arm:
    """Is where it was sent, on time; its place (p,) is what is commanded, a pose in one piece or a configuration."""

    def __init__(self, planner: PaperPlanner, joints: np.ndarray) -> None:
        self._robot, self._poses = planner.robot, planner.skill.space == "task"
        self.joints = joints
        self.place = np.concatenate(self._robot.forward(joints)) if self._poses else joints
        self._playing: list[tuple[JointReference, float]] = []

    def obey(self, output: CycleOutput, now: float) -> None:
        if output.commanded is not None:
            self.place = np.concatenate(output.commanded)
            self.joints = solve(self._robot, *output.commanded, start=self.joints)
        if output.trajectory is not None:
            self._playing.append(output.trajectory)
        begun = [(reference, begin) for reference, begin in self._playing if begin <= now + 1e-12]
        if begun:
            self.place = self.joints = begun[-1][0].sample(now - begun[-1][1])[0]


def played(
    cycle: PaperCycle, inputs: CycleInputs, arm: np.ndarray, count: int, change=lambda number, inputs: inputs
) -> Iterator[tuple[np.ndarray, CycleOutput]]:
    """Places and outputs of cycles one after the other; `change` makes the inputs of each."""
    follower = Arm(cycle.planner, arm)
    for number in range(count):
        now = PERIOD * number
        inputs = dataclasses.replace(change(number, inputs), measured=follower.joints, now=now, heard=now)
        output = cycle.run(inputs, PERIOD)
        follower.obey(output, now)
        yield follower.place.copy(), output


def moving_sphere(planner: PaperPlanner):
    """A sphere that goes to and fro across the middle between start and goal, seen at every third cycle until LEFT."""
    middle = 0.5 * (planner.skill.start_pose[:3] + planner.skill.goal_pose[:3])

    def change(number: int, inputs: CycleInputs) -> CycleInputs:
        centre = middle + 0.15 * np.sin(0.02 * number) * np.array([0.3, 0.2, 1.0])
        seen = dataclasses.replace(
            NOTHING, centres=centre[None], radii=np.array([0.06]), labels=("",), version=1 + number // 3,
            velocities=np.zeros((1, 3)), velocity_errors=np.zeros(1), times=np.array([PERIOD * number]),
        )  # fmt: skip
        seen = dataclasses.replace(NOTHING, version=1 + LEFT) if number >= LEFT else seen
        return dataclasses.replace(inputs, obstacles=seen) if number % 3 == 0 else inputs

    return change


def test_a_goal_is_reached_after_a_moving_sphere_without_a_jump(cycle, inputs, arm, planner) -> None:
    places, outputs, rested = [], [], 0
    for place, output in played(cycle, inputs, arm, 4000, moving_sphere(planner)):
        places.append(place)
        outputs.append(output)
        rested = rested + 1 if output.time_to_goal == 0.0 else 0
        if rested == SETTLED:
            break
    assert {output.verdict.code for output in outputs[2:]} == {VerdictCode.OK}
    assert all(output.verdict.reason.startswith(CAUTION) for output in outputs[2:])
    rates = np.diff(np.array(places), axis=0) / PERIOD
    # Followers of a point that is d away and v slow are accelerated by w^2 d + 2 w v at most: d is half a metre, or a
    # radian, at most.
    largest = STIFFNESS**2 * 1.0 + 2.0 * STIFFNESS * np.abs(rates).max()
    assert np.abs(np.diff(rates, axis=0)).max() <= largest * PERIOD
    assert rested == SETTLED
    assert np.abs(rates[-50:]).max() < 1e-3
    reached = places[-1] if planner.skill.space == "task" else np.concatenate(planner.robot.forward(places[-1]))
    np.testing.assert_allclose(reached[:3], planner.skill.goal_pose[:3], atol=OFFSETS[0])


def test_without_a_goal_and_on_hold_the_arm_rests(cycle, inputs, arm) -> None:
    def stopped_between(number: int, inputs: CycleInputs) -> CycleInputs:
        return dataclasses.replace(inputs, goal_number=1 if number >= 20 else 0, hold=100 <= number < 250)

    places, outputs = map(np.array, zip(*played(cycle, inputs, arm, 400, stopped_between), strict=True))
    np.testing.assert_allclose(places[:20], np.tile(places[0], (20, 1)), atol=1e-9)
    assert outputs[150].verdict.code is VerdictCode.HOLD_REQUESTED
    assert np.abs(places[200:249] - places[200]).max() < 1e-3
    assert np.abs(places[100] - places[0]).max() > 0.02
    assert np.abs(places[-1] - places[249]).max() > 0.02


def test_a_goal_that_the_skill_does_not_know_is_refused(cycle, inputs, arm) -> None:
    far = GoalRequest(Pose(inputs.goal.pose.position + np.array([0.0, 0.0, 0.7]), inputs.goal.pose.quaternion))
    *_, (_, output) = played(cycle, dataclasses.replace(inputs, goal=far), arm, 3)
    assert output.goal_verdict.code is VerdictCode.GOAL_OUT_OF_SUPPORT
    assert output.is_goal_refused


def test_an_arm_that_was_moved_loses_the_goal_and_is_not_pulled_back(cycle, inputs, arm) -> None:
    places = [place for place, _ in played(cycle, inputs, arm, 100)]
    poses = cycle.planner.skill.space == "task"
    joints = solve(cycle.planner.robot, *np.split(places[-1], [3]), start=arm) if poses else places[-1]
    moved = joints + np.concatenate([[0.3], np.zeros(6)])
    now = PERIOD * 100
    output = cycle.run(dataclasses.replace(inputs, measured=moved, now=now, heard=now), PERIOD)
    assert output.verdict.code is VerdictCode.BAD_INPUT
    assert output.commanded is None
    assert output.goal_verdict.code is VerdictCode.NO_GOAL
    if output.trajectory is not None:
        reference, begin = output.trajectory
        assert begin >= now + LATENCY - 1e-9
        np.testing.assert_allclose(reference.positions, np.tile(moved, (len(reference.positions), 1)), atol=1e-9)


def test_a_task_frame_elsewhere_is_refused(cycle, inputs, arm) -> None:
    frame = np.array([0.1, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])
    outputs = [output for _, output in played(cycle, dataclasses.replace(inputs, task_frame=frame), arm, 5)]
    assert outputs[-1].verdict.code is VerdictCode.BAD_INPUT
    assert "task frame" in outputs[-1].verdict.reason


def test_what_the_hand_holds_counts_with_poses_and_is_refused_with_joints(cycle, inputs, arm, planner) -> None:
    bottle = HeldObject("bottle", "cylinder", (0.03, 0.2), (0.0, 0.0, 0.2))
    *_, (_, output) = played(cycle, dataclasses.replace(inputs, held=(bottle,)), arm, 5)
    if planner.skill.space == "joint":
        assert output.verdict.code is VerdictCode.BAD_INPUT
        assert "held object" in output.verdict.reason
    else:
        assert output.verdict.ok
        assert planner.held == (bottle,)
    *_, (_, output) = played(cycle, inputs, arm, 5)
    assert output.verdict.ok
    assert planner.held == ()
