"""What an arm is commanded: continuous, inside its limits, at rest in the end, whatever comes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.hardware.command_stream import LONGEST_WAIT, CommandStream
from geodesic_motion_ros.hardware.judged_commands import PERIOD
from geodesic_motion_ros.trajectory.trajectory import joined
from geodesic_motion_ros.utils.errors import RobotError

SEEDS = st.integers(0, 2**32 - 1)
#: Third differences of positions of about 1 rad, over a cubed millisecond: what rounding adds to a jerk [rad/s^3].
ROUNDING = 8 * np.finfo(float).eps / PERIOD**3


def cycles(time: float) -> int:
    """The number of the first millisecond at or after a time [s]."""
    return int(np.ceil(time / PERIOD - 1e-9))


def played(stream: CommandStream, first: int, last: int) -> tuple[np.ndarray, list[str]]:
    """What is commanded in the milliseconds of these numbers (n, 7), the last one excluded, and what was refused."""
    answers = [stream.command(PERIOD * number) for number in range(first, last)]
    rows = np.reshape([state[0] for state, _ in answers], (-1, 7))
    return rows, [why for _, why in answers if why]


def check_as_the_arm_does(rows: np.ndarray, arm) -> None:
    velocity, acceleration, jerk = (np.diff(rows, order, axis=0) / PERIOD**order for order in (1, 2, 3))
    assert np.all(np.abs(velocity) <= arm.limits.velocity)
    assert np.all(np.abs(acceleration) <= arm.limits.acceleration)
    assert np.all(np.abs(jerk) <= arm.limits.jerk + ROUNDING)


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, early=st.floats(0.001, 0.15))
def test_a_takeover_that_repeats_what_is_played_is_none_that_the_arm_feels(arm, seed: int, early: float) -> None:
    old = arm.motion(seed)
    at = 0.5 * old.duration
    # it repeats the old one, and leads elsewhere from there
    new = joined(old, 0.0, arm.motion(seed + 1, *old.sample(at)), at)
    stream = CommandStream(old.positions[0], arm.limits, arm.names)
    stream.receive(arm.sent(old), 0.0, 0.0)
    # it comes after its begin, and before what is new in it
    heard = cycles(at - early)
    before, nothing = played(stream, 0, heard)
    stream.receive(arm.sent(new), 0.0, PERIOD * heard)
    after, refused = played(stream, heard, cycles(new.duration) + 10)
    assert not nothing + refused
    check_as_the_arm_does(np.concatenate([before, after]), arm)
    np.testing.assert_array_equal(after[-1], new.positions[-1])


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, missed=st.integers(1, 25))
def test_a_takeover_after_missed_milliseconds_is_judged_by_what_should_have_been_sent(arm, seed, missed) -> None:
    old = arm.motion(seed)
    at = 0.5 * old.duration
    new = joined(old, 0.0, arm.motion(seed + 1, *old.sample(at)), at)
    stream = CommandStream(old.positions[0], arm.limits, arm.names)
    stream.receive(arm.sent(old), 0.0, 0.0)
    last = cycles(at - 0.05)
    played(stream, 0, last)
    stream.receive(arm.sent(new), 0.0, PERIOD * last)
    _, refused = stream.command(PERIOD * (last + missed))
    assert not refused
    _, refused = played(stream, last + missed + 1, cycles(new.duration) + 10)
    assert not refused


@settings(max_examples=15, deadline=None)
@given(seed=SEEDS, joint=st.integers(0, 6), step=st.floats(2e-5, 0.05), share=st.floats(0.1, 0.9))
def test_a_trajectory_that_steps_changes_nothing_of_what_is_commanded(arm, seed, joint, step, share) -> None:
    motion = arm.motion(seed)
    disturbed, alone = (CommandStream(motion.positions[0], arm.limits, arm.names) for _ in range(2))
    for stream in (disturbed, alone):
        stream.receive(arm.sent(motion), 0.0, 0.0)
    at, end = cycles(share * motion.duration), cycles(motion.duration) + 50
    begun, _ = played(disturbed, 0, at)
    stepped = replace(arm.sent(motion), positions=motion.positions + step * np.eye(7)[joint])
    disturbed.receive(stepped, 0.0, PERIOD * at)
    rest, refused = played(disturbed, at, end)
    assert len(refused) == 1
    assert "does not continue what is commanded" in refused[0]
    np.testing.assert_array_equal(np.concatenate([begun, rest]), played(alone, 0, end)[0])


def test_silence_is_rest_at_the_end_of_what_was_sent(arm) -> None:
    motion = arm.motion(5)
    stream = CommandStream(motion.positions[0], arm.limits, arm.names)
    stream.receive(arm.sent(motion), 0.0, 0.0)
    rows, refused = played(stream, 0, cycles(motion.duration + 1.0))
    assert not refused
    check_as_the_arm_does(rows, arm)
    state, _ = stream.command(motion.duration + 1.0)
    np.testing.assert_array_equal(state, [motion.positions[-1], np.zeros(7), np.zeros(7)])


def test_a_trajectory_of_the_future_waits_for_its_begin_on_the_old_one(arm) -> None:
    old = arm.motion(6)
    first = cycles(0.4 * old.duration)
    at = PERIOD * first
    new = arm.motion(7, *old.sample(at))
    stream, alone = (CommandStream(old.positions[0], arm.limits, arm.names) for _ in range(2))
    for each in (stream, alone):
        each.receive(arm.sent(old), 0.0, 0.0)
    stream.receive(arm.sent(new), at, at - min(at, 0.9 * LONGEST_WAIT))
    rows, _ = played(stream, 0, first)
    np.testing.assert_array_equal(rows, played(alone, 0, first)[0])
    after, refused = played(stream, first, cycles(at + new.duration))
    assert not refused
    check_as_the_arm_does(np.concatenate([rows, after]), arm)


def test_of_several_that_wait_those_that_begin_later_are_replaced_by_a_newer_one(arm) -> None:
    rest = arm.robot.ready, np.zeros(7), np.zeros(7)
    first, second, third = (arm.motion(seed, *rest) for seed in (1, 2, 3))
    stream = CommandStream(rest[0], arm.limits, arm.names)
    stream.receive(arm.sent(first), 0.1, 0.0)
    stream.receive(arm.sent(second), 0.2, 0.0)
    stream.receive(arm.sent(third), 0.1, 0.0)
    rows, refused = played(stream, 0, cycles(0.1 + third.duration + 0.1))
    assert not refused
    np.testing.assert_array_equal(rows[-1], third.positions[-1])


def test_one_that_has_ended_or_lies_far_ahead_is_refused(arm) -> None:
    motion = arm.motion(8)
    stream = CommandStream(motion.positions[0], arm.limits, arm.names)
    with pytest.raises(RobotError, match=r"ends in the past, 0\.500 s ago"):
        stream.receive(arm.sent(motion), 0.0, motion.duration + 0.5)
    with pytest.raises(RobotError, match=r"begins in 3\.0 s"):
        stream.receive(arm.sent(motion), 3.0, 0.0)


def test_the_refusal_says_how_late_it_came_into_effect(arm) -> None:
    motion = arm.motion(9)
    stream = CommandStream(motion.positions[0], arm.limits, arm.names)
    stream.command(0.0)
    # from rest, by when the motion is well begun
    stream.receive(arm.sent(motion), 0.0, 0.25)
    state, refused = stream.command(0.25)
    assert "250 ms after its begin" in refused
    np.testing.assert_array_equal(state, [motion.positions[0], np.zeros(7), np.zeros(7)])


def test_of_a_motion_that_began_before_the_first_command_that_is_said_in_one_text(arm) -> None:
    motion = arm.motion(10)
    stream = CommandStream(motion.positions[0], arm.limits, arm.names)
    first = cycles(0.4 * motion.duration)
    said = set()
    for number in range(first, first + 3):
        stream.receive(arm.sent(motion), 0.0, PERIOD * number)
        state, refused = stream.command(PERIOD * number)
        said.add(refused)
        np.testing.assert_array_equal(state, [motion.positions[0], np.zeros(7), np.zeros(7)])
    (text,) = said
    assert "the motion began before the arm was armed" in text
    # one that begins where the arm stands is played; from then on it is said what does not fit
    begin = PERIOD * (first + 10)
    stream.receive(arm.sent(motion), begin, begin)
    played(stream, first + 10, first + 20)
    stream.receive(arm.sent(motion), 0.0, begin)
    _, (refused,) = played(stream, first + 20, first + 21)
    assert "does not continue what is commanded" in refused
