"""The action `move_to_goal`: accepted, fed back, cancelled in motion, superseded, ended by a block and by a restart."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from bench import Bench, pose_of
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState

from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

MoveToGoal = pytest.importorskip("geodesic_motion_msgs.action", reason="make ros-extras builds it").MoveToGoal
SUCCEEDED, CANCELED, ABORTED = (
    GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED
)  # fmt: skip


class Client:
    """An action client of the bench's probe: sends goals, and keeps what it hears of each."""

    def __init__(self, bench: Bench) -> None:
        self.bench, self.client = bench, ActionClient(bench.probe, MoveToGoal, "move_to_goal")

    def send(self, **goal: Any) -> Sent:
        self.bench.poll(self.client.server_is_ready, "the action server")
        return Sent(self.bench, self.client, MoveToGoal.Goal(**goal))


class Sent:
    """A goal that was accepted."""

    def __init__(self, bench: Bench, client: ActionClient, goal: Any) -> None:
        self.bench, self.feedback = bench, []
        future = client.send_goal_async(goal, feedback_callback=lambda heard: self.feedback.append(heard.feedback))
        bench.wait(future.done, "an answer to the goal")
        self.handle = future.result()
        assert self.handle.accepted
        self._result = self.handle.get_result_async()

    def end(self) -> tuple[int, str, str]:
        """How it ends: status, code and reason."""
        self.bench.wait(self._result.done, "the end of the goal")
        ended = self._result.result()
        return ended.status, ended.result.code, ended.result.reason

    @property
    def is_over(self) -> bool:
        return self._result.done()

    def cancel(self) -> None:
        self.bench.wait(self.handle.cancel_goal_async().done, "an answer to the cancel request")


@pytest.fixture
def client(ready: Bench) -> Iterator[Client]:
    client = Client(ready)
    yield client
    client.client.destroy()


@pytest.fixture
def in_motion(client: Client, ready: Bench, skill: Skill) -> Sent:
    """The skill's goal, on whose path the arm moves."""
    sent = client.send(pose=pose_of(skill.goal_pose))
    ready.wait(lambda: float(ready.status()["speed"]) > 0.05, "motion")
    return sent


def test_a_goal_is_fed_back_until_the_arm_rests_there(in_motion, ready, skill):
    assert in_motion.end()[:2] == (SUCCEEDED, "OK")
    assert ready.at_goal()
    distances = [heard.distance for heard in in_motion.feedback]
    assert "OK" in {heard.code for heard in in_motion.feedback}
    assert np.nanmax(distances) > 0.1 > np.nanmin(distances)
    assert max(np.nan_to_num(heard.clearance, nan=0.0) for heard in in_motion.feedback) > 0.0


def test_a_goal_in_joints(client, skill):
    joints = solve(Robot.named("panda"), skill.goal_pose[:3], skill.goal_pose[3:])
    names = list(Robot.named("panda").joint_names)
    sent = client.send(joints=JointState(name=names, position=joints.tolist()))
    assert sent.end()[:2] == (SUCCEEDED, "OK")
    assert sent.feedback[0].distance > sent.feedback[-1].distance


def test_cancelled_in_motion_the_arm_stops_and_the_goal_is_dropped(in_motion, ready):
    in_motion.cancel()
    assert in_motion.end() == (CANCELED, "CANCELLED", "the arm rests")
    status = ready.wait_for_code("NO_GOAL", "its client cancelled it")
    assert float(status["speed"]) == 0.0
    assert not ready.at_goal()


def test_a_newer_goal_takes_its_place_by_action_and_by_topic(in_motion, client, ready, skill):
    newer = client.send(pose=pose_of(skill.start_pose))
    assert in_motion.end()[:2] == (ABORTED, "SUPERSEDED")
    assert not newer.is_over
    ready.send_goal(skill.goal_pose)
    assert newer.end()[:2] == (ABORTED, "SUPERSEDED")
    ready.wait(ready.at_goal, "the arm at the goal of the topic")


def test_a_goal_that_is_refused_ends_with_the_reason_and_the_one_before_goes_on(in_motion, client, skill):
    far = skill.goal_pose + np.array([5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    status, code, reason = client.send(pose=pose_of(far)).end()
    assert (status, code) == (ABORTED, "GOAL_OUT_OF_SUPPORT")
    assert reason
    status, code, reason = client.send(pose=pose_of(skill.goal_pose, "nowhere")).end()
    assert (status, code) == (ABORTED, "BAD_INPUT")
    assert "nowhere" in reason
    assert in_motion.end()[:2] == (SUCCEEDED, "OK")


def test_a_block_that_lasts_ends_the_goal_with_the_verdict(bench, planner_options, start_joints, skill, wall):
    bench.watch_planner()
    bench.add(PlannerNode, **planner_options, block_timeout=2.0)
    bench.send_joint_states(start_joints)
    bench.wait_for_code("NO_GOAL")
    bench.send_spheres(wall)
    client = Client(bench)
    status, code, reason = client.send(pose=pose_of(skill.goal_pose)).end()
    client.client.destroy()
    assert (status, code) == (ABORTED, "NO_FEASIBLE_PATH")
    assert reason
    bench.wait_for_code("NO_GOAL", "stood before it for 2 s")
    bench.delete_spheres()
    bench.live(1.0)
    assert bench.status()["code"] == "NO_GOAL"


def test_a_planner_that_ends_says_so_and_the_next_one_takes_goals(in_motion, client, ready, planner_options, skill):
    ready.end(ready.planner)
    assert in_motion.end() == (ABORTED, "ENDED", "the planner ends")
    ready.planner = ready.add(PlannerNode, **planner_options)
    ready.wait_for_code("NO_GOAL")
    assert client.send(pose=pose_of(skill.goal_pose)).end()[:2] == (SUCCEEDED, "OK")
