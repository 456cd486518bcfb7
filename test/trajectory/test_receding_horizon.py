"""What is sent of a reference: the same until the horizon, then a stop along the same path."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.receding_horizon import Horizon
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference

ROBOT = Robot.named("panda")
LIMITS = JointLimits.of(ROBOT, 0.3, 0.2)
LENGTH = 1.0


@pytest.fixture(params=range(5))
def reference(request: pytest.FixtureRequest) -> JointReference:
    """A bent path of some seconds."""
    random = np.random.default_rng(request.param)
    middle, goal = random.uniform(-0.5, 0.5, (2, 7))
    share = np.linspace(0.0, 1.0, 100)[:, None]
    path = np.clip(ROBOT.ready + share * goal + np.sin(np.pi * share) * middle, LIMITS.lower + 0.1, LIMITS.upper - 0.1)
    made = timed_joint_reference(path, np.zeros((100, 1)), LIMITS)
    assert made is not None
    assert made.duration > 2.0
    return made


def test_what_is_sent_is_the_reference_until_the_horizon_and_ends_at_rest_soon_after(reference):
    begin, now = 40.0, 40.3
    sent = Horizon(LENGTH).bound(reference, begin, now, LIMITS)
    assert now + LENGTH - 0.02 < sent.brakes <= now + LENGTH + 1e-9
    same = np.linspace(0.0, sent.brakes - begin, 300)
    np.testing.assert_allclose(sent.reference.samples(same), reference.samples(same), atol=1e-9)
    assert sent.reference.keeps(LIMITS)
    assert not np.any(sent.reference.velocities[-1])
    assert sent.brakes - begin < sent.reference.duration < now + LENGTH - begin + 0.8


def test_it_brakes_along_the_same_path(reference):
    sent = Horizon(LENGTH).bound(reference, 0.0, 0.0, LIMITS)
    path = reference.samples(np.linspace(0.0, reference.duration, 3000))[0]
    halt = sent.reference.samples(np.linspace(sent.brakes, sent.reference.duration, 30))[0]
    assert np.linalg.norm(halt[:, None] - path, axis=2).min(axis=1).max() < 3e-3


def test_what_ends_within_the_horizon_is_sent_whole_and_once(reference):
    horizon = Horizon(LENGTH)
    sent = horizon.bound(reference, 5.0, 5.001 + reference.duration - LENGTH, LIMITS)
    assert sent.reference is reference
    assert sent.brakes == math.inf
    assert not horizon.must_renew(1e9)
    assert horizon.overrun(1e9) is None


def test_in_the_first_second_of_a_stream_it_is_sent_again_ten_times_a_second(reference):
    """The controller may find the sender late."""
    horizon = Horizon(LENGTH)
    horizon.bound(reference, 0.0, 0.0, LIMITS)
    assert [horizon.must_renew(now) for now in (0.09, 0.11)] == [False, True]
    horizon.bound(reference, 0.0, 0.11, LIMITS)
    assert [horizon.must_renew(now) for now in (0.2, 0.22)] == [False, True]
    sent = horizon.bound(reference, 0.0, 0.99, LIMITS)
    assert not horizon.must_renew(min(1.1, sent.brakes - 0.5 * LENGTH - 1e-3))


def test_it_is_renewed_long_before_the_arm_brakes_and_an_overrun_is_reported(reference):
    horizon = Horizon(LENGTH)
    assert not horizon.must_renew(1e9)
    horizon.bound(reference, -9.0, -9.0, LIMITS)
    sent = horizon.bound(reference, 0.0, 0.0, LIMITS)
    assert not horizon.must_renew(sent.brakes - 0.5 * LENGTH - 1e-3)
    assert horizon.must_renew(sent.brakes - 0.5 * LENGTH + 1e-3)
    assert horizon.overrun(sent.brakes - 1e-3) is None
    assert horizon.overrun(sent.brakes) is sent
    horizon.forget()
    assert horizon.overrun(sent.brakes) is None
