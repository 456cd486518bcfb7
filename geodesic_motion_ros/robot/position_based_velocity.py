"""PositionBasedVelocity: how fast joints may approach the stops at the ends of their ranges, as makers limit it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numba
import numpy as np

#: Speed [rad/s] that counts as none: where no speed is allowed, that of rounding is.
STILL = 1e-6


@dataclass(frozen=True)
class PositionBasedVelocity:
    """Limits of eta joints' speeds towards their stops: at a distance x at most sqrt(2 deceleration x) - offset.

    That is the speed from which a joint that brakes as hard as `deceleration` stands before its stop. Away from a stop
    it is no limit.

    Attributes
    ----------
    deceleration : (eta,) [rad/s^2]. offset : (eta,) [rad/s].
    lower, upper : (eta,) stops [rad], which may lie beyond the limits of position; infinite for joints without one.
    """

    deceleration: np.ndarray
    offset: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def __post_init__(self) -> None:
        for field in fields(self):
            values = np.array(getattr(self, field.name), dtype=float)
            values.setflags(write=False)
            object.__setattr__(self, field.name, values)

    def largest_speeds(self, positions: np.ndarray) -> np.ndarray:
        """Largest speeds [rad/s] (2, n, eta) towards the lower and towards the upper stops at positions (n, eta).

        At a stop and just before it `STILL`, far from it any.
        """
        arrays = self.deceleration, self.offset, self.lower, self.upper
        return _largest_speeds(np.asarray(positions, dtype=float), *arrays)


@numba.njit(cache=True, nogil=True)
def approach_speed(room: float, deceleration: float, offset: float) -> float:
    """Largest speed [rad/s] at a distance [rad] before a stop; negative where none is allowed."""
    return math.sqrt(2.0 * deceleration * max(room, 0.0)) - offset


@numba.njit(cache=True, nogil=True)
def _largest_speeds(
    positions: np.ndarray, deceleration: np.ndarray, offset: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """As `PositionBasedVelocity.largest_speeds`."""
    result = np.empty((2, *positions.shape))
    for i in range(positions.shape[0]):
        for j in range(positions.shape[1]):
            downwards = approach_speed(positions[i, j] - lower[j], deceleration[j], offset[j])
            upwards = approach_speed(upper[j] - positions[i, j], deceleration[j], offset[j])
            result[0, i, j], result[1, i, j] = max(downwards, STILL), max(upwards, STILL)
    return result
