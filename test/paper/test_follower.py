"""What follows the leading point of a path: the exact motion of a critically damped mass, without jumps, until rest."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from geodesic_motion_ros.paper.follower import STIFFNESS, TimedPath, followed


def straight(duration: float) -> TimedPath:
    places = np.linspace([0.0, 1.0], [0.4, 0.7], 20)
    return TimedPath.of(np.full(19, duration / 19), places, places)


def test_each_period_is_the_solution_of_the_differential_equation() -> None:
    path, period, start = straight(1.0), 0.05, (np.array([-0.1, 1.2]), np.array([0.3, -0.2]))
    positions, velocities, accelerations = followed(path.times, path.places, 0.0, *start, period, 3)
    lead = path.place_at(period)

    def pulled(_: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[2:], STIFFNESS**2 * (lead - state[:2]) - 2.0 * STIFFNESS * state[2:]])

    end = solve_ivp(pulled, (0.0, period), np.concatenate(start), rtol=1e-11, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(np.concatenate([positions[1], velocities[1]]), end, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(accelerations[1], pulled(0.0, end)[2:], rtol=1e-7, atol=1e-9)


def test_it_ends_at_rest_at_the_end_of_the_path() -> None:
    path = straight(1.0)
    positions, velocities, _ = followed(path.times, path.places, 0.0, path.places[0], np.zeros(2), 0.02, 1000)
    assert len(positions) < 1001
    np.testing.assert_allclose(positions[-1], path.places[-1], atol=2e-5)
    np.testing.assert_allclose(velocities[-1], 0.0, atol=2e-5)
    # It never runs ahead of the leading point, and never turns back.
    assert np.all(np.diff(positions[:, 0]) >= -1e-12)


def test_a_path_that_jumps_makes_no_jump_of_what_is_commanded() -> None:
    path, period = straight(1.0), 0.01
    first = followed(path.times, path.places, 0.0, path.places[0], np.zeros(2), period, 30)
    at, rate = first[0][-1], first[1][-1]
    jumped = TimedPath.of(np.full(19, 0.05), path.places + np.array([0.05, -0.03]), path.latent)
    positions, velocities, _ = followed(jumped.times, jumped.places, 0.3, at, rate, period, 100)
    # Acceleration is bounded by w^2 |off| + 2 w |v|.
    largest = STIFFNESS**2 * 0.3 + 2.0 * STIFFNESS * 0.6
    assert np.abs(np.diff(velocities, axis=0)).max() <= largest * period
    np.testing.assert_array_equal(positions[0], at)


def test_a_standing_path_stays() -> None:
    path = TimedPath.standing(np.array([0.3, 0.1]), np.array([1.0]))
    assert path.stands
    assert not straight(0.5).stands
    positions, _, _ = followed(path.times, path.places, 0.0, np.array([0.3, 0.1]), np.zeros(2), 0.01, 5)
    np.testing.assert_allclose(positions, np.tile([0.3, 0.1], (len(positions), 1)), atol=1e-15)
    np.testing.assert_array_equal(path.latent_at(3.0), [1.0])
