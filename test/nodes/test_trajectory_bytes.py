"""Trajectories that are written as bytes are read as the messages they stand for."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.messages import joint_trajectory_message
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes


def motion(knots: int, joints: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Times (n,) and three rows of values (n, joints)."""
    random = np.random.default_rng(seed)
    return np.append(0.0, np.cumsum(random.uniform(1e-3, 1.0, knots - 1))), *random.normal(size=(3, knots, joints))


def assert_the_same(wire: bytes, message: JointTrajectory) -> None:
    """Read as the message; rclpy's own bytes have something else in gaps and behind the end: what was in memory."""
    assert deserialize_message(wire, JointTrajectory) == message
    assert wire[:12] == serialize_message(message)[:12]


@pytest.mark.parametrize("knots", [1, 2, 3, 400])
@pytest.mark.parametrize("joints", [1, 2, 6, 7])
def test_they_are_read_as_the_message(knots: int, joints: int) -> None:
    """Whatever the names, whose lengths shift all that follows."""
    for extra in range(9):
        names = [f"joint{number}" + extra * "x" for number in range(joints)]
        arguments = names, *motion(knots, joints, extra), 1.7e9 + 0.1 * extra
        assert_the_same(joint_trajectory_bytes(*arguments), joint_trajectory_message(*arguments))


def test_rows_need_not_lie_one_after_the_other_in_memory() -> None:
    times, *rows = motion(30, 14)
    names = [f"joint{number}" for number in range(7)]
    arguments = names, times[::2], *(values[::2, ::2] for values in rows), 5.0
    assert_the_same(joint_trajectory_bytes(*arguments), joint_trajectory_message(*arguments))
