"""The tool keeps its limits of speed and acceleration wherever it is looked at, and is not slower than needed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.motion_curve import MotionCurve, MotionLimits, distinct
from geodesic_motion_ros.planning.path_smoothing import smooth_poses
from geodesic_motion_ros.quaternions import angle_between, normalise, rotate_by, rotation_vector_between
from geodesic_motion_ros.reference import TaskSpaceReference, timed_reference
from geodesic_motion_ros.time_law import braking_law, fastest_law

LIMITS = MotionLimits(0.2, 0.8, 0.5, 2.0)
#: Limits hold at three points of every segment; between them, and for angular velocities of a curved rotation, they may
#: be exceeded: a little in bends of many samples, more where a bend or a corner has two or three.
SMOOTH, CORNERED = 1.05, 1.3
DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def drawn(positions: np.ndarray, turns: np.ndarray) -> MotionCurve:
    """The curve through positions (n, 3) and orientations that are turned by rotation vectors (n, 3)."""
    quaternions = rotate_by(turns, np.broadcast_to(DOWN, (len(turns), 4)))
    kept = distinct(positions, quaternions, LIMITS)
    return MotionCurve.through(positions[kept], quaternions[kept], LIMITS)


def reference(curve: MotionCurve, speed: float = 0.0) -> TaskSpaceReference:
    count = len(curve.knots)
    return timed_reference(curve, np.zeros((count, 2)), LIMITS, speed)


def stop(curve: MotionCurve, rate: float, strain: float = 1.0) -> TaskSpaceReference:
    cut, times, rates = braking_law(curve, LIMITS, rate, strain)
    count = len(times)
    return TaskSpaceReference(times, rates, cut, LIMITS, np.zeros((count, 2)), np.full(count - 1, np.inf))


def differences(motion: TaskSpaceReference, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocities (n, 6) and accelerations (n - 1, 6) of samples `period` [s] apart, from rest and to rest."""
    times = np.arange(-2.0 * period, motion.duration + 3.0 * period, period)
    positions, quaternions = (np.array(part) for part in zip(*[motion.sample(t) for t in times], strict=True))
    turns = rotation_vector_between(quaternions[:-1], quaternions[1:])
    velocities = np.concatenate([np.diff(positions, axis=0), turns], axis=1) / period
    return velocities, np.diff(velocities, axis=0) / period


def assert_within(motion: TaskSpaceReference, factor: float, periods: tuple[float, ...] = (0.01, 0.001)) -> None:
    for period in periods:
        velocities, accelerations = differences(motion, period)
        assert LIMITS.fraction(velocities[:, :3], velocities[:, 3:]).max() <= factor
        # The last two micrometres are passed in one step.
        jump = 2e-6 / period**2
        assert np.linalg.norm(accelerations[:, :3], axis=1).max() <= factor * LIMITS.acceleration + jump
        turning = np.linalg.norm(accelerations[:, 3:], axis=1).max()
        assert turning <= factor * LIMITS.angular_acceleration + 4.0 * jump


waves = st.lists(st.floats(-1.0, 1.0), min_size=18, max_size=18)


@settings(max_examples=40, deadline=None)
@given(waves, st.floats(-3.0, 0.0), st.floats(-2.0, 0.5))
def test_smooth_curves_of_any_size_keep_all_limits(amplitudes, size, turning):
    share = np.linspace(0.0, 1.0, 150)
    basis = np.stack([share, np.sin(3.0 * share), np.cos(5.0 * share)], axis=1)
    mix = np.reshape(amplitudes, (3, 6))
    curve = drawn(10.0**size * basis @ mix[:, :3], 10.0**turning * basis @ mix[:, 3:])
    assert_within(reference(curve), CORNERED)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(2, 6))
def test_polylines_keep_all_limits_at_their_corners(seed, corners):
    random = np.random.default_rng(seed)
    at = np.linspace(0.0, corners, 200)
    points = random.uniform(-0.2, 0.2, (corners + 1, 6))
    poses = np.stack([np.interp(at, np.arange(corners + 1), column) for column in points.T], axis=1)
    assert_within(reference(drawn(poses[:, :3], 2.0 * poses[:, 3:])), CORNERED)


