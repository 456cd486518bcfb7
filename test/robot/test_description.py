"""A robot is a folder: what it says is what is driven, and what is wrong in it is named."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from geodesic_motion_ros.robot.collision_model import CollisionModel, tool_spheres
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT, FILE, RobotDescription, shipped_robots
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.utils.errors import RobotError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of the Panda's folder, under another name."""
    return Path(shutil.copytree(RobotDescription.named("panda").folder, tmp_path / "arm"))


def change(folder: Path, **values: Any) -> None:
    """Write some keys of robot.yaml anew; None takes one out."""
    table = yaml.safe_load((folder / FILE).read_text()) | values
    (folder / FILE).write_text(yaml.safe_dump({key: value for key, value in table.items() if value is not None}))


@pytest.mark.parametrize("name", shipped_robots())
def test_what_is_shipped_is_whole(name: str) -> None:
    robot, model = Robot.named(name), CollisionModel.named(name)
    assert RobotDescription.named(name).name == name
    JointLimits.of(robot)
    robot.checked(robot.ready)
    assert len(model.self_pairs)
    assert len(tool_spheres(name))


def test_the_default_is_one_that_is_shipped() -> None:
    assert DEFAULT_ROBOT in shipped_robots()


def test_a_folder_anywhere_is_the_same_robot(folder: Path) -> None:
    copied, shipped = Robot.named(folder), Robot.named("panda")
    assert copied.joint_names == shipped.joint_names
    for one, other in zip(copied.forward(copied.ready), shipped.forward(shipped.ready), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(CollisionModel.named(folder).radii, CollisionModel.named("panda").radii)


def test_velocity_limits_of_the_file_come_before_those_of_the_urdf(folder: Path) -> None:
    """The control: joints without one keep that of the URDF."""
    limits = yaml.safe_load((folder / "joint_limits.yaml").read_text())
    limits["joint_limits"]["panda_joint2"]["max_velocity"] = 0.5
    (folder / "joint_limits.yaml").write_text(yaml.safe_dump(limits))
    expected = Robot.named("panda").velocity_limits.copy()
    expected[1] = 0.5
    np.testing.assert_array_equal(Robot.named(folder).velocity_limits, expected)


def test_without_spheres_of_its_own_the_tool_has_those_of_the_hand(folder: Path) -> None:
    change(folder, tool_spheres=None)
    found, robot, model = tool_spheres(folder), Robot.named(folder), CollisionModel.named(folder)
    hand = np.array(model.points.names) == "panda_hand"
    np.testing.assert_array_equal(found[:, 3], model.radii[hand])
    position, _ = robot.forward(robot.ready)
    rotation = robot.link_frames(robot.ready)[0][-1]
    placed = position + found[:, :3] @ rotation.T
    np.testing.assert_allclose(placed, model.positions(robot, robot.ready[None])[0, hand], atol=1e-12)
    change(folder, hand=None)
    with pytest.raises(RobotError, match="neither a hand nor tool_spheres"):
        tool_spheres(folder)
    change(folder, hand="panda_link5")
    with pytest.raises(RobotError, match="'panda_link5' of robot 'panda' does not move with its tool link"):
        tool_spheres(folder)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"urdf": None, "ready": None}, "lacks urdf, ready"),
        ({"urdf": "other.urdf"}, "urdf is 'other.urdf'; there is no such file in the folder"),
        ({"reday": [0.0]}, "'reday' is not known; did you mean ready"),
        ({"ready": [0.0, "a"]}, "ready is or holds .* a list of numbers, finite"),
        ({"ready": []}, "ready is or holds"),
        ({"tool_spheres": [[0.0, 0.0, 0.1]]}, "expected 4 numbers"),
        ({"tool_spheres": 3}, "must be a list of"),
        ({"base_link": 3}, "base_link is 3; it must be a text"),
        ({"simulation": {"meshes": 1}}, "it may hold urdf and joints"),
        ({"simulation": {"joints": {"finger": "wide"}}}, r"simulation.joints.finger is 'wide'"),
        ({"simulation": {"urdf": "absent.urdf"}}, "simulation.urdf is 'absent.urdf'; there is no such file"),
    ],
)
def test_what_is_wrong_is_named_with_its_file_and_key(folder: Path, values: dict[str, Any], message: str) -> None:
    RobotDescription.named(folder)
    change(folder, **values)
    with pytest.raises(RobotError, match=f"arm/{FILE}: .*{message}"):
        RobotDescription.named(folder)


def test_files_that_do_not_fit_each_other_are_refused(folder: Path) -> None:
    change(folder, tool_link="gripper")
    with pytest.raises(RobotError, match=r"link 'gripper' is not in panda\.urdf; it has panda_link0"):
        Robot.named(folder)
    change(folder, tool_link="panda_link8", ready=[0.0] * 6)
    with pytest.raises(RobotError, match=r"expected \(7,\)"):
        Robot.named(folder)


@pytest.mark.parametrize(
    ("name", "what"),
    [("arm", "'arm' is not known here; known: "), ("{tmp}/arm.urdf", "arm.urdf' is a file; known: "),
     ("{tmp}", f"{FILE}: No such file or directory: a robot is a folder with {FILE}")],
    ids=["unknown", "a URDF", "a folder of a description package"],
)  # fmt: skip
def test_what_is_no_robot_is_named_with_the_command_that_makes_one(name: str, what: str, tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text("<robot/>")
    with pytest.raises(RobotError) as refused:
        RobotDescription.named(name.format(tmp=tmp_path))
    assert what in str(refused.value)
    remedy = "`geodesic-motion robot FILE --base LINK --tip LINK --out DIR` makes such a folder"
    assert str(refused.value).endswith(remedy)


def test_there_is_no_such_robot(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"robot 'kuka' is not known here; known: .*'panda'.*; or give the path of"):
        Robot.named("kuka")
    with pytest.raises(RobotError, match=f"{FILE}: No such file"):
        Robot.named(tmp_path)
    (tmp_path / FILE).write_text("- panda")
    with pytest.raises(RobotError, match="it must hold name"):
        Robot.named(tmp_path)
