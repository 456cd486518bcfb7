"""Joint states and trajectories that are read from bytes are those that rclpy reads, and what is cut off is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from geodesic_motion_ros.nodes.joint_bytes import parse_joint_state, parse_joint_trajectory
from geodesic_motion_ros.nodes.messages import MessageRefused

FIELDS = ("positions", "velocities", "accelerations", "effort")


def names(random: np.random.Generator, count: int) -> list[str]:
    """Of lengths that shift what follows, some of them empty, some of characters of several bytes."""
    return ["é" * int(random.integers(0, 3)) + "j" * int(random.integers(0, 9)) for _ in range(count)]


def header(random: np.random.Generator) -> Header:
    return Header(stamp=Time(sec=int(random.integers(-5, 2**31)), nanosec=7), frame_id=names(random, 1)[0])


def joint_state(random: np.random.Generator) -> JointState:
    values = [random.normal(size=random.choice([0, 1, 7])).tolist() for _ in range(3)]
    position, velocity, effort = values
    called = names(random, int(random.integers(0, 9)))
    return JointState(header=header(random), name=called, position=position, velocity=velocity, effort=effort)


def trajectory(random: np.random.Generator) -> JointTrajectory:
    """Of points that need not have as many numbers as the one before, as no controller would take them."""
    points = []
    for _ in range(int(random.integers(0, 6))):
        fields = {name: random.normal(size=random.choice([0, 1, 6, 7])).tolist() for name in FIELDS}
        time = Duration(sec=int(random.integers(-3, 9)), nanosec=int(random.integers(0, 10**9)))
        points.append(JointTrajectoryPoint(**fields, time_from_start=time))
    called = names(random, int(random.integers(0, 9)))
    return JointTrajectory(header=header(random), joint_names=called, points=points)


def assert_same(seen: Any, message: Any, fields: tuple[str, ...]) -> None:
    for name in fields:
        np.testing.assert_array_equal(getattr(seen, name), getattr(message, name), err_msg=name)


def assert_same_header(seen: Any, message: Any) -> None:
    assert seen.header.frame_id == message.header.frame_id
    assert tuple(seen.header.stamp) == (message.header.stamp.sec, message.header.stamp.nanosec)


@pytest.mark.parametrize("seed", range(40))
def test_a_joint_state_is_that_of_the_message(seed: int) -> None:
    message = joint_state(np.random.default_rng(seed))
    seen = parse_joint_state(serialize_message(message))
    assert_same_header(seen, message)
    assert_same(seen, message, ("name", "position"))


@pytest.mark.parametrize("seed", range(40))
def test_a_trajectory_is_that_of_the_message(seed: int) -> None:
    message = trajectory(np.random.default_rng(seed))
    seen = parse_joint_trajectory(serialize_message(message))
    assert_same_header(seen, message)
    assert seen.joint_names == message.joint_names
    assert len(seen.points) == len(message.points)
    for point, of_message in zip(seen.points, message.points, strict=True):
        assert_same(point, of_message, FIELDS)
        time = of_message.time_from_start
        assert tuple(point.time_from_start) == (time.sec, time.nanosec)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("parse", [parse_joint_state, parse_joint_trajectory])
def test_bytes_that_are_cut_off_are_refused_or_lack_what_is_not_read(seed: int, parse) -> None:
    """Nothing else is raised wherever it is cut: of a joint state, velocities and efforts are not read."""
    random = np.random.default_rng(seed)
    message = joint_state(random) if parse is parse_joint_state else trajectory(random)
    wire = serialize_message(message)
    whole = parse(wire)
    refused = 0
    for length in range(len(wire)):
        try:
            assert str(parse(wire[:length])) == str(whole)
        except MessageRefused:
            refused += 1
    # rclpy's bytes have something else behind the end
    assert refused > len(wire) // 4


@pytest.mark.parametrize("parse", [parse_joint_state, parse_joint_trajectory])
def test_other_orders_of_bytes_and_counts_beyond_the_end_are_refused(parse) -> None:
    wire = bytearray(serialize_message(JointState() if parse is parse_joint_state else JointTrajectory()))
    with pytest.raises(MessageRefused, match="are written as 0003, expected plain CDR"):
        parse(bytes([0, 3]) + bytes(wire[2:]))
    wire[20:24] = b"\xff" * 4  # how many names there are
    with pytest.raises(MessageRefused, match="end before they should"):
        parse(bytes(wire))
