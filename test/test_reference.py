"""Smoothing keeps the ends, the time law keeps the limits, the follower never jumps."""

import numpy as np
import pytest

from geodesic_motion_ros.motion_curve import MotionCurve, MotionLimits
from geodesic_motion_ros.quaternions import angle_between, normalise, slerp
from geodesic_motion_ros.reference import (
    ReferenceFollower,
    bent_to,
    correct_ends,
    resample_latent,
    smooth_latent,
    smooth_poses,
    timed_reference,
)

SPEED, ANGULAR_SPEED = 0.2, 0.8
LIMITS = MotionLimits(SPEED, ANGULAR_SPEED, 0.5, 2.0)


def staircase(count: int = 12) -> np.ndarray:
    steps = np.tile([[1.0, 0.0], [0.0, 1.0]], (count, 1))
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def reference(initial_speed: float = 0.0, length: float = 0.5):
    share = np.linspace(0.0, 1.0, 120)
    positions = np.stack([length * share, 0.1 * np.sin(3.0 * share), 0.0 * share], axis=1)
    quaternions = slerp(np.array([1.0, 0, 0, 0]), normalise(np.array([1.0, 0.5, 0, 0])), share)
    curve = MotionCurve.through(positions, quaternions, LIMITS)
    return timed_reference(curve, np.stack([share, share], axis=1), LIMITS, initial_speed)


def test_resampling_is_even_and_keeps_the_ends():
    points = resample_latent(staircase(), 0.1)
    np.testing.assert_array_equal(points[[0, -1]], staircase()[[0, -1]])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).max() <= 0.1 + 1e-12


def test_smoothing_straightens_a_staircase_between_fixed_ends():
    points = resample_latent(staircase(), 0.25)
    smooth = smooth_latent(points, 8.0)
    np.testing.assert_array_equal(smooth[[0, -1]], points[[0, -1]])
    inner = smooth[5:-5]
    assert np.abs(inner[:, 0] - inner[:, 1]).max() < 0.6
    assert np.linalg.norm(np.diff(smooth, axis=0), axis=1).sum() < np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    turns = np.linalg.norm(np.diff(smooth, 2, axis=0), axis=1)
    assert turns.max() < np.linalg.norm(np.diff(points, 2, axis=0), axis=1).max()


def test_smoothing_a_straight_line_changes_nothing():
    line = np.linspace([0.0, 1.0], [2.0, 3.0], 50)
    np.testing.assert_allclose(smooth_latent(line, 4.0), line, atol=1e-12)


def test_smoothing_works_on_a_path_shorter_than_the_filter():
    line = np.linspace([0.0, 1.0], [0.1, 1.1], 5)
    np.testing.assert_allclose(smooth_latent(line, 4.0), line, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_corrected_curves_meet_both_ends_and_fade_between(seed):
    random = np.random.default_rng(seed)
    positions = np.cumsum(random.normal(size=(50, 3)), axis=0)
    quaternions = slerp(normalise(random.normal(size=4)), normalise(random.normal(size=4)), np.linspace(0, 1, 50))
    start, goal = (
        (positions[i] + random.normal(scale=0.1, size=3), normalise(quaternions[i] + random.normal(scale=0.1, size=4)))
        for i in (0, -1)
    )
    moved, turned = correct_ends(positions, quaternions, start, goal)
    for i, (position, quaternion) in ((0, start), (-1, goal)):
        np.testing.assert_allclose(moved[i], position, atol=1e-12)
        assert angle_between(turned[i], quaternion) < 1e-7
    largest = max(np.linalg.norm(start[0] - positions[0]), np.linalg.norm(goal[0] - positions[-1]))
    assert np.linalg.norm(moved - positions, axis=1).max() <= largest + 1e-12


def test_smoothed_poses_keep_their_ends_and_lose_their_kinks():
    share = np.linspace(0.0, 1.0, 60)
    positions = np.stack([share, np.abs(share - 0.5), 0.0 * share], axis=1)
    quaternions = normalise(np.stack([1.0 + 0.0 * share, np.abs(share - 0.5), 0.0 * share, 0.0 * share], axis=1))
    moved, turned = smooth_poses(positions, quaternions, 3.0)
    np.testing.assert_array_equal(moved[[0, -1]], positions[[0, -1]])
    np.testing.assert_allclose(turned[[0, -1]], quaternions[[0, -1]], atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1.0)
    for smooth, raw in ((moved, positions), (turned, quaternions)):
        assert np.abs(np.diff(smooth, 2, axis=0)).max() < 0.3 * np.abs(np.diff(raw, 2, axis=0)).max()


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
