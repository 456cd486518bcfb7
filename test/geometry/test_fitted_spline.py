"""Least squares through a path: exact ends, exact lines, shorter than the corners of a grid."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from geodesic_motion_ros.geometry.fitted_spline import fitted_spline

AT = np.linspace(0.0, 1.0, 500)


def length(curve: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())


def staircase(steps: int) -> np.ndarray:
    """(2 steps + 1, 2): right and up in turn, of which the diagonal is 1."""
    moves = np.tile([[1.0, 0.0], [0.0, 1.0]], (steps, 1)) / (steps * np.sqrt(2.0))
    return np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])


@pytest.mark.parametrize("coefficients", [4, 5, 10, 20])
def test_the_ends_stay_and_the_corners_of_a_grid_go(coefficients: int) -> None:
    path = staircase(50)
    curve = fitted_spline(path, coefficients)(AT)
    np.testing.assert_allclose(curve[[0, -1]], path[[0, -1]], atol=1e-12)
    assert length(path) == pytest.approx(np.sqrt(2.0))
    assert length(curve) < 1.03


def test_a_straight_line_comes_back() -> None:
    """Whatever the distances between its points."""
    line = np.sort(np.random.default_rng(0).random(40))[:, None] * [1.0, -2.0, 0.5]
    curve = fitted_spline(line, 8)(AT)
    np.testing.assert_allclose(curve, line[0] + AT[:, None] * (line[-1] - line[0]), atol=1e-12)


def test_no_other_spline_with_these_ends_is_nearer_to_the_path() -> None:
    random = np.random.default_rng(1)
    path = np.cumsum(random.normal(size=(60, 3)), axis=0)
    spline = fitted_spline(path, 9)
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at /= at[-1]

    def off(coefficients: np.ndarray) -> float:
        return float(np.sum((BSpline(spline.t, coefficients, spline.k)(at) - path) ** 2))

    for _ in range(50):
        change = 0.1 * random.normal(size=spline.c.shape)
        change[[0, -1]] = 0.0
        assert off(spline.c) < off(spline.c + change)


@pytest.mark.parametrize("points", [1, 2, 3, 4])
def test_short_paths_have_fewer_coefficients(points: int) -> None:
    path = np.random.default_rng(points).normal(size=(points, 2))
    for doubled in (path, np.repeat(path, 2, axis=0)):
        np.testing.assert_allclose(fitted_spline(doubled)([0.0, 1.0]), path[[0, -1]], atol=1e-12)
