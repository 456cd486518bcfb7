"""What of a point lies outside a convex hull: exact where the answer is known, and proved short enough elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.geometry.convex_hull import beyond_hull

#: Errors, over the distance to the farthest corner, that the squared error in which the search ends allows.
ROUNDING = 1e-7


def outside(random: np.random.Generator, count: int, dimension: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A point (D,), corners (N, D) and the difference (D,) of the point from the nearest point of their hull.

    That lies inside a face, and all other corners lie behind it.
    """
    normal = random.normal(size=dimension)
    normal /= np.linalg.norm(normal)
    corners = random.normal(size=(count, dimension))
    on_face = random.integers(1, count + 1)
    behind = np.append(np.zeros(on_face), random.uniform(0.0, 1.0, count - on_face))
    corners -= np.outer(corners @ normal + behind, normal)
    nearest = random.dirichlet(np.ones(on_face)) @ corners[:on_face]
    beyond = 10.0 ** random.uniform(-3.0, 1.0) * normal
    return nearest + beyond, corners[random.permutation(count)], beyond


def error_bound(point: np.ndarray, corners: np.ndarray, beyond: np.ndarray) -> float:
    """How much a difference from a point of the hull may differ from the shortest one, over the farthest corner's.

    With x the difference, x* the shortest and r that of any corner, x*.r >= x*.x*, so |x - x*|^2 <= x.x - min r.x.
    """
    differences = point - corners
    gap = beyond @ beyond - np.min(differences @ beyond)
    return np.sqrt(max(gap, 0.0)) / np.max(np.linalg.norm(differences, axis=1), initial=1e-300)


@pytest.mark.parametrize("seed", range(300))
def test_the_nearest_point_of_a_face_is_found(seed):
    random = np.random.default_rng(seed)
    point, corners, beyond = outside(random, random.integers(1, 60), random.integers(1, 8))
    scale = 10.0 ** random.uniform(-12.0, 12.0)
    np.testing.assert_allclose(
        beyond_hull(scale * point, scale * corners), scale * beyond, atol=ROUNDING * scale * np.ptp([*corners, point])
    )


@pytest.mark.parametrize("seed", range(300))
def test_nothing_of_a_point_inside_is_beyond(seed):
    random = np.random.default_rng(seed)
    corners = random.normal(size=(random.integers(1, 200), random.integers(1, 8)))
    for point in (random.dirichlet(np.ones(len(corners))) @ corners, corners[-1]):
        np.testing.assert_allclose(beyond_hull(point, corners), 0.0, atol=ROUNDING * np.ptp(corners))


@pytest.mark.parametrize(
    "corners",
    [
        np.zeros((10, 7)),
        np.ones((1, 7)),
        np.repeat(np.eye(7), 20, axis=0),
        np.outer(np.linspace(-1.0, 1.0, 12), np.arange(1.0, 8.0)),
        np.outer(np.geomspace(1e-8, 1.0, 12), np.ones(7)),
        np.eye(7) + 1e-9 * np.arange(7),
        np.random.default_rng(0).integers(-1, 2, (200, 7)).astype(float),
        np.random.default_rng(1).normal(size=(200, 7)) * np.geomspace(1e-9, 1.0, 7),
        1e-9 * np.random.default_rng(2).normal(size=(30, 7)) + 1.0,
    ],
    ids=["zeros", "one", "repeated", "a line", "far along a ray", "almost a plane", "a grid", "flat", "almost a point"],
)
def test_degenerate_hulls_are_no_exception(corners):
    random = np.random.default_rng(0)
    for point in (*corners[:3], np.zeros(7), *random.normal(size=(100, 7)) * np.geomspace(1e-9, 10.0, 100)[:, None]):
        beyond = beyond_hull(point, corners)
        assert error_bound(point, corners, beyond) <= ROUNDING
        assert np.linalg.norm(beyond) <= np.min(np.linalg.norm(point - corners, axis=1)) * (1.0 + 1e-12)


def test_the_answer_does_not_depend_on_the_run():
    point, corners, _ = outside(np.random.default_rng(0), 40, 7)
    np.testing.assert_array_equal(beyond_hull(point, corners), beyond_hull(point.copy(), corners.copy()))
