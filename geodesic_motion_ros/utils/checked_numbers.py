"""Judge numbers: those of files, whose ranges tell an arm's from a damaged or foreign file's, and those of a caller.

What cannot be compared, NaN, lies in no range.
"""

from __future__ import annotations

from numbers import Real

import numpy as np

from geodesic_motion_ros.utils.errors import GeodesicMotionError, PlanningError, SkillError

LARGEST_NUMBER = 1000.0
"""Nothing that an arm has to do with is farther away or larger [m], has turned further [rad], or is faster [m/s]."""
LARGEST_TIME = 4e9
"""No clock in seconds shows more, before 2096: a larger time [s] is one in milliseconds or nanoseconds."""

ARM_REACH = 3.0
"""No arm this package is meant for carries its tool farther than this [m] from its base."""
UNIT_NORM_TOLERANCE = 1e-2
"""Quaternions this close to length 1 are normalised: rounding passes, mixed-up columns do not."""
LARGEST_TURN = 4.0 * np.pi
"""Joints turn by two turns at most in either direction [rad], and offsets by no more."""
LARGEST_WEIGHT, SMALLEST_SCALE = 1e9, 1e-9
"""Of a network. The largest of the shipped skills are those of kappa, 1e5, the smallest scale is 0.1: a hundred times
more precise demonstrations of a thousandth of the size stay far inside, and products of them do not overflow."""
LARGEST_DIMENSION = 6
"""Of a latent space."""
ROUND_DIMENSIONS = 2, 3
"""Of the latent space of a closed skill: the graph of its rounds is a grid."""
LARGEST_CODE, SMALLEST_BOX = 1e3, 1e-6
"""Codes are drawn towards a normal distribution of variance 1 and lie within 5 of the origin. In a smaller box the
steps that derivatives are taken over drown in rounding."""


def real_array(
    name: str, value: object, shape: tuple[int | str, ...], error: type[GeodesicMotionError] = PlanningError
) -> np.ndarray:
    """Copy what a caller gives as an array of floats, row by row, and refuse what is none of its shape.

    Parameters
    ----------
    shape : a letter stands for any length. Nothing, as of an empty list, has every shape with a length of 0.
    error : raised with the name, what is wrong, and what would be right.
    """
    wanted = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
    if np.ma.is_masked(value):
        raise error(f"{name} has masked values: numbers of shape {wanted} are needed")
    try:
        array = np.asarray(value)
    except (TypeError, ValueError, RuntimeError) as cause:  # lists of several lengths; tensors with a gradient
        raise error(f"{name} cannot be read as numbers of shape {wanted}: {cause}") from cause
    if array.dtype.kind not in "iuf":
        raise error(f"{name} is {value!r:.60}: real numbers of shape {wanted} are needed")
    if array.shape == (0,) and isinstance(shape[0], str):
        return np.empty([0 if isinstance(length, str) else length for length in shape])
    fits = (isinstance(length, str) or length == here for length, here in zip(shape, array.shape, strict=False))
    if array.ndim != len(shape) or not all(fits):
        raise error(f"{name} has shape {array.shape}: expected {wanted}")
    return np.array(array, dtype=float, order="C")


def check_number(
    name: str, value: object, lowest: float, highest: float, error: type[GeodesicMotionError] = PlanningError
) -> None:
    """Refuse what is no real number from lowest to highest, by its name and value."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise error(f"{name} is {value!r:.60}: a real number is needed")
    if not lowest <= value <= highest:
        raise error(f"{name} is {value}: it must lie between {lowest:g} and {highest:g}")


def check_time(name: str, value: object) -> None:
    """Refuse what is no time in seconds: PlanningError."""
    check_number(f"{name} [s]", value, -LARGEST_TIME, LARGEST_TIME)


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
    outside = array[~((array >= lowest) & (array <= highest))]
    if outside.size:
        raise SkillError(f"{name} holds {outside[0]:.4g}; it must lie between {lowest:.4g} and {highest:.4g}")


def check_unit(name: str, quaternions: np.ndarray) -> None:
    """Refuse quaternions (..., 4) that are not of unit length: SkillError with the length."""
    lengths = np.linalg.norm(quaternions, axis=-1).ravel()
    wrong = lengths[~(np.abs(lengths - 1.0) <= UNIT_NORM_TOLERANCE)]
    if wrong.size:
        raise SkillError(f"{name} holds a quaternion of length {wrong[0]:.4g}; it must be 1 (w, x, y, z)")


def check_pose(name: str, pose: np.ndarray) -> None:
    """Refuse a pose (7,) that no arm holds its tool in, x, y, z [m], w, x, y, z: SkillError."""
    check_array(name, pose, (7,))
    distance = float(np.linalg.norm(pose[:3]))
    if not distance <= ARM_REACH:
        raise SkillError(f"{name} is {distance:.4g} m from the base; no arm reaches {ARM_REACH:g} m")
    check_unit(name, pose[3:])
