"""Fixtures of the integration tests: a small skill on disk, a bench, and nodes on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench import Bench, cloud_of, pose_of
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import PointCloud2

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.kept_graph import digest_recipe
from geodesic_motion_ros.skill.skill import GRID_SHAPES, LearnedModel, Skill

#: Of the skills that a test of this process has decoded, by what they are.
GRAPHS: dict[str, Any] = {}


@pytest.fixture(scope="module", autouse=True)
def graphs_are_shared() -> Iterator[None]:
    """Decode the graph of a skill once for all nodes of this process: it takes half of a planner's start."""
    decode = LearnedModel.graph

    def graph(skill: LearnedModel, *size: Any) -> Any:
        key = digest_recipe({"skill": skill, "size": size, "default": GRID_SHAPES})
        if key not in GRAPHS:
            GRAPHS[key] = decode(skill, *size)
        return GRAPHS[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LearnedModel, "graph", graph)
        yield


@pytest.fixture(scope="session")
def skill_folder(fan_skill: Skill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small skill, on disk."""
    return fan_skill.save(tmp_path_factory.mktemp("skills") / "fan")


@pytest.fixture(scope="session")
def table_skill_folder(fan_skill: Skill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same skill, which says that it was recorded on the shipped table."""
    recorded = replace(fan_skill, scene=DeclaredScene.from_name("table").described)
    return recorded.save(tmp_path_factory.mktemp("skills") / "fan_on_a_table")


@pytest.fixture(scope="session")
def skill(skill_folder: Path) -> Skill:
    return Skill.load(skill_folder)


@pytest.fixture(scope="session")
def start_joints(skill: Skill) -> np.ndarray:
    """Joint positions (7,) [rad] at the skill's start."""
    return solve(Robot.named("panda"), skill.start_pose[:3], skill.start_pose[3:])


@pytest.fixture
def make_cloud() -> Callable[[np.ndarray], PointCloud2]:
    """Makes a cloud of points (n, 3) [m] in the base frame."""
    return cloud_of


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    bench = Bench(realtime=request.node.get_closest_marker("realtime") is not None)
    yield bench
    bench.close()


@pytest.fixture
def make_pose() -> Callable[..., PoseStamped]:
    return pose_of


@pytest.fixture
def planner_options(skill_folder: Path) -> dict[str, Any]:
    """Parameters for a planner of postures, on a machine that may be busy."""
    return {
        "skill": str(skill_folder),
        "output": "target_pose",
        # a small tool, which stands free where a whole hand would touch the scenes' obstacles
        "avoid": "tool",
        "tool_spheres": [0.0, 0.0, 0.0, 0.04],
        "latency": 0.1,
        "state_timeout": 2.0,
        "resume_timeout": 60.0,
        "obstacle_timeout": 3600.0,
        "latent_view_rate": 0.0,
    }


@pytest.fixture
def ready(bench: Bench, planner_options: dict[str, Any], start_joints: np.ndarray) -> Bench:
    """A bench with a planner that has joint states and no goal."""
    bench.watch_planner()
    bench.planner = bench.add(PlannerNode, **planner_options)
    bench.joint_states = bench.send_joint_states(start_joints)
    bench.wait_for_code("NO_GOAL")
    return bench


@pytest.fixture
def moving(ready: Bench, skill: Skill) -> Bench:
    """The same, moving to the skill's goal."""
    ready.send_goal(skill.goal_pose)
    ready.wait_for_code("OK")
    return ready


@pytest.fixture
def wall() -> tuple[list[float], float]:
    """The middle of every demonstration, and a radius [m] that blocks them all without touching the ends."""
    return [0.465, -0.01, 0.34], 0.2
