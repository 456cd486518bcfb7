"""Progress tau(z) of latent points along the demonstrations, tabulated on the grid or, where there is none, worked out.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt

from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.sampled_nodes import SampledNodes


class ProgressMap:
    """Progress tau(z), 0 at the demonstrations' start and 1 at their end, and the shares of the mean paths at z.

    Both are tabulated on the lattice of a grid and interpolated linearly.
    """

    def __init__(self, progress: np.ndarray, shares: np.ndarray, grid: LatentGrid) -> None:
        """progress (n,) and shares (n, K), K may be 0, at all the n nodes of the grid."""
        self._grid, self._shape = grid, np.array(grid.shape)
        #: (n, 1 + K) progress and shares beside each other.
        self.table = np.column_stack([progress, shares])

    def __call__(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """tau (n,) and shares (n, K) of latent points (n, d); beyond the grid, those at its rim."""
        rows = _multilinear(self.table, self._shape, self._grid.coordinates(latent))
        return rows[:, 0].copy(), rows[:, 1:].copy()

    @classmethod
    def from_mean_paths(cls, mean_paths: MeanPaths, grid: LatentGrid, kept: np.ndarray | None = None) -> ProgressMap:
        """The mean paths' own progress and shares.

        kept : mask over the grid's nodes: they are worked out there and one node further, and taken over from the
            nearest of those elsewhere, where no path leads. In three dimensions most of the grid is empty. None: all.
        """
        if kept is None:
            return cls(*mean_paths.coordinates(grid.nodes()), grid)
        near = binary_dilation(kept.reshape(grid.shape), np.ones([3] * len(grid.shape)))
        nearest = distance_transform_edt(~near, return_distances=False, return_indices=True)
        row = np.zeros(grid.shape, dtype=int)
        row[near] = np.arange(np.count_nonzero(near))
        taken = row[tuple(nearest)].reshape(-1)
        progress, shares = mean_paths.coordinates(grid.nodes()[near.reshape(-1)])
        return cls(progress[taken], shares[taken], grid)

    @classmethod
    def from_codes(cls, codes: np.ndarray, grid: LatentGrid) -> ProgressMap:
        """`CodeProgress` of codes (N, T, d)."""
        return cls(*CodeProgress(codes)(grid.nodes()), grid)


class CodeProgress:
    """Progress of the nearby codes, without a table; there are no mean paths.

    tau(z) = sum w s / sum w, w = exp(-|z - z_i(s)|^2 / (2 h^2)), over the demonstrations' codes z_i(s) with arc length
    s; h is the typical distance between neighbouring demonstrations.
    """

    def __init__(self, codes: np.ndarray) -> None:
        """codes (N, T, d), each demonstration's in order of arc length."""
        self._codes = codes.reshape(-1, codes.shape[-1])
        self._share = np.tile(np.linspace(0.0, 1.0, codes.shape[1]), len(codes))
        self._rate = 0.5 / _tube_width(codes) ** 2

    def __call__(self, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """tau (n,) and shares (n, 0) of latent points (n, d)."""
        norms, progress = np.sum(self._codes**2, axis=1), np.empty(len(latent))
        for begin in range(0, len(latent), 512):
            block = latent[begin : begin + 512]
            # |z - z_i|^2 but for |z|^2, which the quotient does not depend on; as a product of matrices.
            squared = norms - 2.0 * (block @ self._codes.T)
            weight = np.exp(-self._rate * (squared - squared.min(axis=1, keepdims=True)))
            progress[begin : begin + 512] = weight @ self._share / weight.sum(axis=1)
        return progress, np.empty((len(latent), 0))


#: Progress (n,) and shares (n, K) of the mean paths at latent points (n, d).
Progress = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def progress_of(
    codes: np.ndarray, mean_paths: MeanPaths | None, grid: LatentGrid | SampledNodes, kept: np.ndarray | None = None
) -> Progress:
    """Choose what tells progress: along the mean paths, or the codes where there are none; of a grid in a table.

    kept : as of `ProgressMap.from_mean_paths`.
    """
    if isinstance(grid, SampledNodes):
        return CodeProgress(codes) if mean_paths is None else mean_paths.coordinates
    if mean_paths is None:
        return ProgressMap.from_codes(codes, grid)
    return ProgressMap.from_mean_paths(mean_paths, grid, kept)


@numba.njit(cache=True, nogil=True)
def _multilinear(table: np.ndarray, shape: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Rows of a table (prod(shape), K), one for each lattice point, last axis fastest, between them at (n, d): (n, K).

    The sum over the corners of a cell, each with the product over the axes of 1 - f, or f at the upper end.
    """
    count, d = at.shape
    result, fractions = np.zeros((count, table.shape[1])), np.empty(d)
    for i in range(count):
        first = 0
        for a in range(d):
            place = min(max(at[i, a], 0.0), shape[a] - 1.0)
            left = min(int(place), shape[a] - 2)
            fractions[a] = place - left
            first = first * shape[a] + left
        for corner in range(1 << d):
            row, weight, stride = first, 1.0, 1
            for a in range(d - 1, -1, -1):
                upper = corner >> a & 1
                row += upper * stride
                weight *= fractions[a] if upper else 1.0 - fractions[a]
                stride *= shape[a]
            for k in range(table.shape[1]):
                result[i, k] += weight * table[row, k]
    return result


def _tube_width(codes: np.ndarray) -> float:
    """Median distance from a code to the nearest code of another demonstration; of its own where there is only one."""
    if len(codes) == 1:
        return float(np.median(np.linalg.norm(np.diff(codes[0], axis=0), axis=1))) * 3.0
    distances = []
    for i, own in enumerate(codes):
        others = np.delete(codes, i, axis=0).reshape(-1, codes.shape[-1])
        distances.append(np.sqrt(np.sum((own[:, None] - others[None]) ** 2, axis=-1).min(axis=1)))
    return max(float(np.median(distances)), 1e-6)
