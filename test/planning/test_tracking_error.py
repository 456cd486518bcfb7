"""The tracking error that the certificate counts: of the last second, and of this goal and the one before."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.planning.tracking_error import COUNTED, TrackingError
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

READY = Robot.panda().ready


@pytest.fixture
def tracking() -> TrackingError:
    return TrackingError(Robot.panda(), CollisionModel.named("panda"))


def off(turned: float) -> np.ndarray:
    """Where the arm is with its first joint so far [rad] from where it was sent."""
    return READY + turned * np.eye(len(READY))[0]


def test_the_part_that_is_farthest_off_counts(tracking) -> None:
    assert tracking.add(READY, READY, 0.0) == 0.0
    reached = np.hypot(*Robot.panda().forward(READY)[0][:2])
    assert tracking.add(off(0.05), READY, 0.1) == pytest.approx(0.05 * reached, rel=0.2)


def test_an_error_counts_on_while_the_arm_waits_on_its_way_to_the_goal(tracking) -> None:
    tracking.take_goal()
    moving = tracking.add(off(0.05), READY, 0.0)
    assert tracking.add(READY, READY, 100.0 * COUNTED) == moving


def test_a_lag_is_known_when_the_next_goal_is_set_out_for(tracking) -> None:
    tracking.take_goal()
    large, small = tracking.add(off(0.05), READY, 0.0), tracking.add(off(0.01), READY, 0.5)
    assert large == small
    tracking.take_goal()
    assert tracking.add(READY, READY, 10.0) == large
    assert tracking.add(off(0.01), READY, 11.0) == large
    # A push that did not come again is forgotten with the goal after that one; what came meanwhile is not.
    tracking.take_goal()
    assert 0.0 < tracking.add(READY, READY, 20.0) < large
    tracking.take_goal()
    assert tracking.add(READY, READY, 30.0) == 0.0


def test_however_often_goals_come_the_last_second_counts(tracking) -> None:
    error = tracking.add(off(0.05), READY, 0.0)
    for _ in range(5):
        tracking.take_goal()
    assert tracking.add(READY, READY, COUNTED) == error
    assert tracking.add(READY, READY, COUNTED + 0.1) == 0.0


def test_an_arm_that_begins_anew_has_no_error(tracking) -> None:
    tracking.add(off(0.05), READY, 0.0)
    tracking.forget()
    assert tracking.add(READY, READY, 0.1) == 0.0
