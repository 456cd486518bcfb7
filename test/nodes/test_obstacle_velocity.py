"""Velocities of obstacles: right for what moves evenly, quiet under noise, zero where nothing can be known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.nodes.obstacle_velocity import FASTEST, LONGEST_GAP, WINDOW, ObstacleVelocity

STAMP = 1.7e9
ZERO = (0.0, 0.0, 0.0)


def seen(centres: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Velocity (n, 3) after each of the positions (n, 3)."""
    motion, velocities = ObstacleVelocity(), []
    for centre, time in zip(centres.tolist(), times.tolist(), strict=True):
        motion.see(tuple(centre), time)
        velocities.append(motion.velocity)
    return np.array(velocities)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), rate=st.floats(3.0, 240.0))
def test_even_motion_is_told_from_the_second_position_on(seed: int, rate: float) -> None:
    generator = np.random.default_rng(seed)
    velocity = generator.uniform(-1.0, 1.0, 3)
    times = STAMP + np.cumsum(generator.uniform(0.5, 1.5, 40)) / rate
    times = times[np.append(True, np.diff(times) < LONGEST_GAP)]
    velocities = seen(generator.uniform(-1.0, 1.0, 3) + np.outer(times - STAMP, velocity), times)
    np.testing.assert_array_equal(velocities[0], ZERO)
    np.testing.assert_allclose(velocities[1:], np.broadcast_to(velocity, (len(times) - 1, 3)), atol=1e-3)


def test_noise_of_a_millimetre_at_60_hz_is_no_motion() -> None:
    generator = np.random.default_rng(0)
    times = np.arange(2000) / 60.0
    speeds = np.linalg.norm(seen(generator.normal(scale=1e-3, size=(2000, 3)), times)[20:], axis=1)
    assert np.sqrt(np.mean(speeds**2)) < 0.013
    assert np.quantile(speeds, 0.99) < 0.03


def errors(centres: np.ndarray, times: np.ndarray, noise: float) -> np.ndarray:
    """Errors of the velocity (n,) after each of the positions (n, 3) with noise [m]."""
    noisy = centres + np.random.default_rng(0).normal(scale=noise, size=centres.shape)
    motion, result = ObstacleVelocity(), []
    for centre, time in zip(noisy.tolist(), times.tolist(), strict=True):
        motion.see(tuple(centre), time)
        result.append(motion.error)
    return np.array(result)


@pytest.mark.parametrize("rate", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("noise", [1e-3, 5e-3, 1e-2])
@pytest.mark.parametrize("speed", [0.0, 0.2])
def test_noise_is_no_turn(rate: float, noise: float, speed: float) -> None:
    """Whatever its size: how noisy positions are is found out."""
    times = STAMP + np.arange(int(60.0 * rate)) / rate
    error = errors(np.outer(times - STAMP, [speed, 0.0, 0.0]), times, noise)
    assert np.mean(error > 0.0) < 0.1
    assert np.quantile(error, 0.95) <= 10.0 * noise


@pytest.mark.parametrize("rate", [10.0, 30.0, 60.0])
def test_a_turn_is_no_noise_until_the_obstacle_is_lost(rate: float) -> None:
    times = np.arange(0.0, 6.0, 1.0 / rate)
    angle = np.maximum(0.0, times - 3.0)
    velocities = 0.2 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    centres = np.cumsum(velocities / rate, axis=0)
    assert np.all(errors(centres, STAMP + times, 1e-3)[times > 4.5] > 0.1)
    gap = np.append(times, times[-1] + LONGEST_GAP + 0.1)
    assert errors(np.append(centres, centres[-1:], axis=0), STAMP + gap, 1e-3)[-1] == 0.0


def test_late_and_early_arrivals_of_an_even_motion_hardly_matter() -> None:
    generator = np.random.default_rng(1)
    times = np.arange(300) / 60.0
    centres = np.outer(times, [0.5, 0.0, 0.0])
    velocities = seen(centres, times + generator.uniform(0.0, 5e-3, 300))
    np.testing.assert_allclose(velocities[20:], np.tile([0.5, 0.0, 0.0], (280, 1)), atol=0.05)


@pytest.mark.parametrize("rate", [5.0, 60.0, 200.0])
def test_what_stops_has_velocity_zero_after_the_window(rate: float) -> None:
    times = np.arange(200) / rate
    centres = np.outer(np.minimum(times, times[100]), [0.4, -0.3, 0.2])
    velocities = seen(centres, STAMP + times)
    stopped = times > times[100] + max(WINDOW, 1.0 / rate) + 1e-6
    assert np.any(velocities[100] != 0.0)
    np.testing.assert_array_equal(velocities[stopped], 0.0)


def test_a_change_of_velocity_is_there_within_the_window() -> None:
    times = np.arange(100) / 60.0
    centres = np.zeros((100, 3))
    centres[:, 0] = 0.8 * np.abs(times - times[50])
    velocities = seen(centres, times)
    assert velocities[50, 0] == pytest.approx(-0.8)
    assert np.all(np.diff(velocities[50:61, 0]) > -1e-9)
    assert velocities[60, 0] == pytest.approx(0.8)


def test_after_a_gap_it_begins_again() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.2 + LONGEST_GAP + 0.01, 0.3 + LONGEST_GAP + 0.01])
    velocities = seen(np.outer(times, [0.5, 0.0, 0.0]), times)
    np.testing.assert_allclose(velocities[:, 0], [0.0, 0.5, 0.5, 0.0, 0.5], atol=1e-9)


def test_a_jump_is_another_object() -> None:
    times = np.arange(6) / 60.0
    centres = np.zeros((6, 3))
    centres[3:, 1] = 1.1 * FASTEST / 60.0
    np.testing.assert_array_equal(seen(centres, times), 0.0)
    centres[3:, 1] = 0.9 * FASTEST / 60.0
    assert seen(centres, times)[3, 1] > 0.0


def test_messages_that_arrive_together_after_a_stall_are_no_jump() -> None:
    times = np.array([0.0, 0.016, 0.032, 0.08, 0.0801, 0.0802, 0.096])
    centres = np.outer(np.arange(7) * 0.016, [1.0, 0.0, 0.0])
    velocities = seen(centres, times)
    assert np.all(velocities[1:, 0] > 0.5)
    assert np.all(velocities[1:, 0] < 1.2)


def test_a_clock_that_is_set_back_begins_again_and_one_that_stands_still_counts_once() -> None:
    back = seen(np.array([[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]]), np.array([10.0, 10.1, 5.0]))
    np.testing.assert_array_equal(back[2], ZERO)
    still = seen(np.array([[0.0, 0, 0], [0.01, 0, 0], [0.02, 0, 0]]), np.array([10.0, 10.1, 10.1]))
    np.testing.assert_allclose(still[2], [0.2, 0.0, 0.0], atol=1e-9)
