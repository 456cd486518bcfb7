"""Deviations: none within what is allowed, both numbers beyond it, and motion of an arm that should rest."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.nodes.deviation import has_pose_moved, have_joints_moved, joint_deviation, pose_deviation

HERE = np.array([0.4, 0.0, 0.3])
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


def turned(angle: float) -> np.ndarray:
    """About x by an angle [rad]."""
    return np.array([np.cos(angle / 2.0), np.sin(angle / 2.0), 0.0, 0.0])


def test_a_pose_deviates_by_distance_or_by_angle() -> None:
    commanded = HERE, UPRIGHT
    assert pose_deviation((HERE + [0.009, 0.0, 0.0], turned(0.09)), commanded, 0.01, 0.1) is None
    off = pose_deviation((HERE + [0.012, 0.0, 0.0], UPRIGHT), commanded, 0.01, 0.1)
    assert off == ("12 mm and 0.0 deg", "tracking_tolerance: 10 mm, 5.7 deg")
    assert pose_deviation((HERE, turned(0.11)), commanded, 0.01, 0.1) == (
        "0 mm and 6.3 deg",
        "tracking_tolerance: 10 mm, 5.7 deg",
    )
    # The quaternion's other sign is the same orientation.
    assert pose_deviation((HERE, -UPRIGHT), commanded, 0.01, 0.1) is None


def test_the_worst_joint_is_named() -> None:
    commanded = np.zeros(3)
    assert joint_deviation(np.array([0.04, -0.05, 0.0]), commanded, ("a", "b", "c"), 0.05) is None
    assert joint_deviation(np.array([0.06, -0.08, 0.0]), commanded, ("a", "b", "c"), 0.05) == (
        "0.080 rad in 'b'",
        "tracking_tolerance_joint: 0.050 rad",
    )


def test_an_arm_that_should_rest_moves_by_more_than_noise() -> None:
    assert not has_pose_moved((HERE + [0.004, 0.0, 0.0], turned(0.015)), (HERE, UPRIGHT))
    assert has_pose_moved((HERE + [0.006, 0.0, 0.0], UPRIGHT), (HERE, UPRIGHT))
    assert has_pose_moved((HERE, turned(0.025)), (HERE, UPRIGHT))
    assert not have_joints_moved(np.array([0.009, -0.009]), np.zeros(2))
    assert have_joints_moved(np.array([0.0, -0.011]), np.zeros(2))
