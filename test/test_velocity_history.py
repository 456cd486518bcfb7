"""Errors of velocities: nothing for what moves straight on, more the more it turns, no more than its speed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.velocity_history import INTERVAL, REMEMBERED, VelocityHistory

MEMORY = INTERVAL * (REMEMBERED - 1)


def turning(speed: float, rate: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (n, 3) on a circle, at a speed [m/s], turning at a rate [rad/s], or straight on."""
    angles = rate * times
    velocities = speed * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    if rate == 0.0:
        return times[:, None] * velocities, velocities
    return speed / rate * np.stack([np.sin(angles), -np.cos(angles), np.zeros_like(angles)], axis=1), velocities


def errors(positions: np.ndarray, velocities: np.ndarray, times: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """(n,) after each of them."""
    history, result = VelocityHistory(noise), []
    for position, velocity, time in zip(positions.tolist(), velocities.tolist(), times.tolist(), strict=True):
        history.see(position, time)
        result.append(history.error(velocity))
    return np.array(result)


@settings(max_examples=30, deadline=None)
@given(speed=st.floats(0.0, 1.0), rate=st.floats(5.0, 200.0))
def test_what_moves_straight_on_goes_on(speed: float, rate: float) -> None:
    times = 1e5 + np.arange(int(4.0 * rate)) / rate
    positions, velocities = turning(speed, 0.0, times - times[0])
    np.testing.assert_allclose(errors(positions, velocities, times), 0.0, atol=1e-6)


def test_what_turns_faster_has_a_larger_error_up_to_its_speed() -> None:
    times = np.arange(0.0, 4.0, 0.01)
    settled = [errors(*turning(0.2, rate, times), times)[-1] for rate in (0.02, 0.05, 0.1, 2.0)]
    assert 0.0 < settled[0] < settled[1] < settled[2] <= settled[3]
    assert settled[3] == pytest.approx(0.2)


def test_where_an_obstacle_goes_that_turns_on_as_it_did_is_within_the_error() -> None:
    """At the turns of a sphere that follows an arm: 0.1 m/s, up to 1 rad/s, for the second that a stop takes."""
    times = np.arange(0.0, 4.0, 0.01)
    for rate in np.linspace(0.1, 1.0, 10):
        positions, velocities = turning(0.1, rate, times)
        error = errors(positions, velocities, times)
        for now in range(200, 300, 10):
            ahead = times[now : now + 100] - times[now]
            off = np.linalg.norm(positions[now : now + 100] - positions[now] - ahead[:, None] * velocities[now], axis=1)
            assert np.all(off <= ahead * error[now] + 1e-9)


def test_a_turn_is_forgotten() -> None:
    times = np.arange(0.0, 6.0, 0.02)
    velocities = np.where(times[:, None] < 2.0, [0.1, 0.0, 0.0], [0.0, 0.1, 0.0])
    positions = np.concatenate([np.zeros((1, 3)), np.cumsum(0.02 * velocities[:-1], axis=0)])
    error = errors(positions, velocities, times)
    assert np.all(error[(times > 2.01) & (times < 2.0 + MEMORY - 0.2)] == pytest.approx(0.1))
    np.testing.assert_allclose(error[times > 2.0 + MEMORY + 0.2], 0.0, atol=1e-9)


def test_changes_that_may_be_noise_do_not_count() -> None:
    random, times = np.random.default_rng(0), np.arange(0.0, 10.0, 1.0 / 60.0)
    positions, velocities = turning(0.2, 0.0, times)
    noisy = positions + random.normal(scale=1e-3, size=positions.shape)
    assert np.max(errors(noisy, velocities, times)[200:]) > 0.05
    assert np.max(errors(noisy, velocities, times, noise=0.03)) == 0.0
