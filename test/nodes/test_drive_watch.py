"""Where a motion begins: at what the drive commands, as long as that is known, rests, and is where the arm is."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.nodes.arm_watch import REST_TIME
from geodesic_motion_ros.nodes.drive_watch import DRIVE_RESTS, SAME_PLACE, DriveWatch, Start
from geodesic_motion_ros.nodes.sent_trajectories import LEFT

NAMES = ("shoulder", "elbow")
PLACE = np.array([0.5, -1.0])
#: A joint of the arm rests so far [rad] from what is commanded.
MEASURED = PLACE + np.array([0.0, 0.003])
TOLERANCE = 0.1


@pytest.fixture
def watch() -> DriveWatch:
    """A drive that has rested for long, at time 10 s."""
    watch = DriveWatch(NAMES)
    for time in np.arange(9.0, 10.01, 0.1):
        watch.take(PLACE.copy(), float(time))
    return watch


def test_a_motion_begins_where_the_drive_commands_the_arm_and_the_log_says_how_far_it_is_off(watch):
    start = watch.start(MEASURED, MEASURED, TOLERANCE, oldest=9.9)
    assert isinstance(start, Start)
    np.testing.assert_array_equal(start.configuration, PLACE)
    assert "3.00 mrad in 'elbow'" in start.news


@pytest.mark.parametrize(
    ("sent", "begins"),
    [(None, MEASURED), (PLACE, PLACE), (PLACE + 2.0 * TOLERANCE, MEASURED)],
    ids=["sent nowhere", "sent to stand there", "sent to stand elsewhere"],
)
def test_without_a_word_of_the_drive_it_begins_where_the_arm_was_sent_to_stand_or_else_is_measured(sent, begins):
    start = DriveWatch(NAMES).start(MEASURED, sent, TOLERANCE, oldest=0.0)
    assert isinstance(start, Start)
    np.testing.assert_array_equal(start.configuration, begins)
    assert ("commanded_joint_states" in start.news) == (begins is MEASURED)


def test_a_drive_that_has_fallen_silent_is_named(watch):
    refused = watch.start(MEASURED, PLACE, TOLERANCE, oldest=10.5)
    assert isinstance(refused, Refusal)
    assert refused.code is VerdictCode.STALE_STATE
    assert refused.reason.startswith("commanded_joint_states: the newest is older than state_timeout")


def test_a_drive_that_commands_another_place_than_that_of_the_arm_is_named_with_joint_and_distance(watch):
    refused = watch.start(PLACE - np.array([0.2, 0.0]), PLACE, TOLERANCE, oldest=9.9)
    assert isinstance(refused, Refusal)
    assert refused.code is VerdictCode.BAD_INPUT
    assert "0.200 rad in 'shoulder' from where its drive commands it" in refused.reason
    assert "0.100 rad" in refused.reason


def compared(watch: DriveWatch, sent: np.ndarray | None, seconds: float, speed: float = 0.0) -> str:
    """What is said of a drive that moves at a speed [rad/s] for some seconds, sent elsewhere."""
    for time in np.arange(0.02, seconds, 0.02):
        watch.take(PLACE + speed * time, 10.0 + float(time))
        watch.compare(sent)
    return watch.stalled


def test_a_drive_that_stands_still_where_it_was_sent_to_move_is_named_after_a_while(watch):
    away = PLACE + np.array([0.0, 2.0 * LEFT])
    assert compared(watch, away, REST_TIME) == ""
    assert compared(watch, away, 2.0 * REST_TIME) == "0.006 rad in 'elbow'"
    assert compared(watch, None, 2.0 * REST_TIME) == ""


@pytest.mark.parametrize(("off", "speed"), [(0.5 * LEFT, 0.0), (2.0 * LEFT, 0.01)], ids=["near", "moves"])
def test_a_drive_that_is_near_where_it_was_sent_or_moves_does_not_stand_still(watch, off, speed):
    assert compared(watch, PLACE + off, 2.0 * REST_TIME, speed) == ""


def test_nothing_begins_while_the_drive_moves(watch):
    watch.take(PLACE + 2.0 * SAME_PLACE, 10.1)
    refused = watch.start(MEASURED, PLACE, TOLERANCE, oldest=9.9)
    assert isinstance(refused, Refusal)
    assert "has not commanded one place for 0.1 s" in refused.reason
    watch.take(PLACE + 2.0 * SAME_PLACE, 10.11 + DRIVE_RESTS)
    assert isinstance(watch.start(MEASURED, PLACE, TOLERANCE, oldest=9.9), Start)


def test_a_creeping_drive_does_not_rest(watch):
    """From one message to the next it moves by less than rounding leaves."""
    for step in range(1, 40):
        watch.take(PLACE + 0.3 * SAME_PLACE * step, 10.0 + 0.01 * step)
    assert watch.rested < 0.05


def test_a_drive_has_left_once_it_rests_elsewhere_and_is_heard(watch):
    assert not watch.has_left(PLACE, oldest=9.9)
    assert not watch.has_left(PLACE + 0.5 * SAME_PLACE, oldest=9.9)
    assert watch.has_left(MEASURED, oldest=9.9)
    assert not watch.has_left(MEASURED, oldest=10.5)
    watch.take(MEASURED, 10.1)
    assert not watch.has_left(PLACE, oldest=9.9)
    watch.take(MEASURED, 10.11 + REST_TIME)
    assert watch.has_left(PLACE, oldest=9.9)
    assert not DriveWatch(NAMES).has_left(PLACE, oldest=0.0)
