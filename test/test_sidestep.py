"""Sidesteps: there are places on all sides; one that is gone is certified, within reach, and found in time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.deadline import Deadline
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.pose_solver import PoseSolver, Scene
from geodesic_motion_ros.query import Pose
from geodesic_motion_ros.sidestep import SOON, places_beside
from geodesic_motion_ros.task_frame import TaskFrame

HERE = np.array([0.4, -0.1, 0.3])


def test_there_are_places_on_all_sides_the_nearer_ones_first() -> None:
    away = places_beside(HERE) - HERE
    lengths = np.linalg.norm(away, axis=1)
    assert np.all(np.diff(lengths) > -1e-12)
    for length in np.unique(np.round(lengths, 9)):
        beside = away[np.isclose(lengths, length)] / length
        for direction in np.random.default_rng(0).normal(size=(50, 3)):
            assert np.max(beside @ direction) / np.linalg.norm(direction) > np.cos(np.radians(30.0))


@pytest.fixture(scope="module")
def solver(fan_skill) -> PoseSolver:
    planner = ReactivePlanner(fan_skill)
    return PoseSolver(fan_skill, planner.graph, PlannerSettings(), planner.robot)


@pytest.fixture
def start(fan_skill) -> Pose:
    return Pose(*np.split(fan_skill.start_pose, [3]))


def grazing(start: Pose) -> Scene:
    """A sphere that comes to overlap the tool by 3 cm within `SOON`."""
    velocity = np.array([0.0, 0.2, 0.0])
    centre = start.position + [0.0, 0.0, 0.04] - 0.5 * velocity
    return Scene.of(TaskFrame.identity(), Obstacles.of_spheres(centre[None], np.array([0.03]), velocity[None]))


def anywhere(_: object) -> bool:
    return True


def test_a_sidestep_keeps_clear_and_the_tool_as_it_is(solver, start) -> None:
    scene, latent = grazing(start), np.zeros(2)
    assert solver.clearance_until(None, start, scene.in_task, SOON) < -0.02
    step = solver.sidestep(start, latent, scene, SOON, anywhere, anywhere).reference
    assert np.min(solver.certified(step, scene.in_task, SOON, trusting=True).clearance) > 0.0
    assert np.linalg.norm(step.positions[-1] - start.position) <= 0.05 + 1e-9
    assert np.allclose(np.abs(step.quaternions @ start.quaternion), 1.0)
    assert np.linalg.norm(step.velocity(0.0)) == np.linalg.norm(step.velocity(step.duration)) == 0.0


def test_there_is_no_sidestep_to_where_nothing_may_start_or_the_arm_does_not_reach(solver, start) -> None:
    scene, latent = grazing(start), np.zeros(2)
    assert solver.sidestep(start, latent, scene, SOON, lambda _: False, anywhere) is None
    far = replace(scene, frame=TaskFrame(np.array([5.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0])))
    assert solver.sidestep(start, latent, far, SOON, anywhere, anywhere) is None


def test_out_of_time_one_sidestep_is_tried(solver, start) -> None:
    tried: list[object] = []
    for deadline, count in ((Deadline(-np.inf), 1), (Deadline(np.inf), 4)):
        tried.clear()
        refused = solver.sidestep(
            start, np.zeros(2), grazing(start), SOON, anywhere, lambda step: bool(tried.append(step)), deadline
        )
        assert refused is None
        assert len(tried) == count
