"""Exact shortest paths on the dense graph under the paper's ambient metric, a piece at a time.

An obstacle of radius r at o stretches space around a body point p by the ambient metric (IJRR 2023, eq. 30)

    m(p) = 1 + zeta sum_o exp(-|p - o|^2 / (2 r^2))

and the weight of an edge e = (u, v) from what it was to

    w_e = sqrt(b_e + sum_k (m_k(u) + m_k(v)) / 2 * a_ek).

The stretch of a node is worked out where the search first reaches it, for the present obstacles, and nothing of it is
kept: weights are those of a graph that was reset and reweighted as a whole. As every m is at least 1, the obstacle-free
cost to the target never overestimates and is consistent: A* with it finds what Dijkstra's algorithm finds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.heap import TAKEN, WAITING, put, take
from geodesic_motion_ros.manifold.shortest_path import cost_field, edge_weight
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: Nodes that are settled between two looks at the time: a fraction of a millisecond.
_BATCH = 256


class Front(NamedTuple):
    """What a search has found out of n nodes; one array an attribute, as of `heap` and `shortest_path`.

    factors : (n, K) m_k of the nodes that are `known` (n,).
    """

    cost: np.ndarray
    predecessor: np.ndarray
    keys: np.ndarray
    items: np.ndarray
    place: np.ndarray
    factors: np.ndarray
    known: np.ndarray

    @classmethod
    def of(cls, nodes: int, points: int) -> Front:
        """Before anything is known."""
        return cls(
            cost=np.full(nodes, math.inf),
            predecessor=np.full(nodes, -1, dtype=np.int32),
            keys=np.empty(nodes),
            items=np.empty(nodes, dtype=np.int32),
            place=np.full(nodes, WAITING, dtype=np.int32),
            factors=np.empty((nodes, points)),
            known=np.zeros(nodes, dtype=np.bool_),
        )


class GraphAmongSpheres(NamedTuple):
    """The dense graph among the present obstacles, as compiled kernels read it.

    Attributes
    ----------
    first, neighbour, edge : as of `Adjacency`. fixed, shares, base, points : as of `WeightedGraph`.
    centres, radii : (o, 3), (o,) [m]. strength : zeta.
    """

    first: np.ndarray
    neighbour: np.ndarray
    edge: np.ndarray
    fixed: np.ndarray
    shares: np.ndarray
    base: np.ndarray
    points: np.ndarray
    centres: np.ndarray
    radii: np.ndarray
    strength: float


@numba.njit(cache=True, nogil=True)
def ambient_factors(
    points: np.ndarray, centres: np.ndarray, radii: np.ndarray, strength: float, factors: np.ndarray
) -> None:
    """Write m (K,) of body points (K, 3) among spheres (o, 3), (o,) [m]; strength is zeta."""
    for k in range(len(points)):
        factors[k] = 1.0
        for o in range(len(radii)):
            squared = 0.0
            for a in range(3):
                squared += (points[k, a] - centres[o, a]) ** 2
            factors[k] += strength * math.exp(-0.5 * squared / radii[o] ** 2)


@numba.njit(cache=True, nogil=True)
def _settle(
    graph: GraphAmongSpheres,
    to_target: np.ndarray,
    target: int,
    cheapest: float,
    most: int,
    front: Front,
    size: int,
) -> int:
    """Settle at most so many nodes of A*; returns how many then wait, 0 where nothing cheaper than `cheapest` is left.

    The target is settled where its place is TAKEN.
    """
    first, neighbour, edge_of, fixed, shares, base, points, centres, radii, strength = graph
    cost, predecessor, keys, items, place, factors, known = front
    for _ in range(most):
        if size == 0 or keys[0] >= cheapest or place[target] == TAKEN:
            return 0
        u = items[0]
        size = take(keys, items, place, size)
        for slot in range(first[u], first[u + 1]):
            v, edge = neighbour[slot], edge_of[slot]
            least = cost[u] + base[edge]
            if place[v] == TAKEN or least >= cost[v] or least + to_target[v] >= cheapest:
                continue
            if not known[v]:
                ambient_factors(points[v], centres, radii, strength, factors[v])
                known[v] = True
            through = cost[u] + edge_weight(fixed, shares, factors, edge, u, v)
            if through < cost[v] and through + to_target[v] < cheapest:
                cost[v], predecessor[v] = through, u
                size = put(keys, items, place, size, v, through + to_target[v])
    return size


@numba.njit(cache=True, nogil=True)
def _free_path(graph: GraphAmongSpheres, to_target: np.ndarray, source: int, target: int) -> np.ndarray:
    """Nodes (p,) of the cheapest path without obstacles, down its field (n,)."""
    first, neighbour, edge_of, base = graph.first, graph.neighbour, graph.edge, graph.base
    nodes, count = np.empty(len(to_target), dtype=np.int32), 1
    nodes[0] = source
    while nodes[count - 1] != target:
        least = math.inf
        for slot in range(first[nodes[count - 1]], first[nodes[count - 1] + 1]):
            left = base[edge_of[slot]] + to_target[neighbour[slot]]
            if left < least:
                least, nodes[count] = left, neighbour[slot]
        count += 1
    return nodes[:count].copy()


@numba.njit(cache=True, nogil=True)
def _path_cost(graph: GraphAmongSpheres, nodes: np.ndarray) -> float:
    """What a path (p,) of nodes that are joined costs among the obstacles."""
    first, neighbour, edge_of, fixed, shares, _, points, centres, radii, strength = graph
    cost, factors = 0.0, np.empty((len(nodes), points.shape[1]))
    for i in range(len(nodes)):
        ambient_factors(points[nodes[i]], centres, radii, strength, factors[i])
        for slot in range(first[nodes[i]], first[nodes[i] + 1]):
            if i > 0 and neighbour[slot] == nodes[i - 1]:
                cost += edge_weight(fixed, shares, factors, edge_of[slot], i - 1, i)
    return cost


class LiteralSearch:
    """The search for one path after the other on a dense graph.

    Attributes
    ----------
    weights : of the graph.
    nodes : (p,) of the cheapest path known for the newest query; cost : what it costs; bound : no path costs less.
    finished : whether the path is the cheapest: cost equals bound. free : what the cheapest costs without obstacles.
    """

    def __init__(self, adjacency: Adjacency, weights: WeightedGraph, strength: float) -> None:
        """strength : zeta."""
        self._adjacency, self.weights, self._strength = adjacency, weights, strength
        self._target, self._to_target = -1, np.empty(0)
        self._centres, self._radii = np.empty((0, 3)), np.empty(0)
        self._front, self._size = Front.of(0, 0), 0
        self.nodes = np.empty(0, dtype=np.int32)
        self.cost = self.bound = self.free = math.inf
        self.finished = True

    def field(self, target: int) -> np.ndarray:
        """Obstacle-free cost (n,) from every node to a target, by Dijkstra's algorithm."""
        return cost_field(self._adjacency, self.weights.base, target)

    def aim(self, target: int, to_target: np.ndarray) -> None:
        """Search for paths to a target from now on; to_target : its `field`."""
        self._target, self._to_target = target, to_target
        self.abandon()

    def abandon(self) -> None:
        """End the search that runs; what it has found stays."""
        self.finished = True

    def begin(self, source: int, centres: np.ndarray, radii: np.ndarray, known: np.ndarray | None = None) -> None:
        """Ask for the cheapest path from a source among spheres (o, 3), (o,) [m].

        A path is known at once: the cheaper of the cheapest one without obstacles and `known` (p,), where given, which
        leads from the source to the target.
        """
        self._centres, self._radii = np.ascontiguousarray(centres), np.ascontiguousarray(radii)
        free = _free_path(self._graph, self._to_target, source, self._target)
        candidates = [free] + ([] if known is None else [known])
        costs = [self.path_cost(nodes) for nodes in candidates]
        best = int(np.argmin(costs))
        self.nodes, self.cost, self.free = candidates[best], costs[best], float(self._to_target[source])
        self.bound = self.free
        self._front = front = Front.of(len(self._to_target), self.weights.body_points.shape[1])
        front.cost[source], front.known[source] = 0.0, True
        points = self.weights.body_points[source]
        ambient_factors(points, self._centres, self._radii, self._strength, front.factors[source])
        self._size = put(front.keys, front.items, front.place, 0, source, self.bound)
        self.finished = self.cost <= self.bound

    def go_on(self, deadline: Deadline = NEVER) -> None:
        """Search until the path is the cheapest, or the deadline has passed."""
        if self.finished:
            return
        graph, front = self._graph, self._front
        while not self.finished and not deadline.passed:
            self._size = _settle(graph, self._to_target, self._target, self.cost, _BATCH, front, self._size)
            self.finished = self._size == 0
            self.bound = self.cost if self.finished else min(self.cost, float(front.keys[0]))
        if self.finished and front.cost[self._target] < self.cost:
            nodes = [self._target]
            while front.predecessor[nodes[-1]] >= 0:
                nodes.append(int(front.predecessor[nodes[-1]]))
            self.nodes = np.array(nodes[::-1], dtype=np.int32)
            self.cost = self.bound = float(front.cost[self._target])

    @property
    def gap(self) -> float:
        """How much more than the cheapest path this one costs at most, over that path's cost."""
        return 0.0 if self.finished or self.bound <= 0.0 else self.cost / self.bound - 1.0

    @property
    def energy_ratio(self) -> float:
        """Energy of the path, the square of what it costs, over that of the path without obstacles."""
        return (self.cost / self.free) ** 2 if 0.0 < self.free < math.inf else 1.0

    def path_cost(self, nodes: np.ndarray) -> float:
        """What a path (p,) costs among the present obstacles."""
        return _path_cost(self._graph, nodes)

    @property
    def _graph(self) -> GraphAmongSpheres:
        adjacency, weights = self._adjacency, self.weights
        return GraphAmongSpheres(
            adjacency.first, adjacency.node, adjacency.edge, weights.fixed, weights.shares, weights.base,
            weights.body_points, self._centres, self._radii, self._strength,
        )  # fmt: skip
