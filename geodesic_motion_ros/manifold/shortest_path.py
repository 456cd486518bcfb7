"""Shortest paths on the latent graph: Dijkstra's field, and A* with the obstacle-free field as exact heuristic.

The weight of edge e = (u, v) under obstacles is

    w_e = sqrt(b_e + sum_k (m_k(u) + m_k(v)) / 2 * a_ek)

with the ambient factors m_k >= 1 of the body points at both ends. Without obstacles every m_k is 1. So the
obstacle-free cost to the goal never overestimates and is consistent, whatever the obstacles: A* with it returns
Dijkstra's cost.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.heap import TAKEN, WAITING, put, take
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_node, evaluate_nodes

_NOTHING = np.empty(0, dtype=np.int32)


@numba.njit(cache=True, nogil=True)
def edge_weight(fixed: np.ndarray, shares: np.ndarray, factors: np.ndarray, edge: int, u: int, v: int) -> float:
    """Riemannian length of one edge, with fixed (m,), shares (m, K) and factors (n, K)."""
    squared = fixed[edge]
    for k in range(shares.shape[1]):
        squared += 0.5 * (factors[u, k] + factors[v, k]) * shares[edge, k]
    return math.sqrt(squared)


@numba.njit(cache=True, nogil=True)
def _search(
    first_slot: np.ndarray,
    neighbour: np.ndarray,
    edge_of: np.ndarray,
    base: np.ndarray,
    fixed: np.ndarray,
    shares: np.ndarray,
    evaluation: NodeEvaluation | None,
    margin: float,
    heuristic: np.ndarray,
    source: int,
    target: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A* from source; stops when target is settled (target -1: settles everything).

    Nodes with an infinite heuristic cannot reach the goal and are skipped. An edge's obstacle-free length, `base` (m,),
    is a lower bound of its weight, and its weight where no obstacle touches its ends: what obstacles do is worked out
    for the few nodes and edges that remain. Returns, per node, the cost (n,), the predecessor (n,) and the edge to it
    (n,).
    """
    count = len(first_slot) - 1
    cost = np.full(count, np.inf)
    predecessor, arrival = np.full(count, -1, dtype=np.int32), np.full(count, -1, dtype=np.int32)
    keys, items, place = np.empty(count), np.empty(count, dtype=np.int32), np.full(count, WAITING, dtype=np.int32)
    if evaluation is not None:
        factors, affected, clearance = evaluation.factors, evaluation.affected, evaluation.clearance
    cost[source] = 0.0
    size = put(keys, items, place, 0, source, heuristic[source])
    while size > 0:
        u = items[0]
        size = take(keys, items, place, size)
        if u == target:
            break
        for slot in range(first_slot[u], first_slot[u + 1]):
            v = neighbour[slot]
            if place[v] == TAKEN or heuristic[v] == np.inf:
                continue
            edge = edge_of[slot]
            through = cost[u] + base[edge]
            if through >= cost[v]:
                continue
            if evaluation is not None:
                evaluate_node(v, evaluation)
                if clearance[v] < margin and v != target:
                    continue
                if affected[u] or affected[v]:
                    through = cost[u] + edge_weight(fixed, shares, factors, edge, u, v)
            if through < cost[v]:
                cost[v] = through
                predecessor[v] = u
                arrival[v] = edge
                size = put(keys, items, place, size, v, through + heuristic[v])
    return cost, predecessor, arrival


def cost_field(adjacency: Adjacency, base: np.ndarray, source: int) -> np.ndarray:
    """Obstacle-free cost (n,) between `source` and every node, infinite where there is no path (Dijkstra).

    It is the exact heuristic of `shortest_path`. base : (m,) obstacle-free lengths.
    """
    return _field(adjacency.first, adjacency.node, adjacency.edge, base, source)


@numba.njit(cache=True, nogil=True)
def _field(
    first_slot: np.ndarray, neighbour: np.ndarray, edge_of: np.ndarray, base: np.ndarray, source: int
) -> np.ndarray:
    count = len(first_slot) - 1
    cost = np.full(count, np.inf)
    keys, items, place = np.empty(count), np.empty(count, dtype=np.int32), np.full(count, WAITING, dtype=np.int32)
    cost[source] = 0.0
    size = put(keys, items, place, 0, source, 0.0)
    while size > 0:
        u, here = items[0], keys[0]
        size = take(keys, items, place, size)
        for slot in range(first_slot[u], first_slot[u + 1]):
            v = neighbour[slot]
            through = here + base[edge_of[slot]]
            # A node that has been taken costs no more than this.
            if through < cost[v]:
                cost[v] = through
                size = put(keys, items, place, size, v, through)
    return cost


def shortest_free_path(
    adjacency: Adjacency, base: np.ndarray, heuristic: np.ndarray, source: int, target: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """`shortest_path` where there is no obstacle."""
    return shortest_path(adjacency, base, base, base[:, None], None, -math.inf, heuristic, source, target)


def shortest_path(
    adjacency: Adjacency,
    base: np.ndarray,
    fixed: np.ndarray,
    shares: np.ndarray,
    evaluation: NodeEvaluation | None,
    margin: float,
    heuristic: np.ndarray,
    source: int,
    target: int,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Cheapest path from source to target: its nodes (p,), its edges (p - 1,) and its cost.

    Where there is none: no nodes, no edges, and inf.

    Parameters
    ----------
    base : (m,) obstacle-free lengths.
    fixed, shares : (m,) and (m, K) squared lengths b_e and a_ek; a_ek is read at edges that obstacles touch only.
    evaluation : the obstacles; None without any.
    margin : nodes with less clearance [m] are not entered, but for source and target.
    heuristic : (n,) obstacle-free cost to the target; zeros make the search plain Dijkstra.
    """
    if not math.isfinite(heuristic[source]):
        return _NOTHING, _NOTHING, math.inf
    if evaluation is not None:
        evaluate_nodes(np.array([source]), evaluation)
    cost, predecessor, arrival = _search(
        adjacency.first, adjacency.node, adjacency.edge, base, fixed, shares, evaluation, margin, heuristic, source,
        target,
    )  # fmt: skip
    if not math.isfinite(cost[target]):
        return _NOTHING, _NOTHING, math.inf
    nodes, edges = _traced(predecessor, arrival, target, source)
    return np.array(nodes[::-1], dtype=np.int32), np.array(edges[::-1], dtype=np.int32), float(cost[target])


def _traced(predecessor: np.ndarray, arrival: np.ndarray, node: int, end: int) -> tuple[list[int], list[int]]:
    """The nodes from one back to an end, and the edges between them."""
    nodes, edges = [node], []
    while nodes[-1] != end:
        edges.append(arrival[nodes[-1]])
        nodes.append(predecessor[nodes[-1]])
    return nodes, edges
