"""The action `follow_joint_trajectory`: the twin serves it, and a planner sends its trajectories there."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from bench import Bench
from rclpy.action import ActionClient
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.timing import timed_joint_reference

control = pytest.importorskip("control_msgs.action", reason="make ros-extras builds it")
ROBOT = Robot.named("panda")
GOAL = ROBOT.ready + np.array([0.4, 0.2, -0.3, 0.2, 0.3, -0.2, 0.4])
SUCCEEDED, CANCELED, ABORTED = (
    GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED
)  # fmt: skip


@pytest.fixture
def twin(bench: Bench) -> Iterator[Bench]:
    bench.twin = bench.add(TwinNode, skill="", initial_joint_positions=ROBOT.ready.tolist())
    bench.listen(JointState, "joint_states", 1000)
    bench.wait(lambda: bench.heard["joint_states"], "the state of the arm")
    bench.client = ActionClient(bench.probe, control.FollowJointTrajectory, "follow_joint_trajectory")
    bench.poll(bench.client.server_is_ready, "the action server")
    yield bench
    bench.client.destroy()


def trajectory(start: np.ndarray, end: np.ndarray, begin: float) -> JointTrajectory:
    reference = timed_joint_reference(np.stack([start, end]), np.zeros((2, 1)), JointLimits.of(ROBOT, speed_scale=0.25))
    knots = reference.times, reference.positions, reference.velocities, reference.accelerations
    wire = joint_trajectory_bytes(ROBOT.joint_names, *knots, round(1e9 * begin))
    return deserialize_message(wire, JointTrajectory)


def send(bench: Bench, message: JointTrajectory) -> Any:
    future = bench.client.send_goal_async(control.FollowJointTrajectory.Goal(trajectory=message))
    bench.wait(future.done, "an answer to the goal")
    handle = future.result()
    return handle.get_result_async() if handle.accepted else None, handle


def ended(bench: Bench, result: Any) -> tuple[int, int]:
    bench.wait(result.done, "the end of the goal")
    return result.result().status, result.result().result.error_code


def measured(bench: Bench) -> np.ndarray:
    return np.array(bench.heard["joint_states"][-1].position)


def speed(bench: Bench) -> float:
    return float(np.max(np.abs(bench.heard["joint_states"][-1].velocity)))


def test_a_goal_is_played_to_its_end(twin):
    result, _ = send(twin, trajectory(ROBOT.ready, GOAL, twin.now() + 0.1))
    assert ended(twin, result) == (SUCCEEDED, control.FollowJointTrajectory.Result.SUCCESSFUL)
    np.testing.assert_allclose(measured(twin), GOAL, atol=5e-3)


def test_a_goal_is_replaced_in_motion_by_another_and_by_the_topic(twin):
    first, _ = send(twin, trajectory(ROBOT.ready, GOAL, twin.now() + 0.1))
    twin.wait(lambda: speed(twin) > 0.05, "motion")
    second, _ = send(twin, trajectory(measured(twin), ROBOT.ready, twin.now() + 0.1))
    assert ended(twin, first)[0] == ABORTED
    twin.wait(lambda: speed(twin) > 0.05, "motion")
    twin.publisher(JointTrajectory, "joint_trajectory").publish(trajectory(measured(twin), GOAL, twin.now() + 0.1))
    assert ended(twin, second)[0] == ABORTED


def test_a_goal_that_is_cancelled_leaves_the_arm_at_rest(twin):
    result, handle = send(twin, trajectory(ROBOT.ready, GOAL, twin.now() + 0.1))
    twin.wait(lambda: speed(twin) > 0.05, "motion")
    handle.cancel_goal_async()
    assert ended(twin, result)[0] == CANCELED
    twin.wait(lambda: speed(twin) < 1e-3, "the arm at rest")
    assert np.max(np.abs(measured(twin) - GOAL)) > 0.05


def test_a_trajectory_that_is_none_is_rejected_and_the_one_before_goes_on(twin):
    result, _ = send(twin, trajectory(ROBOT.ready, GOAL, twin.now() + 0.1))
    bad = trajectory(ROBOT.ready, GOAL, twin.now() + 0.1)
    bad.joint_names[0] = "tail"
    refused, _ = send(twin, bad)
    assert refused is None
    assert ended(twin, result)[0] == SUCCEEDED


def test_a_planner_sends_its_trajectories_as_goals(bench, planner_options, start_joints, skill):
    bench.watch_planner()
    options = planner_options | {"output": "joint_trajectory", "tracking_tolerance_joint": 0.3}
    bench.planner = bench.add(PlannerNode, **options, trajectory_action="follow_joint_trajectory")
    bench.wait(lambda: bench.status(), "the planner")
    bench.add(TwinNode, skill="", initial_joint_positions=start_joints.tolist())
    bench.listen(JointState, "joint_states", 1000)
    bench.wait_for_code("NO_GOAL")
    bench.wait(lambda: "twin" in bench.status()["commands_received_by"], "the server of the action")
    bench.send_goal(skill.goal_pose)
    bench.wait_for_code("OK")
    bench.wait(lambda: bench.status()["code"] == "OK" and bench.at_goal(), "the arm at the goal")
    position, _ = ROBOT.forward(measured(bench))
    np.testing.assert_allclose(position, skill.goal_pose[:3], atol=0.01)
    assert not bench.probe.get_publishers_info_by_topic("/joint_trajectory")
    assert not any("rejected" in value for value in bench.status().values())


def test_a_planner_without_a_server_says_whom_it_waits_for(bench, planner_options, start_joints, skill):
    bench.watch_planner()
    options = planner_options | {"output": "joint_trajectory"}
    planner = bench.add(PlannerNode, **options, trajectory_action="arm/follow_joint_trajectory")
    bench.send_joint_states(start_joints)
    bench.wait_for_code("NO_GOAL")
    # Until it has looked for servers it does not know that there is none.
    bench.poll(lambda: planner.inputs.snapshot().subscribers == (), "a planner that has looked for servers")
    bench.send_goal(skill.goal_pose)
    bench.wait_for_code("BAD_INPUT", "no node receives arm/follow_joint_trajectory")
