"""What is written is read back as it was."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.readers import read_demonstrations
from geodesic_motion_ros.demonstrations.writers import save_demonstrations
from geodesic_motion_ros.errors import DemonstrationError


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
