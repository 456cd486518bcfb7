"""The cubes of a grid that hold points of a cloud; compiled, and without the interpreter lock that the loop needs."""

from __future__ import annotations

import math

import numba
import numpy as np

# A cube's three numbers are packed into 21 bits each: up to a million cubes on either side of the origin.
_BITS = 21
_MIDDLE, _MASK = 1 << (_BITS - 1), (1 << _BITS) - 1
#: Largest number of a cube along one axis.
MOST = _MIDDLE - 1
_FREE = -1
_POINTS = numba.types.Array(numba.float64, 2, "C", readonly=True)


@numba.njit(numba.int64[:](_POINTS, numba.float64), cache=True, nogil=True)
def _occupied(points: np.ndarray, edge: float) -> np.ndarray:
    """Packed numbers (n,) of the distinct cubes, by a hash table with open addressing."""
    size = 16
    while size < 2 * len(points):
        size *= 2
    table = np.full(size, _FREE, dtype=np.int64)
    found = np.empty(len(points), dtype=np.int64)
    count = 0
    for i in range(len(points)):
        key = np.int64(0)
        for axis in range(3):
            key = (key << _BITS) | (np.int64(math.floor(points[i, axis] / edge)) + _MIDDLE)
        # Fibonacci hashing: the multiplier is 2^64 over the golden ratio, as a signed number.
        slot = ((key * np.int64(-7046029254386353131)) >> 20) & (size - 1)
        while table[slot] != _FREE and table[slot] != key:
            slot = (slot + 1) & (size - 1)
        if table[slot] == _FREE:
            table[slot] = key
            found[count] = key
            count += 1
    return found[:count].copy()


def occupied_cubes(points: np.ndarray, edge: float) -> np.ndarray:
    """Distinct cubes (n, 3) of an edge [m] that hold the points (m, 3), finite and within `MOST` cubes; sorted."""
    return _unpacked(np.sort(_occupied(np.ascontiguousarray(points, dtype=float), edge)))


def doubled(cubes: np.ndarray) -> np.ndarray:
    """The distinct cubes (k, 3) of twice the edge that hold cubes (n, 3)."""
    return occupied_cubes(cubes.astype(float), 2.0)


def _unpacked(packed: np.ndarray) -> np.ndarray:
    return np.stack([packed >> 2 * _BITS, (packed >> _BITS) & _MASK, packed & _MASK], axis=1) - _MIDDLE
