"""How alike two motions are: the measures that every table of this package prints.

All of them compare the *paths*, not their timing: both curves are first resampled to 200 points equally
spaced in arc length of the positions.

- DTW: dynamic time warping finds the monotone matching of the two sequences with the least sum of position
  distances; the measure is the mean position distance of the matched pairs [m].
- orientation: the mean angle [rad] between the orientations of the same matched pairs.
- discrete Frechet distance [m]: the smallest, over monotone matchings, of the largest position distance
  (T. Eiter, H. Mannila, "Computing discrete Frechet distance", 1994): the leash of a walker and a dog.
- to the closest: DTW to the demonstration for which it is smallest: does a motion stay on the skill at all?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import angle_between

COMPARED_POINTS = 200


@dataclass(frozen=True)
class Similarity:
    """dtw [m], frechet [m] and orientation [rad] of two motions, as this module defines them."""

    dtw: float
    frechet: float
    orientation: float


def compare(first: PoseCurve, second: PoseCurve) -> Similarity:
    """Compare two motions sampled at any numbers of points. Symmetric; all zero for the same path."""
    one, other = first.resample(COMPARED_POINTS), second.resample(COMPARED_POINTS)
    distances = _distances(one.positions, other.positions)
    matching = _warping_path(_accumulated_cost(distances))
    rows, columns = matching.T
    return Similarity(
        dtw=float(distances[rows, columns].mean()),
        frechet=float(_frechet(distances)),
        orientation=float(angle_between(one.quaternions[rows], other.quaternions[columns]).mean()),
    )


def distance_to_closest(curve: PoseCurve, others: Sequence[PoseCurve]) -> float:
    """DTW [m] from a motion to the one of the others that it is closest to."""
    return min(compare(curve, other).dtw for other in others)


def dtw_matching(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Index pairs (k, 2) of the matching with the least sum of distances between points (n, d) and (m, d)
    [m].

    Starts at (0, 0), ends at (n - 1, m - 1), and each step advances one index or both by one.
    """
    return _warping_path(_accumulated_cost(_distances(first, second)))


@njit(cache=True)
def _distances(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances (n, m) between all pairs of points."""
    distances = np.empty((len(first), len(second)))
    for i in range(len(first)):
        for j in range(len(second)):
            distances[i, j] = np.sqrt(np.sum((first[i] - second[j]) ** 2))
    return distances


@njit(cache=True)
def _accumulated_cost(distances: np.ndarray) -> np.ndarray:
    """D[i, j] = d[i, j] + min(D[i-1, j-1], D[i-1, j], D[i, j-1]), with a border of infinities at index 0."""
    rows, columns = distances.shape
    cost = np.full((rows + 1, columns + 1), np.inf)
    cost[0, 0] = 0.0
    for i in range(rows):
        for j in range(columns):
            cost[i + 1, j + 1] = distances[i, j] + min(cost[i, j], min(cost[i, j + 1], cost[i + 1, j]))
    return cost


@njit(cache=True)
def _warping_path(cost: np.ndarray) -> np.ndarray:
    """Walk back from the last pair to the first; among equals the diagonal step is preferred."""
    i, j = cost.shape[0] - 1, cost.shape[1] - 1
    path = np.empty((i + j, 2), dtype=np.int64)
    length = 0
    while i > 0 and j > 0:
        path[length] = i - 1, j - 1
        length += 1
        diagonal, up, left = cost[i - 1, j - 1], cost[i - 1, j], cost[i, j - 1]
        if diagonal <= up and diagonal <= left:
            i, j = i - 1, j - 1
        elif up <= left:
            i -= 1
        else:
            j -= 1
    return path[:length][::-1].copy()


@njit(cache=True)
def _frechet(distances: np.ndarray) -> float:
    """F[i, j] = max(d[i, j], min(F[i-1, j-1], F[i-1, j], F[i, j-1]))."""
    rows, columns = distances.shape
    leash = np.full((rows + 1, columns + 1), np.inf)
    leash[0, 0] = 0.0
    for i in range(rows):
        for j in range(columns):
            leash[i + 1, j + 1] = max(
                distances[i, j], min(leash[i, j], min(leash[i, j + 1], leash[i + 1, j]))
            )
    return leash[rows, columns]
