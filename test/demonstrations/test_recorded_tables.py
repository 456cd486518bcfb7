"""Columns by their names out of files: whatever the file, the same numbers are the same table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.column_names import parse_columns
from geodesic_motion_ros.demonstrations.recorded_tables import read_joint_tables, read_names, read_pose_tables
from geodesic_motion_ros.utils.errors import DemonstrationError

COLUMNS = "t,px,py,pz,qw,qx,qy,qz"
NAMES = parse_columns(COLUMNS)
POSES = np.random.default_rng(0).normal(size=(2, 5, len(NAMES)))
JOINTS = ("shoulder", "elbow")


def write_npy(path: Path) -> None:
    np.save(path, POSES)


def write_one_array(path: Path) -> None:
    np.savez(path, anything=POSES)


def write_named_arrays(path: Path) -> None:
    np.savez(path, positions=POSES[..., 1:4], quaternions=POSES[..., 4:], times=POSES[..., 0])


def write_csv(path: Path) -> None:
    rows = [f"demonstration,{COLUMNS}"]
    for number, sheet in enumerate(POSES):
        rows += [",".join([f"{path.stem}_{number}", *map(repr, row.tolist())]) for row in sheet]
    path.write_text("\n".join(rows))


@pytest.mark.parametrize(
    ("suffix", "write"),
    [("npy", write_npy), ("npz", write_one_array), ("npz", write_named_arrays), ("csv", write_csv)],
)
def test_the_same_numbers_are_the_same_tables(tmp_path: Path, suffix: str, write) -> None:
    path = tmp_path / f"pour.{suffix}"
    write(path)
    tables = read_pose_tables(path, NAMES, 100.0)
    assert list(tables) == ["pour_0", "pour_1"]
    for table, expected in zip(tables.values(), POSES, strict=True):
        assert set(table) == set(NAMES)
        np.testing.assert_array_equal(np.stack([table[name] for name in NAMES], axis=1), expected)


def test_joints_are_named_by_the_file_and_those_of_another_arm_are_refused(tmp_path: Path) -> None:
    path, angles = tmp_path / "reach.npz", POSES[..., :2]
    np.savez(path, configurations=angles, joint_names=JOINTS[::-1], names=["left", "right"])
    tables = read_joint_tables(path, JOINTS, "toy", 100.0)
    np.testing.assert_array_equal(tables["right"]["elbow"], angles[1, :, 0])
    with pytest.raises(DemonstrationError, match="expected are those of 'other'"):
        read_joint_tables(path, ("shoulder", "wrist"), "other", 100.0)


def test_names_are_those_of_arrays_or_of_columns(tmp_path: Path) -> None:
    poses, rows, letters = tmp_path / "poses.npz", tmp_path / "rows.csv", tmp_path / "letters.npy"
    write_named_arrays(poses)
    write_csv(rows)
    write_npy(letters)
    assert read_names(poses) == {"positions", "quaternions", "times"}
    assert read_names(rows) == {"demonstration", *NAMES}
    assert read_names(letters) == set()
