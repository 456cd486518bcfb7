"""A binary heap's wider cousin: four children a parent, and every item knows its place, so that its key can fall.

It is kept in three arrays of as many entries as there are items: keys (n,), items (n,) int32, and place (n,) int32 of
each item, WAITING before it is first put and TAKEN once it has been taken.
"""

from __future__ import annotations

import numba
import numpy as np

WAITING, TAKEN = -1, -2


@numba.njit(cache=True, nogil=True)
def put(keys: np.ndarray, items: np.ndarray, place: np.ndarray, size: int, item: int, key: float) -> int:
    """Put an item that is WAITING, or lower the key of one that is in the heap; returns the new size."""
    child = place[item]
    if child < 0:
        child = size
        size += 1
    while child > 0:
        parent = (child - 1) // 4
        if keys[parent] <= key:
            break
        keys[child], items[child] = keys[parent], items[parent]
        place[items[child]] = child
        child = parent
    keys[child], items[child], place[item] = key, item, child
    return size


@numba.njit(cache=True, nogil=True)
def take(keys: np.ndarray, items: np.ndarray, place: np.ndarray, size: int) -> int:
    """Take items[0], whose key is the smallest; returns the new size."""
    place[items[0]] = TAKEN
    size -= 1
    key, item = keys[size], items[size]
    parent = 0
    while 4 * parent + 1 < size:
        least = 4 * parent + 1
        for child in range(least + 1, min(least + 4, size)):
            if keys[child] < keys[least]:
                least = child
        if keys[least] >= key:
            break
        keys[parent], items[parent] = keys[least], items[least]
        place[items[parent]] = parent
        parent = least
    if size > 0:
        keys[parent], items[parent], place[item] = key, item, parent
    return size