def test_a_smoothed_corner_costs_little_time():
    share = np.linspace(0.0, 1.0, 150)
    bent = np.stack([np.minimum(share, 0.5), np.maximum(share - 0.5, 0.0), 0.0 * share], axis=1)
    straight = np.stack([share, 0.0 * share, 0.0 * share], axis=1)
    quaternions = np.broadcast_to(DOWN, (150, 4))
    plain, cornered, smooth = (
        reference(MotionCurve.through(*poses, LIMITS)).duration
        for poses in ((straight, quaternions), (bent, quaternions), smooth_poses(bent, quaternions, 3.0))
    )
    assert cornered < plain + 1.0
    assert smooth < plain + 0.6


@pytest.mark.parametrize("angle", [1e-4, 0.05, 2.5])
def test_a_spin_on_the_spot_keeps_its_limits_and_takes_its_time(angle):
    turns = np.linspace(0.0, 1.0, 100)[:, None] * np.array([0.0, 0.6, 0.8]) * angle
    motion = reference(drawn(np.zeros((100, 3)), turns))
    assert_within(motion, 1.001)
    ramp = LIMITS.angular_speed / LIMITS.angular_acceleration
    trapezoid = angle / LIMITS.angular_speed + ramp
    expected = trapezoid if angle > ramp * LIMITS.angular_speed else 2.0 * np.sqrt(angle / LIMITS.angular_acceleration)
    assert motion.duration == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("length", [1e-9, 1e-5, 0.01, 0.5])
def test_a_straight_line_takes_the_time_of_a_trapezoid(length):
    positions = np.linspace(0.0, 1.0, 100)[:, None] * np.array([0.6, 0.0, -0.8]) * length
    motion = reference(drawn(positions, np.zeros((100, 3))))
    assert_within(motion, 1.001)
    ramp = LIMITS.speed / LIMITS.acceleration
    trapezoid = length / LIMITS.speed + ramp
    expected = trapezoid if length > ramp * LIMITS.speed else 2.0 * np.sqrt(length / LIMITS.acceleration)
    assert motion.duration == pytest.approx(expected, rel=0.01, abs=0.01)


def test_a_circle_is_passed_no_faster_than_its_curvature_allows_and_nearly_so():
    turn = np.linspace(0.0, 6.0, 400)
    motion = reference(drawn(0.02 * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1), np.zeros((400, 3))))
    velocities, _ = differences(motion, 0.001)
    fastest = np.sqrt(LIMITS.acceleration * 0.02)
    assert np.linalg.norm(velocities[:, :3], axis=1).max() == pytest.approx(fastest, rel=0.01)
    assert_within(motion, 1.01)


def test_no_faster_law_keeps_the_limits():
    """Some limit is nearly met at every instant: what a time-optimal motion is."""
    share = np.linspace(0.0, 1.0, 300)
    positions = np.stack([0.3 * share, 0.05 * np.sin(9.0 * share), 0.0 * share], axis=1)
    motion = reference(drawn(positions, np.zeros((300, 3))))
    velocities, accelerations = differences(motion, 0.001)
    used = np.maximum(
        np.linalg.norm(accelerations[:, :3], axis=1) / LIMITS.acceleration,
        LIMITS.fraction(velocities[1:, :3], velocities[1:, 3:]),
    )
    assert np.mean(used[3:-3] > 0.85) > 0.95


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 1.0))
def test_rates_begin_as_asked_end_at_rest_and_never_jump(seed, speed):
    random = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, 80)
    mix = random.normal(size=(3, 3))
    size = 10.0 ** random.uniform(-4.0, 0.0)
    curve = drawn(size * np.stack([share, share**2, np.sin(4.0 * share)], axis=1) @ mix, np.zeros((80, 3)))
    times, rates, strain = fastest_law(curve, LIMITS, speed)
    assert rates[0] == pytest.approx(speed, rel=1e-5, abs=1e-5)
    assert rates[-1] == 0.0
    assert np.all(np.diff(times) >= 0.0)
    velocity = rates[:, None] * curve.tangents[:, :3]
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    assert np.all(change <= CORNERED * strain * LIMITS.acceleration * np.diff(times) + 1e-9)


def test_an_unstoppable_speed_is_ramped_down_as_hard_as_needed_and_no_harder():
    positions = np.linspace(0.0, 0.01, 60)[:, None] * np.array([1.0, 0.0, 0.0])
    motion = reference(drawn(positions, np.zeros((60, 3))), speed=1.0)
    # 0.2 m/s in 10 mm: 2 m/s^2, four times as hard as allowed.
    assert motion.rate(0.0) == pytest.approx(1.0)
    assert 4.0 <= motion.strain <= 4.5
    _, accelerations = differences(motion, 0.001)
    assert np.linalg.norm(accelerations[3:-5], axis=1).max() <= 4.5 * LIMITS.acceleration
    assert reference(drawn(positions, np.zeros((60, 3))), speed=0.3).strain == 1.0


