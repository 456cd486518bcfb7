"""Where a field on a three-dimensional lattice takes a value, as a surface of quadrilaterals.

Naive surface nets: every cell that the surface passes has one vertex, the mean of the points at which the surface cuts
the cell's edges (by linear interpolation); every edge of the lattice that is cut has a quadrilateral, through the
vertices of the four cells around it.
"""

from __future__ import annotations

import numpy as np


def isosurface(values: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Surface values = level of a field (nx, ny, nz).

    Returns
    -------
    vertices (v, 3), in units of the lattice from its first point; quads (q, 4), numbers of vertices, in order around.
    Where the surface leaves the lattice it is open.
    """
    inside = values < level
    cells = tuple(side - 1 for side in values.shape)
    sums, counts = np.zeros((*cells, 3)), np.zeros(cells, dtype=int)
    around: list[np.ndarray] = []
    for axis in range(3):
        near = tuple(slice(None, -1) if a == axis else slice(None) for a in range(3))
        far = tuple(slice(1, None) if a == axis else slice(None) for a in range(3))
        cut = np.argwhere(inside[near] != inside[far])
        low, high = values[near][tuple(cut.T)], values[far][tuple(cut.T)]
        points = cut.astype(float)
        points[:, axis] += (level - low) / (high - low)
        neighbours = cut[:, None] - _around(axis)
        exists = np.all((neighbours >= 0) & (neighbours < cells), axis=-1)
        edge, corner = np.nonzero(exists)
        where = tuple(neighbours[edge, corner].T)
        np.add.at(sums, where, points[edge])
        np.add.at(counts, where, 1)
        around.append(neighbours[np.all(exists, axis=1)])
    numbers = np.cumsum(counts.reshape(-1) > 0).reshape(cells) - 1
    vertices = sums[counts > 0] / counts[counts > 0][:, None]
    return vertices, numbers[tuple(np.moveaxis(np.concatenate(around), -1, 0))]


def _around(axis: int) -> np.ndarray:
    """From an edge along an axis back to the four cells around it, in order, (4, 3)."""
    first, second = (a for a in range(3) if a != axis)
    steps = np.zeros((4, 3), dtype=int)
    steps[:, first], steps[:, second] = (0, 1, 1, 0), (0, 0, 1, 1)
    return steps
