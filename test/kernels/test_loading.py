"""No kernel is loaded, or compiled for seconds, while an arm moves: `load_kernels` loads them all.

Each planner runs in a process of its own, where nothing else has loaded kernels.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

COMMON = """
import sys, time
import numpy as np
from numba.core.dispatcher import Dispatcher
from geodesic_motion_ros.utils.deadline import Deadline
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.kernels.loading import load_kernels
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.contract.status import Refusal, VerdictCode

def loaded():
    modules = [module for name, module in sys.modules.items() if name.startswith("geodesic_motion_ros")]
    kernels = {kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)}
    return {(kernel.py_func.__name__, str(signature)) for kernel in kernels for signature in kernel.signatures}

def scenes(places):
    '''Obstacles of each kind that go along places (n, 3), spheres alone, ten of them, then none.'''
    for number, place in enumerate(places):
        time = 0.1 * number
        yield time, Obstacles.one_of_each(place, np.array([0.05, 0.0, 0.0]), time)
        around = place + 0.08 * np.random.default_rng(number).normal(size=(10, 3))
        for centres in (around[:1], around):
            radii, still = np.full(len(centres), 0.04), np.zeros_like(centres)
            yield time + 0.003 * len(centres), Obstacles.of_spheres(centres, radii, still, time)
        yield time + 0.06, Obstacles.none()

def deadlines():
    while True:
        yield Deadline()
        yield Deadline(time.monotonic() + 0.005)
        yield Deadline(time.monotonic() - 1.0)
"""

PLANNED = """
planner = ReactivePlanner(skill, scene=DeclaredScene.empty())
load_kernels(planner)
before = loaded()
assert planner.commanded_state(0.0) is None and planner.tick(0.0).verdict.code is VerdictCode.STALE_STATE
ends = skill.start_pose[:3], skill.start_pose[3:], skill.goal_pose[:3], skill.goal_pose[3:]
codes = set()
for path in example_paths(planner):
    planner.stand_at(path[0], 0.0)
    planner.set_goal_configuration(path[-1])
    places = end_effector_poses(path[:: len(path) // 10].copy(), planner.robot.chain)[0]
    for (time_of, obstacles), deadline in zip(scenes(places), deadlines()):
        planner.take_obstacles(obstacles)
        codes.add(planner.tick(time_of, deadline).verdict.code.name)
    planner.set_goal(skill.goal_pose[:3] + 0.01, skill.goal_pose[3:])
    planner.tick(time_of + 0.1)
    planner.stop(time_of + 0.2, Refusal(VerdictCode.NO_GOAL))
planner.plan(*ends)
# The goal is covered.
planner.stand_at(path[0], 5.0)
planner.set_goal_configuration(path[-1])
covered = end_effector_poses(path[-1:].copy(), planner.robot.chain)[0]
planner.take_obstacles(Obstacles.of_spheres(covered, np.full(1, 0.05), np.zeros((1, 3)), 5.0))
modes = [planner.tick(5.0 + 0.01 * number).mode.value for number in range(5)]
assert "approaching" in modes, modes
# No path, and something comes to where the arm stands.
planner.stand_at(path[len(path) // 2], 10.0)
planner.set_goal_configuration(path[-1])
hand, goal = end_effector_poses(path[[len(path) // 2, -1]].copy(), planner.robot.chain)[0]
centres, velocities = np.stack([goal, hand + [0.0, 0.0, 0.5]]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -0.22]])
planner.take_obstacles(Obstacles.of_spheres(centres, np.full(2, 0.05), velocities, 10.0))
reasons = [planner.tick(10.0 + 0.01 * number).verdict.reason for number in range(5)]
assert any("evading" in reason for reason in reasons), reasons
# What comes leaves no place on the graph free.
middle, from_right = path[len(path) // 2], np.array([[0.0, -1.0, 0.0]])
planner.stand_at(middle, 20.0)
planner.set_goal_configuration(path[-1])
for number in range(60):
    now = 20.0 + 0.01 * number
    hand = planner.robot.forward(planner.commanded_state(now)[0])[0]
    centre = hand + (0.3 - 0.003 * number) * from_right
    planner.take_obstacles(Obstacles.of_spheres(centre, np.full(1, 0.1), -0.3 * from_right, now))
    planner.tick(now)
assert np.linalg.norm(hand - planner.robot.forward(middle)[0]) > 0.02, hand
print(len(before) > 40, sorted(codes), sorted(loaded() - before))
"""

JOINTS = """
skill = Skill.load("panda_reach_to_grasp")
def example_paths(planner):
    return [skill.canonical.configurations[skill.canonical.modes == mode].mean(axis=0) for mode in (0, 1)]
"""

TOOL = """
skill = Skill.load("panda_pouring")
def example_paths(planner):
    return [np.array(planner.plan(*ends).reference.positions)]
"""


def check_loaded(program: str, *arguments: str) -> None:
    """Run ticks in a process of their own, and check that none of them loads a kernel."""
    command = [sys.executable, "-c", COMMON + program, *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    many, rest = done.stdout.strip().split(" ", 1)
    assert many == "True"
    # The scenes are not all free, nor all blocked.
    assert "'OK'" in rest
    assert "'NO_FEASIBLE_PATH'" in rest
    assert rest.endswith(" []"), rest


@pytest.mark.parametrize("skill", [JOINTS, TOOL], ids=["joints", "tool"])
def test_every_kernel_of_ticks_is_loaded_before_them(skill: str) -> None:
    check_loaded(skill + PLANNED)


#: An arm that takes configurations as goals, for it holds few poses.
FEW_JOINTS = """
skill = Skill.load(sys.argv[1])
planner = ReactivePlanner(skill, scene=DeclaredScene.empty())
load_kernels(planner)
before = loaded()
path = skill.canonical.configurations.mean(axis=0)
codes = set()
planner.stand_at(path[0], 0.0)
planner.set_goal_configuration(path[-1])
places = end_effector_poses(path[:: len(path) // 10].copy(), planner.robot.chain)[0]
for (time_of, obstacles), deadline in zip(scenes(places), deadlines()):
    planner.take_obstacles(obstacles)
    codes.add(planner.tick(time_of, deadline).verdict.code.name)
print(len(before) > 40, sorted(codes), sorted(loaded() - before))
"""


def test_so_are_those_of_an_arm_of_few_joints() -> None:
    folder = Path(__file__).resolve().parents[1] / "skills" / "arm_of_5"
    check_loaded(FEW_JOINTS, str(folder))
