"""Arms of fewer than six joints: taught by the command, planned for, and a detour or why there is none.

The arms and what was learned for them are stored in robots/ and skills/; `--remake` makes both anew.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.cli import main
from geodesic_motion_ros.cli.recorded import refuse_unsaid_order
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.demonstrations.writers import save_joint_demonstrations
from geodesic_motion_ros.geometry.quaternions import multiply
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.making import Limits, make_robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError

ROBOTS = Path(__file__).resolve().parents[1] / "robots"
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1")
START, GOAL = np.array([-0.7, 0.5, 0.6, 0.4, 0.0]), np.array([0.7, 0.6, 0.5, 0.3, 0.3])
SMALL = {"hidden": (64, 32), "samples": 60, "batch": 128, "precision_samples": 2, "precision_iterations": 60}


def arm_of(joints: int) -> Path:
    """The folder of an arm whose joints are called "1", "2", ..."""
    return ROBOTS / f"arm_of_{joints}"


def make_arm(joints: int) -> None:
    """Make the folder out of a URDF."""
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
    folder = arm_of(joints)
    shutil.rmtree(folder, ignore_errors=True)
    urdf = ROBOTS / f"arm_of_{joints}.urdf"
    urdf.parent.mkdir(exist_ok=True)
    urdf.write_text(f'<robot name="arm">{links}{chain}{tool}</robot>')
    limits = Limits((8.0,) * joints, (200.0,) * joints, "chosen for a test")
    make_robot(urdf, "l0", "tool", folder, limits, ready=tuple(0.5 * (START + GOAL)[:joints]))
    urdf.unlink()


def taught(joints: int) -> JointDemonstrations:
    """Six motions of the arm, which differ in their ends and between them."""
    random = np.random.default_rng(0)
    share = np.linspace(0.0, 1.0, 60)[:, None]
    share = 3.0 * share**2 - 2.0 * share**3
    items = []
    for number in range(6):
        ends = np.stack([START, GOAL])[:, :joints] + random.normal(0.0, 0.03, (2, joints))
        path = ends[0] + share * (ends[1] - ends[0]) + np.sin(np.pi * share) * random.normal(0.0, 0.05, joints)
        items.append(JointDemonstration(path, np.arange(60) / 30.0, str(number)))
    return JointDemonstrations(tuple(items), tuple(str(i + 1) for i in range(joints)), str(arm_of(joints)))


@pytest.fixture(params=[5, 2])
def skill(request: pytest.FixtureRequest, stored: Callable[[str, Callable[[], Skill]], Skill]) -> Skill:
    joints: int = request.param

    def train() -> Skill:
        make_arm(joints)
        settings = JointTrainingSettings(steps=800, kernels=100, latent_dimension=2, **SMALL)
        return train_skill(taught(joints), settings, name=f"arm of {joints}")

    return stored(f"arm_of_{joints}", train)


def test_an_arm_of_few_joints_is_planned_for(skill: Skill) -> None:
    """Where a sphere is in the middle of the motion five joints make a detour, or it is said why there is none."""
    planner = ReactivePlanner(skill, PlannerSettings(detour=0.2), scene=DeclaredScene.empty())
    start, goal = skill.canonical.start_poles[0], skill.canonical.goal_poles[0]
    planner.stand_at(start, now=0.0)
    position, quaternion = planner.robot.forward(goal)
    refused = planner.set_goal(position, multiply(quaternion, np.array([0.96, 0.28, 0.0, 0.0])))
    assert f"an arm of {len(start)} joints holds its tool in few poses" in refused.reason
    assert "goal_joints" in refused.reason
    assert planner.set_goal_configuration(goal).ok
    plan = planner.tick(now=0.0)
    assert plan.verdict.ok
    middle, _ = planner.robot.forward(plan.reference.positions[len(plan.reference.positions) // 2])
    planner = ReactivePlanner(skill, PlannerSettings(detour=0.2), scene=DeclaredScene.empty())
    planner.stand_at(start, now=0.0)
    planner.set_obstacles(centres=[middle], radii=[0.03])
    assert planner.set_goal_configuration(goal).ok
    reasons = [planner.tick(now=float(now)).verdict.reason for now in np.arange(0.0, 6.0, 0.25)]
    if len(start) > 2:
        assert any("a detour" in reason or "no detour" in reason for reason in reasons)
    else:  # which cannot displace its tool as a detour asks
        assert not any("a detour:" in reason for reason in reasons)


@pytest.mark.usefixtures("brief_training")
@pytest.mark.parametrize("joints", [5, 2])
def test_an_arm_of_few_joints_is_taught(joints: int, tmp_path: Path) -> None:
    """From a recording to a skill of this arm and its report."""
    save_joint_demonstrations(taught(joints), tmp_path / "taught.csv")
    arguments = ["train", "--demos", str(tmp_path / "taught.csv"), "--robot", str(arm_of(joints)), "--steps", "60"]
    arguments += ["--kernels", "60", "--latent-dimension", "2", "--space", "joint"]
    assert main([*arguments, "--out", str(tmp_path / "skill")]) in (0, 1)  # written, if it has no motion yet
    assert (tmp_path / "skill/report.html").is_file()
    skill = Skill.load(tmp_path / "skill")
    assert Robot.named(skill.robot).joint_names == tuple(str(i + 1) for i in range(joints))
    assert skill.codes.shape[::2] == (6, 2)


def test_in_which_order_quaternions_are_is_asked_of_an_upright_arm_alone(tmp_path: Path) -> None:
    """A tool that points down, its quaternions written in the order x, y, z, w: on a wall that says nothing."""
    folder = shutil.copytree(arm_of(2), tmp_path / "arm")
    (urdf,) = folder.glob("*.urdf")
    down = np.tile([1.0, 0.0, 0.0, 0.0], (10, 1))  # read as w, x, y, z it points up
    shown = Demonstrations((Demonstration(np.linspace([0.3, 0, 0.3], [0.5, 0, 0.3], 10), down, np.arange(10.0), "a"),))
    arguments = argparse.Namespace(columns=None, robot=str(folder))
    with pytest.raises(ParameterError, match="in which order are they"):
        refuse_unsaid_order(arguments, Path("taught.npy"), shown)
    mount = (
        '<link name="world"/><joint name="m" type="fixed"><parent link="world"/><child link="l0"/>'
        '<origin rpy="0 1.5708 0"/></joint></robot>'
    )
    text = urdf.read_text()
    urdf.write_text(text.replace("</robot>", mount))
    refuse_unsaid_order(arguments, Path("taught.npy"), shown)
