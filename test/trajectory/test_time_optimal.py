"""The law along a path is the fastest within the limits; its average is smooth and stays on the path."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from geodesic_motion_ros.trajectory.time_optimal import SmoothLaw, braking_rates, fastest_rates

VELOCITY = np.array([2.0, 2.5, 1.5])
ACCELERATION = np.array([15.0, 7.5, 10.0])


def path(seed: int) -> CubicSpline:
    random = np.random.default_rng(seed)
    return CubicSpline(np.linspace(0.0, 1.0, 6), np.cumsum(random.normal(scale=0.4, size=(6, 3)), axis=0))


def fastest(curve: CubicSpline, grid: np.ndarray, initial: float = 0.0) -> np.ndarray:
    full = np.ones((len(grid), 1))
    return fastest_rates(grid, curve(grid, 1), curve(grid, 2), full * VELOCITY, full * ACCELERATION, initial)


def used(curve: CubicSpline, grid: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Largest share of any limit at the begin and the end of every segment, (n - 1,)."""
    changes = (0.5 * np.diff(rates**2) / np.diff(grid))[:, None]
    parts = []
    for ends in (slice(None, -1), slice(1, None)):
        slopes, bends, squared = curve(grid[ends], 1), curve(grid[ends], 2), rates[ends, None] ** 2
        parts.append(np.abs(slopes * changes + bends * squared) / ACCELERATION)
        parts.append(np.abs(slopes) * rates[ends, None] / VELOCITY)
    return np.max(parts, axis=(0, 2))


@pytest.mark.parametrize("length", [0.001, 0.1, 3.0])
def test_a_straight_line_takes_the_time_of_a_trapezoid(length):
    grid = np.linspace(0.0, 1.0, 400)
    slopes = np.tile([[0.0, length, 0.0]], (400, 1))
    full = np.ones((400, 1))
    rates = fastest_rates(grid, slopes, 0.0 * slopes, full * VELOCITY, full * ACCELERATION, 0.0)
    ramp = VELOCITY[1] / ACCELERATION[1]
    trapezoid = length / VELOCITY[1] + ramp
    expected = trapezoid if length > ramp * VELOCITY[1] else 2.0 * np.sqrt(length / ACCELERATION[1])
    assert SmoothLaw.along(grid, rates, 0.03).times[-1] == pytest.approx(expected, rel=0.005)


@pytest.mark.parametrize("seed", range(40))
def test_all_limits_are_kept_and_one_is_met_nearly_everywhere(seed):
    grid = np.linspace(0.0, 1.0, 300)
    share = used(path(seed), grid, fastest(path(seed), grid))
    assert share.max() <= 1.0 + 1e-6
    assert np.mean(share > 0.9) > 0.95


@pytest.mark.parametrize("seed", range(20))
def test_it_begins_as_asked_where_that_can_be_braked_and_ends_at_rest(seed):
    grid = np.linspace(0.0, 1.0, 300)
    free = fastest(path(seed), grid, np.inf)
    assert free[-1] == 0.0
    np.testing.assert_allclose(fastest(path(seed), grid, 0.5 * free[0])[0], 0.5 * free[0])
    assert fastest(path(seed), grid, 2.0 * free[0])[0] == free[0]


@pytest.mark.parametrize("seed", range(20))
def test_it_takes_no_longer_than_toppra(seed):
    toppra = pytest.importorskip("toppra")
    curve, grid = path(seed), np.linspace(0.0, 1.0, 400)
    waypoints = np.linspace(0.0, 1.0, 6)
    limits = [
        toppra.constraint.JointVelocityConstraint(np.stack([-VELOCITY, VELOCITY], axis=1)),
        toppra.constraint.JointAccelerationConstraint(np.stack([-ACCELERATION, ACCELERATION], axis=1)),
    ]
    solver = toppra.algorithm.TOPPRA(
        limits, toppra.SplineInterpolator(waypoints, curve(waypoints)), gridpoints=grid, solver_wrapper="seidel"
    )
    _, rates, _ = solver.compute_parameterization(0.0, 0.0)
    best = np.sum(2.0 * np.diff(grid) / (rates[1:] + rates[:-1]))
    found = SmoothLaw.along(grid, fastest(curve, grid), 0.03).times[-1]
    assert found == pytest.approx(best, rel=0.01)


