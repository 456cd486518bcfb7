"""Trajectories that are written as bytes are read as the messages they stand for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from geodesic_motion_ros.geometry.quintic import quintic_samples
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes


def motion(knots: int, joints: int, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Times (n,), whole nanoseconds, and three rows of values (n, joints)."""
    random = np.random.default_rng(seed)
    times = np.append(0.0, np.cumsum(random.uniform(1e-3, 1.0, knots - 1)))
    return np.round(1e9 * times) * 1e-9, *random.normal(size=(3, knots, joints))


def message_of(names: Sequence[str], times: np.ndarray, *values: np.ndarray) -> JointTrajectory:
    """The message itself, point by point; its stamp is 1.7e9 s."""
    points = []
    for time, *rows in zip(times, *values, strict=True):
        whole, rest = divmod(round(1e9 * time), 10**9)
        fields = dict(zip(("positions", "velocities", "accelerations"), (row.tolist() for row in rows), strict=True))
        points.append(JointTrajectoryPoint(**fields, time_from_start=Duration(sec=whole, nanosec=rest)))
    header = Header(stamp=Time(sec=1_700_000_000))
    return JointTrajectory(header=header, joint_names=list(names), points=points)


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
        arguments = names, *motion(knots, joints, extra)
        assert_the_same(joint_trajectory_bytes(*arguments, 1_700_000_000 * 10**9), message_of(*arguments))


def test_rows_need_not_lie_one_after_the_other_in_memory() -> None:
    times, *rows = motion(30, 14)
    names = [f"joint{number}" for number in range(7)]
    arguments = names, times[::2], *(values[::2, ::2] for values in rows)
    assert_the_same(joint_trajectory_bytes(*arguments, 1_700_000_000 * 10**9), message_of(*arguments))


def test_knots_a_millisecond_apart_ask_for_the_acceleration_of_the_motion() -> None:
    """Its quintics are those of the motion, whatever the times are rounded by."""
    times = np.cumsum(np.full(50, 1e-3 + 3.7e-10))
    positions, velocities = times + times**2, 1.0 + 2.0 * times
    rows = (values[:, None] for values in (positions, velocities, np.full(50, 2.0)))
    message = deserialize_message(joint_trajectory_bytes(["j"], times, *rows, 0), JointTrajectory)
    read = np.array([point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in message.points])
    knots = [
        np.array([getattr(point, name) for point in message.points])
        for name in ("positions", "velocities", "accelerations")
    ]
    _, _, accelerations = quintic_samples(read, *knots, np.linspace(read[0], read[-2], 500))
    np.testing.assert_allclose(accelerations, 2.0, rtol=1e-6)


def test_times_are_rounded_to_whole_nanoseconds() -> None:
    times = np.array([0.0, 0.9999999999, 1.0000000011])
    wire = joint_trajectory_bytes(("j1", "j2", "j3"), times, *np.zeros((3, 3, 3)), 1_795_722_000_123_456_789)
    message = deserialize_message(wire, JointTrajectory)
    stamps = [point.time_from_start for point in message.points]
    assert [(stamp.sec, stamp.nanosec) for stamp in stamps] == [(0, 0), (1, 0), (1, 1)]
    assert message.header.stamp == Time(sec=1_795_722_000, nanosec=123_456_789)
