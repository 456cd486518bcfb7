"""The ambient factor: at least 1, exactly 1 far away, continuous, and blind to the order of obstacles."""

import numpy as np
import pytest

from geodesic_motion_ros.graph.ambient import CUTOFF, ambient_factor, clearances

POINT_RADII = np.array([0.03, 0.0])


def points(seed: int = 0, count: int = 500) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 2, 3))


def factors(where: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    return np.array(
        [
            [ambient_factor(*x, r, centres, radii, 1e3, 0.5) for x, r in zip(row, POINT_RADII, strict=True)]
            for row in where
        ]
    )


def test_without_obstacles_every_factor_is_exactly_one():
    assert np.all(factors(points(), np.empty((0, 3)), np.empty(0)) == 1.0)


def test_an_obstacle_changes_what_is_near_and_nothing_else():
    where, centre, radius = points(), np.array([[0.1, 0.2, 0.3]]), np.array([0.2])
    result = factors(where, centre, radius)
    reach = CUTOFF * 0.5 * (0.2 + POINT_RADII)
    near = np.linalg.norm(where - centre[0], axis=-1) < reach
    assert 0 < np.count_nonzero(near) < near.size
    assert np.all(result[near] > 1.0)
    assert np.all(result[~near] == 1.0)


def test_it_is_the_shifted_gaussian_of_the_docstring():
    where, radius = points(), 0.4
    result = factors(where, np.zeros((1, 3)), np.array([radius]))
    width = 0.5 * (radius + POINT_RADII)
    shift = np.exp(-0.5 * CUTOFF**2)
    gaussian = np.exp(-0.5 * (np.linalg.norm(where, axis=-1) / width) ** 2)
    np.testing.assert_allclose(result, 1.0 + 1e3 * np.maximum(gaussian - shift, 0.0) / (1.0 - shift), rtol=1e-10)


def test_the_order_of_obstacles_does_not_matter():
    random = np.random.default_rng(1)
    centres, radii, order = random.uniform(-1, 1, (8, 3)), random.uniform(0.1, 0.4, 8), random.permutation(8)
    first, second = factors(points(), centres, radii), factors(points(), centres[order], radii[order])
    np.testing.assert_allclose(first, second, rtol=1e-12)


def test_clearance_is_the_gap_between_surfaces():
    where = np.array([[[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]]])
    result = clearances(where, POINT_RADII, np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 2.0]]), np.array([0.2, 0.1]), np.inf)
    assert result[0] == pytest.approx(0.5 - 0.2 - 0.03)
    assert clearances(where, POINT_RADII, np.empty((0, 3)), np.empty(0), np.inf)[0] == np.inf


def test_what_is_further_than_asked_for_is_not_told():
    where, centres, radii = points(), np.random.default_rng(2).uniform(-1, 1, (5, 3)), np.full(5, 0.2)
    everything = clearances(where, POINT_RADII, centres, radii, np.inf)
    near = clearances(where, POINT_RADII, centres, radii, 0.05)
    assert 0 < np.count_nonzero(everything < 0.05) < len(where)
    np.testing.assert_array_equal(near, np.where(everything < 0.05, everything, np.inf))
