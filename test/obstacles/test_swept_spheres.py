"""Spheres on straight paths among obstacles that move: the clearance is that of dense samples, from below."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.obstacles.swept_spheres import clearances_in_motion, clearances_until, self_clearances

RADII, MOVING, HORIZON = np.array([0.05, 0.03, 0.04]), np.array([0, 2]), 0.4
PAIRS = np.array([(0, 1), (1, 2)])


def motion(seed: int) -> tuple[np.ndarray, np.ndarray, Obstacles]:
    """Times (n,) and places (n, S, 3) of the spheres, which move straight between them, and obstacles."""
    random = np.random.default_rng(seed)
    times = np.append(0.0, np.cumsum(random.uniform(0.05, 0.2, 6)))
    placed = np.cumsum(random.normal(scale=0.1, size=(len(times), 3, 3)), axis=0)
    places, velocities = random.normal(scale=0.4, size=(2, 5, 3))
    return times, placed, Obstacles.of_spheres(places, random.uniform(0.02, 0.1, 5), velocities, time=0.0)


def densely(times: np.ndarray, placed: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments (n - 1, q) and places (n - 1, q, S, 3) at shares (q,) of every interval."""
    moments = times[:-1, None] + shares * np.diff(times)[:, None]
    shares = shares[None, :, None, None]
    return moments, (1.0 - shares) * placed[:-1, None] + shares * placed[1:, None]


@pytest.mark.parametrize("seed", range(20))
def test_the_clearance_is_that_of_dense_samples_from_below(seed):
    times, placed, obstacles = motion(seed)
    bulges = np.random.default_rng(seed).uniform(0.0, 0.02, (len(times) - 1, 3))
    clearance, sphere = clearances_in_motion(times, placed, bulges, RADII, MOVING, obstacles, HORIZON)
    moments, places = densely(times, placed, np.linspace(0.0, 1.0, 400))
    centres = obstacles.centres + np.minimum(moments, HORIZON)[..., None, None] * obstacles.velocities
    gaps = np.linalg.norm(places[:, :, MOVING, None] - centres[:, :, None], axis=-1).min(axis=1)
    gaps = gaps - obstacles.radii - (RADII + bulges)[:, MOVING, None]
    assert np.all(clearance <= gaps.min(axis=(1, 2)) + 1e-9)
    # Where obstacles do not stop within the interval nothing is given away, but for what lies between the samples.
    steady = (times[1:] <= HORIZON) | (times[:-1] >= HORIZON)
    np.testing.assert_allclose(clearance[steady], gaps.min(axis=(1, 2))[steady], atol=1e-3)
    assert np.all(np.isin(sphere, MOVING))


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("horizon", [HORIZON, 3.0])
def test_until_a_horizon_is_as_dense_samples_find_and_later_only_what_stands_counts(seed, horizon):
    """The last knot's spheres stand until the horizon, where that is later."""
    times, placed, obstacles = motion(seed)
    bulges = np.zeros((len(times) - 1, 3))
    given = RADII, MOVING, obstacles, horizon
    clearance, sphere = clearances_until(times, placed, bulges, *given)
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
    # Nothing moves that late: what comes then is not counted.
    later, _ = clearances_in_motion(times, placed, bulges, *given)
    assert np.all(clearance[knots - 1 : -1] >= later[knots - 1 : -1] - 1e-12)
    still, _ = clearances_until(times, placed, bulges, RADII, MOVING, obstacles.swept(0.0), horizon)
    always, _ = clearances_in_motion(times, placed, bulges, RADII, MOVING, obstacles.swept(0.0), horizon)
    np.testing.assert_allclose(still, always, rtol=0.0, atol=1e-12)


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
