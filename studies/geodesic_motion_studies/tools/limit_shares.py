"""Shares of the joints' limits that a motion uses, of samples as a driver takes them: not of bounds between knots."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.trajectory import JointReference

#: Time between two samples [s]: that of Franka's drivers.
STEP = 1e-3


def limit_shares(reference: JointReference, limits: JointLimits) -> np.ndarray:
    """Largest shares (3,) of the limits of velocity, acceleration and jerk, of samples every `STEP`.

    A velocity's limit is that at its position, in its direction; jerks are differences of accelerations.
    """
    times = STEP * np.arange(np.ceil(reference.duration / STEP) + 1)
    positions, velocities, accelerations = reference.samples(times)
    shares = (
        np.abs(velocities) / np.where(velocities < 0.0, *limits.largest_speeds(positions)),
        np.abs(accelerations) / limits.acceleration,
        np.abs(np.diff(accelerations, axis=0)) / STEP / limits.jerk,
    )
    return np.array([np.max(share) for share in shares])
