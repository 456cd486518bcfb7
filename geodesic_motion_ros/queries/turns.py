"""Whole turns of joints without an end: drivers report them in [-pi, pi), skills have them as demonstrated."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.robot.kinematics import Robot


def in_turn_of(nodes: np.ndarray, joint_positions: np.ndarray, robot: Robot) -> np.ndarray:
    """Return joint positions (eta,) [rad] with continuous joints in the turn in which nodes (n, eta) have them.

    Where nodes extend over more than a turn positions among them stay as they are.
    """
    if not np.any(robot.is_continuous):
        return joint_positions
    lower, upper = nodes.min(axis=0), nodes.max(axis=0)
    middle, ambiguous = 0.5 * (lower + upper), np.maximum(0.0, 0.5 * (upper - lower) - np.pi)
    return robot.nearest_turn(joint_positions, np.clip(joint_positions, middle - ambiguous, middle + ambiguous))
