"""Arms whose URDFs lack strengths, masses or postures stand in the twin; those on walls hang as gravity has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from geodesic_motion_ros.robot.making import Limits, make_robot
from geodesic_motion_ros.simulation import free_drive
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints

BODY = '<collision><origin xyz="0 0 0.1"/><geometry><box size="0.08 0.08 0.18"/></geometry></collision>'
MASS = '<inertial><origin xyz="0 0 0.1"/><mass value="1.2"/><inertia ixx="4e-3" ixy="0" ixz="0" iyy="4e-3" iyz="0" ' \
       'izz="2e-3"/></inertial>'
FINGER = (
    f'<link name="claw">{BODY}</link><joint name="finger" type="prismatic"><parent link="l3"/><child link="claw"/>'
    '<axis xyz="1 0 0"/><limit lower="0.015" upper="0.037" velocity="1" effort="5"/></joint>'
)


def folder_of(place: Path, effort: str = "0", rpy: str = "0 0 0", base: str = "l0", beside: str = "") -> Path:
    """The folder of an arm of three joints without a mass, made by the command's own function."""
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.2"/>'
        f'<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="2" effort="{effort}"/></joint>'
        for i, axis in enumerate(("0 0 1", "0 1 0", "0 1 0"))
    )
    links = "".join(f'<link name="l{i}">{BODY}</link>' for i in range(4))
    mount = f'<link name="world"/><joint name="m" type="fixed"><parent link="world"/><child link="l0"/>' \
            f'<origin xyz="0 0 1" rpy="{rpy}"/></joint>'
    tool = '<link name="tool"/><joint name="t" type="fixed"><parent link="l3"/><child link="tool"/>' \
           '<origin xyz="0 0 0.2"/></joint>'
    (place / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}{mount}{tool}{beside}</robot>')
    limits = Limits((8.0,) * 3, (200.0,) * 3, "chosen for a test")
    return make_robot(place / "arm.urdf", base, "tool", place / "made", limits, ready=(0.3, 0.9, 0.6)).folder


@pytest.mark.parametrize("masses", ["of the folder", "none, as of folders made before"])
def test_an_arm_without_effort_is_held_and_follows(masses: str, tmp_path: Path, capfd) -> None:
    """Stretched out level it stands, and goes where it is sent. PyBullet says nothing of what is missing."""
    folder = folder_of(tmp_path)
    if masses != "of the folder":
        text = (folder / "arm.urdf").read_text()
        while "<inertial>" in text:
            begin, end = text.index("<inertial>"), text.index("</inertial>") + len("</inertial>")
            text = text[:begin] + text[end:]
        (folder / "arm.urdf").write_text(text)
    level = np.array([0.3, 1.5708, 0.0])
    with ArmWorld(robot=folder) as world:
        world.reset(level)
        for _ in range(480):
            world.step()
        np.testing.assert_allclose(world.joint_positions, level, atol=2e-3)
        goal = np.array([0.6, 1.2, -0.4])
        world.set_joint_trajectory(JointWaypoints(np.array([0.0, 1.5]), np.stack([level, goal])))
        for _ in range(720):
            world.step()
        np.testing.assert_allclose(world.joint_positions, goal, atol=2e-3)
    assert "No inertial data" not in "".join(capfd.readouterr())


def test_an_arm_that_is_too_weak_falls(tmp_path: Path) -> None:
    """The control: strength is what holds it."""
    with ArmWorld(robot=folder_of(tmp_path, effort="0.5")) as world:
        world.reset(np.array([0.3, 1.5708, 0.0]))
        for _ in range(480):
            world.step()
        assert np.max(np.abs(world.joint_positions - [0.3, 1.5708, 0.0])) > 0.2


@pytest.mark.parametrize("base", ["l0", "world"])
@pytest.mark.parametrize("rpy", ["0 1.5708 0", "3.14159265 0 0"])
def test_an_arm_on_a_wall_or_ceiling_floats_in_free_drive_and_falls_down(rpy: str, base: str, tmp_path: Path) -> None:
    folder = folder_of(tmp_path, effort="50", rpy=rpy, base=base)
    up = [0.0, 0.0, 1.0]
    if base == "l0":
        up = [-1.0, 0.0, 0.0] if rpy.startswith("0") else [0.0, 0.0, -1.0]
    with ArmWorld(robot=folder) as world:
        start = np.array([0.3, 0.9, 0.6])
        world.reset(start)
        world.begin_free_drive()
        for _ in range(240):
            world.step()
        np.testing.assert_allclose(world.joint_positions, start, atol=2e-3)
        with pytest.MonkeyPatch.context() as patch:
            # without the motors' torques
            patch.setattr(free_drive.FreeDrive, "torque", lambda self, hand: None)
            before = world.tool_pose()[0]
            for _ in range(40):
                world.step()
            assert (world.tool_pose()[0] - before) @ np.array(up) < -0.01


def test_a_finger_stands_within_its_limits_in_folders_made_before_too(tmp_path: Path) -> None:
    folder = folder_of(tmp_path, effort="50", beside=FINGER)
    described = yaml.safe_load((folder / "robot.yaml").read_text())
    assert described.pop("simulation") == {"joints": {"finger": 0.015}}
    for text in (None, yaml.safe_dump(described)):
        if text is not None:
            (folder / "robot.yaml").write_text(text)
        with ArmWorld(robot=folder) as world:
            assert list(world._beside.values()) == [0.015]
