from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import ModuleType

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.quaternions import rotate_by
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill


@pytest.fixture(scope="session")
def demonstrations() -> Demonstrations:
    """Six invented demonstrations of carrying a cup over an edge and tilting it; starts and goals vary."""
    rng = np.random.default_rng(11)
    items = []
    for index in range(6):
        samples = 150 + 10 * index
        s = np.linspace(0.0, 1.0, samples)[:, None]
        start, goal = np.array([0.45, 0.2, 0.3]), np.array([0.4, -0.35, 0.25])
        start, goal = start + rng.normal(0.0, 0.02, 3), goal + rng.normal(0.0, 0.01, 3)
        lift = (0.12 + 0.01 * rng.normal()) * np.sin(np.pi * s) * np.array([0.3, 0.0, 1.0])
        turn = s**2 * (np.array([1.2, 0.2, 0.0]) + rng.normal(0.0, 0.05, 3))
        upright = np.tile([0.0, 1.0, 0.0, 0.0], (samples, 1))
        recorded = rotate_by(turn, upright) * (-1.0 if index == 4 else 1.0)
        times = s[:, 0] * (2.0 + 0.1 * index)
        items.append(Demonstration(start + s * (goal - start) + lift, recorded, times, f"cup_{index}"))
    return Demonstrations(tuple(items))


@pytest.fixture(scope="session")
def reach_poses(reach_demonstrations) -> Demonstrations:
    """The tool's poses in what reach_skill was learned from."""
    return reach_demonstrations.tool_demonstrations(Robot.named("panda"))


@pytest.fixture(scope="session")
def reach_pose_skill(stored, reach_poses: Demonstrations) -> Skill:
    """A skill of task space of the same reaches, on the canonical sheet."""
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.learning.training import train_skill

    settings = TrainingSettings(
        steps=800, hidden=(64, 32), samples=80, kernels=100, precision_samples=2, precision_iterations=60
    )
    return stored("reach_poses", lambda: train_skill(reach_poses, settings, name="reach poses"))


@pytest.fixture(scope="session")
def pouring_poses() -> Demonstrations:
    """Three bottles carried to three cups, three times each: the tool's commanded poses, without physics."""
    from geodesic_motion_ros.simulation.joint_teacher import pouring_guidances

    commanded = [guidance.motion for guidance in pouring_guidances(3, 0)]
    items = [Demonstration(each.positions, each.quaternions, each.times, each.name) for each in commanded]
    return Demonstrations(tuple(items))


@pytest.fixture(scope="session")
def pouring_pose_skill(stored, pouring_poses: Demonstrations) -> Skill:
    """A skill of task space of those pourings, on the raw sheet."""
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.learning.training import train_skill

    settings = TrainingSettings(
        steps=900, batch=128, learning_rate=6e-3, hidden=(64, 32), samples=60, kernels=100, precision_samples=2,
        precision_iterations=40, sheet="raw",
    )  # fmt: skip
    return stored("pouring_poses", lambda: train_skill(pouring_poses, settings, name="pouring poses"))


@pytest.fixture(scope="session")
def stored_in(stored) -> Callable[[ModuleType], AbstractContextManager[list[Skill]]]:
    """`with stored_in(experiment) as taken:` an experiment takes the stored skill where it would train one; `taken` has
    those that it took.
    """

    @contextmanager
    def replaced(experiment: ModuleType) -> Iterator[list[Skill]]:
        taken: list[Skill] = []

        def take(task, shown, settings, folder) -> Skill:
            taken.append(stored(task, lambda: train_skill(shown, settings, name=task)))
            return taken[-1]

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(experiment, "trained_once", take)
            yield taken

    return replaced
