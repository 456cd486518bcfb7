"""A stream of target poses is carried on smoothly, whatever the jitter of its arrival."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between, rotate_by
from geodesic_motion_ros.simulation.target_stream import TargetStream

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
VELOCITY = np.array([0.2, -0.1, 0.05])
TURNING = np.array([0.0, 0.4, 0.3])


def pose_at(time: float) -> tuple[np.ndarray, np.ndarray]:
    return VELOCITY * time, rotate_by(TURNING * time, IDENTITY)


def fed(arrivals: np.ndarray, period: float) -> TargetStream:
    stream = TargetStream(*pose_at(0.0))
    for number, arrival in enumerate(arrivals):
        stream.accept(*pose_at(number * period), arrival)
    return stream


@pytest.mark.parametrize("period", [0.005, 0.01, 0.02])
def test_the_velocity_of_the_stream_is_found(period: float) -> None:
    twist = fed(np.arange(200) * period, period).twist
    np.testing.assert_allclose(twist, np.concatenate([VELOCITY, TURNING]), rtol=0.02, atol=1e-3)


def test_between_targets_it_runs_ahead() -> None:
    stream = fed(np.arange(100) * 0.01, 0.01)
    position, quaternion, twist = stream.sample(0.996)
    expected_position, expected_quaternion = pose_at(0.996)
    np.testing.assert_allclose(position, expected_position, atol=1e-6)
    assert angle_between(quaternion, expected_quaternion) < 1e-5
    np.testing.assert_allclose(twist[:3], VELOCITY, rtol=1e-3)


ACCELERATION = np.array([1.5, 0.0, -0.5])


def accelerated(numbers: range) -> TargetStream:
    stream = TargetStream(np.zeros(3), IDENTITY)
    for number in numbers:
        stream.accept(0.5 * ACCELERATION * (0.01 * number) ** 2, IDENTITY, 0.01 * number)
    return stream


def test_a_steadily_accelerated_target_has_no_steps_of_velocity() -> None:
    stream, twists = accelerated(range(40)), []
    for number in range(40, 60):
        stream.accept(0.5 * ACCELERATION * (0.01 * number) ** 2, IDENTITY, 0.01 * number)
        for time in 0.01 * number + 0.001 * np.arange(10):
            position, _, twist = stream.sample(time)
            np.testing.assert_allclose(position, 0.5 * ACCELERATION * time**2, atol=1e-6)
            twists.append(twist[:3])
    np.testing.assert_allclose(np.diff(twists, axis=0), np.tile(0.001 * ACCELERATION, (199, 1)), atol=1e-6)


@pytest.mark.parametrize("lost", [1, 2])
def test_lost_targets_do_not_change_where_an_accelerated_one_is_expected(lost: int) -> None:
    stream, last = accelerated(range(60)), 59 + lost + 1
    stream.accept(0.5 * ACCELERATION * (0.01 * last) ** 2, IDENTITY, 0.01 * last)
    np.testing.assert_allclose(stream.twist[:3], ACCELERATION * 0.01 * (last + 1), atol=1e-6)


def test_jitter_of_arrival_is_not_velocity() -> None:
    """Arrivals off by up to 6 ms would make 0.6 to 2.5 times the velocity, were the intervals believed."""
    jitter = np.random.default_rng(8).uniform(0.0, 0.006, size=300)
    twist = fed(np.arange(300) * 0.01 + jitter, 0.01).twist
    np.testing.assert_allclose(twist[:3], VELOCITY, rtol=0.1)


def test_a_lost_target_is_not_a_leap() -> None:
    stream = fed(np.arange(100) * 0.01, 0.01)
    stream.accept(*pose_at(1.01), 1.01)
    np.testing.assert_allclose(stream.twist[:3], VELOCITY, rtol=0.05)


def test_two_targets_at_once_are_one_period_apart() -> None:
    stream = fed(np.arange(100) * 0.01, 0.01)
    stream.accept(*pose_at(1.0), 0.99)
    np.testing.assert_allclose(stream.twist[:3], VELOCITY, rtol=0.15)


def test_targets_that_are_repeated_while_a_simulation_stands_change_nothing_for_later() -> None:
    stream = fed(np.arange(100) * 0.01, 0.01)
    for _ in range(500):
        stream.accept(*pose_at(0.99), 0.99)
    np.testing.assert_array_equal(stream.twist, np.zeros(6))
    for number in range(100, 110):
        stream.accept(*pose_at(number * 0.01), number * 0.01)
    np.testing.assert_allclose(stream.twist[:3], VELOCITY, rtol=0.02)
    np.testing.assert_allclose(stream.period, 0.01, rtol=0.02)


def test_a_stream_that_ends_leaves_the_last_target_at_rest() -> None:
    stream = fed(np.arange(100) * 0.01, 0.01)
    np.testing.assert_array_equal(stream.sample(1.05)[2], np.zeros(6))
    position, _, twist = stream.sample(2.0)
    np.testing.assert_allclose(position, pose_at(0.99)[0])
    np.testing.assert_array_equal(twist, np.zeros(6))


def test_a_far_target_is_a_step_without_velocity() -> None:
    stream = fed(np.arange(100) * 0.01, 0.01)
    stream.accept(np.array([0.5, 0.5, 0.5]), IDENTITY, 1.0)
    position, _, twist = stream.sample(1.004)
    np.testing.assert_array_equal(position, [0.5, 0.5, 0.5])
    np.testing.assert_array_equal(twist, np.zeros(6))
