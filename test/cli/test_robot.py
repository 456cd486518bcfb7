"""The command that makes a robot's folder: what it needs is named in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from geodesic_motion_ros.cli import main
from geodesic_motion_ros.cli.robot import advise_on_alarms
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_pairs import LinkPair

PANDA = Robot.named("panda").urdf
ENDS = ["--base", "panda_link0", "--tip", "panda_hand"]
LIMITS = ["--acceleration", "5", "--jerk", "500", "--limits-source", "chosen"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (ENDS, "give --acceleration, --jerk, --limits-source for panda_joint1, panda_joint2"),
        ([*ENDS, *LIMITS, "--velocity", "1,2"], "--velocity: expected a positive number, or 7 of them"),
        ([*ENDS, *LIMITS], "panda.urdf has no <collision>"),
        ([*ENDS[:3], "tool0", *LIMITS], "link 'tool0' is not in panda.urdf; it has panda_link0, panda_link1"),
    ],
)
def test_what_is_missing_is_named(arguments: list[str], message: str, tmp_path: Path, capsys) -> None:
    assert main(["robot", str(PANDA), *arguments, "--out", str(tmp_path / "arm")]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "arm").exists()


def test_the_help_marks_what_a_urdf_does_not_say_as_required(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["robot", "--help"])
    shown = " ".join(capsys.readouterr().out.split())
    for option in ("--acceleration A", "--jerk J", "--limits-source TEXT"):
        assert f" {option} required: " in shown


@pytest.mark.parametrize("option", [["--package", "arm=none"], ["--package", "arm"], ["height=2"]])
def test_what_cannot_be_a_package_or_an_argument_is_refused(option: list[str], tmp_path: Path, capsys) -> None:
    with pytest.raises(SystemExit):
        main(["robot", str(PANDA), *option, *ENDS, *LIMITS, "--out", str(tmp_path / "arm")])
    assert "NAME=FOLDER" in (shown := capsys.readouterr().err) or "like hand:=true" in shown
    assert not (tmp_path / "arm").exists()


def test_what_spheres_mean_that_overlap_while_bodies_are_apart_is_said_once(capsys) -> None:
    """Not of links whose bodies touch as often, nor of those that are not kept apart: the controls."""
    quiet = [LinkPair(("base", "hand"), None, 0.3, 0.35), LinkPair(("wrist", "hand"), (), 1.0, 1.0)]
    advise_on_alarms(quiet)
    assert capsys.readouterr().out == ""
    loud = [LinkPair(("base", "elbow"), None, 0.0, 0.31), LinkPair(("elbow", "wrist"), ((0, 1),), 0.02, 0.14)]
    advise_on_alarms([*quiet, *loud])
    (line,) = capsys.readouterr().out.splitlines()
    assert "bodies are apart: base and elbow in 31 %, elbow and wrist in 12 % of the postures drawn" in line
    assert "spheres.yaml" in line


def test_a_robot_is_made_and_drawn(tmp_path: Path, capsys) -> None:
    links = "".join(
        f'<link name="{name}"><collision><origin xyz="0 0 0.06"/><geometry><box size="0.05 0.05 0.12"/></geometry>'
        "</collision></link>"
        for name in ("base", "upper", "lower")
    )
    links += '<link name="tool"/>'
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{one}"/><child link="{other}"/><origin xyz="0 0 0.15"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1"/></joint>'
        for name, one, other in (("shoulder", "base", "upper"), ("elbow", "upper", "lower"))
    )
    joints += '<joint name="flange" type="fixed"><parent link="lower"/><child link="tool"/></joint>'
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    out = tmp_path / "made"
    given = ["robot", str(tmp_path / "arm.urdf"), "--base", "base", "--tip", "tool", "--out", str(out), *LIMITS]
    assert main(given) == 2
    assert "no positive limit of velocity is given for shoulder, elbow" in capsys.readouterr().err
    assert not out.exists()
    assert main([*given, "--ready", "0.3,0.5", "--velocity", "1,2"]) == 0
    shown = capsys.readouterr().out
    assert "farthest point outside all spheres: 0.0 mm" in shown
    assert "without a body in the URDF, and so never kept clear: tool\n" in shown
    assert "poses need six joints, this arm has 2: teach it by joint angles, send it goal_joints" in shown
    assert "detours need three joints" in shown
    assert "without <inertial> or a mass: base, upper, lower; the twin takes that of the collision bodies" in shown
    assert "limit of effort 0 or absent" not in shown
    assert (out / "spheres.png").is_file()
    assert Robot.named(out).joint_names == ("shoulder", "elbow")
    assert Robot.named(out).velocity_limits.tolist() == [1.0, 2.0]
