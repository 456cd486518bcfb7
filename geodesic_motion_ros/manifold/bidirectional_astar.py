"""Shortest paths searched from both ends at once, and for so long as there is time.

Where obstacles stand on the path two searches that meet reach fewer nodes than the one of `shortest_path.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.manifold.any_path import any_path, load_any_path
from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.heap import put, take
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_node, evaluate_nodes
from geodesic_motion_ros.manifold.search_buffers import SearchBuffers, begin_at_both_ends, lent_buffers, trace
from geodesic_motion_ros.manifold.shortest_path import edge_weight
from geodesic_motion_ros.manifold.weighted_graph import GraphAmongObstacles
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: Nodes that one side takes before both are compared again.
_BATCH = 64
#: So many batches are about half a millisecond: then the time is looked at, where there is a deadline.
_BATCHES, _UNLIMITED = 4, 1 << 62
#: Looks at the time without a path, after which any path is looked for.
_PATIENCE = 3

_NOTHING = np.empty(0, dtype=np.int32)


@numba.njit(cache=True, nogil=True)
def _field_path(
    graph: GraphAmongObstacles,
    to_target: np.ndarray,
    source: int,
    target: int,
    nodes: np.ndarray,
    edges: np.ndarray,
) -> tuple[float, int]:
    """What the cheapest path without obstacles costs among them, and its number of edges; inf where they block it.

    The path is written to nodes (n,) and edges (n,). Its cost is summed as the field was: from the target on.
    """
    first_slot, neighbour, edge_of, base, fixed, shares, evaluation, margin = graph
    evaluate_nodes(np.array([source, target]), evaluation)
    nodes[0], count = source, 0
    while nodes[count] != target:
        u, least, best = nodes[count], math.inf, -1
        for slot in range(first_slot[u], first_slot[u + 1]):
            through = base[edge_of[slot]] + to_target[neighbour[slot]]
            if through < least:
                least, best = through, slot
        if not to_target[neighbour[best]] < to_target[u]:
            # Edges without a length might lead around for ever.
            return math.inf, 0
        nodes[count + 1], edges[count] = neighbour[best], edge_of[best]
        count += 1
    evaluate_nodes(nodes[: count + 1], evaluation)
    factors, affected, clearance = evaluation.factors, evaluation.affected, evaluation.clearance
    cost = 0.0
    for i in range(count - 1, -1, -1):
        u, v, edge = nodes[i], nodes[i + 1], edges[i]
        if i > 0 and clearance[u] < margin:
            return math.inf, 0
        cost += edge_weight(fixed, shares, factors, edge, u, v) if affected[u] or affected[v] else base[edge]
    return cost, count


@numba.njit(cache=True, nogil=True)
def _go_on(
    graph: GraphAmongObstacles,
    to_target: np.ndarray,
    from_landmark: np.ndarray,
    source: int,
    target: int,
    best: float,
    meeting: int,
    batches: int,
    buffers: SearchBuffers,
) -> tuple[float, int, float]:
    """Bidirectional A* (W. Pijls and H. Post, "Yet another bidirectional algorithm for finding the shortest path",
    technical report EI 2009-10, Erasmus University Rotterdam, 2009), for so many batches of nodes.

    A node is settled once, by the side that takes it first. A side rejects what it takes where no path through it can
    be cheaper than the best so far: its cost, and the other side's smallest key less what that side still has to go.
    The search ends as soon as one side has no key left below the best cost. So all that counts is to raise the keys of
    one of them: each batch goes to the side whose keys have risen faster. Nothing better than `best` is found beyond
    the keys of either side: the larger of both smallest keys bounds the cost of every path from below.

    Returns the best cost, the node where both halves of that path meet (`meeting` as given where none is cheaper than
    the cost `best` as given), and the bound.
    """
    first_slot, neighbour, edge_of, base, fixed, shares, evaluation, margin = graph
    evaluated, factors = evaluation.evaluated, evaluation.factors
    affected, clearance = evaluation.affected, evaluation.clearance
    cost, predecessor, arrival, all_keys, all_items, places, size, begun, spent, written, count, _, _ = buffers
    at_source = from_landmark[source]
    while _lower_bound(all_keys, size) < best and batches > 0:
        batches -= 1
        risen = (all_keys[0, 0] - begun[0]) * spent[1], (all_keys[1, 0] - begun[1]) * spent[0]
        side = 0 if spent[0] == 0 or (spent[1] > 0 and risen[0] >= risen[1]) else 1
        other = 1 - side
        keys, items, place = all_keys[side], all_items[side], places[side]
        for _ in range(_BATCH):
            if size[side] == 0 or keys[0] >= best:
                break
            u = items[0]
            at_u = cost[side, u]
            size[side] = take(keys, items, place, size[side])
            if at_u == -math.inf:
                continue
            spent[side] += 1
            cost[side, u] = cost[other, u] = -math.inf
            behind = abs(from_landmark[u] - at_source) if side == 0 else to_target[u]
            if at_u + all_keys[other, 0] - behind >= best:
                continue
            for slot in range(first_slot[u], first_slot[u + 1]):
                v, edge = neighbour[slot], edge_of[slot]
                before, through = cost[side, v], at_u + base[edge]
                if through >= before:
                    continue
                left = abs(from_landmark[v] - at_source) if side == 1 else to_target[v]
                if through + left >= best:
                    continue
                # Tested here as well: a call takes as long as all else that is done for v.
                if not evaluated[v]:
                    evaluate_node(v, evaluation)
                closed = clearance[v] < margin and v != source and v != target
                if closed:
                    through = -math.inf
                elif affected[u] or affected[v]:
                    through = at_u + edge_weight(fixed, shares, factors, edge, u, v)
                # Where an obstacle is infinitely strong and a body point does not move there is no number to compare.
                if not (through < before and through + left < best):
                    continue
                if before == math.inf and cost[other, v] == math.inf:
                    written[count[0]] = v
                    count[0] += 1
                if closed:
                    cost[side, v] = cost[other, v] = -math.inf
                    continue
                cost[side, v], predecessor[side, v], arrival[side, v] = through, u, edge
                size[side] = put(keys, items, place, size[side], v, through + left)
                if through + cost[other, v] < best:
                    best, meeting = through + cost[other, v], v
    return best, meeting, min(best, _lower_bound(all_keys, size))


@numba.njit(cache=True, nogil=True)
def _lower_bound(keys: np.ndarray, size: np.ndarray) -> float:
    """The larger of the smallest keys of two heaps; inf where one of them is empty."""
    return max(keys[0, 0], keys[1, 0]) if size[0] > 0 and size[1] > 0 else math.inf


class ShortestPath(NamedTuple):
    """What a search has found: nodes (p,), edges (p - 1,) and the cost; none, and inf, where there is no path.

    Attributes
    ----------
    bound : no path costs less. It is the cost itself, or without a path the cap, but for searches that ran out of time.
    """

    nodes: np.ndarray
    edges: np.ndarray
    cost: float
    bound: float

    @property
    def gap(self) -> float:
        """How much more than the cheapest path this one costs at most, over that path's cost: cost <= (1 + gap) best.

        0 where the search came to its end.
        """
        if self.cost <= self.bound:
            return 0.0
        return self.cost / self.bound - 1.0 if self.bound > 0.0 else math.inf


def shortest_path_from_both_ends(
    adjacency: Adjacency,
    base: np.ndarray,
    fixed: np.ndarray,
    shares: np.ndarray,
    evaluation: NodeEvaluation,
    margin: float,
    to_target: np.ndarray,
    from_landmark: np.ndarray,
    source: int,
    target: int,
    cap: float = math.inf,
    deadline: Deadline = NEVER,
) -> ShortestPath:
    """`shortest_path` by bidirectional A*: the same cost, and fewer nodes reached where obstacles stand on the path.

    What the cheapest path without obstacles costs among them is known first: the search looks for what is cheaper.

    Parameters
    ----------
    to_target : (n,) obstacle-free cost to the target.
    from_landmark : (n,) obstacle-free cost to some node that the source can reach, the nearer to it the better: by the
        triangle inequality the source is no nearer to a node than the difference of their costs.
    cap : only paths that are cheaper count.
    deadline : when it has passed the best path so far is the answer, with the bound that is proved by then. With one,
        a search that has found none after some time looks for any path, and then for the cheapest again.
    """
    if not math.isfinite(to_target[source]):
        return ShortestPath(_NOTHING, _NOTHING, math.inf, math.inf)
    graph = GraphAmongObstacles.of(adjacency, base, fixed, shares, evaluation, margin)
    with lent_buffers(adjacency) as buffers:
        best, count = _field_path(graph, to_target, source, target, buffers.nodes, buffers.edges)
        found = best < cap
        best, meeting, bound = best if found else cap, -1, to_target[source]
        begin_at_both_ends(to_target, from_landmark, source, target, buffers)
        batches, looks = _UNLIMITED if deadline.at == math.inf else _BATCHES, 0
        while bound < best:
            best, meeting, bound = _go_on(
                graph, to_target, from_landmark, source, target, best, meeting, batches, buffers
            )
            looks += 1
            if deadline.passed:
                break
            if looks == _PATIENCE and not found and meeting < 0:
                ends = to_target, from_landmark, source, target
                cost, count, least = any_path(adjacency, graph, *ends, deadline.halfway, buffers.nodes, buffers.edges)
                found, best = cost < best, min(best, cost)
                bound = max(bound, min(best, least))
        if meeting >= 0:
            found, count = True, trace(meeting, source, target, buffers)
        if not found:
            return ShortestPath(_NOTHING, _NOTHING, math.inf, bound)
        return ShortestPath(buffers.nodes[: count + 1].copy(), buffers.edges[:count].copy(), best, bound)


def load_search_from_both_ends(
    adjacency: Adjacency,
    base: np.ndarray,
    fixed: np.ndarray,
    shares: np.ndarray,
    evaluation: NodeEvaluation,
    to_target: np.ndarray,
    from_landmark: np.ndarray,
    node: int,
) -> None:
    """Load the kernels of `shortest_path_from_both_ends`, or compile them: from a node to itself.

    A real search needs most of them only where obstacles make the free path dearer.
    """
    graph = GraphAmongObstacles.of(adjacency, base, fixed, shares, evaluation, -math.inf)
    evaluate_nodes(np.array([node]), evaluation)
    with lent_buffers(adjacency) as buffers:
        best, _ = _field_path(graph, to_target, node, node, buffers.nodes, buffers.edges)
        begin_at_both_ends(to_target, from_landmark, node, node, buffers)
        _go_on(graph, to_target, from_landmark, node, node, best, -1, _BATCHES, buffers)
        load_any_path(graph, to_target, node, buffers)
        trace(node, node, node, buffers)
