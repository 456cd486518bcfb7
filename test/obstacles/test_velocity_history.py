"""Errors of velocities: nothing for what moves straight on, more the more it turns, no more than the fastest
that it has been of late.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geodesic_motion_ros.obstacles.velocity_history import MEMORY, NOISE_FACTOR, VelocityHistory


def turning(speed: float, rate: float, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (n, 3) on a circle, at a speed [m/s], turning at a rate [rad/s], or straight on."""
    angles = rate * times
    velocities = speed * np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
    if rate == 0.0:
        return times[:, None] * velocities, velocities
    return speed / rate * np.stack([np.sin(angles), -np.cos(angles), np.zeros_like(angles)], axis=1), velocities


def errors(positions: np.ndarray, velocities: np.ndarray, times: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """(n,) after each of them."""
    history, result = VelocityHistory(), []
    for position, velocity, time in zip(positions.tolist(), velocities.tolist(), times.tolist(), strict=True):
        history.see(tuple(position), time)
        result.append(history.error(tuple(velocity), noise))
    return np.array(result)


@settings(max_examples=30, deadline=None)
@given(speed=st.floats(0.0, 1.0), rate=st.floats(5.0, 200.0))
def test_what_moves_straight_on_goes_on(speed: float, rate: float) -> None:
    times = 1e5 + np.arange(int(4.0 * rate)) / rate
    positions, velocities = turning(speed, 0.0, times - times[0])
    np.testing.assert_allclose(errors(positions, velocities, times), 0.0, atol=1e-6)


def test_what_turns_faster_has_a_larger_error_up_to_its_speed() -> None:
    times = np.arange(0.0, 4.0, 0.01)
    settled = [errors(*turning(0.2, rate, times), times)[-1] for rate in (0.02, 0.05, 0.1, 1.5)]
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


@pytest.mark.parametrize("rate", [4.0, 10.0, 30.0, 60.0])
def test_it_remembers_two_seconds_however_often_an_obstacle_is_detected(rate: float) -> None:
    times = np.arange(0.0, 8.0, 1.0 / rate) + np.random.default_rng(0).uniform(0.0, 0.2 / rate, int(8.0 * rate))
    velocities = np.where(times[:, None] < 2.0, [0.1, 0.0, 0.0], [0.0, 0.1, 0.0])
    positions = np.stack([0.1 * np.minimum(times, 2.0), 0.1 * np.maximum(times - 2.0, 0.0), 0.0 * times], axis=1)
    error = errors(positions, velocities, times)
    assert np.all(error[(times > 2.01) & (times < 1.6 + MEMORY)] > 0.05)
    np.testing.assert_allclose(error[times > 2.0 + MEMORY + 1.0 / rate + 0.1], 0.0, atol=1e-9)


def test_an_obstacle_of_which_little_is_known_has_no_error() -> None:
    history = VelocityHistory()
    assert history.error((0.1, 0.0, 0.0)) == 0.0
    for time in (0.0, 0.1, 0.15, 0.2):
        history.see((time**2, 0.0, 0.0), time)
    assert history.error((0.1, 0.0, 0.0)) == 0.0


def test_what_has_come_to_a_stand_has_no_error_and_what_turns_back_has_that_of_its_speed() -> None:
    """Both have moved at 0.2 m/s until now."""
    history = VelocityHistory()
    for time in np.arange(0.0, 1.05, 0.1).tolist():
        history.see((0.2 * time, 0.0, 0.0), time)
    stands, turns = (0.0, 0.0, 0.0), (1e-3, 0.0, 0.0)
    assert history.error(stands) == 0.0
    assert history.bounds(stands) == (0.0, 0.0)
    assert history.error(turns) == pytest.approx(0.2)


def test_changes_that_may_come_from_noise_do_not_count_and_larger_ones_do() -> None:
    """Known velocities, so that the means over three intervals of 0.1 s alone are noisy: by 4.7 times the noise."""
    times, noise = np.arange(0.0, 60.0, 1.0 / 30.0), 0.01
    positions, velocities = turning(0.3, 0.0, times)
    noisy = positions + np.random.default_rng(0).normal(scale=noise, size=positions.shape)
    assert np.mean(errors(noisy, velocities, times, noise) > 0.0) < 0.01
    assert np.mean(errors(noisy, velocities, times) > 0.0) > 0.9
    turned = np.where(times[:, None] < 59.0, velocities, [-0.3, 0.0, 0.0])
    assert 0.3 <= errors(noisy, turned, times, noise)[-1] < 0.3 + NOISE_FACTOR * noise
