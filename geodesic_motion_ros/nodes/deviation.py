"""Distance of an arm from where it was sent, and whether it moves: tool poses, configurations. Knows nothing of ROS."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.nodes.cycle import PoseArrays

#: An arm that was lost rests while its tool stays within this distance [m] and angle [rad].
REST_DISTANCE, REST_ANGLE = 0.005, 0.02
#: It rests while no joint leaves this interval [rad].
REST_JOINT = 0.01


def pose_deviation(
    measured: PoseArrays, commanded: PoseArrays, distance: float, angle: float
) -> tuple[str, str] | None:
    """Return how far a measured pose is from the commanded one, and what is allowed; None within a distance [m] and an
    angle [rad].
    """
    off = float(np.linalg.norm(measured[0] - commanded[0]))
    turned = float(angle_between(measured[1], commanded[1]))
    if off <= distance and turned <= angle:
        return None
    return (
        f"{1000 * off:.0f} mm and {math.degrees(turned):.1f} deg",
        f"tracking_tolerance: {1000 * distance:.0f} mm, {math.degrees(angle):.1f} deg",
    )


def has_pose_moved(measured: PoseArrays, before: PoseArrays) -> bool:
    """Whether an arm whose tool should rest has moved."""
    moved = float(np.linalg.norm(measured[0] - before[0]))
    return not (moved <= REST_DISTANCE and float(angle_between(measured[1], before[1])) <= REST_ANGLE)


def joint_deviation(
    measured: np.ndarray, commanded: np.ndarray, names: Sequence[str], tolerance: float
) -> tuple[str, str] | None:
    """Return how far the worst joint (eta,) is from where it was sent, and what is allowed; None within a tolerance
    [rad].
    """
    off, worst = farthest(measured - commanded, names)
    if off <= tolerance:
        return None
    return f"{off:.3f} rad in '{worst}'", f"tracking_tolerance_joint: {tolerance:.3f} rad"


def farthest(errors: np.ndarray, names: Sequence[str]) -> tuple[float, str]:
    """Return the largest of errors (eta,) [rad], without its sign, and the name of its joint."""
    worst = int(np.argmax(np.abs(errors)))
    return float(abs(errors[worst])), names[worst]


def have_joints_moved(measured: np.ndarray, before: np.ndarray) -> bool:
    """Whether an arm that should rest has moved."""
    return not bool(np.max(np.abs(measured - before)) <= REST_JOINT)