@pytest.mark.parametrize("seed", range(40))
def test_braking_keeps_the_limits_and_is_as_hard_as_they_allow(seed):
    grid = np.linspace(0.0, 1.0, 300)
    rates = fastest(path(seed), grid)
    law = SmoothLaw.along(grid, rates, 0.03)
    # The motion itself as a path: t is its parameter, and at the rate 1 it keeps all limits.
    motion = CubicSpline(law.times[1:], path(seed)(law.values[1:]))
    times = np.linspace(0.3 * motion.x[-1], motion.x[-1], 300)
    slopes, bends = motion(times, 1), motion(times, 2)
    limits = np.maximum(ACCELERATION, np.abs(bends))
    braking, stop = braking_rates(times, slopes, bends, limits)
    moving = np.flatnonzero(times < stop)[:-1]
    changes = 0.5 * (braking[moving + 1] ** 2 - braking[moving] ** 2) / np.diff(times)[moving]
    assert np.all(np.diff(braking) <= 0.0)
    assert stop < times[-1]
    for at in (moving, moving + 1):
        accelerations = slopes[at] * changes[:, None] + bends[at] * braking[at, None] ** 2
        assert np.all(np.abs(accelerations) <= limits[at] * (1.0 + 1e-6))
    harder = slopes[moving] * (changes[:, None] - 0.2) + bends[moving] * braking[moving, None] ** 2
    later = slopes[moving + 1] * (changes[:, None] - 0.2) + bends[moving + 1] * (
        braking[moving + 1, None] ** 2 - 0.4 * np.diff(times)[moving, None]
    )
    broken = np.any((np.abs(harder) > limits[moving]) | (np.abs(later) > limits[moving + 1]), axis=1)
    assert np.mean(broken) > 0.9


def test_the_average_is_the_integral_over_a_triangle():
    grid = np.linspace(0.0, 1.0, 50)
    law = SmoothLaw.along(grid, fastest(path(3), grid), 0.05)
    offsets = np.linspace(-0.05, 0.05, 20001)
    weights = (1.0 - np.abs(offsets) / 0.05) / 0.05

    def plain(time: np.ndarray) -> np.ndarray:
        i = np.clip(np.searchsorted(law.times, time) - 1, 0, len(law.times) - 2)
        h, span = time - law.times[i], law.times[i + 1] - law.times[i]
        inside = law.values[i] + h * (law.rates[i] + 0.5 * h * (law.rates[i + 1] - law.rates[i]) / span)
        return np.where(time < law.times[0], law.values[0], np.where(time > law.times[-1], law.values[-1], inside))

    at = np.linspace(-0.1, law.end + 0.1, 37)
    expected = [np.trapezoid(weights * plain(time + offsets), offsets) for time in at]
    np.testing.assert_allclose(law.sample(at)[0], expected, atol=1e-7)


def test_the_average_is_continuous_up_to_its_second_derivative():
    grid = np.linspace(0.0, 1.0, 50)
    law = SmoothLaw.along(grid, fastest(path(3), grid), 0.05)
    at = np.linspace(-0.05, law.end, 4001)
    value, rate, change = law.sample(at)
    np.testing.assert_allclose(np.gradient(value, at)[1:-1], rate[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(rate, at)[1:-1], change[1:-1], atol=0.05)
    # Of the law itself the second derivative jumps; of its average it changes by no more than 2 jumps a width.
    plain = np.abs(np.diff(law.rates) / np.diff(law.times)).max()
    assert np.abs(np.diff(change)).max() <= 2.0 * plain * (at[1] - at[0]) / 0.05 * (1.0 + 1e-6)
    np.testing.assert_allclose(law.sample(np.array([-0.05, law.end])), [[0.0, 1.0], [0.0, 0.0], [0.0, 0.0]], atol=1e-9)


def test_a_steady_rate_stays_as_it_is():
    law = SmoothLaw.along(np.linspace(2.0, 3.0, 20), np.ones(20), 0.05)
    at = np.linspace(-0.3, 1.3, 50)
    np.testing.assert_allclose(law.sample(at), [2.0 + at, np.ones(50), np.zeros(50)], atol=1e-9)
