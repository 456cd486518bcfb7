"""The time law keeps the limits, the follower never jumps."""

import numpy as np
import pytest

from geodesic_motion_ros.motion_curve import MotionCurve, MotionLimits
from geodesic_motion_ros.quaternions import angle_between, normalise, slerp
from geodesic_motion_ros.reference import (
    ReferenceFollower,
    bent_to,
    timed_reference,
)

SPEED, ANGULAR_SPEED = 0.2, 0.8
LIMITS = MotionLimits(SPEED, ANGULAR_SPEED, 0.5, 2.0)


def reference(initial_speed: float = 0.0, length: float = 0.5):
    share = np.linspace(0.0, 1.0, 120)
    positions = np.stack([length * share, 0.1 * np.sin(3.0 * share), 0.0 * share], axis=1)
    quaternions = slerp(np.array([1.0, 0, 0, 0]), normalise(np.array([1.0, 0.5, 0, 0])), share)
    curve = MotionCurve.through(positions, quaternions, LIMITS)
    return timed_reference(curve, np.stack([share, share], axis=1), LIMITS, initial_speed)


@pytest.mark.parametrize("degrees", [1.0, 20.0, 50.0])
def test_a_way_is_bent_to_the_present_motion_and_nowhere_else(degrees):
    curve, turn = reference().curve, np.radians(degrees)
    ahead = curve.tangents[0]
    velocity = 0.3 * ahead
    cosine, sine = np.cos(turn), np.sin(turn)
    velocity[:2] = 0.3 * np.array([cosine * ahead[0] - sine * ahead[1], sine * ahead[0] + cosine * ahead[1]])
    positions, quaternions = bent_to(curve.positions, curve.quaternions, velocity, LIMITS)
    np.testing.assert_allclose(positions[[0, -1]], curve.positions[[0, -1]], atol=1e-12)
    assert angle_between(quaternions[-1], curve.quaternions[-1]) < 1e-7
    step = positions[1] - positions[0]
    assert step @ velocity[:3] >= 0.9 * np.linalg.norm(step) * np.linalg.norm(velocity[:3])
    bent = timed_reference(
        MotionCurve.through(positions, quaternions, LIMITS, velocity), np.zeros((120, 2)), LIMITS,
        float(LIMITS.fraction(velocity[:3], velocity[3:])),
    )  # fmt: skip
    np.testing.assert_allclose(bent.velocity(0.0), velocity, atol=1e-9)
    assert bent.strain == 1.0


@pytest.mark.parametrize("back", [-1.0, -0.1])
def test_no_way_is_bent_backwards(back):
    curve = reference().curve
    assert bent_to(curve.positions, curve.quaternions, back * curve.tangents[0], LIMITS) is None


@pytest.mark.parametrize("initial_speed", [0.0, 0.7])
def test_the_rest_of_a_reference_is_the_same_motion(initial_speed):
    whole = reference(initial_speed)
    for begin in np.linspace(0.0, whole.duration, 37):
        segment, share, distance, angle = whole.curve.foot(*whole.sample(begin), len(whole.times) - 1, 0.1)
        assert distance < 1e-9
        assert angle < 1e-7
        rest = whole.rest(segment, share)
        assert rest.duration == pytest.approx(whole.duration - begin, abs=1e-4)
        assert len(rest.latent) == len(rest.times) == len(rest.clearance) + 1
        expected = (1.0 - share) * whole.latent[segment] + share * whole.latent[segment + 1]
        np.testing.assert_allclose(rest.latent[0], expected)
        for time in np.linspace(0.0, rest.duration, 11):
            position, quaternion = rest.sample(time)
            expected = whole.sample(begin + time)
            # Where the last two micrometres are left out, the end is reached a little sooner.
            np.testing.assert_allclose(position, expected[0], atol=3e-6)
            assert angle_between(quaternion, expected[1]) < 1e-5
    assert rest.rate(0.0) == 0.0


def test_sampled_motion_keeps_speed_limits():
    curve, period = reference(), 0.001
    times = np.arange(0.0, curve.duration, period)
    positions, quaternions = (np.array(x) for x in zip(*[curve.sample(t) for t in times], strict=True))
    assert np.linalg.norm(np.diff(positions, axis=0), axis=1).max() <= SPEED * period * 1.001
    assert angle_between(quaternions[1:], quaternions[:-1]).max() <= ANGULAR_SPEED * period * 1.001


def test_sampling_is_held_beyond_both_ends():
    curve = reference()
    np.testing.assert_array_equal(curve.sample(-1.0)[0], curve.positions[0])
    np.testing.assert_allclose(curve.sample(curve.duration + 1.0)[0], curve.positions[-1])


def test_a_replanned_stream_arrives_like_the_single_plan():
    single, follower, period = reference(), ReferenceFollower(SPEED), 0.01
    follower.reset(single.positions[0], single.quaternions[0])
    follower.accept(single)
    elapsed, largest = 0.0, 0.0
    while not follower.at_end:
        before = follower.position
        follower.advance(period)
        largest = max(largest, float(np.linalg.norm(follower.position - before)))
        elapsed += period
    assert elapsed == pytest.approx(single.duration, abs=2 * period)
    assert largest <= SPEED * period * 1.001
    np.testing.assert_allclose(follower.position, single.positions[-1])
    assert follower.speed == 0.0


def test_a_held_follower_stands_where_it_is():
    follower = ReferenceFollower(SPEED)
    assert not follower.ready
    follower.reset(np.zeros(3), np.array([1.0, 0, 0, 0]))
    follower.accept(reference())
    follower.advance(0.5)
    follower.hold()
    here = follower.position.copy()
    np.testing.assert_array_equal(follower.advance(0.5)[0], here)
    assert follower.ready
    assert follower.speed == 0.0


def test_the_commanded_quaternion_never_changes_hemisphere():
    follower, curve = ReferenceFollower(SPEED), reference()
    follower.reset(curve.positions[0], -curve.quaternions[0])
    follower.accept(curve)
    before = follower.quaternion
    for _ in range(100):
        _, after = follower.advance(0.02)
        assert before @ after > 0.0
        before = after
