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
        # A shift takes less time than a division of signed numbers.
        parent = (child - 1) >> 2
        if keys[parent] <= key:
            break
        moved = items[parent]
        keys[child], items[child], place[moved] = keys[parent], moved, child
        child = parent
    keys[child], items[child], place[item] = key, item, child
    return size


@numba.njit(cache=True, nogil=True)
def take(keys: np.ndarray, items: np.ndarray, place: np.ndarray, size: int) -> int:
    """Take items[0], whose key is the smallest; returns the new size."""
    place[items[0]] = TAKEN
    size -= 1
    key, item = keys[size], items[size]
    parent, first = 0, 1
    while first < size:
        least, smallest = first, keys[first]
        for child in range(first + 1, min(first + 4, size)):
            if keys[child] < smallest:
                least, smallest = child, keys[child]
        if smallest >= key:
            break
        moved = items[least]
        keys[parent], items[parent], place[moved] = smallest, moved, parent
        parent, first = least, 4 * least + 1
    if size > 0:
        keys[parent], items[parent], place[item] = key, item, parent
    return size
