"""Joint states and joint trajectories as they come over the wire.

rclpy makes an object of each point: 0.5 ms for a chunk of 15 points, 3 ms for a trajectory of 300, in which the control
loop stands still; here 0.1 and 1.1 ms.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geodesic_motion_ros.nodes.plain_cdr import (
    LENGTH,
    Stamp,
    StampedFrame,
    checked_plain,
    multiple,
    numbers,
    refusing_short,
    stamp,
    text,
    texts,
)


class SeenJointState(NamedTuple):
    """The fields of a sensor_msgs/JointState that tell where joints are, under the names that they have there."""

    header: StampedFrame
    name: list[str]
    position: np.ndarray


class SeenPoint(NamedTuple):
    """A trajectory_msgs/JointTrajectoryPoint."""

    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    effort: np.ndarray
    time_from_start: Stamp


class SeenTrajectory(NamedTuple):
    """A trajectory_msgs/JointTrajectory."""

    header: StampedFrame
    joint_names: list[str]
    points: list[SeenPoint]


def parse_joint_state(wire: bytes) -> SeenJointState:
    """Parse a serialised JointState."""
    data = checked_plain(wire, "joint states")
    with refusing_short(data, "joint states"):
        header, at = _header(data)
        names, at = texts(data, at)
        return SeenJointState(header, names, numbers(data, at)[0])


def parse_joint_trajectory(wire: bytes) -> SeenTrajectory:
    """Parse a serialised JointTrajectory."""
    data, points = checked_plain(wire, "trajectories"), []
    with refusing_short(data, "trajectories"):
        header, at = _header(data)
        names, at = texts(data, at)
        (count,), at = LENGTH.unpack_from(data, at), at + 4
        for _ in range(count):
            positions, at = numbers(data, multiple(at, 4))
            velocities, at = numbers(data, at)
            accelerations, at = numbers(data, at)
            effort, at = numbers(data, at)
            points.append(SeenPoint(positions, velocities, accelerations, effort, stamp(data, at)))
            at += 8
    return SeenTrajectory(header, names, points)


def _header(data: bytes) -> tuple[StampedFrame, int]:
    """The header that a message begins with, and where what follows does."""
    frame, at = text(data, 8)
    return StampedFrame(stamp(data, 0), frame), at
