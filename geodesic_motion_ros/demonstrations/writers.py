"""Demonstrations -> a file that `read_demonstrations` reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.errors import DemonstrationError


def save_demonstrations(demonstrations: Demonstrations, path: str | Path) -> None:
    """Write demonstrations of equally many samples to a `.npz` file, to be read with units "m".

    Keys: positions (N, T, 3) [m], quaternions (N, T, 4), scalar first, where there are orientations, and times
    (N, T) [s]. Names and the frame are not kept.

    Raises
    ------
    DemonstrationError : the path does not end in .npz or cannot be written; the numbers of samples differ.
    """
    path = Path(path)
    if path.suffix.lower() != ".npz":
        raise DemonstrationError(f"{path}: demonstrations are written to .npz files, not '{path.suffix}'")
    arrays = {
        "positions": demonstrations.positions_array(),
        "times": np.stack([item.times for item in demonstrations]),
    }
    if demonstrations.has_orientation:
        arrays["quaternions"] = demonstrations.quaternions_array()
    try:
        with path.open("wb") as stream:
            np.savez_compressed(stream, **arrays)
    except OSError as error:
        raise DemonstrationError(f"{path}: cannot be written ({error.strerror or error})") from error
