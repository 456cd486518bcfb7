"""Transport: carrying decoded poses to a query, so that a path begins and ends where it was requested to.

A pose at progress t in [0, 1] between start and goal is moved by the displacement

    D = (1 - tau) d0 + tau d1 + c,      1 - tau = (1 - t)^fade

of a translation [m] and a rotation vector [rad, base frame], x + D_x and exp(D_r) q: the offsets d0 of the start and d1
of the goal, and a correction c of the decoder that is known along the demonstrations (zero where none is).

With a fade of 1 the start's offset fades linearly. Powers of 1 - t are the only shares that keep a path where it is
when it is planned again from half of it: what is left at t1 fades on as (1 - t1)^fade ((1 - t) / (1 - t1))^fade.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np


@dataclass(frozen=True)
class Offsets:
    """The displacements that move decoded tool poses so that they begin and end at a query's start and goal.

    Attributes
    ----------
    start, goal : (6,) offsets d0 and d1: translation [m] and rotation vector [rad], base frame.
    start_progress, goal_progress : progress of the latent points that are carried onto start and goal.
    corrections : (K, S, 6) corrections c_k along K mean paths at S equally spaced values of progress; K may be 0.
    fade : exponent with which the start's offset fades.
    """

    start: np.ndarray
    goal: np.ndarray
    start_progress: float
    goal_progress: float
    corrections: np.ndarray
    fade: float = 1.0

    @classmethod
    def none(cls, mean_paths: int = 0) -> Offsets:
        """Leaves every pose of a graph with so many mean paths where it is."""
        return cls(np.zeros(6), np.zeros(6), 0.0, 1.0, np.zeros((mean_paths, 2, 6)))

    def displacements(self, progress: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """D (..., 6) at progress (...) and shares (..., K) of the mean paths."""
        tau = self.blended(progress).reshape(-1)
        flat = shares.reshape(len(tau), self.corrections.shape[0])
        moved = _displacements(tau, progress.reshape(-1), flat, self.start, self.goal, self.corrections)
        return moved.reshape(*progress.shape, 6)

    def blended(self, progress: np.ndarray) -> np.ndarray:
        """tau (n,) in [0, 1], the share of the goal's offset, at progress (n,)."""
        return faded(blended(progress, self.start_progress, self.goal_progress), self.fade)


def blended(progress: np.ndarray, start_progress: float, goal_progress: float) -> np.ndarray:
    """t (n,) in [0, 1] at progress (n,): 0 at the start's, 1 at the goal's, linear between."""
    span = goal_progress - start_progress
    if abs(span) < 1e-6:
        return np.ones_like(progress)
    return np.clip((progress - start_progress) / span, 0.0, 1.0)


def faded(t: np.ndarray, fade: float) -> np.ndarray:
    """tau (n,) = 1 - (1 - t)^fade, the share of the goal's offset where the start's fades so; t itself for 1."""
    # Written so that nothing is rounded for a fade of 1.
    return t + ((1.0 - t) - (1.0 - t) ** fade)


def corrections_at(corrections: np.ndarray, progress: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """c (n, D) = sum_k shares_k c_k at progress (n,), shares (n, K), linear between the samples of (K, S, D)."""
    nowhere = np.zeros(corrections.shape[2])
    return _displacements(np.zeros(len(progress)), progress, shares, nowhere, nowhere, corrections)


@numba.njit(cache=True, nogil=True)
def _displacements(
    tau: np.ndarray,
    progress: np.ndarray,
    shares: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    corrections: np.ndarray,
) -> np.ndarray:
    count, samples = corrections.shape[:2]
    size = len(start)
    result = np.empty((len(tau), size))
    for i in range(len(tau)):
        for j in range(size):
            result[i, j] = (1.0 - tau[i]) * start[j] + tau[i] * goal[j]
        at = min(max(progress[i], 0.0), 1.0) * (samples - 1)
        left = min(int(at), samples - 2)
        fraction = at - left
        for k in range(count):
            for j in range(size):
                between = (1.0 - fraction) * corrections[k, left, j] + fraction * corrections[k, left + 1, j]
                result[i, j] += shares[i, k] * between
    return result
