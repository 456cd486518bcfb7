"""Towards the stops of its joints an FR3 is no faster than its maker allows: from rest, taken over, and stopping."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.stopping import leaving_stop, slowed_reference, stopping_reference
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference, joined

ROBOT = Robot.named("fr3")
LIMITS = JointLimits.of(ROBOT, ROBOT.largest_speed_scale)
BARE = replace(LIMITS, position_based_velocity=None)
#: Of Franka's documentation: decelerations, offsets, stops and largest speeds.
DECELERATION = np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0])
OFFSET = np.array([0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35])
LOWER = np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196])
UPPER = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196])
FASTEST = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])


def makers_share(reference: JointReference) -> float:
    """The largest share of the maker's limits that a motion's speeds use, at 1 kHz."""
    positions, velocities, _ = reference.samples(np.arange(0.0, reference.duration + 1e-3, 1e-3))
    room = np.where(velocities < 0.0, positions - LOWER, UPPER - positions)
    limits = np.minimum(FASTEST, np.maximum(0.0, np.sqrt(2.0 * DECELERATION * np.maximum(0.0, room)) - OFFSET))
    moving = np.abs(velocities) > 1e-6
    return float(np.max(np.abs(velocities[moving]) / np.maximum(limits[moving], 1e-12), initial=0.0))


def path(random: np.random.Generator) -> np.ndarray:
    """A path (60, 7) between two configurations anywhere within the limits, bent."""
    ends = random.uniform(LIMITS.lower, LIMITS.upper, (2, 7))
    share = np.linspace(0.0, 1.0, 60)[:, None]
    bent = ends[0] + share * (ends[1] - ends[0]) + np.sin(np.pi * share) * random.normal(scale=0.2, size=7)
    return np.clip(bent, LIMITS.lower, LIMITS.upper)


def timed(along: np.ndarray, limits: JointLimits, *state: np.ndarray) -> JointReference | None:
    return timed_joint_reference(along, np.zeros((len(along), 1)), limits, *state)


def references(count: int, seed: int) -> Iterator[tuple[np.random.Generator, JointReference]]:
    for number in range(count):
        random = np.random.default_rng([seed, number])
        reference = timed(path(random), LIMITS)
        if reference is not None:
            yield random, reference


def test_the_largest_speeds_are_the_makers() -> None:
    positions = ROBOT.sample(500, np.random.default_rng(0))
    own = JointLimits.of(ROBOT)
    towards = np.stack([positions - LOWER, UPPER - positions])
    expected = np.minimum(FASTEST, np.maximum(0.0, np.sqrt(2.0 * DECELERATION * towards) - OFFSET))
    # libfranka keeps a thousandth of a rad/s below.
    np.testing.assert_allclose(own.largest_speeds(positions), np.maximum(expected - 1e-3, 0.0), atol=1.1e-3)
    assert np.all(own.largest_speeds(positions) <= np.maximum(expected, 1e-6))
    assert np.any(expected < FASTEST)
    scaled = LIMITS.largest_speeds(positions)
    np.testing.assert_array_equal(scaled, np.minimum(LIMITS.velocity, own.largest_speeds(positions)))


def test_at_a_stop_and_beyond_it_joints_may_only_return() -> None:
    outside = np.stack([LOWER - 0.01, LOWER, UPPER, UPPER + 0.01])
    downwards, upwards = LIMITS.largest_speeds(outside)
    np.testing.assert_array_equal(downwards[:2], 1e-6)
    np.testing.assert_array_equal(upwards[2:], 1e-6)
    assert np.all(downwards[2:] > 1.0)
    assert np.all(upwards[:2] > 1.0)


def test_other_robots_have_no_such_limits() -> None:
    limits = JointLimits.of(Robot.named("panda"), 0.5)
    assert limits.position_based_velocity is None
    assert np.all(limits.largest_speeds(np.zeros((3, 7))) == limits.velocity)


def test_plans_keep_them_and_without_them_many_would_not() -> None:
    kept, bare, longer = [], [], []
    for number in range(120):
        along = path(np.random.default_rng([0, number]))
        reference, control = timed(along, LIMITS), timed(along, BARE)
        if reference is not None and control is not None:
            assert reference.keeps(LIMITS)
            kept.append(makers_share(reference))
            bare.append(makers_share(control))
            longer.append(reference.duration / control.duration)
    assert len(kept) > 80
    assert max(kept) <= 1.0
    assert np.mean(np.array(bare) > 1.0) > 0.2
    assert np.median(longer) < 1.02


def test_what_is_judged_between_knots_is_never_less_than_what_is_played_and_little_more() -> None:
    near = []
    for number in range(60):
        control = timed(path(np.random.default_rng([1, number])), BARE)
        if control is None:
            continue
        judged, played = control.limit_ratio(LIMITS)[0].max(), makers_share(control)
        if played > 1.0:
            # The maker's limit without libfranka's thousandth of a rad/s.
            assert judged >= played
            near.append(judged / played)
            assert not control.keeps(LIMITS)
    assert len(near) > 10
    assert np.median(near) < 1.02


def test_takeovers_in_motion_keep_them() -> None:
    taken, refused = [], 0
    for random, reference in references(150, 2):
        time = random.uniform(0.1, 0.8) * reference.duration
        state = reference.sample(time)
        rest = reference.rest(time).positions
        goal = rest[-1] + random.normal(scale=0.3, size=7)
        share = np.linspace(0.0, 1.0, len(rest))[:, None]
        along = np.clip(rest + share**2 * (goal - rest[-1]), LIMITS.lower, LIMITS.upper)
        other = timed(along, LIMITS, *state[1:])
        if other is None:
            refused += 1
            continue
        whole = joined(reference, 0.0, other, time)
        assert whole.keeps(LIMITS)
        taken.append(makers_share(whole))
    assert len(taken) > 60
    assert max(taken) <= 1.0


def test_a_stop_from_every_state_that_keeps_them_keeps_them() -> None:
    stops = []
    for _, reference in references(40, 3):
        for time in reference.times[:-1]:
            stop = stopping_reference(reference, time, LIMITS)
            assert stop.keeps(LIMITS)
            stops.append(makers_share(stop))
            leaving = leaving_stop(reference, time, LIMITS)
            if leaving is not None:
                stops.append(makers_share(leaving))
    assert len(stops) > 1000
    assert max(stops) <= 1.0


def test_a_motion_that_is_slowed_down_keeps_them() -> None:
    lower, slowed = JointLimits.of(ROBOT, 0.2, 0.5), []
    for random, reference in references(40, 4):
        slower = slowed_reference(reference, random.uniform(0.1, 0.5) * reference.duration, lower, LIMITS)
        if slower is not None:
            slowed.append(makers_share(slower))
    assert len(slowed) > 20
    assert max(slowed) <= 1.0


def test_an_arm_that_stands_just_before_a_stop_may_leave_it() -> None:
    """Where the maker allows no speed towards the stop: joint 4 is within its limits there."""
    start = ROBOT.ready.copy()
    start[3] = -0.152
    away = timed(start + np.linspace(0.0, 1.0, 40)[:, None] * (ROBOT.ready - start), LIMITS)
    assert away is not None
    assert makers_share(away) <= 1.0


@pytest.mark.parametrize("scale", [0.05, 0.3])
def test_the_curve_itself_is_not_scaled(scale: float) -> None:
    limits = JointLimits.of(ROBOT, scale)
    assert limits.position_based_velocity is ROBOT.position_based_velocity
    np.testing.assert_allclose(limits.velocity, scale * FASTEST)
