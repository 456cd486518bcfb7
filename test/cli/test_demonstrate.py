"""`demonstrate`: files that the readers read, or one line that says why not."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.demonstrations.readers import read_demonstrations, read_joint_demonstrations
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation import joint_teacher
from geodesic_motion_ros.simulation.joint_teacher import circle, reach_guidances, reach_to_grasp
from geodesic_motion_ros.simulation.teacher import two_mode_motions


@pytest.fixture
def _small_picture(monkeypatch) -> None:
    """The picture of the command, of a thirty-sixth of its pixels."""
    monkeypatch.setattr(joint_teacher, "picture", partial(joint_teacher.picture, width=160, height=120))


@pytest.mark.usefixtures("_small_picture")
def test_demonstrations_of_joints_are_written_and_pictured(tmp_path, capsys) -> None:
    file, picture = tmp_path / "deep" / "reach.npz", tmp_path / "reach.png"
    asked = ["reach-to-grasp-separated", "--count", "1", "--families", "2", "--seed", "4"]
    assert main(["demonstrate", *asked, "--out", str(file), "--picture", str(picture)]) == 0
    made = reach_to_grasp(1, 4, families=2, connected=False)
    shortest, longest = sorted(item.times[-1] for item in made)
    assert f"wrote 2 demonstrations of {shortest:.1f} to {longest:.1f} s to {file}" in capsys.readouterr().out
    assert picture.read_bytes().startswith(b"\x89PNG")
    for read, item in zip(read_joint_demonstrations(file, "panda"), made, strict=True):
        assert read.name == item.name
        np.testing.assert_allclose(read.configurations[[0, -1]], item.configurations[[0, -1]], atol=1e-12)
        np.testing.assert_allclose(read.times[-1], item.times[-1])


def test_a_csv_keeps_every_sample(tmp_path) -> None:
    file = tmp_path / "circle.csv"
    assert main(["demonstrate", "circle", "--count", "2", "--seed", "2", "--out", str(file)]) == 0
    for read, item in zip(read_joint_demonstrations(file, "panda"), circle(2, 2), strict=True):
        np.testing.assert_array_equal(read.configurations, item.configurations)


def test_demonstrations_of_the_tool_are_written_in_metres(tmp_path) -> None:
    file = tmp_path / "two_sides.npz"
    assert main(["demonstrate", "passing", "--count", "1", "--out", str(file)]) == 0
    assert len(read_demonstrations(file, "m")) == 2


@pytest.mark.usefixtures("_small_picture")
@pytest.mark.parametrize("robot", ["fr3", "iiwa14"])
def test_other_arms_demonstrate_too_each_with_its_own_joints(tmp_path, robot: str) -> None:
    file, picture = tmp_path / "reach.npz", tmp_path / "reach.png"
    asked = ["reach-to-grasp", "--robot", robot, "--families", "2", "--count", "1", "--out", str(file)]
    assert main(["demonstrate", *asked, "--picture", str(picture)]) == 0
    arm = Robot.named(robot)
    for guidance, tool in zip(
        reach_guidances(1, 0, 2, True), read_joint_demonstrations(file, robot).tool_demonstrations(arm), strict=True
    ):
        wanted = guidance.motion.positions
        assert np.max(np.linalg.norm(tool.positions[[0, -1]] - wanted[[0, -1]], axis=1)) < 5e-3
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_an_arm_of_six_joints_demonstrates_with_its_tool(tmp_path) -> None:
    file = tmp_path / "two_sides.npz"
    assert main(["demonstrate", "passing", "--robot", "ur5", "--count", "1", "--out", str(file)]) == 0
    for motion, tool in zip(two_mode_motions(1, 0), read_demonstrations(file, "m"), strict=True):
        np.testing.assert_allclose(tool.positions[[0, -1]], motion.positions[[0, -1]], atol=5e-3)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["circle", "--families", "2", "--out", "{tmp}/a.npz"], "circle has no families: --families is for reach-to"),
        (["circle", "--robot", "ur5", "--out", "{tmp}/a.npz"], "a swivel angle is that of an arm with 7 revolute"),
        (["circle", "--out", "{tmp}/a.npy"], "written to .npz or .csv files, not '.npy'"),
        (["pouring", "--out", "{tmp}/a.csv"], "written to .npz files, not '.csv'"),
        (["circle", "--out", "{tmp}/a.npz", "--picture", "{tmp}/a.jpg"], "a picture is written to a .png file"),
        (["circle", "--out", "{tmp}/file/a.npz"], "cannot be written"),
        (["circle", "--count", "0", "--out", "{tmp}/a.npz"], "count is 0: at least one"),
        (["reach-to-grasp", "--families", "0", "--out", "{tmp}/a.npz"], "families is 0"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(arguments, said, tmp_path, capsys) -> None:
    (tmp_path / "file").write_text("")
    assert main(["demonstrate", *(argument.format(tmp=tmp_path) for argument in arguments)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("geodesic-motion: ")
    assert said in line
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]
