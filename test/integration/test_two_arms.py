"""Arms with prefixed names, two of them in namespaces, and arms that are not those of the skill."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from geodesic_motion_ros.nodes.messages import joint_state_message
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.same_arm import difference
from geodesic_motion_ros.robot.urdf import parse_urdf, read_urdf

PANDA = Robot.named("panda")


def add_arm(bench, side: str, planner_options, start_joints) -> None:
    """A planner in the namespace of a side, and an arm that rests, whose names have the side as prefix."""
    options = planner_options | {"joint_prefix": f"{side}_", "output": "joint_trajectory"}
    bench.listen(DiagnosticArray, f"/{side}/planner/status")
    bench.listen(JointTrajectory, f"/{side}/joint_trajectory")
    bench.add(PlannerNode, namespace=side, **options)
    publisher = bench.publisher(JointState, f"/{side}/joint_states")
    names = PANDA.prefixed(f"{side}_").joint_names

    def send() -> None:
        stamp = bench.probe.get_clock().now().to_msg()
        publisher.publish(joint_state_message(names, start_joints, np.zeros(7), stamp))

    bench.repeat(0.02, send)


def test_two_arms_do_not_hear_each_other(bench, planner_options, start_joints, skill, make_pose):
    for side in ("left", "right"):
        add_arm(bench, side, planner_options, start_joints)
    bench.listen(DiagnosticArray, "/diagnostics")
    status = lambda side: {  # noqa: E731
        pair.key: pair.value for pair in bench.heard[f"/{side}/planner/status"][-1].status[0].values
    }
    for side in ("left", "right"):
        bench.wait(lambda side=side: bench.heard[f"/{side}/planner/status"] and status(side)["code"] == "NO_GOAL", side)
    bench.publisher(PoseStamped, "/left/goal_pose").publish(make_pose(skill.goal_pose, "left_panda_link0"))
    bench.wait(lambda: status("left")["goal_code"] == "OK", "the goal of the left arm")
    sent = bench.wait(lambda: len(bench.heard["/left/joint_trajectory"]) > 1, "trajectories of the left arm")
    assert sent
    assert bench.heard["/left/joint_trajectory"][-1].joint_names == [f"left_{name}" for name in PANDA.joint_names]
    assert status("right")["code"] == "NO_GOAL"
    assert not bench.heard["/right/joint_trajectory"]
    names = {"left/planner: loop", "right/planner: loop"}
    bench.wait(lambda: {m.status[0].name for m in bench.heard["/diagnostics"]} == names, "the health of both")


def test_the_twin_of_an_arm_with_a_prefix(bench, start_joints):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    bench.listen(String, "/left/robot_description", latched)
    bench.listen(JointState, "/left/joint_states")
    bench.listen(PoseStamped, "/left/ee_pose")
    options = {"joint_prefix": "left_", "initial_joint_positions": start_joints.tolist()}
    twin = bench.add(TwinNode, namespace="left", **options)
    names = PANDA.prefixed("left_").joint_names
    assert bench.wait(lambda: bench.heard["/left/joint_states"], "states")[-1].name == list(names)
    assert bench.wait(lambda: bench.heard["/left/ee_pose"], "poses")[-1].header.frame_id == "left_panda_link0"
    (published,) = bench.wait(lambda: bench.heard["/left/robot_description"], "the description")
    assert difference(PANDA.prefixed("left_"), parse_urdf(published.data, "published")).is_same
    moved = start_joints + 0.05
    point = JointTrajectoryPoint(positions=moved.tolist(), velocities=[0.0] * 7, time_from_start=Duration(sec=1))
    message = JointTrajectory(joint_names=list(names), points=[point])
    bench.publisher(JointTrajectory, "/left/joint_trajectory").publish(message)
    arrived = lambda: np.max(np.abs(np.array(bench.heard["/left/joint_states"][-1].position) - moved)) < 0.01  # noqa: E731
    bench.wait(arrived, "an arm that follows the trajectory")
    assert twin.refusals.counts == {}


class TestDescription:
    """Another arm's `robot_description` stops the planner, the arm's own does not."""

    @pytest.fixture
    def publish(self, bench):
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publisher = bench.probe.create_publisher(String, "robot_description", latched)

        def publish(longer: float) -> None:
            root = read_urdf(PANDA.urdf)
            origin = root.find("joint[@name='panda_joint4']/origin")
            x, y, z = map(float, origin.get("xyz").split())
            origin.set("xyz", f"{x} {y} {z + longer}")
            publisher.publish(String(data=ElementTree.tostring(root, encoding="unicode")))

        return publish

    def test_of_another_arm_is_refused_with_the_difference_and_the_right_one_releases_it(self, publish, moving):
        publish(0.05)
        status = moving.wait_for_code("BAD_INPUT", "/robot_description is of another arm than the skill's, 'panda'")
        assert "panda_grasptarget comes up to " in status["reason"]
        assert "mm from where that of 'panda' does (allowed: 10 mm)" in status["reason"]
        publish(0.004)
        moving.wait_for_code("OK")
        assert "add it to obstacle_position_error" in moving.planner.inputs.remarks()["description"]
