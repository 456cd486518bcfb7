"""Demonstrations -> a file that `read_demonstrations` or `read_joint_demonstrations` reads."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.recorded_tables import DEMONSTRATION, TIME
from geodesic_motion_ros.utils.errors import DemonstrationError

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
    path = checked_suffix(path, (".npz",))
    arrays = {
        "positions": demonstrations.positions_array(),
        "times": np.stack([item.times for item in demonstrations]),
    }
    if demonstrations.has_orientation:
        arrays["quaternions"] = demonstrations.quaternions_array()
    _write(path, lambda: _write_arrays(path, arrays))


def save_joint_demonstrations(demonstrations: JointDemonstrations, path: str | Path) -> None:
    """Write demonstrations of joints to a `.npz` or `.csv` file.

    `.npz`, for equally many samples each: keys configurations (N, T, eta) [rad], times (N, T) [s], joint_names (eta,),
    names (N,), robot. `.csv`: columns demonstration, t and the joints' names; the name of the robot is not kept.

    Raises
    ------
    DemonstrationError : the path ends otherwise or cannot be written; `.npz`: the numbers of samples differ.
    """
    path = checked_suffix(path, JOINT_SUFFIXES)
    if path.suffix.lower() == ".csv":
        _write(path, lambda: _write_rows(path, demonstrations))
        return
    arrays = {
        "configurations": demonstrations.configurations_array(),
        "times": np.stack([item.times for item in demonstrations]),
        "joint_names": np.array(demonstrations.joint_names),
        "names": np.array([item.name for item in demonstrations]),
        "robot": np.array(demonstrations.robot),
    }
    _write(path, lambda: _write_arrays(path, arrays))


def checked_suffix(path: str | Path, suffixes: tuple[str, ...]) -> Path:
    """A path that ends in one of the suffixes; DemonstrationError otherwise."""
    path = Path(path)
    if path.suffix.lower() not in suffixes:
        raise DemonstrationError(
            f"{path}: demonstrations are written to {' or '.join(suffixes)} files, not '{path.suffix}'"
        )
    return path


def _write(path: Path, write: Callable[[], None]) -> None:
    try:
        write()
    except OSError as error:
        raise DemonstrationError(f"{path}: cannot be written ({error.strerror or error})") from error


def _write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with path.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def _write_rows(path: Path, demonstrations: JointDemonstrations) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow((DEMONSTRATION, TIME, *demonstrations.joint_names))
        for item in demonstrations:
            for time, configuration in zip(item.times, item.configurations, strict=True):
                writer.writerow((item.name, time, *configuration))
