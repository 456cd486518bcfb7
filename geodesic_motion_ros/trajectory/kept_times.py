"""A joint reference that passes points at the times that somebody else has given them, where the limits allow that."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.limited_tool import LimitedTool
from geodesic_motion_ros.trajectory.stopping import keeps_all
from geodesic_motion_ros.trajectory.timing import correction_length
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference, ending_at_rest, interpolated

#: Points that a cubic spline needs for its ends to follow from the others.
_FEWEST = 4
#: What fades may leave the spline by this [rad]: an arm that is led onto it from farther off would overshoot.
_LARGEST_FADE = 2e-3


def kept_times_reference(
    times: np.ndarray,
    path: np.ndarray,
    latent: np.ndarray,
    limits: JointLimits,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    tool: LimitedTool | None = None,
) -> JointReference | None:
    """Return the reference that passes a path at its times, and is at rest at its end; None where that exceeds limits,
    as it does where the path ends in full motion, or begins in another motion than the arm's.

    A cubic spline in time leads through the points; the little that the state of motion differs from it fades as a
    quintic.

    Parameters
    ----------
    times : (m,) [s], increasing from 0. path : (m, eta) [rad]; the first one is what is commanded now. latent : (m, d).
    velocity, acceleration : (eta,) commanded now.
    """
    if len(times) < _FEWEST:
        return None
    spline = CubicSpline(times, path)
    state = np.stack([path[0], velocity, acceleration])
    mismatch = state - np.stack([spline(0.0, order) for order in range(3)])
    length = correction_length(mismatch, limits.acceleration, limits.jerk)
    if length > times[-1]:
        return None
    count = max(2, int(np.ceil(times[-1] / PERIOD - 1e-6)))
    at = np.linspace(0.0, times[-1], count + 1)
    begin = np.zeros((3, 2, path.shape[1]))
    begin[:, 0] = mismatch
    fading = quintic_samples(np.array([0.0, length]), begin[0], begin[1], begin[2], at)
    if np.max(np.abs(fading[0])) > _LARGEST_FADE:
        return None
    motion = np.stack([spline(at, order) for order in range(3)]) + fading
    motion[:, 0] = state
    reference = ending_at_rest(at, motion[0], motion[1], motion[2], interpolated(at, times, latent))
    return reference if keeps_all(reference, limits, tool) else None
