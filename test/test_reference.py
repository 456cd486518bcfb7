"""Smoothing keeps the ends, the time law keeps the limits, the follower never jumps."""

import numpy as np
import pytest

from geodesic_motion_ros.quaternions import angle_between, normalise, slerp
from geodesic_motion_ros.reference import (
    ReferenceFollower,
    correct_ends,
    cut_curve,
    nominal_durations,
    resample_latent,
    smooth_latent,
    time_law,
    timed_reference,
)

SPEED, ANGULAR_SPEED, ACCELERATION = 0.2, 0.8, 0.5


def staircase(count: int = 12) -> np.ndarray:
    steps = np.tile([[1.0, 0.0], [0.0, 1.0]], (count, 1))
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def reference(initial_speed: float = 0.0, length: float = 0.5):
    share = np.linspace(0.0, 1.0, 120)
    positions = np.stack([length * share, 0.1 * np.sin(3.0 * share), 0.0 * share], axis=1)
    quaternions = slerp(np.array([1.0, 0, 0, 0]), normalise(np.array([1.0, 0.5, 0, 0])), share)
    return timed_reference(
        positions, quaternions, np.zeros((120, 2)), np.full(119, np.inf),
        SPEED, ANGULAR_SPEED, ACCELERATION, initial_speed,
    )  # fmt: skip


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


@pytest.mark.parametrize("initial", [0.0, 0.3, 1.0])
def test_the_time_law_keeps_rate_and_acceleration_and_ends_at_rest(initial):
    nominal = np.random.default_rng(0).uniform(0.001, 0.05, 200)
    times, rates = time_law(nominal, 2.0, initial)
    assert rates[0] == pytest.approx(initial)
    assert rates[-1] == 0.0
    assert rates.max() <= 1.0
    assert np.all(np.diff(times) > 0.0)
    assert np.abs(np.diff(rates) / np.diff(times)).max() <= 2.0 * (1.0 + 1e-9)


@pytest.mark.parametrize("duration", [0.0, 0.013, 1.0, 2.0, 100.0])
def test_a_cut_curve_lasts_as_long_as_asked_and_follows_the_whole(duration):
    curve = reference()
    nominal = nominal_durations(curve.positions, curve.quaternions, SPEED, ANGULAR_SPEED)
    positions, quaternions = cut_curve(curve.positions, curve.quaternions, nominal, duration)
    lasted = nominal_durations(positions, quaternions, SPEED, ANGULAR_SPEED).sum()
    assert lasted == pytest.approx(min(duration, nominal.sum()), abs=1e-6)
    np.testing.assert_array_equal(positions[:-1], curve.positions[: len(positions) - 1])
    assert len(positions) >= 2


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
