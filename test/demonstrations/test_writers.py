"""What is written is read back as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.demonstrations.readers import read_demonstrations, read_joint_demonstrations
from geodesic_motion_ros.demonstrations.writers import save_demonstrations, save_joint_demonstrations
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import DemonstrationError

ROBOT = Robot.named("panda")


def shown(samples: tuple[int, ...]) -> Demonstrations:
    """One demonstration for each number of samples, with orientations and uneven times."""
    generator = np.random.default_rng(5)
    items = []
    for index, count in enumerate(samples):
        s = np.linspace(0.0, 1.0, count)
        positions = np.stack([0.4 + 0.1 * s, 0.3 * np.sin(3.0 * s), 0.2 + 0.1 * index * s], axis=1)
        quaternions = np.stack([np.cos(0.5 * s), 0.0 * s, np.sin(0.5 * s), 0.0 * s], axis=1)
        times = np.cumsum(generator.uniform(0.005, 0.015, count))
        items.append(Demonstration(positions, quaternions, times, f"shown_{index}"))
    return Demonstrations(tuple(items))


def test_the_reader_gives_back_what_was_saved(tmp_path: Path) -> None:
    demonstrations = shown((40, 40, 40))
    save_demonstrations(demonstrations, tmp_path / "shown.npz")
    back = read_demonstrations(tmp_path / "shown.npz", "m")
    assert back.has_orientation
    np.testing.assert_array_equal(back.positions_array(), demonstrations.positions_array())
    np.testing.assert_allclose(back.quaternions_array(), demonstrations.quaternions_array(), atol=1e-15)
    for before, after in zip(demonstrations, back, strict=True):
        np.testing.assert_array_equal(after.times, before.times)


def test_no_orientation_is_made_up(tmp_path: Path) -> None:
    save_demonstrations(replace(shown((20,)), has_orientation=False), tmp_path / "shown.npz")
    assert not read_demonstrations(tmp_path / "shown.npz", "m").has_orientation


def test_different_numbers_of_samples_are_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(DemonstrationError, match="between 30 and 40 samples: resample"):
        save_demonstrations(shown((40, 30)), tmp_path / "shown.npz")
    assert not list(tmp_path.iterdir())


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DemonstrationError, match=r"\.npz"):
        save_demonstrations(shown((20,)), tmp_path / "shown.csv")


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(DemonstrationError, match="missing"):
        save_demonstrations(shown((20,)), tmp_path / "missing" / "shown.npz")


def guided(samples: tuple[int, ...]) -> JointDemonstrations:
    """One demonstration of the Panda's joints for each number of samples, with uneven times."""
    generator = np.random.default_rng(6)
    items = []
    for index, count in enumerate(samples):
        configurations = ROBOT.ready + np.cumsum(generator.normal(size=(count, 7)) * 0.01, axis=0)
        times = np.cumsum(generator.uniform(0.005, 0.015, count))
        items.append(JointDemonstration(configurations, times, f"family_{index}"))
    return JointDemonstrations(tuple(items), ROBOT.joint_names, "panda")


@pytest.mark.parametrize(("name", "samples"), [("guided.npz", (40, 40)), ("guided.csv", (40, 30))])
def test_the_reader_gives_back_the_joints_that_were_saved(tmp_path: Path, name: str, samples: tuple[int, ...]) -> None:
    demonstrations = guided(samples)
    save_joint_demonstrations(demonstrations, tmp_path / name)
    back = read_joint_demonstrations(tmp_path / name, "panda")
    assert back.joint_names == demonstrations.joint_names
    assert back.robot == "panda"
    for before, after in zip(demonstrations, back, strict=True):
        assert after.name == before.name
        np.testing.assert_array_equal(after.configurations, before.configurations)
        np.testing.assert_array_equal(after.times, before.times)


def test_joints_cannot_be_saved_in_different_numbers_or_elsewhere(tmp_path: Path) -> None:
    with pytest.raises(DemonstrationError, match="between 30 and 40 samples: resample"):
        save_joint_demonstrations(guided((40, 30)), tmp_path / "guided.npz")
    with pytest.raises(DemonstrationError, match=r"to \.npz or \.csv files, not '\.npy'"):
        save_joint_demonstrations(guided((40,)), tmp_path / "guided.npy")
    with pytest.raises(DemonstrationError, match=r"missing.*cannot be written"):
        save_joint_demonstrations(guided((40,)), tmp_path / "missing" / "guided.csv")
    assert not list(tmp_path.iterdir())
