"""Shared fixtures: a small skill trained for the tests, and where real recordings are, when they are there at all."""

from __future__ import annotations

import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.quaternions import rotate_by
from geodesic_motion_ros.skill import Skill

REPOSITORY = Path(__file__).resolve().parents[1]

# A shell that starts the tests in the background has SIGINT ignored, and programs under test would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of real recordings (GEODESIC_DATA, or shared/data beside the clone); skips where there is none."""
    folder = Path(os.environ.get("GEODESIC_DATA", REPOSITORY.parent / "shared" / "data"))
    if not (folder / "robotasks").is_dir():
        pytest.skip(f"no recordings in {folder}: set GEODESIC_DATA to a folder that holds robotasks/")
    return folder


def fan_of_demonstrations() -> Demonstrations:
    """Seven reaches of a Panda from right to left that bulge out differently far, turning the tool by half a radian."""
    share = np.linspace(0.0, 1.0, 120)
    start, goal = np.array([0.45, -0.28, 0.32]), np.array([0.48, 0.26, 0.36])
    down = np.array([0.0, 1.0, 0.0, 0.0])
    items = []
    for number, bulge in enumerate(np.linspace(-0.12, 0.12, 7)):
        line = start + share[:, None] * (goal - start)
        positions = line + np.sin(np.pi * share)[:, None] * bulge * np.array([0.8, 0.0, 0.6])
        turns = share[:, None] * np.array([0.0, 0.0, 0.5]) + bulge * np.array([0.5, 0.0, 0.0])
        quaternions = rotate_by(turns, np.broadcast_to(down, (len(share), 4)))
        items.append(Demonstration(positions, quaternions, 4.0 * share, f"reach {number}"))
    return Demonstrations(tuple(items))


#: Of a skill small enough to be trained anew for every run of the tests.
SMALL = {
    "steps": 800, "hidden": (64, 32), "samples": 100, "kernels": 100, "precision_samples": 2,
    "precision_iterations": 60,
}  # fmt: skip


def shifted(demonstration: Demonstration, start: np.ndarray, goal: np.ndarray) -> Demonstration:
    """A demonstration with offsets (6,) of its start and goal, translation [m] and rotation vector [rad], that blend
    linearly with the sample's number."""
    share = np.linspace(0.0, 1.0, len(demonstration))[:, None]
    blend = (1.0 - share) * start + share * goal
    return replace(
        demonstration,
        positions=demonstration.positions + blend[:, :3],
        quaternions=rotate_by(blend[:, 3:], demonstration.quaternions),
    )


def fan_with_varying_ends(seed: int = 0) -> Demonstrations:
    """The fan, with starts and goals that vary by some centimetres and tenths of a radian."""
    random = np.random.default_rng(seed)
    scale = np.repeat([0.025, 0.08], 3)
    items = [shifted(item, *random.uniform(-scale, scale, (2, 6))) for item in fan_of_demonstrations()]
    return Demonstrations(tuple(items))


@pytest.fixture(scope="session")
def fan_skill() -> Skill:
    """A skill for a Panda on the raw sheet, really trained."""
    from geodesic_motion_ros.manifold.training import TrainingSettings, train_task_space_skill

    settings = TrainingSettings(sheet="raw", **SMALL)
    return train_task_space_skill(fan_of_demonstrations(), settings, name="fan")


@pytest.fixture(scope="session")
def varying_fan() -> Demonstrations:
    """What canonical_fan_skill was learned from."""
    return fan_with_varying_ends()


@pytest.fixture(scope="session")
def canonical_fan_skill(varying_fan: Demonstrations) -> Skill:
    """A skill for a Panda on the canonical sheet, learned from demonstrations whose starts and goals vary."""
    from geodesic_motion_ros.manifold.training import TrainingSettings, train_task_space_skill

    return train_task_space_skill(varying_fan, TrainingSettings(**SMALL), name="canonical fan")
