"""A single joint state that cannot be is refused; an arm that really is elsewhere is believed at the second one."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest

from geodesic_motion_ros.nodes.messages import MessageRefused
from geodesic_motion_ros.nodes.plausible_joints import FORGOTTEN, OVERTAKEN, PlausibleJoints
from geodesic_motion_ros.robot.kinematics import Robot

ROBOT = Robot.named("panda")
STEP = 0.008
AWAY = np.array([0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0])


@pytest.fixture
def states() -> PlausibleJoints:
    joints = PlausibleJoints(ROBOT)
    joints.check(ROBOT.ready, 10.0)
    return joints


def test_an_arm_at_full_speed_is_believed(states):
    for number in range(1, 50):
        states.check(ROBOT.ready + number * STEP * ROBOT.velocity_limits, 10.0 + number * STEP)


def test_a_glitch_is_refused_by_the_name_of_its_joint_and_forgotten(states):
    for number in range(1, 1000):
        away = AWAY if number % 250 == 0 else np.zeros(7)
        refused = pytest.raises(MessageRefused, match=r"'panda_joint4' has jumped by 0\.50 rad")
        with refused if np.any(away) else nullcontext():
            states.check(ROBOT.ready + away, 10.0 + number * STEP)


def test_of_two_sources_that_alternate_neither_is_believed_until_one_is_alone(states):
    refusals, times = [], 10.0 + 0.1 * np.arange(1, 100)
    for number, time in enumerate(times):
        try:
            states.check(ROBOT.ready + (AWAY if number % 2 and number < 40 else 0.0), time)
        except MessageRefused as refusal:
            refusals.append((number, str(refusal)))
    assert all("has jumped by" in reason for number, reason in refusals if number % 2 and number < 40)
    between = [number for number, reason in refusals if "are of two places in turn" in reason]
    # from the third jump on, and until the last three are forgotten
    assert between == [*range(6, 40, 2), *range(40, 55)]




def test_two_states_that_agree_are_believed(states):
    with pytest.raises(MessageRefused):
        states.check(ROBOT.ready + AWAY, 10.0 + STEP)
    states.check(ROBOT.ready + AWAY, 10.0 + 2.0 * STEP)
    states.check(ROBOT.ready + AWAY, 10.0 + 3.0 * STEP)
    with pytest.raises(MessageRefused):
        states.check(ROBOT.ready, 10.0 + 4.0 * STEP)


def test_after_a_silence_the_arm_may_be_anywhere(states):
    states.check(ROBOT.ready + AWAY, 10.0 + FORGOTTEN + STEP)


@pytest.mark.parametrize("stamp", [-1.7e9, 10.0 - FORGOTTEN - STEP, 10.0 - OVERTAKEN - STEP])
def test_an_old_stamp_does_not_make_the_next_state_credible(states, stamp):
    """Between it and any other lies so much time that the arm could be anywhere."""
    with pytest.raises(MessageRefused, match="older than that of the newest state"):
        states.check(ROBOT.ready - AWAY, stamp)
    with pytest.raises(MessageRefused, match="has jumped by"):
        states.check(ROBOT.ready + AWAY, 10.0 + STEP)
    states.check(ROBOT.ready, 10.0 + 2.0 * STEP)


def test_a_state_that_was_overtaken_is_one_of_an_arm_in_motion(states):
    states.check(ROBOT.ready - 10.0 * STEP * ROBOT.velocity_limits, 10.0 - 10.0 * STEP)
