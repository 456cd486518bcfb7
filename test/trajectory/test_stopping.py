"""Every motion can be stopped: within its limits, without a jump, soon, and along its own path where it has one."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.stopping import bridge_to_rest, leaving_stop, stopping_reference
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import PERIOD

ROBOT = Robot.named("panda")
LIMITS = JointLimits.of(ROBOT)


def test_every_motion_can_be_stopped_along_its_own_path(motions):
    """From rest or replanned, at any time: continuous, within limits, on the path, sooner than by playing on."""
    stops = []
    for random, reference in motions.references(60, seed=3):
        for _ in range(2):
            time = random.uniform(0.0, 0.9) * reference.duration
            stop = stopping_reference(reference, time, LIMITS)
            for value, wanted in zip(stop.sample(0.0), reference.sample(time), strict=True):
                np.testing.assert_allclose(value, wanted, atol=1e-9)
            motions.assert_plays_within_limits(stop)
            left = reference.samples(np.linspace(time, reference.duration, 2000))[0]
            halt = stop.samples(np.linspace(0.0, stop.duration, 20))[0]
            assert np.linalg.norm(halt[:, None] - left, axis=2).min(axis=1).max() < 3e-3
            assert stop.duration <= reference.duration - time + PERIOD
            stops.append(stop.duration)
            path = motions.detour(random, reference, time, 0.0)
            reference = (path is not None and motions.timed(path, *reference.sample(time)[1:])) or reference
    assert len(stops) >= 100
    assert np.median(stops) < 0.35
    assert max(stops) < 0.8


def test_a_motion_in_which_joints_brake_as_hard_as_they_may_is_stopped_soon():
    """Braking along the path would brake these harder still, at first: that is no reason to go on to the path's end."""
    limits = JointLimits.of(ROBOT, 0.3, 0.2)
    for seed in range(40):
        random = np.random.default_rng([6, seed])
        goal = np.clip(ROBOT.ready + random.normal(scale=0.5, size=7), limits.lower + 0.1, limits.upper - 0.1)
        path = ROBOT.ready + np.linspace(0.0, 1.0, 100)[:, None] * (goal - ROBOT.ready)
        velocity = random.uniform(-0.1, 0.1, 7) * limits.velocity
        acceleration = -0.997 * np.sign(velocity) * limits.acceleration * (random.uniform(size=7) < 0.4)
        reference = timed_joint_reference(path, np.zeros((100, 1)), limits, velocity, acceleration)
        assert reference is not None
        for time in (0.0, 0.01, 0.02, 0.04):
            stop = stopping_reference(reference, time, limits)
            assert stop.keeps(limits)
            assert stop.duration < 0.3


def test_every_state_of_motion_can_be_bridged_to_rest(motions):
    durations = []
    for random, reference in motions.references(60, seed=4):
        for time in random.uniform(0.0, reference.duration, 2):
            state = reference.sample(time)
            bridge = bridge_to_rest(*state, LIMITS)
            for value, wanted in zip(bridge.sample(0.0), state, strict=True):
                np.testing.assert_allclose(value, wanted, atol=1e-9)
            assert np.all(bridge.limit_ratio(LIMITS) <= 1.0 + 1e-6)
            assert np.diff(bridge.times).max() <= PERIOD + 1e-12
            assert not np.any(bridge.velocities[-1])
            assert not np.any(bridge.accelerations[-1])
            # No joint can be at rest sooner than its acceleration limit allows; jerk costs little more.
            least = np.max(np.abs(state[1]) / LIMITS.acceleration)
            assert least - 1e-9 <= bridge.duration <= least + 0.02
            durations.append(bridge.duration)
    assert max(durations) > 0.15


def test_a_stop_that_leaves_the_path_is_no_later_than_one_along_it_and_none_where_the_motion_is_over_as_soon(motions):
    sooner = []
    for random, reference in motions.references(30, seed=5):
        time = random.uniform(0.0, 0.9) * reference.duration
        along, leaving = (stop(reference, time, LIMITS) for stop in (stopping_reference, leaving_stop))
        assert leaving is not None
        assert leaving.keeps(LIMITS)
        assert leaving.latent.shape == (len(leaving.times), reference.latent.shape[1])
        for value, wanted in zip(leaving.sample(0.0), reference.sample(time), strict=True):
            np.testing.assert_allclose(value, wanted, atol=1e-9)
        sooner.append(along.duration - leaving.duration)
        assert leaving_stop(reference, reference.duration - 1e-3, LIMITS) is None
    assert min(sooner) > -0.02
    assert max(sooner) > 0.05
