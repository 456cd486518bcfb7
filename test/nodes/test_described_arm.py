"""What is made of a `robot_description`: a fault where it is of another arm, a remark where that is not known."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.nodes.described_arm import DescribedArm
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.robot_file import published_urdf


def urdf(robot: str) -> str:
    return published_urdf(RobotDescription.named(robot).urdf)


@pytest.fixture
def arm() -> DescribedArm:
    return DescribedArm(Robot.named("ur5"), "ur5", "/robot_description")


def test_the_own_arm_is_nothing_to_speak_of(arm):
    arm.receive(urdf("ur5"))
    assert (arm.fault, arm.remark) == ("", "")


def test_other_joints_are_a_fault(arm):
    arm.receive(urdf("ur5").replace("elbow_joint", "knee_joint"))
    assert arm.fault.startswith(
        "/robot_description is of another arm than the skill's, 'ur5': its joints up to tool0 are shoulder_pan_joint, "
        "shoulder_lift_joint, knee_joint,"
    )
    arm.receive(urdf("ur5"))
    assert arm.fault == ""


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (urdf("panda"), "it has no base_link, or no other link of 'ur5'"),
        ("<html/>", "its root element is <html>, expected <robot>"),
        ("", "it is empty"),
    ],
)
def test_what_cannot_be_compared_is_a_remark(arm, text, reason):
    arm.receive(text)
    assert arm.fault == ""
    assert reason in arm.remark
    assert arm.remark.endswith("whether it is of the skill's arm is not known")
