"""Chasing: the point that chasing spheres move towards, and where spheres are while they chase it."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_studies.comparison.guard import GuardedArm
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere


def chased_point(arm: GuardedArm, tool: bool, configuration: np.ndarray) -> np.ndarray:
    """What chasing spheres move towards, (3,) [m]: the tool or the elbow in a configuration (eta,) [rad]."""
    return arm.robot.forward(configuration)[0] if tool else elbow_position(arm.robot, configuration)


def sphere_centres(sphere: MovingSphere, times: np.ndarray, chased: np.ndarray) -> np.ndarray:
    """Where a sphere is (n, 3) [m] at times (n,) [s] at which it chases what is at `chased` (n, 3)."""
    if not sphere.chases:
        moved = np.clip(times - sphere.appears, 0.0, sphere.rests - sphere.appears)
        return sphere.begin + moved[:, None] * sphere.velocity
    speed, centre, centres = float(np.linalg.norm(sphere.velocity)), sphere.begin, [sphere.begin]
    for now, span, point in zip(times[:-1], np.diff(times), chased[:-1], strict=True):
        towards = point - centre
        step = speed * span / max(float(np.linalg.norm(towards)), 1e-9) if now < sphere.rests else 0.0
        centre = centre + step * towards
        centres.append(centre)
    return np.array(centres)
