"""Ranges of the numbers in files: what lies outside was made by a damaged or foreign file, not by an arm."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.utils.errors import SkillError

ARM_REACH = 3.0
"""No arm this package is meant for carries its tool farther than this [m] from its base."""
UNIT_NORM_TOLERANCE = 1e-2
"""Quaternions this close to length 1 are normalised: rounding passes, mixed-up columns do not."""
LARGEST_TURN = 4.0 * np.pi
"""Joints turn by two turns at most in either direction [rad], and offsets by no more."""
LARGEST_WEIGHT, SMALLEST_SCALE = 1e9, 1e-9
"""Of a network. The largest of the shipped skills are those of kappa, 1e5, the smallest scale is 0.1: a hundred times
more precise demonstrations of a thousandth of the size stay far inside, and products of them do not overflow."""
LARGEST_CODE, SMALLEST_BOX = 1e3, 1e-6
"""Codes are drawn towards a normal distribution of variance 1 and lie within 5 of the origin. In a smaller box the
steps that derivatives are taken over drown in rounding."""


def check_array(
    name: str, array: np.ndarray, shape: tuple[int, ...], lowest: float = -np.inf, highest: float = np.inf
) -> None:
    """Refuse an array of another shape, with values that are not finite, or outside lowest to highest.

    Raises
    ------
    SkillError : names the array, and the value or the shape.
    """
    check_real(name, array)
    if array.shape != shape:
        raise SkillError(f"{name} has shape {array.shape}; it must have shape {shape}")
    wrong = array[~np.isfinite(array)]
    if wrong.size:
        raise SkillError(f"{name} holds {wrong[0]}; its numbers must be finite")
    check_range(name, array, lowest, highest)


def check_real(name: str, array: np.ndarray) -> None:
    """Refuse an array of anything but real numbers: SkillError with the type."""
    if array.dtype.kind not in "iuf":
        raise SkillError(f"{name} holds elements of type {array.dtype}; real numbers are needed")


def check_range(name: str, array: np.ndarray, lowest: float, highest: float) -> None:
    """Refuse an array with values outside lowest to highest: SkillError with the first of them."""
    outside = array[(array < lowest) | (array > highest)]
    if outside.size:
        raise SkillError(f"{name} holds {outside[0]:.4g}; it must lie between {lowest:.4g} and {highest:.4g}")


def check_unit(name: str, quaternions: np.ndarray) -> None:
    """Refuse quaternions (..., 4) that are not of unit length: SkillError with the length."""
    lengths = np.linalg.norm(quaternions, axis=-1).ravel()
    wrong = lengths[np.abs(lengths - 1.0) > UNIT_NORM_TOLERANCE]
    if wrong.size:
        raise SkillError(f"{name} holds a quaternion of length {wrong[0]:.4g}; it must be 1 (w, x, y, z)")


def check_pose(name: str, pose: np.ndarray) -> None:
    """Refuse a pose (7,) that no arm holds its tool in, x, y, z [m], w, x, y, z: SkillError."""
    check_array(name, pose, (7,))
    distance = float(np.linalg.norm(pose[:3]))
    if distance > ARM_REACH:
        raise SkillError(f"{name} is {distance:.4g} m from the base; no arm reaches {ARM_REACH:g} m")
    check_unit(name, pose[3:])
