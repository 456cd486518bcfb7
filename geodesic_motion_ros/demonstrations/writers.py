"""Demonstrations -> a file that `read_demonstrations` or `read_joint_demonstrations` reads. A file is written whole."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from geodesic_motion_ros.demonstrations.column_names import DEMONSTRATION, TIME
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.takes import Take
from geodesic_motion_ros.utils.errors import DemonstrationError
from geodesic_motion_ros.utils.whole_files import written_whole

JOINT_SUFFIXES = (".npz", ".csv")
"""Kinds of files that demonstrations of joints are written to."""


def save_demonstrations(demonstrations: Demonstrations, path: str | Path) -> None:
    """Write demonstrations of equally many samples to a `.npz` file, to be read with units "m".

    Keys: positions (N, T, 3) [m], quaternions (N, T, 4), scalar first, where there are orientations, and times
    (N, T) [s]. Names and the frame are not kept.

    Raises
    ------
    DemonstrationError : the path does not end in .npz or cannot be written; the numbers of samples differ.
    """
    path = check_suffix(path, (".npz",))
    arrays = {
        "positions": demonstrations.positions_array(),
        "times": np.stack([item.times for item in demonstrations]),
    }
    if demonstrations.has_orientation:
        arrays["quaternions"] = demonstrations.quaternions_array()
    with _written(path) as part:
        _write_arrays(part, arrays)


def save_joint_demonstrations(demonstrations: JointDemonstrations, path: str | Path) -> None:
    """Write demonstrations of joints to a `.npz` or `.csv` file.

    `.npz`, for equally many samples each: keys configurations (N, T, eta) [rad], times (N, T) [s], joint_names (eta,),
    names (N,), robot. `.csv`: columns demonstration, t and the joints' names; the name of the robot is not kept.

    Raises
    ------
    DemonstrationError : the path ends otherwise or cannot be written; `.npz`: the numbers of samples differ.
    """
    path = check_suffix(path, JOINT_SUFFIXES)
    if path.suffix.lower() == ".csv":
        rows = [(item.name, item.times, item.configurations) for item in demonstrations]
        with _written(path) as part:
            _write_rows(part, demonstrations.joint_names, rows)
        return
    arrays = {
        "configurations": demonstrations.configurations_array(),
        "times": np.stack([item.times for item in demonstrations]),
        "joint_names": np.array(demonstrations.joint_names),
        "names": np.array([item.name for item in demonstrations]),
        "robot": np.array(demonstrations.robot),
    }
    with _written(path) as part:
        _write_arrays(part, arrays)


def save_take(take: Take, path: str | Path) -> None:
    """Write a take of joints to a `.csv` file, as it was recorded: its times may repeat and fall.

    Raises
    ------
    DemonstrationError : the path ends otherwise or cannot be written.
    """
    with _written(check_suffix(path, (".csv",))) as part:
        _write_rows(part, take.names, [(take.name, take.times, take.values)])


def check_suffix(path: str | Path, suffixes: tuple[str, ...]) -> Path:
    """Refuse a path that ends in none of the suffixes: DemonstrationError; else it is returned."""
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise DemonstrationError(
            f"{path}: demonstrations are written to {' or '.join(suffixes)} files, not '{path.suffix}'"
        )
    return path


@contextmanager
def _written(path: Path) -> Iterator[Path]:
    """`written_whole`; DemonstrationError: the path cannot be written."""
    try:
        with written_whole(path) as part:
            yield part
    except OSError as error:
        raise DemonstrationError(f"{path}: cannot be written ({error.strerror or error})") from error


def _write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with path.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def _write_rows(
    path: Path, columns: Sequence[str], demonstrations: Sequence[tuple[str, np.ndarray, np.ndarray]]
) -> None:
    """Of each demonstration its name, times (T,) and values (T, C)."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow((DEMONSTRATION, TIME, *columns))
        for name, times, values in demonstrations:
            for time, row in zip(times, values, strict=True):
                writer.writerow((name, time, *row))
