"""Shortest paths on the latent graph: Dijkstra's field, and A* with the obstacle-free field as exact heuristic.

The weight of edge e = (u, v) under obstacles is (design.md section 4)

    w_e = sqrt(b_e + sum_k (m_k(u) + m_k(v)) / 2 * a_ek)

with the ambient factors m_k >= 1 of the body points at both ends. Without obstacles every m_k is 1. So the
obstacle-free cost to the goal never overestimates and is consistent, whatever the obstacles: A* with it returns
Dijkstra's cost.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.graph.grid import Adjacency


@numba.njit(cache=True, nogil=True)
def edge_weight(fixed: np.ndarray, shares: np.ndarray, factors: np.ndarray, edge: int, u: int, v: int) -> float:
    """Riemannian length of one edge, with fixed (m,), shares (m, K) and factors (n, K)."""
    squared = fixed[edge]
    for k in range(shares.shape[1]):
        squared += 0.5 * (factors[u, k] + factors[v, k]) * shares[edge, k]
    return math.sqrt(squared)


@numba.njit(cache=True, nogil=True)
def touched_nodes(factors: np.ndarray) -> np.ndarray:
    """Nodes (n,) with a factor (n, K) above 1."""
    touched = np.zeros(len(factors), dtype=np.bool_)
    for i in range(len(factors)):
        for k in range(factors.shape[1]):
            if factors[i, k] > 1.0:
                touched[i] = True
                break
    return touched


@numba.njit(cache=True, nogil=True)
def _push(keys: np.ndarray, items: np.ndarray, size: int, key: float, item: int) -> int:
    """Add to a binary min-heap held in two arrays; returns the new size."""
    child = size
    while child > 0:
        parent = (child - 1) // 2
        if keys[parent] <= key:
            break
        keys[child] = keys[parent]
        items[child] = items[parent]
        child = parent
    keys[child] = key
    items[child] = item
    return size + 1


@numba.njit(cache=True, nogil=True)
def _drop_smallest(keys: np.ndarray, items: np.ndarray, size: int) -> int:
    """Remove the root of the heap; returns the new size."""
    size -= 1
    key, item = keys[size], items[size]
    parent = 0
    while 2 * parent + 1 < size:
        child = 2 * parent + 1
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[parent] = keys[child]
        items[parent] = items[child]
        parent = child
    keys[parent] = key
    items[parent] = item
    return size


@numba.njit(cache=True, nogil=True)
def _search(
    first: np.ndarray,
    neighbour: np.ndarray,
    edge_of: np.ndarray,
    base: np.ndarray,
    fixed: np.ndarray,
    shares: np.ndarray,
    factors: np.ndarray,
    touched: np.ndarray,
    blocked: np.ndarray,
    heuristic: np.ndarray,
    source: int,
    target: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A* from source; stops when target is settled (target -1: settles everything, Dijkstra's field).

    Nodes with an infinite heuristic cannot reach the goal and are skipped. An edge's obstacle-free length, `base` (m,),
    is a lower bound of its weight, and its weight where no obstacle touches its ends: the sum over body points is
    worked out for the few edges that remain. Returns, per node, the cost (n,), the predecessor (n,) and the edge to it
    (n,).
    """
    cost = np.full(len(first) - 1, np.inf)
    predecessor = np.full(len(first) - 1, -1, dtype=np.int32)
    arrival = np.full(len(first) - 1, -1, dtype=np.int32)
    settled = np.zeros(len(first) - 1, dtype=np.bool_)
    keys = np.empty(len(neighbour) + 1)
    items = np.empty(len(neighbour) + 1, dtype=np.int32)
    cost[source] = 0.0
    size = _push(keys, items, 0, heuristic[source], source)
    while size > 0:
        u = items[0]
        size = _drop_smallest(keys, items, size)
        if settled[u]:
            continue
        settled[u] = True
        if u == target:
            break
        for slot in range(first[u], first[u + 1]):
            v = neighbour[slot]
            if settled[v] or blocked[v] or heuristic[v] == np.inf:
                continue
            edge = edge_of[slot]
            through = cost[u] + base[edge]
            if through >= cost[v]:
                continue
            if touched[u] or touched[v]:
                through = cost[u] + edge_weight(fixed, shares, factors, edge, u, v)
            if through < cost[v]:
                cost[v] = through
                predecessor[v] = u
                arrival[v] = edge
                size = _push(keys, items, size, through + heuristic[v], v)
    return cost, predecessor, arrival


def cost_field(adjacency: Adjacency, base: np.ndarray, source: int) -> np.ndarray:
    """Obstacle-free cost (n,) between `source` and every node, infinite where there is no path (Dijkstra).

    It is the exact heuristic of `shortest_path`. base : (m,) obstacle-free lengths.
    """
    nodes = len(adjacency.first) - 1
    nowhere, nothing = np.zeros(nodes, dtype=np.bool_), np.empty((0, 0))
    cost, _, _ = _search(
        adjacency.first, adjacency.node, adjacency.edge, base, np.empty(0), nothing, nothing,
        nowhere, nowhere, np.zeros(nodes), source, -1,
    )  # fmt: skip
    return cost


def shortest_free_path(
    adjacency: Adjacency, base: np.ndarray, heuristic: np.ndarray, source: int, target: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """`shortest_path` where there is no obstacle."""
    nowhere, nothing = np.zeros(len(heuristic), dtype=np.bool_), np.empty((0, 0))
    return shortest_path(
        adjacency, base, np.empty(0), nothing, nothing, nowhere, nowhere, heuristic, source, target
    )


def shortest_path(
    adjacency: Adjacency,
    base: np.ndarray,
    fixed: np.ndarray,
    shares: np.ndarray,
    factors: np.ndarray,
    touched: np.ndarray,
    blocked: np.ndarray,
    heuristic: np.ndarray,
    source: int,
    target: int,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Cheapest path from source to target: its nodes (p,), its edges (p - 1,) and its cost.

    Where there is none: no nodes, no edges, and inf.

    Parameters
    ----------
    base : (m,) obstacle-free lengths.
    fixed, shares : (m,) and (m, K) squared lengths b_e and a_ek; a_ek is read at edges of touched nodes only.
    factors : (n, K) ambient factors >= 1; touched : (n,) nodes where any of them exceeds 1, see `touched_nodes`.
    blocked : (n,) nodes that may not be entered.
    heuristic : (n,) obstacle-free cost to the target; zeros make the search plain Dijkstra.
    """
    nothing = np.empty(0, dtype=np.int32)
    if blocked[source] or blocked[target] or not math.isfinite(heuristic[source]):
        return nothing, nothing, math.inf
    cost, predecessor, arrival = _search(
        adjacency.first, adjacency.node, adjacency.edge, base, fixed, shares, factors, touched,
        blocked, heuristic, source, target,
    )  # fmt: skip
    if not math.isfinite(cost[target]):
        return nothing, nothing, math.inf
    path = [target]
    while path[-1] != source:
        path.append(predecessor[path[-1]])
    nodes = np.array(path[::-1], dtype=np.int32)
    return nodes, arrival[nodes[1:]], float(cost[target])
