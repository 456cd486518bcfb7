"""Convex hull of a few points, and what of another point lies outside of it."""

from __future__ import annotations

import numba
import numpy as np

#: The search ends at this bound on the squared error, over the distance found times the farthest corner's.
_TOLERANCE = 1e-15
#: A shorter distance, over the farthest corner's, is rounding.
_ROUNDING = 1e-15
#: Steps of the search; in seven dimensions it takes about ten.
_MOST_STEPS = 200
#: The smallest positive number.
_TINY = np.finfo(float).tiny


def beyond_hull(point: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """A point (D,) minus the nearest point of the convex hull of corners (N, D); zeros, up to rounding, inside.

    P. Wolfe, "Finding the nearest point in a polytope", Mathematical Programming 11, 1976. With r_i = point - corner i,
    x is the shortest convex combination of a few of the r_i, to which the one with the smallest r_i.x is added until
    no r_i.x is smaller than x.x. The search always ends: after _MOST_STEPS, or where rounding leaves no shorter x.

    Every x is the difference from a point of the hull, so it is never too short; it differs from the shortest by
    sqrt(x.x - min r_i.x) at most.
    """
    size = np.max(np.abs(point - corners))
    if size == 0.0:
        return np.zeros_like(point)
    return size * _shortest_in_hull(np.ascontiguousarray((point - corners) / size, dtype=float))


@numba.njit(cache=True, nogil=True)
def _shortest_in_hull(differences: np.ndarray) -> np.ndarray:
    """The shortest convex combination (D,) of differences (N, D)."""
    lengths = np.sqrt(np.sum(differences**2, axis=1))
    farthest, chosen, weights = np.max(lengths), np.array([np.argmin(lengths)]), np.ones(1)
    shortest = differences[chosen[0]].copy()
    for _ in range(_MOST_STEPS):
        products, length = differences @ shortest, np.sqrt(np.sum(shortest**2))
        added = np.argmin(products)
        gap = length**2 - products[added]
        if length <= _ROUNDING * farthest or gap <= _TOLERANCE * length * farthest or np.any(chosen == added):
            break
        chosen, weights = _shortest_combination(differences, np.append(chosen, added), np.append(weights, 0.0))
        found = weights @ differences[chosen]
        if np.sqrt(np.sum(found**2)) >= length:
            break
        shortest = found
    return shortest


@numba.njit(cache=True, nogil=True)
def _shortest_combination(
    points: np.ndarray, chosen: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The chosen points (N, D) and their weights, moved to the shortest affine combination of as many as keep positive
    weights: each step towards it that would make weights negative ends at the first zero, and drops that point.
    """
    while True:
        aimed = _affine_weights(points[chosen])
        share, first = np.inf, -1
        for i in range(len(aimed)):
            if aimed[i] <= 0.0:
                # A point that has just been added has no weight yet.
                falls = weights[i] / max(weights[i] - aimed[i], _TINY)
                if falls < share:
                    share, first = falls, i
        if first < 0:
            return chosen, aimed
        weights = weights + share * (aimed - weights)
        weights[first] = 0.0
        kept = weights > 0.0
        chosen, weights = chosen[kept], weights[kept]


@numba.njit(cache=True, nogil=True)
def _affine_weights(points: np.ndarray) -> np.ndarray:
    """Weights (n,) with sum 1 of the shortest affine combination of points (n, D), which may depend on each other."""
    weights = np.ones(len(points))
    if len(points) > 1:
        weights[1:] = np.linalg.lstsq(np.ascontiguousarray((points[1:] - points[0]).T), -points[0])[0]
        weights[0] = 1.0 - np.sum(weights[1:])
    return weights
