"""What an arm lets pass that judges its commands."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.hardware.judged_commands import PERIOD, SEEN, check_motion, check_takeover
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_ros.utils.errors import RobotError

SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_a_motion_inside_the_limits_passes_as_a_whole_and_wherever_it_is_cut(arm, seed: int) -> None:
    motion = arm.motion(seed)
    check_motion(arm.sent(motion), arm.limits, arm.names)
    for begin in np.random.default_rng(seed).uniform(0.0, motion.duration, 5):
        rows = motion.samples(begin + PERIOD * np.arange(2 * SEEN))[0]
        check_takeover(rows[:SEEN], rows[SEEN:], arm.limits, arm.names)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, joint=st.integers(0, 6), step=st.floats(1.1e-5, 0.1), downwards=st.booleans())
def test_a_step_of_more_than_the_arm_forgives_is_refused_with_the_joint(arm, seed, joint, step, downwards) -> None:
    # 10 rad/s^2 in a millisecond squared: what a step from rest may be
    assert step > arm.limits.acceleration[joint] * PERIOD**2
    rows = np.tile(arm.robot.ready, (2 * SEEN, 1))
    rows[SEEN:, joint] += -step if downwards else step
    with pytest.raises(RobotError, match=f"does not continue what is commanded: .*{arm.names[joint]} "):
        check_takeover(rows[:SEEN], rows[SEEN:], arm.limits, arm.names)


@pytest.mark.parametrize(("order", "what"), [(1, "velocity"), (2, "acceleration"), (3, "jerk")])
def test_what_is_broken_is_named_with_its_figure_and_the_limit(arm, order: int, what: str) -> None:
    limit = (arm.limits.velocity, arm.limits.acceleration, arm.limits.jerk)[order - 1][6]
    # one difference of joint 7, far from its stops, is half as much again as allowed, those below it are about zero
    joint = np.full(2 * SEEN - order, 1.5 * limit)
    for _ in range(order):
        joint = np.append(0.0, np.cumsum(joint)) * PERIOD
        joint -= joint.mean()
    rows = arm.robot.ready + np.outer(joint, np.eye(7)[6])
    expected = f"{arm.names[6]} would have a {what} of {1.5 * limit:.3g} rad"
    with pytest.raises(RobotError, match=f"{re.escape(expected)}.*at most {re.escape(f'{limit:.3g}')} is allowed"):
        check_takeover(rows[:SEEN], rows[SEEN:], arm.limits, arm.names)


def test_speeds_towards_a_stop_count_where_the_joint_is(arm) -> None:
    # joint 2, a tenth of a radian before its upper stop, at 0.6 rad/s
    near = arm.robot.ready.copy()
    near[1] = 1.7918 - 0.1
    allowed = arm.limits.largest_speeds(near[None])[1, 0, 1]
    assert allowed < 0.6 < arm.limits.velocity[1]
    rows = near + 0.6 * PERIOD * np.arange(2 * SEEN)[:, None] * np.eye(7)[1]
    with pytest.raises(RobotError, match=rf"{arm.names[1]} would have a velocity of 0\.6 rad/s"):
        check_takeover(rows[:SEEN], rows[SEEN:], arm.limits, arm.names)
    # away from the stop it is no limit
    check_takeover(rows[::-1][:SEEN], rows[::-1][SEEN:], arm.limits, arm.names)


def test_a_trajectory_without_accelerations_is_refused(arm) -> None:
    motion = arm.motion(3)
    for given_ in ((motion.positions,), (motion.positions, motion.velocities)):
        with pytest.raises(RobotError, match="no velocities and accelerations"):
            check_motion(JointWaypoints(motion.times, *given_), arm.limits, arm.names)


def test_a_trajectory_that_is_too_fast_is_refused_with_how_much(arm) -> None:
    motion = arm.sent(arm.motion(3))
    # in a third of the time velocities are three times, jerks 27 times as large
    faster = JointWaypoints(motion.times / 3.0, motion.positions, 3.0 * motion.velocities, 9.0 * motion.accelerations)
    with pytest.raises(RobotError, match=r"the trajectory has \d+\.\d\d times the (velocity|acceleration|jerk) that"):
        check_motion(faster, arm.limits, arm.names)


def test_a_trajectory_that_leaves_the_range_of_a_joint_is_refused_by_its_name(arm) -> None:
    motion = arm.sent(arm.motion(3))
    share = motion.times / motion.times[-1]
    shift = np.outer(share, (arm.limits.upper[2] + 0.05 - motion.positions[-1, 2]) * np.eye(7)[2])
    with pytest.raises(RobotError, match=f"leaves the range of {arm.names[2]}"):
        check_motion(replace(motion, positions=motion.positions + shift), arm.limits, arm.names)


def test_a_trajectory_that_ends_with_an_acceleration_is_refused(arm) -> None:
    motion = arm.sent(arm.motion(3))
    accelerations = motion.accelerations.copy()
    most = arm.limits.jerk[4] * PERIOD
    accelerations[-1, 4] = 1.01 * most
    with pytest.raises(RobotError, match=f"ends with an acceleration of .* of {arm.names[4]}"):
        check_motion(replace(motion, accelerations=accelerations), arm.limits, arm.names)
