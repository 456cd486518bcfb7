"""Spheres on straight ways among obstacles that move: the clearance is that of dense samples, from below."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.swept_spheres import clearances_in_motion, self_clearances

RADII, MOVING, HORIZON = np.array([0.05, 0.03, 0.04]), np.array([0, 2]), 0.4
PAIRS = np.array([(0, 1), (1, 2)])


def motion(seed: int) -> tuple[np.ndarray, np.ndarray, Obstacles]:
    """Times (n,) and places (n, S, 3) of the spheres, which move straight between them, and obstacles."""
    random = np.random.default_rng(seed)
    times = np.append(0.0, np.cumsum(random.uniform(0.05, 0.2, 6)))
    placed = np.cumsum(random.normal(scale=0.1, size=(len(times), 3, 3)), axis=0)
    places, velocities = random.normal(scale=0.4, size=(2, 5, 3))
    return times, placed, Obstacles.of_spheres(places, random.uniform(0.02, 0.1, 5), velocities)


def densely(times: np.ndarray, placed: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments (n - 1, q) and places (n - 1, q, S, 3) at shares (q,) of every interval."""
    moments = times[:-1, None] + shares * np.diff(times)[:, None]
    shares = shares[None, :, None, None]
    return moments, (1.0 - shares) * placed[:-1, None] + shares * placed[1:, None]


@pytest.mark.parametrize("seed", range(20))
def test_until_the_horizon_the_clearance_is_that_of_dense_samples_from_below(seed):
    times, placed, obstacles = motion(seed)
    bulges = np.random.default_rng(seed).uniform(0.0, 0.02, (len(times) - 1, 3))
    clearance, sphere = clearances_in_motion(times, placed, bulges, RADII, MOVING, obstacles, HORIZON)
    moments, places = densely(times, placed, np.linspace(0.0, 1.0, 400))
    centres = obstacles.centres + moments[..., None, None] * obstacles.velocities
    gaps = np.linalg.norm(places[:, :, MOVING, None] - centres[:, :, None], axis=-1).min(axis=1)
    gaps = (gaps - obstacles.radii - (RADII + bulges)[:, MOVING, None]).min(axis=(1, 2))
    counted = times[1:] <= HORIZON
    assert np.any(counted)
    assert np.all(clearance[counted] <= gaps[counted] + 1e-9)
    # Nothing is given away, but for what lies between the samples.
    np.testing.assert_allclose(clearance[counted], gaps[counted], atol=1e-3)
    assert np.all(np.isin(sphere[counted], MOVING))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("horizon", [HORIZON, 3.0])
def test_what_moves_counts_until_the_horizon_and_what_stands_always(seed, horizon):
    """The last knot's spheres stand until the horizon, where that is later."""
    times, placed, obstacles = motion(seed)
    bulges = np.zeros((len(times) - 1, 3))
    clearance, sphere = clearances_in_motion(times, placed, bulges, RADII, MOVING, obstacles, horizon)
    knots = max(2, int(np.searchsorted(times, horizon)) + 1)
    lasting = np.append(times, max(horizon, times[-1] + 1e-6)), np.concatenate([placed, placed[-1:]])
    moments, places = densely(*lasting, np.linspace(0.0, 1.0, 400))
    centres = obstacles.centres + np.minimum(moments, horizon)[..., None, None] * obstacles.velocities
    gaps = np.linalg.norm(places[:, :, MOVING, None] - centres[:, :, None], axis=-1).min(axis=1)
    gaps = (gaps - obstacles.radii - RADII[MOVING, None]).min(axis=(1, 2))
    assert np.min(clearance) <= np.min(gaps[: knots - 1]) + 1e-9
    steady = np.append(lasting[0][1:knots] <= horizon, np.full(len(gaps) - knots + 1, horizon > times[-1]))
    if np.all(steady):
        np.testing.assert_allclose(np.min(clearance), np.min(gaps), atol=1e-3)
    assert np.all(np.isin(sphere[np.isfinite(clearance)], MOVING))
    # Nothing moves that late: what comes then is not counted, and what stands as near as it is.
    assert np.all(np.isinf(clearance[knots - 1 : -1]))
    still = obstacles.swept(0.0)
    standing, _ = clearances_in_motion(times, placed, bulges, RADII, MOVING, still, 0.0)
    half = replace(obstacles, velocities=obstacles.velocities * [[1.0], [0.0], [1.0], [0.0], [1.0]])
    both, _ = clearances_in_motion(times, placed, bulges, RADII, MOVING, half, horizon)
    of_standing, _ = clearances_in_motion(times, placed, bulges, RADII, MOVING, half.at_rest, 0.0)
    assert np.all(standing <= of_standing + 1e-12)
    np.testing.assert_allclose(both[knots - 1 : -1], of_standing[knots - 1 : -1], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_spheres_are_as_near_to_each_other_as_dense_samples_find(seed):
    times, placed, _ = motion(seed)
    bulges = np.random.default_rng(seed).uniform(0.0, 0.02, (len(times) - 1, 3))
    clearance, _ = self_clearances(placed, bulges, RADII, PAIRS)
    _, places = densely(times, placed, np.linspace(0.0, 1.0, 400))
    gaps = np.linalg.norm(places[:, :, PAIRS[:, 0]] - places[:, :, PAIRS[:, 1]], axis=-1).min(axis=1)
    gaps = (gaps - (RADII + bulges)[:, PAIRS].sum(axis=2)).min(axis=1)
    assert np.all(clearance <= gaps + 1e-9)
    np.testing.assert_allclose(clearance, gaps, atol=1e-3)
