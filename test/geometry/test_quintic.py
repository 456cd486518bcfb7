"""Quintics pass through their knots with all derivatives, and stay within what is said of them."""

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quintic import quintic_bounds, quintic_samples


def knots_of(seed: int, count: int = 8, joints: int = 3) -> tuple[np.ndarray, ...]:
    random = np.random.default_rng(seed)
    times = np.append(0.0, np.cumsum(random.uniform(0.01, 0.05, count - 1)))
    return times, *random.normal(size=(3, count, joints)) * np.array([0.01, 0.5, 5.0])[:, None, None]


def test_a_polynomial_of_degree_five_is_played_exactly():
    polynomials = [np.polynomial.Polynomial(c) for c in np.random.default_rng(0).normal(size=(3, 6))]
    times, at = np.array([0.0, 0.3, 0.4, 1.0]), np.linspace(0.0, 1.0, 100, endpoint=False)

    def exact(where: np.ndarray, order: int) -> np.ndarray:
        return np.stack([p.deriv(order)(where) for p in polynomials], axis=1)

    found = quintic_samples(times, *(exact(times, order) for order in range(3)), at)
    for order in range(3):
        np.testing.assert_allclose(found[order], exact(at, order), atol=1e-9)


def test_it_is_held_before_and_after():
    times, positions, velocities, accelerations = knots_of(1)
    before, after = quintic_samples(times, positions, velocities, accelerations, np.array([-0.1, 9.0])).swapaxes(0, 1)
    np.testing.assert_array_equal(before[0], positions[0])
    np.testing.assert_array_equal(after[0], positions[-1])
    assert not np.any(before[1:])
    assert not np.any(after[1:])


@pytest.mark.parametrize("seed", range(30))
def test_bounds_are_never_less_than_what_is_played(seed):
    knots = knots_of(seed)
    times = knots[0]
    (lowest, highest), largest = quintic_bounds(*knots)
    for i in range(len(times) - 1):
        fine = np.linspace(times[i], times[i + 1] - 1e-9, 400)
        motion = quintic_samples(*knots, fine)
        jerks = np.abs(np.diff(motion[2], axis=0) / np.diff(fine)[:, None])
        assert np.all(lowest - 1e-12 <= motion[0].min(axis=0))
        assert np.all(motion[0].max(axis=0) <= highest + 1e-12)
        played = np.stack([*np.abs(motion[1:]).max(axis=1), jerks.max(axis=0)])
        assert np.all(played <= largest[:, i] * (1.0 + 1e-6))


def test_bounds_are_tight_where_the_motion_is_smooth():
    times = np.arange(0.0, 1.0, 0.02)
    waves = np.array([2.0, 5.0, 9.0])
    angles = times[:, None] * waves
    ends, largest = quintic_bounds(times, np.sin(angles), waves * np.cos(angles), -(waves**2) * np.sin(angles))
    for order in range(3):
        np.testing.assert_allclose(largest[order].max(axis=0), waves ** (order + 1), rtol=0.02)
    np.testing.assert_allclose(ends[:, 1:], [[-1.0, -1.0], [1.0, 1.0]], atol=0.01)
