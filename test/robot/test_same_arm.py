"""A URDF of another arm is distinguished from a calibrated one of the same arm by where its links come."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest

from geodesic_motion_ros.robot.description import RobotDescription, shipped_robots
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.robot_file import published_urdf
from geodesic_motion_ros.robot.same_arm import SAME, difference
from geodesic_motion_ros.robot.urdf import parse_urdf
from geodesic_motion_ros.simulation.loading import simulated_urdf
from geodesic_motion_ros.utils.errors import RobotError


def described(robot: str, prefix: str = "") -> ElementTree.Element:
    return parse_urdf(published_urdf(simulated_urdf(RobotDescription.named(robot)), prefix), robot)


def shift(root: ElementTree.Element, joint: str, change: np.ndarray) -> None:
    """Move the origin of a joint by (3,) [m]."""
    origin = root.find(f"joint[@name='{joint}']/origin")
    place = np.array(origin.get("xyz").split(), dtype=float) + change
    origin.set("xyz", " ".join(map(str, place)))


@pytest.mark.parametrize("robot", shipped_robots())
@pytest.mark.parametrize("prefix", ["", "left_"])
def test_the_twin_publishes_the_arm_of_the_skill(robot, prefix):
    found = difference(Robot.named(robot).prefixed(prefix), described(robot, prefix))
    assert found.largest < 1e-6
    assert found.link == prefix + Robot.named(robot).tool_link


def test_a_longer_link_is_another_arm_by_as_much():
    root = described("ur5")
    shift(root, "wrist_3_joint", np.array([0.0, 0.05, 0.0]))
    found = difference(Robot.named("ur5"), root)
    # every posture is off by the same, as the hand turns with the link
    assert found.largest == pytest.approx(0.05, abs=1e-9)
    assert not found.is_same


def test_a_calibrated_arm_is_the_same_one():
    root = described("ur5")
    random = np.random.default_rng(0)
    joints = Robot.named("ur5").joint_names
    for joint in joints:
        shift(root, joint, random.uniform(-1e-3, 1e-3, 3))
    found = difference(Robot.named("ur5"), root)
    # six offsets of up to sqrt(3) mm
    assert 1e-4 < found.largest < 6.0 * 3.0**0.5 * 1e-3
    assert found.largest <= SAME or not found.is_same


def test_a_turned_tool_frame_counts_at_a_lever():
    root = described("ur5")
    (joint,) = (one for one in root.iterfind("joint") if one.find("child").get("link") == "tool0")
    joint.find("origin").set("rpy", "0 0 3.0")
    assert difference(Robot.named("ur5"), root).largest > 0.05


def test_without_the_tool_the_farthest_common_link_is_compared():
    root = described("panda")
    for link in root.findall("link"):
        if link.get("name") == "panda_grasptarget":
            root.remove(link)
    for joint in root.findall("joint"):
        if joint.find("child").get("link") == "panda_grasptarget":
            root.remove(joint)
    found = difference(Robot.named("panda"), root)
    assert found.link == "panda_hand"
    assert found.is_same


def test_other_joints_between_the_same_links_are_named():
    root = described("ur5")
    for joint in root.iterfind("joint[@name='elbow_joint']"):
        joint.set("name", "knee_joint")
    found = difference(Robot.named("ur5"), root)
    assert "knee_joint" in found.joints
    assert not found.is_same


def test_a_chain_that_cannot_be_read_is_named():
    root = described("ur5")
    for limit in root.iterfind("joint/limit"):
        limit.set("velocity", "fast")
    with pytest.raises(RobotError, match="limit velocity of joint"):
        difference(Robot.named("ur5"), root)


def test_what_has_no_link_in_common_is_not_compared():
    assert difference(Robot.named("ur5"), described("panda")) is None
    assert difference(Robot.named("ur5"), described("ur5", "left_")) is None
