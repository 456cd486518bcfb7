"""Arms of fewer than six joints, from URDF to a skill with its report, a plan, and a detour or why there is none."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.cli.arguments import refuse_unsaid_order
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.learning import joint_training
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.robot.making import Limits, make_robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.studies.cli import main
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.visualization import skill_report

AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1")
START, GOAL = np.array([-0.7, 0.5, 0.6, 0.4, 0.0]), np.array([0.7, 0.6, 0.5, 0.3, 0.3])


def made_arm(place: Path, joints: int) -> Path:
    """The folder of an arm whose joints are called "1", "2", ..., and its recording of six demonstrations beside it."""
    body = '<collision><origin xyz="0 0 0.08"/><geometry><box size="0.05 0.05 0.14"/></geometry></collision>'
    links = "".join(f'<link name="l{i}">{body}</link>' for i in range(joints + 1))
    chain = "".join(
        f'<joint name="{i + 1}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.16"/>'
        f'<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="3" effort="0"/></joint>'
        for i, axis in enumerate(AXES[:joints])
    )
    tool = (
        f'<link name="tool"/><joint name="t" type="fixed"><parent link="l{joints}"/><child link="tool"/>'
        '<origin xyz="0 0 0.16"/></joint>'
    )
    (place / "arm.urdf").write_text(f'<robot name="arm">{links}{chain}{tool}</robot>')
    limits = Limits((8.0,) * joints, (200.0,) * joints, "chosen for a test")
    ready = tuple(0.5 * (START + GOAL)[:joints])
    random = np.random.default_rng(0)
    share = (3.0 * np.linspace(0.0, 1.0, 60) ** 2 - 2.0 * np.linspace(0.0, 1.0, 60) ** 3)[:, None]
    rows = [",".join(["demonstration", "t", *(str(i + 1) for i in range(joints))])]
    for number in range(6):
        ends = np.stack([START, GOAL])[:, :joints] + random.normal(0.0, 0.03, (2, joints))
        path = ends[0] + share * (ends[1] - ends[0])
        path += np.sin(np.pi * share) * random.normal(0.0, 0.05, joints)
        rows += [f"{number},{i / 30.0:.4f}," + ",".join(f"{x:.5f}" for x in q) for i, q in enumerate(path)]
    (place / "taught.csv").write_text("\n".join(rows) + "\n")
    return make_robot(place / "arm.urdf", "l0", "tool", place / "arm", limits, ready=ready).folder


@pytest.mark.parametrize("joints", [5, 2])
def test_an_arm_of_few_joints_is_taught_and_planned_for(joints: int, tmp_path: Path) -> None:
    """Where a sphere is in the middle of the motion five joints make a detour, or it is said why there is none."""
    robot = made_arm(tmp_path, joints)
    thoroughly = joint_training.train_joint_space_skill

    def briefly(shown, of_robot, settings, *progress):
        small = {"hidden": (64, 32), "samples": 60, "batch": 128, "precision_samples": 2, "precision_iterations": 60}
        return thoroughly(shown, of_robot, replace(settings, **small), *progress)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(joint_training, "train_joint_space_skill", briefly)
        patch.setattr(skill_report, "PLACES", 1)
        arguments = ["train", "--demos", str(tmp_path / "taught.csv"), "--robot", str(robot), "--steps", "800"]
        arguments += ["--kernels", "100", "--latent-dimension", "2", "--space", "joint"]
        assert main([*arguments, "--out", str(tmp_path / "skill")]) == 0
    assert (tmp_path / "skill/report.html").is_file()
    skill = Skill.load(tmp_path / "skill")
    planner = ReactivePlanner(skill, PlannerSettings(detour=0.2), scene=DeclaredScene.empty())
    start, goal = skill.canonical.start_poles[0], skill.canonical.goal_poles[0]
    planner.stand_at(start, now=0.0)
    assert planner.set_goal_configuration(goal).ok
    plan = planner.tick(now=0.0)
    assert plan.verdict.ok
    middle, _ = planner.robot.forward(plan.reference.positions[len(plan.reference.positions) // 2])
    planner = ReactivePlanner(skill, PlannerSettings(detour=0.2), scene=DeclaredScene.empty())
    planner.stand_at(start, now=0.0)
    planner.set_obstacles(centres=[middle], radii=[0.03])
    assert planner.set_goal_configuration(goal).ok
    reasons = [planner.tick(now=float(now)).verdict.reason for now in np.arange(0.0, 6.0, 0.25)]
    if joints > 2:
        assert any("a detour" in reason or "no detour" in reason for reason in reasons)
    else:  # which cannot displace its tool as a detour asks
        assert not any("a detour:" in reason for reason in reasons)


def test_in_which_order_quaternions_are_is_asked_of_an_upright_arm_alone(tmp_path: Path) -> None:
    """A tool that points down, its quaternions written in the order x, y, z, w: on a wall that says nothing."""
    folder = made_arm(tmp_path, 2)
    down = np.tile([1.0, 0.0, 0.0, 0.0], (10, 1))  # read as w, x, y, z it points up
    shown = Demonstrations((Demonstration(np.linspace([0.3, 0, 0.3], [0.5, 0, 0.3], 10), down, np.arange(10.0), "a"),))
    arguments = argparse.Namespace(columns=None, robot=str(folder))
    with pytest.raises(ParameterError, match="in which order are they"):
        refuse_unsaid_order(arguments, Path("taught.npy"), shown)
    mount = (
        '<link name="world"/><joint name="m" type="fixed"><parent link="world"/><child link="l0"/>'
        '<origin rpy="0 1.5708 0"/></joint></robot>'
    )
    text = (folder / "arm.urdf").read_text()
    (folder / "arm.urdf").write_text(text.replace("</robot>", mount))
    refuse_unsaid_order(arguments, Path("taught.npy"), shown)
