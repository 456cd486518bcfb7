"""Where the arm was at the time of a cloud: between two joint states, or not known."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.robot.joint_history import JointHistory
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError

PERIOD, APART = 1.0 / 120.0, 0.25
TURNTABLE = """<robot name="turntable"><link name="base"/><link name="plate"/>
  <joint name="turn" type="continuous"><parent link="base"/><child link="plate"/><axis xyz="0 0 1"/>
    <limit velocity="1" effort="1"/></joint></robot>"""


@pytest.fixture
def robot() -> Robot:
    return Robot.named("panda")


@pytest.fixture
def history(robot: Robot) -> JointHistory:
    """Joint states from 10 s to 11 s."""
    history = JointHistory(robot)
    for number in range(121):
        history.add(swing(robot, 10.0 + number * PERIOD), 10.0 + number * PERIOD)
    return history


def swing(robot: Robot, time: float) -> np.ndarray:
    """A fast motion (7,) [rad]: 1.6 rad/s and 8 rad/s^2."""
    return robot.ready + 0.32 * np.sin(5.0 * time + np.arange(7.0))


def test_between_states_of_120_hz_it_is_known_to_a_ten_thousandth(robot, history):
    for time in np.random.default_rng(0).uniform(10.0, 11.0, 200):
        np.testing.assert_allclose(history.at(time, APART), swing(robot, time), atol=8.0 * PERIOD**2 / 8.0 + 1e-9)


def test_at_the_time_of_a_state_it_is_that_state(robot, history):
    # Of clocks that stand, too: sums of seconds are not exact.
    for time in (10.0 - 2e-7, 10.0, 10.0 + 7 * PERIOD, 11.0, 11.0 + 2e-7):
        np.testing.assert_allclose(history.at(time, APART), swing(robot, time), rtol=0.0, atol=1e-6)
        assert history.reaches(time)
    assert not history.reaches(11.0 + 1e-4)


@pytest.mark.parametrize(
    ("time", "why"),
    [(9.9, "the oldest joint state that is known is 100 ms newer"), (11.2, "the newest joint state is 200 ms older")],
)
def test_what_no_two_states_bracket_is_not_known(history, time, why):
    with pytest.raises(RobotError, match=why):
        history.at(time, APART)


def test_nothing_is_known_before_the_first_state_nor_across_a_gap(robot, history):
    empty = JointHistory(robot)
    assert not empty.reaches(0.0)
    with pytest.raises(RobotError, match="there is no joint state yet"):
        empty.at(10.0, APART)
    history.add(robot.ready, 11.3)
    with pytest.raises(RobotError, match=r"the joint states around it are 300 ms apart, of 250 ms at most"):
        history.at(11.2, APART)
    np.testing.assert_array_equal(history.at(11.3, APART), robot.ready)


def test_it_forgets_what_is_old(robot, history):
    for second in range(12, 20):
        history.add(robot.ready, float(second))
    with pytest.raises(RobotError, match="the oldest joint state that is known is"):
        history.at(10.5, APART)


def test_a_joint_without_an_end_is_turned_the_shorter_angle(tmp_path):
    (tmp_path / "turntable.urdf").write_text(TURNTABLE)
    history = JointHistory(Robot.from_urdf(tmp_path / "turntable.urdf", "base", "plate"))
    history.add(np.array([3.1]), 0.0)
    history.add(np.array([-3.1]), 0.1)
    between = history.at(0.05, APART)
    np.testing.assert_allclose(np.cos(between), -1.0, atol=1e-12)
