"""Which trajectory the drive follows: the newest, or, after a while that one may be in transit, one of before."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geodesic_motion_ros.nodes.sent_trajectories import FOLLOWED, IN_TRANSIT, LEFT, SentTrajectories
from geodesic_motion_ros.trajectory.receding_horizon import Sent
from geodesic_motion_ros.trajectory.trajectory import JointReference

#: Two joints move on at this speed [rad/s] for 10 s.
SPEED = np.array([0.2, -0.1])


def moving(speed: np.ndarray, start: np.ndarray, begin: float) -> Sent:
    """A motion at a constant speed (2,) [rad/s] from a place (2,) [rad] on, from a time [s]."""
    times = np.array([0.0, 10.0])
    rates = np.stack([speed, speed])
    reference = JointReference(times, start + times[:, None] * speed, rates, np.zeros((2, 2)), np.zeros((2, 0)))
    return Sent(reference, begin, math.inf)


OLD = moving(SPEED, np.zeros(2), 0.0)
#: Parts from it at 1 s, with 0.3 rad/s.
NEW = moving(SPEED + np.array([0.3, 0.0]), SPEED, 1.0)


def place(sent: Sent, time: float) -> np.ndarray:
    return sent.reference.sample(time - sent.begin)[0]


@pytest.fixture
def trajectories() -> SentTrajectories:
    trajectories = SentTrajectories()
    trajectories.add(OLD, -math.inf)
    trajectories.add(NEW, 1.0)
    return trajectories


def test_of_nothing_sent_nothing_is_known():
    assert SentTrajectories().fall_back(np.zeros(2), 5.0) is None


def test_a_drive_that_follows_the_newest_has_not_fallen_back(trajectories):
    for time in np.arange(0.5, 3.0, 0.01):
        sent = OLD if time < 1.0 else NEW
        assert trajectories.fall_back(place(sent, time) + 0.9 * FOLLOWED, float(time)) is None


def test_a_drive_that_goes_on_with_the_one_before_has_once_the_newest_cannot_be_in_transit(trajectories):
    for time in np.arange(0.9, 1.0 + IN_TRANSIT - 1e-9, 0.01):
        assert trajectories.fall_back(place(OLD, time), float(time)) is None
    time = 1.0 + IN_TRANSIT + 0.01
    fallen_back = trajectories.fall_back(place(OLD, time), time)
    assert fallen_back is not None
    assert fallen_back[0] is OLD
    assert fallen_back[1] == pytest.approx(IN_TRANSIT + 0.01)
    # from then on that is the newest
    assert trajectories.fall_back(place(OLD, 2.0), 2.0) is None


def test_what_was_planned_on_from_one_that_was_refused_does_not_count_either(trajectories):
    later = moving(SPEED, place(NEW, 1.1), 1.1)
    trajectories.add(later, 1.1)
    fallen_back = trajectories.fall_back(place(OLD, 1.3), 1.3)
    assert fallen_back is not None
    assert fallen_back[0] is OLD
    # since the first that was not taken
    assert fallen_back[1] == pytest.approx(0.3)


@pytest.mark.parametrize("off", [np.array([0.5 * (FOLLOWED + LEFT), 0.0]), np.array([0.5, 0.5])], ids=["near", "far"])
def test_a_drive_that_follows_none_of_them_is_not_known(trajectories, off):
    assert trajectories.fall_back(place(NEW, 2.0) + off, 2.0) is None


def test_an_old_one_that_was_left_is_no_place_to_fall_back_to(trajectories):
    assert trajectories.fall_back(place(NEW, 1.5), 1.5) is None
    assert trajectories.fall_back(place(OLD, 1.6), 1.6) is None


def test_what_was_sent_to_an_arm_that_was_lost_is_forgotten(trajectories):
    trajectories.forget()
    assert trajectories.fall_back(place(OLD, 2.0), 2.0) is None
