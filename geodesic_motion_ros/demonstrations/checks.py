"""Checks that recordings of every kind must pass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from geodesic_motion_ros.utils.errors import DemonstrationError

Abscissa = Literal["arc_length", "time"]
"""What samples can be equally spaced in."""
LATEST_TIME = 1e10
"""Seconds since 1970 are below 2e9; larger times are milliseconds or nanoseconds."""


def check_columns(
    array: np.ndarray, names: Sequence[str], demonstration: str, times: np.ndarray | None = None
) -> np.ndarray:
    """Copy an array as float64 of shape (T, len(names)), every value finite; DemonstrationError otherwise.

    times : (T,) [s], named where they are known.
    """
    copy = np.array(array, dtype=float)
    if copy.ndim != 2 or copy.shape[1] != len(names):
        raise DemonstrationError(
            f"demonstration '{demonstration}': an array of shape {copy.shape} cannot hold "
            f"{', '.join(names)}; it needs shape (samples, {len(names)})"
        )
    bad = np.argwhere(~np.isfinite(copy))
    if len(bad):
        sample, column = bad[0]
        when = "" if times is None else f", at {times[sample]:.2f} s"
        raise DemonstrationError(
            f"demonstration '{demonstration}', sample {sample}, column {names[column]}: "
            f"{copy[sample, column]} is not a finite number ({len(bad)} such value(s) in these columns){when}"
        )
    return copy


def check_times(times: np.ndarray, demonstration: str) -> np.ndarray:
    """Copy times (T,) [s] as float64, finite and within LATEST_TIME; DemonstrationError otherwise."""
    copy = check_columns(np.reshape(times, (-1, 1)), ("t",), demonstration)[:, 0]
    late = np.flatnonzero(np.abs(copy) > LATEST_TIME)
    if len(late):
        raise DemonstrationError(
            f"demonstration '{demonstration}', sample {late[0]}, column t: {copy[late[0]]:.4g} s is beyond "
            f"{LATEST_TIME:g} s; times must be in seconds"
        )
    return copy


def check_rising_times(times: np.ndarray, demonstration: str) -> np.ndarray:
    """Copy times (T,) [s] as float64, within LATEST_TIME and strictly increasing; DemonstrationError otherwise."""
    copy = check_times(times, demonstration)
    falls = np.flatnonzero(np.diff(copy) <= 0.0)
    if len(falls):
        sample = falls[0] + 1
        raise DemonstrationError(
            f"demonstration '{demonstration}', sample {sample}, column t: {copy[sample]:.6g} s does not "
            f"come after {copy[sample - 1]:.6g} s; times must be strictly increasing"
        )
    return copy


def check_samples(samples: int, demonstration: str) -> None:
    """Refuse fewer samples than a motion has: DemonstrationError."""
    if samples < 2:
        raise DemonstrationError(f"demonstration '{demonstration}' has {samples} sample(s); a motion needs at least 2")


def check_resampling(samples: int, by: Abscissa) -> None:
    """Refuse numbers of samples and abscissas that nothing can be resampled to: DemonstrationError."""
    if samples < 2:
        raise DemonstrationError(f"cannot resample to {samples} sample(s); ask for at least 2")
    if by not in ("arc_length", "time"):
        raise DemonstrationError(f"cannot resample by '{by}'; choose 'arc_length' or 'time'")
