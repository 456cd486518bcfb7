"""Quintic Hermite interpolation of joint motions: what is played between knots, and what bounds it.

Knots carry positions, velocities and accelerations, and between two of them the motion is the one polynomial of degree
five that has all six: this is what joint_trajectory_controller plays. In Bernstein form on an interval of length h its
control points are

    q0,  q0 + h v0 / 5,  q0 + 2 h v0 / 5 + h^2 a0 / 20,  q1 - 2 h v1 / 5 + h^2 a1 / 20,  q1 - h v1 / 5,  q1,

those of its derivatives are 5 / h, 20 / h^2 and 60 / h^3 times their first, second and third differences, and a
polynomial stays within its control points (G. Farin, "Curves and Surfaces for CAGD", ch. 5 and 6).
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def quintic_samples(
    times: np.ndarray, positions: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """Positions, velocities and accelerations (3, k, eta) of a motion at the times `at` (k,), constant beyond its ends.

    Parameters
    ----------
    times : (n,) of the knots [s], increasing. positions, velocities, accelerations : (n, eta) [rad], [rad/s],
        [rad/s^2].
    """
    count, joints = positions.shape
    result = np.zeros((3, len(at), joints))
    for k in range(len(at)):
        i = int(np.searchsorted(times, at[k], side="right")) - 1
        if i < 0 or i >= count - 1:
            result[0, k] = positions[0 if i < 0 else count - 1]
            continue
        h = times[i + 1] - times[i]
        x = (at[k] - times[i]) / h
        for j in range(joints):
            v0, v1 = h * velocities[i, j], h * velocities[i + 1, j]
            a0, a1 = 0.5 * h * h * accelerations[i, j], 0.5 * h * h * accelerations[i + 1, j]
            # What is left of position, velocity and acceleration at the end when a0 is kept.
            p = positions[i + 1, j] - positions[i, j] - v0 - a0
            v = v1 - v0 - 2.0 * a0
            a = a1 - a0
            c3 = 10.0 * p - 4.0 * v + a
            c4 = -15.0 * p + 7.0 * v - 2.0 * a
            c5 = 6.0 * p - 3.0 * v + a
            result[0, k, j] = positions[i, j] + x * (v0 + x * (a0 + x * (c3 + x * (c4 + x * c5))))
            result[1, k, j] = (v0 + x * (2.0 * a0 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / h
            result[2, k, j] = (2.0 * a0 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / (h * h)
    return result


@numba.njit(cache=True, nogil=True)
def control_points(
    points: np.ndarray,
    h: float,
    positions: np.ndarray,
    velocities: np.ndarray,
    accelerations: np.ndarray,
    i: int,
    j: int,
) -> None:
    """Write the control points (6,) of joint j on interval i, of length h [s], relative to its first knot: differences
    of large numbers would lose digits.
    """
    points[0], points[5] = 0.0, positions[i + 1, j] - positions[i, j]
    points[1] = 0.2 * h * velocities[i, j]
    points[2] = 2.0 * points[1] + 0.05 * h * h * accelerations[i, j]
    points[4] = points[5] - 0.2 * h * velocities[i + 1, j]
    points[3] = points[5] - 0.4 * h * velocities[i + 1, j] + 0.05 * h * h * accelerations[i + 1, j]


@numba.njit(cache=True, nogil=True)
def quintic_bounds(
    times: np.ndarray, positions: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """What is never exceeded between knots.

    Returns
    -------
    range : (2, eta) lowest and highest position [rad] of the whole motion.
    largest : (3, n - 1, eta) largest magnitudes of velocity, acceleration and jerk on each interval.
    """
    count, joints = positions.shape
    ends = np.empty((2, joints))
    ends[0], ends[1] = positions[0], positions[0]
    largest = np.zeros((3, count - 1, joints))
    points = np.empty(6)
    for i in range(count - 1):
        h = times[i + 1] - times[i]
        factors = (5.0 / h, 20.0 / (h * h), 60.0 / (h * h * h))
        for j in range(joints):
            begin = positions[i, j]
            control_points(points, h, positions, velocities, accelerations, i, j)
            for k in range(6):
                ends[0, j] = min(ends[0, j], begin + points[k])
                ends[1, j] = max(ends[1, j], begin + points[k])
            for order in range(3):
                most = 0.0
                for k in range(5 - order):
                    points[k] = points[k + 1] - points[k]
                    most = max(most, abs(points[k]))
                largest[order, i, j] = factors[order] * most
    return ends, largest
