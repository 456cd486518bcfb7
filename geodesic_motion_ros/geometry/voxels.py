"""VoxelGrid: cubes around a place. Their middles are at whole multiples of an edge: they are the same in all clouds."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

#: The numbers of cubes, in a grid.
NUMBERS = numba.types.Array(numba.int32, 3, "C")
#: Their places in it, whole multiples of the edge along the axes.
PLACES = numba.types.Array(numba.int64, 2, "C")
WHOLE = numba.types.Array(numba.int64, 1, "C")


class VoxelGrid(NamedTuple):
    """Cubes that hold a ball.

    Attributes
    ----------
    centre, radius : (3,) and [m] of the ball. edge : of a cube [m].
    first : (3,) place of the cube in the lower corner, whole multiples of the edge. shape : (3,) how many along each
        axis; those at the rim hold nothing of the ball.
    """

    centre: tuple[float, float, float]
    radius: float
    edge: float
    first: np.ndarray
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, centre: np.ndarray, radius: float, edge: float) -> VoxelGrid:
        """Make the grid around a centre (3,) [m]."""
        first = np.rint((centre - radius) / edge).astype(np.int64) - 1
        i, j, k = (np.rint((centre + radius) / edge).astype(np.int64) + 2 - first).tolist()
        x, y, z = centre.tolist()
        return cls((x, y, z), radius, edge, first, (i, j, k))

    def numbers(self) -> np.ndarray:
        """Make room for numbers of cubes: (x, y, z), all 0."""
        return np.zeros(self.shape, dtype=np.int32)

    def numbered(self, places: np.ndarray) -> np.ndarray:
        """Write 1 + the number of each cube at places (v, 3) into a grid of zeros: (x, y, z)."""
        cubes = self.numbers()
        _write_numbers(np.ascontiguousarray(places), cubes, self.first)
        return cubes


@numba.njit((PLACES, NUMBERS, WHOLE), cache=True, nogil=True)
def _write_numbers(places: np.ndarray, cubes: np.ndarray, first: np.ndarray) -> None:
    """Write 1 + the number of each cube at places (v, 3) into a grid of zeros whose lower corner is the first (3,)."""
    for n in range(len(places)):
        cubes[places[n, 0] - first[0], places[n, 1] - first[1], places[n, 2] - first[2]] = n + 1
