"""Nonsense is of every input's type, can be sent, and is the same for the same seed; the readers refuse or take it."""

from __future__ import annotations

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from geodesic_motion_ros.nodes.joint_bytes import parse_joint_state, parse_joint_trajectory
from geodesic_motion_ros.nodes.marker_bytes import parse_marker
from geodesic_motion_ros.nodes.marker_messages import read_marker
from geodesic_motion_ros.nodes.messages import (
    MessageRefused,
    read_cloud,
    read_joint_positions,
    read_joint_trajectory,
    read_pose,
)
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.faults.fuzz import INPUTS, OFFERS, Fuzzer

ROBOT, MADE = Robot.named("panda"), {**INPUTS, **OFFERS}
READERS = {
    "goal_pose": lambda message: read_pose(message, "panda_link0"),
    "goal_joints": lambda message: read_joint_positions(message, ROBOT.joint_names),
    "joint_states": lambda message: read_joint_positions(
        parse_joint_state(serialize_message(message)), ROBOT.joint_names
    ),
    "joint_trajectory": lambda message: read_joint_trajectory(
        parse_joint_trajectory(serialize_message(message)), ROBOT
    ),
    "obstacle_marker": lambda message: read_marker(parse_marker(serialize_message(message)), "panda_link0"),
    "obstacle_cloud": lambda message: read_cloud(message, "panda_link0"),
}


@pytest.mark.parametrize("topic", MADE)
def test_nonsense_can_be_sent_and_repeats_with_its_seed(topic) -> None:
    first, second = (Fuzzer(np.random.default_rng(3)) for _ in range(2))
    messages = [MADE[topic](first) for _ in range(50)]
    assert list(map(repr, messages)) == [repr(MADE[topic](second)) for _ in range(50)]
    assert len(set(map(serialize_message, messages))) > 25


@pytest.mark.parametrize("topic", READERS)
def test_readers_refuse_nonsense_and_take_what_is_none(topic) -> None:
    fuzzer, refused = Fuzzer(np.random.default_rng(0)), 0
    for _ in range(1000):
        try:
            READERS[topic](MADE[topic](fuzzer))
        except MessageRefused:
            refused += 1
    assert 0 < refused < 1000