@pytest.mark.parametrize("seed", range(20))
def test_braking_is_the_soonest_rest_within_the_limits(seed):
    random = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, 150)
    waves = np.stack([np.sin(3.0 * share), np.sin(5.0 * share)], axis=1) @ random.normal(scale=0.05, size=(2, 3))
    whole = reference(drawn(np.stack([0.5 * share, 0.0 * share, 0.0 * share], axis=1) + waves, waves))
    half = int(np.searchsorted(whole.times, 0.5 * whole.duration))
    going = whole.rest(half, 0.5)
    halt = stop(going.curve, going.rates[0])
    np.testing.assert_allclose(halt.velocity(0.0), going.velocity(0.0), atol=1e-9)
    assert halt.rate(halt.duration) == 0.0
    velocities, accelerations = differences(halt, 0.001)
    moving = np.linalg.norm(accelerations[3:-4, :3], axis=1)
    assert moving.max() <= SMOOTH * LIMITS.acceleration
    assert halt.duration >= np.linalg.norm(velocities[2, :3]) / LIMITS.acceleration * 0.98
    assert braking_law(whole.curve.until(3, 0.5), LIMITS, 1.0) is None
    for point in halt.positions:
        assert np.linalg.norm(going.curve.positions - point, axis=1).min() < 0.01


@pytest.mark.parametrize("excess", [1.02, 1.04])
def test_braking_in_a_bend_that_is_too_fast_exceeds_the_limit_by_a_tenth_and_no_more(excess):
    angles = np.linspace(0.0, 2.0 * np.pi, 200)
    radius = 0.04
    circle = drawn(radius * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1), np.zeros((200, 3)))
    # Centripetal alone: speed^2 / radius.
    speed = excess * np.sqrt(LIMITS.acceleration * radius)
    halt = stop(circle, speed / float(np.linalg.norm(circle.tangents[0, :3])))
    assert np.linalg.norm(halt.velocity(0.0)[:3]) == pytest.approx(speed)
    assert halt.rate(halt.duration) == 0.0
    _, accelerations = differences(halt, 0.001)
    moving = np.linalg.norm(accelerations[3:-4, :3], axis=1)
    assert LIMITS.acceleration * 1.02 < moving.max() <= 1.12 * LIMITS.acceleration
    assert halt.duration < 1.6 * speed / LIMITS.acceleration


def test_a_stop_before_a_bend_takes_no_more_than_the_law_that_it_leaves():
    # A straight, half a turn: a strained law brakes before it as late as it can.
    straight, angles, radius = np.linspace(-0.06, 0.0, 60)[:-1], np.linspace(0.0, np.pi, 100), 0.01
    along = np.concatenate([straight, radius * np.sin(angles)])
    across = np.concatenate([0.0 * straight, radius * (1.0 - np.cos(angles))])
    curve = drawn(np.stack([along, across, 0.0 * along], axis=1), np.zeros((len(along), 3)))
    speeds = np.linspace(0.5, 1.2, 71)
    going = next(law for law in (reference(curve, speed) for speed in speeds) if law.strain > 1.0)
    assert going.strain == 1.1
    strongest = {going.strain: 0.0, 1.0: 0.0}
    for time in np.linspace(0.02, 0.4, 10) * going.duration:
        left = going.rest(int(np.searchsorted(going.times, time)), 0.5)
        for strain in strongest:
            _, accelerations = differences(stop(left.curve, left.rates[0], strain), 0.001)
            moving = np.linalg.norm(accelerations[3:-4, :3], axis=1)
            strongest[strain] = max(strongest[strain], moving.max() / LIMITS.acceleration)
    assert strongest[going.strain] <= 1.1 * SMOOTH
    # The control: one that brakes less is in the bend too fast.
    assert strongest[1.0] > 1.3


def test_quaternions_of_a_timed_curve_keep_their_hemisphere():
    turns = np.linspace(0.0, 1.0, 80)[:, None] * np.array([3.0, 1.0, 0.0])
    motion = reference(drawn(np.zeros((80, 3)), turns))
    samples = np.array([motion.sample(t)[1] for t in np.linspace(0.0, motion.duration, 200)])
    assert np.all(np.sum(samples[1:] * samples[:-1], axis=1) > 0.0)
    np.testing.assert_allclose(np.linalg.norm(samples, axis=1), 1.0)
    assert angle_between(samples[-1], normalise(motion.quaternions[-1])) < 1e-7
