"""SearchBuffers: what a search from both ends writes into; made once for a graph, lent to one search after another.

To fill arrays for all nodes takes longer than most searches. So a search notes the nodes that it writes at, and only
those are undone when it gives the buffers back. Searches that run at the same time have buffers of their own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.heap import WAITING, put


class SearchBuffers(NamedTuple):
    """Working memory of one shortest-path search on n nodes, used again by the next: costs, predecessors, heaps.

    Side 0 of each array is of the search from the source, side 1 of the search from the target.

    Attributes
    ----------
    cost : (2, n) of the cheapest path known to a node; inf where none is known, -inf where no better one is looked for.
    predecessor, arrival : (2, n) int32 the node before, and the edge to it, where there is a cost.
    keys, items, place : (2, n) heaps of nodes, see `heap.py`; size : (2,) int64 how many they hold.
    begun : (2,) the first key; spent : (2,) int64 how many nodes were taken.
    written : (n,) int32 the nodes with a cost; count : (1,) int64 how many.
    nodes, edges : (n,) int32 room for a path.
    """

    cost: np.ndarray
    predecessor: np.ndarray
    arrival: np.ndarray
    keys: np.ndarray
    items: np.ndarray
    place: np.ndarray
    size: np.ndarray
    begun: np.ndarray
    spent: np.ndarray
    written: np.ndarray
    count: np.ndarray
    nodes: np.ndarray
    edges: np.ndarray

    @classmethod
    def of(cls, nodes: int) -> SearchBuffers:
        """For a graph of so many nodes."""
        sides = (2, nodes)
        return cls(
            cost=np.full(sides, math.inf),
            predecessor=np.empty(sides, dtype=np.int32),
            arrival=np.empty(sides, dtype=np.int32),
            keys=np.empty(sides),
            items=np.empty(sides, dtype=np.int32),
            place=np.full(sides, WAITING, dtype=np.int32),
            size=np.zeros(2, dtype=np.int64),
            begun=np.zeros(2),
            spent=np.zeros(2, dtype=np.int64),
            written=np.empty(nodes, dtype=np.int32),
            count=np.zeros(1, dtype=np.int64),
            nodes=np.empty(nodes, dtype=np.int32),
            edges=np.empty(nodes, dtype=np.int32),
        )


@numba.njit(cache=True, nogil=True)
def begin_at_both_ends(
    to_target: np.ndarray, from_landmark: np.ndarray, source: int, target: int, buffers: SearchBuffers
) -> None:
    """Both ends wait to be taken; to_target, from_landmark : (n,) as of `shortest_path_from_both_ends`."""
    for side, end in enumerate((source, target)):
        ahead = to_target[source] if side == 0 else abs(from_landmark[target] - from_landmark[source])
        buffers.cost[side, end], buffers.begun[side] = 0.0, ahead
        put(buffers.keys[side], buffers.items[side], buffers.place[side], 0, end, ahead)
        buffers.size[side], buffers.written[side] = 1, end
    buffers.count[0] = 2


@numba.njit(cache=True, nogil=True)
def trace(meeting: int, source: int, target: int, buffers: SearchBuffers) -> int:
    """Write the path through a node that both sides know, from source to target; returns its number of edges."""
    before = 0
    u = meeting
    while u != source:
        u = buffers.predecessor[0, u]
        before += 1
    u = meeting
    buffers.nodes[before] = meeting
    for i in range(before, 0, -1):
        buffers.edges[i - 1], u = buffers.arrival[0, u], buffers.predecessor[0, u]
        buffers.nodes[i - 1] = u
    u, count = meeting, before
    while u != target:
        buffers.edges[count], u = buffers.arrival[1, u], buffers.predecessor[1, u]
        count += 1
        buffers.nodes[count] = u
    return count


@numba.njit(cache=True, nogil=True)
def _undo(
    cost: np.ndarray,
    place: np.ndarray,
    size: np.ndarray,
    spent: np.ndarray,
    written: np.ndarray,
    count: np.ndarray,
) -> None:
    """Leave no trace of a search."""
    for i in range(count[0]):
        for side in range(2):
            cost[side, written[i]] = math.inf
            place[side, written[i]] = WAITING
    size[:], spent[:], count[0] = 0, 0, 0


@contextmanager
def lent_buffers(adjacency: Adjacency) -> Iterator[SearchBuffers]:
    """The buffers of one search on a graph; from any thread."""
    try:
        buffers = adjacency.spare_buffers.pop()
    except IndexError:
        buffers = SearchBuffers.of(len(adjacency.first) - 1)
    yield buffers
    # A search that was interrupted does not come here: what it leaves is not used again.
    _undo(buffers.cost, buffers.place, buffers.size, buffers.spent, buffers.written, buffers.count)
    adjacency.spare_buffers.append(buffers)
