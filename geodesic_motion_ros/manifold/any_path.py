"""Some path instead of the cheapest, for who is in a hurry: weighted A* from the source."""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.heap import TAKEN, put, take
from geodesic_motion_ros.manifold.obstacle_weights import evaluate_node
from geodesic_motion_ros.manifold.search_buffers import SearchBuffers, begin_at_both_ends, lent_buffers, trace
from geodesic_motion_ros.manifold.shortest_path import edge_weight
from geodesic_motion_ros.manifold.weighted_graph import GraphAmongObstacles
from geodesic_motion_ros.utils.deadline import Deadline

#: So many nodes are about half a millisecond: then the time is looked at.
_BATCH = 256
#: How much more what is left to go counts than what lies behind.
_GREED = 20.0


@numba.njit(cache=True, nogil=True)
def _go_on(
    graph: GraphAmongObstacles,
    to_target: np.ndarray,
    target: int,
    most: int,
    buffers: SearchBuffers,
) -> float:
    """Weighted A* (I. Pohl, "Heuristic search viewed as path finding in a graph", Artificial Intelligence 1, 1970) from
    the source, for so many nodes at most: a path found among far fewer of them than the cheapest.

    Returns the cost of the first path to the target; inf without one yet, and for good where no node is left.
    """
    first_slot, neighbour, edge_of, base, fixed, shares, evaluation, margin = graph
    evaluated, factors = evaluation.evaluated, evaluation.factors
    affected, clearance = evaluation.affected, evaluation.clearance
    costs, predecessor, arrival, all_keys, all_items, places, size, _, _, written, count, _, _ = buffers
    cost, keys, items, place = costs[0], all_keys[0], all_items[0], places[0]
    for _ in range(most):
        if size[0] == 0:
            break
        u = items[0]
        size[0] = take(keys, items, place, size[0])
        for slot in range(first_slot[u], first_slot[u + 1]):
            v, edge = neighbour[slot], edge_of[slot]
            through = cost[u] + base[edge]
            if place[v] == TAKEN or through >= cost[v]:
                continue
            if not evaluated[v]:
                evaluate_node(v, evaluation)
            if clearance[v] < margin and v != target:
                continue
            if affected[u] or affected[v]:
                through = cost[u] + edge_weight(fixed, shares, factors, edge, u, v)
            if not through < cost[v]:
                continue
            if cost[v] == math.inf and v != target:
                written[count[0]] = v
                count[0] += 1
            cost[v], predecessor[0, v], arrival[0, v] = through, u, edge
            if v == target:
                return through
            size[0] = put(keys, items, place, size[0], v, through + _GREED * to_target[v])
    return math.inf


def any_path(
    adjacency: Adjacency,
    graph: GraphAmongObstacles,
    to_target: np.ndarray,
    from_landmark: np.ndarray,
    source: int,
    target: int,
    deadline: Deadline,
    nodes: np.ndarray,
    edges: np.ndarray,
) -> tuple[float, int, float]:
    """The cost of some path, its number of edges, and what every path costs at least: inf where it is proved that there
    is none, else 0. The path is written to nodes (n,) and edges (n,).

    graph : whose source has been evaluated. The rest as of `shortest_path_from_both_ends`.
    """
    with lent_buffers(adjacency) as buffers:
        begin_at_both_ends(to_target, from_landmark, source, target, buffers)
        buffers.cost[0, target] = cost = math.inf
        while cost == math.inf and buffers.size[0] > 0 and not deadline.passed:
            cost = _go_on(graph, to_target, target, _BATCH, buffers)
        if cost == math.inf:
            return cost, 0, cost if buffers.size[0] == 0 else 0.0
        count = trace(target, source, target, buffers)
        nodes[: count + 1], edges[:count] = buffers.nodes[: count + 1], buffers.edges[:count]
        return cost, count, 0.0


def load_any_path(graph: GraphAmongObstacles, to_target: np.ndarray, node: int, buffers: SearchBuffers) -> None:
    """Load the kernel of `any_path`, or compile it: from a node to itself, where both ends wait in the buffers."""
    _go_on(graph, to_target, node, _BATCH, buffers)
