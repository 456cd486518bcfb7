"""How late the arm is, and how far off the path: of the last second, and of this goal and the one before."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.motion.tracking import COUNTED, LATEST, Tracking, TrackingMonitor
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

READY = Robot.named("panda").ready
#: Of joint states [s], of the first joint [rad/s], and how late the arm is [s].
PERIOD, SPEED, LAG = 0.01, 0.5, 0.08


@pytest.fixture
def monitor() -> TrackingMonitor:
    return TrackingMonitor(Robot.named("panda"), CollisionModel.named("panda"))


def turned(angle: float) -> np.ndarray:
    """The first joint turned by so much [rad]."""
    return READY + angle * np.eye(len(READY))[0]


def path(time: float) -> float:
    """The first joint, sent from rest to rest within a second from 0 on [rad]."""
    share = np.clip(time, 0.0, 1.0)
    return SPEED * (3.0 * share**2 - 2.0 * share**3)


def moved(monitor: TrackingMonitor, begin: float, seconds: float, lag: float = LAG, off: float = 0.0) -> Tracking:
    """What counts after a motion that begins at a time [s] is followed for so long, late and so far off [rad]."""
    counted = Tracking()
    for time in np.arange(0.0, seconds, PERIOD):
        measured = turned(path(time - lag) + off)
        counted = monitor.add(measured, turned(path(time)), begin + time)
    return counted


def test_an_arm_that_is_late_is_on_its_path(monitor) -> None:
    counted = moved(monitor, 0.0, 0.5)
    assert counted.lag == pytest.approx(LAG, abs=PERIOD)
    # What it is behind: more than an arm that is late by that time is off.
    behind = 0.7 * (path(0.49) - path(0.49 - LAG))
    assert counted.error < 0.15 * behind


def test_an_arm_beside_its_path_is_off(monitor) -> None:
    reach = np.hypot(*Robot.named("panda").forward(READY)[0][:2])
    assert monitor.add(turned(0.05), READY, 0.0).error == pytest.approx(0.05 * reach, rel=0.2)
    assert monitor.add(turned(0.05), READY, 0.1).lag == 0.0


def test_the_lag_is_known_before_the_arm_is_fast(monitor) -> None:
    early = moved(monitor, 0.0, 0.15)
    assert early.lag == pytest.approx(LAG, abs=2 * PERIOD)
    assert path(0.15) - path(0.15 - LAG) < 0.5 * (path(0.5) - path(0.5 - LAG))


def test_an_arm_that_does_not_follow_is_off_by_what_it_is_behind(monitor) -> None:
    counted = Tracking()
    for time in np.arange(0.0, 1.0, PERIOD):
        counted = monitor.add(READY, turned(path(time)), time)
    assert counted.lag == pytest.approx(LATEST, abs=PERIOD)
    assert counted.error > 0.05


def test_a_lag_is_not_forgotten_while_the_arm_waits_nor_as_the_next_goal_is_set_out_for(monitor) -> None:
    monitor.take_goal()
    first = moved(monitor, 0.0, 1.5)
    waited = monitor.add(turned(path(1.0)), turned(path(1.0)), 100.0 * COUNTED)
    assert waited == first
    monitor.take_goal()
    assert monitor.add(READY, READY, 200.0) == first


def test_a_push_that_does_not_come_again_is_forgotten(monitor) -> None:
    monitor.take_goal()
    pushed = monitor.add(turned(0.05), READY, 0.0)
    monitor.take_goal()
    assert monitor.add(READY, READY, 10.0) == pushed
    monitor.take_goal()
    assert monitor.add(READY, READY, 20.0) == Tracking()


def test_however_often_goals_come_the_last_second_counts(monitor) -> None:
    pushed = monitor.add(turned(0.05), READY, 0.0)
    for _ in range(5):
        monitor.take_goal()
    assert monitor.add(READY, READY, COUNTED) == pushed
    assert monitor.add(READY, READY, COUNTED + 0.1) == Tracking()


def test_an_arm_that_begins_anew_follows(monitor) -> None:
    moved(monitor, 0.0, 0.5)
    monitor.forget()
    assert monitor.add(READY, READY, 0.6) == Tracking()
