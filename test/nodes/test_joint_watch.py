"""Whether a take can be made of what arrives, and why not."""

from __future__ import annotations

import pytest
from sensor_msgs.msg import JointState

from geodesic_motion_ros.nodes.joint_watch import SILENCE, STANDING, JointWatch

NAMES = ("left", "right")


def state(stamp: float, names: tuple[str, ...] = ("right", "finger", "left")) -> JointState:
    message = JointState(name=list(names), position=[0.1] * len(names))
    message.header.stamp.sec, message.header.stamp.nanosec = int(stamp), int(1e9 * (stamp % 1.0))
    return message


@pytest.fixture
def watch() -> JointWatch:
    return JointWatch(NAMES)


def hear(watch: JointWatch, *messages: JointState) -> float:
    """A message each 10 ms, from 0 on; returns when the last one came [s]."""
    for number, message in enumerate(messages):
        watch.receive(message, 0.01 * number)
    return 0.01 * (len(messages) - 1)


def test_states_with_all_joints_and_stamps_that_go_on_are_enough(watch: JointWatch) -> None:
    now = hear(watch, *(state(5.0 + 0.01 * number) for number in range(200)))
    assert watch.objection(now) == ""


def test_states_without_stamps_are_enough(watch: JointWatch) -> None:
    now = hear(watch, *(state(0.0) for _ in range(200)))
    assert watch.objection(now) == ""


def test_silence_is_named_from_its_beginning(watch: JointWatch) -> None:
    assert watch.objection(100.0) == "no joint states have arrived yet"
    now = hear(watch, state(1.0))
    assert watch.objection(now + 0.9 * SILENCE) == ""
    assert watch.objection(now + 3.0) == "no joint states for 3.0 s"


def test_joints_that_are_missing_are_named_beside_those_that_are_there(watch: JointWatch) -> None:
    now = hear(watch, state(1.0, ("left", "finger")))
    assert "no message has right; the joints there are 'left, finger'" in watch.objection(now)


def test_joints_that_come_in_several_messages_are_enough_until_one_is_silent(watch: JointWatch) -> None:
    for number in range(100):
        for name in NAMES:
            watch.receive(state(1.0 + number, (name,)), 0.1 * number)
        assert watch.objection(0.1 * number) == ""
    for number in range(100, 130):
        watch.receive(state(1.0 + number, ("left",)), 0.1 * number)
    assert "no message has right" in watch.objection(12.9)


def test_a_gripper_on_the_same_topic_does_not_matter(watch: JointWatch) -> None:
    messages = [message for number in range(100) for message in (state(1.0 + number), state(1.0, ("finger",)))]
    assert watch.objection(hear(watch, *messages)) == ""


def test_stamps_that_stand_still_are_named(watch: JointWatch) -> None:
    now = hear(watch, *(state(7.5) for _ in range(10)))
    assert watch.objection(now) == ""
    hear(watch, *(state(7.5) for _ in range(round(100 * STANDING) + 20)))
    assert "stand still at 7.500 s" in watch.objection(0.7)
    watch.receive(state(7.6), 0.8)
    assert watch.objection(0.8) == ""
