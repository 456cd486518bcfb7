"""The same ticks by other means: well-known graph libraries, and this package's own Dijkstra.

A tick of a library is: weigh all edges anew under the obstacles, hand the weights over, search, name the path. All get
their weights from `EdgeWeights`, plain numpy that finds what obstacles touch in a tree and leaves the rest as it is;
that time counts for each of them. networkx is used as in the method's public scheme: copy the graph, rewrite its
weights, search. Libraries run on one thread.
"""

from __future__ import annotations

import importlib.util
from itertools import pairwise
from typing import ClassVar, Protocol

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from geodesic_motion_ros.geometry.distance_field import REACH, DistanceField, field_distances
from geodesic_motion_ros.manifold.ambient_metric import CUTOFF
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_studies.benchmarks.engine import Answer, SearchProblem


class EdgeWeights:
    """Weights of all edges of a problem under spheres and a cloud, with numpy."""

    def __init__(self, problem: SearchProblem) -> None:
        self._problem = problem
        self._first, self._second = np.ascontiguousarray(problem.graph.edges.T)
        body = problem.body
        self._points = cKDTree(body.points.reshape(-1, 3))
        self._spheres = self._points if body.spheres is body.points else cKDTree(body.spheres.reshape(-1, 3))

    def under(self, obstacles: Obstacles) -> np.ndarray:
        """(m,) the lengths that the engine gives them; inf at nodes that obstacles close, but for the two ends."""
        graph = self._problem.graph
        weights = graph.base.copy()
        factors = self._factors(obstacles.centres, obstacles.radii) + self._cloud_factors(obstacles.cloud)
        touched = np.any(factors > 1.0, axis=1)
        changed = np.flatnonzero(touched[self._first] | touched[self._second])
        both = factors[self._first[changed]] + factors[self._second[changed]]
        weights[changed] = np.sqrt(graph.fixed[changed] + 0.5 * np.einsum("mk,mk->m", both, graph.shares[changed]))
        closed = self._closed(obstacles)
        weights[closed[self._first] | closed[self._second]] = np.inf
        return weights

    def _factors(self, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Ambient factors (n, K), as `manifold.ambient_metric.ambient_factor`."""
        body, settings = self._problem.body, self._problem.settings
        shift = np.exp(-0.5 * CUTOFF**2)
        factors = np.ones(body.points.shape[:2])
        point_radii = np.tile(body.point_radii, len(factors))
        reach = CUTOFF * settings.ambient_width_ratio * (radii + body.point_radii.max())
        felt = self._points.query_ball_point(centres, reach, return_sorted=False)
        for points, centre, radius in zip(felt, centres, radii, strict=True):
            squared = np.sum((self._points.data[points] - centre) ** 2, axis=1)
            widths = settings.ambient_width_ratio * (radius + point_radii[points])
            excess = (np.exp(-0.5 * squared / widths**2) - shift) / (1.0 - shift)
            factors.reshape(-1)[points] += settings.ambient_strength * np.maximum(excess, 0.0)
        return factors

    def _cloud_factors(self, cloud: DistanceField) -> np.ndarray:
        """What a cloud adds to the factors (n, K), as `manifold.ambient_metric.cloud_factor`; 0 without one."""
        body, settings = self._problem.body, self._problem.settings
        if not cloud.squares.size:
            return np.zeros(())
        widths = settings.ambient_width_ratio * (cloud.thickness + body.point_radii)
        cuts = np.minimum(CUTOFF * widths, REACH - cloud.edge - cloud.surface + cloud.thickness)
        distances = field_distances(body.points.reshape(-1, 3), *cloud).reshape(body.points.shape[:2])
        shifts = np.exp(-0.5 * (cuts / widths) ** 2)
        away = np.minimum(np.maximum(distances + cloud.thickness, 0.0), cuts)
        return settings.ambient_strength * (np.exp(-0.5 * (away / widths) ** 2) - shifts) / (1.0 - shifts)

    def _closed(self, obstacles: Obstacles) -> np.ndarray:
        """Nodes (n,) where the body has less than the margin, but for the two ends."""
        problem, body, centres, radii = self._problem, self._problem.body, obstacles.centres, obstacles.radii
        nodes, count = body.spheres.shape[:2]
        closed = np.zeros(nodes, dtype=bool)
        margin = problem.settings.obstacle_margin
        reach = radii + body.sphere_radii.max() + margin
        near = self._spheres.query_ball_point(centres, reach, return_sorted=False)
        for found, centre, radius in zip(near, centres, radii, strict=True):
            sphere = np.asarray(found, dtype=int)
            distance = np.linalg.norm(self._spheres.data[sphere] - centre, axis=1)
            closed[sphere[distance - radius - body.sphere_radii[sphere % count] < margin] // count] = True
        if obstacles.cloud.squares.size:
            distances = field_distances(body.spheres.reshape(-1, 3), *obstacles.cloud).reshape(nodes, count)
            closed |= np.any(distances - body.sphere_radii < margin, axis=1)
        closed[[problem.source, problem.target]] = False
        return closed


class Peer(Protocol):
    """A library that finds the cheapest path of one problem under given weights.

    Attributes
    ----------
    module : what has to be installed.
    """

    module: ClassVar[str]

    def __init__(self, problem: SearchProblem) -> None: ...

    def answer(self, weights: np.ndarray) -> Answer:
        """The cheapest path under edge weights (m,)."""
        ...


class Scipy:
    """`scipy.sparse.csgraph.dijkstra` from the source to everywhere: it has no target."""

    module = "scipy"

    def __init__(self, problem: SearchProblem) -> None:
        self._problem = problem
        adjacency = problem.adjacency
        self._matrix = csr_matrix(
            (problem.graph.base[adjacency.edge], adjacency.node, adjacency.first), shape=(problem.nodes,) * 2
        )

    def answer(self, weights: np.ndarray) -> Answer:
        source, target = self._problem.source, self._problem.target
        self._matrix.data[:] = weights[self._problem.adjacency.edge]
        costs, before = dijkstra(self._matrix, indices=source, return_predecessors=True)
        if not np.isfinite(costs[target]):
            return Answer(np.empty(0, dtype=int), np.inf)
        nodes = [target]
        while nodes[-1] != source:
            nodes.append(before[nodes[-1]])
        return Answer(np.array(nodes[::-1]), float(costs[target]))


class Igraph:
    """`Graph.get_shortest_path` between the two ends."""

    module = "igraph"

    def __init__(self, problem: SearchProblem) -> None:
        self._problem = problem
        self._graph = importlib.import_module("igraph").Graph(problem.nodes, problem.graph.edges.tolist())

    def answer(self, weights: np.ndarray) -> Answer:
        source, target = self._problem.source, self._problem.target
        edges = self._graph.get_shortest_path(source, target, weights.tolist(), output="epath")
        return _of_edges(self._problem, weights, np.array(edges, dtype=int))


class Networkit:
    """`networkit.distance.Dijkstra` with a target, on a graph that is made anew with the weights.

    It is given no closed edges: setting each weight by itself would take longer.
    """

    module = "networkit"

    def __init__(self, problem: SearchProblem) -> None:
        self._problem = problem
        self._library = importlib.import_module("networkit")
        self._library.setNumberOfThreads(1)
        self._first, self._second = np.ascontiguousarray(problem.graph.edges.T.astype(np.uint64))

    def answer(self, weights: np.ndarray) -> Answer:
        source, target = self._problem.source, self._problem.target
        open_ = np.isfinite(weights)
        triplets = weights[open_], (self._first[open_], self._second[open_])
        graph = self._library.GraphFromCoo(triplets, n=self._problem.nodes, weighted=True)
        search = self._library.distance.Dijkstra(graph, source, True, False, target)
        search.run()
        nodes = np.array(search.getPath(target), dtype=int)
        if len(nodes) < 2:
            return Answer(np.empty(0, dtype=int), np.inf)
        return Answer(nodes, float(search.distance(target)))


class Networkx:
    """Copy the graph, rewrite every weight, `shortest_path`."""

    module = "networkx"

    def __init__(self, problem: SearchProblem) -> None:
        self._problem = problem
        self._library = importlib.import_module("networkx")
        self._edges = problem.graph.edges.tolist()
        self._graph = self._library.Graph()
        self._graph.add_nodes_from(range(problem.nodes))
        self._graph.add_weighted_edges_from(
            (u, v, weight) for (u, v), weight in zip(self._edges, problem.graph.base.tolist(), strict=True)
        )

    def answer(self, weights: np.ndarray) -> Answer:
        graph = self._graph.copy()
        for (u, v), weight in zip(self._edges, weights.tolist(), strict=True):
            graph[u][v]["weight"] = weight
        source, target = self._problem.source, self._problem.target
        nodes = self._library.shortest_path(graph, source, target, weight="weight", method="dijkstra")
        cost = sum(graph[u][v]["weight"] for u, v in pairwise(nodes))
        return Answer(np.array(nodes) if np.isfinite(cost) else np.empty(0, dtype=int), float(cost))


PEERS: tuple[type[Peer], ...] = (Scipy, Igraph, Networkit, Networkx)


def installed(peers: tuple[type[Peer], ...] = PEERS) -> tuple[list[type[Peer]], list[str]]:
    """Those that can be imported, and the names of the others."""
    found = [peer for peer in peers if importlib.util.find_spec(peer.module) is not None]
    return found, [peer.module for peer in peers if peer not in found]


def _of_edges(problem: SearchProblem, weights: np.ndarray, edges: np.ndarray) -> Answer:
    """The nodes along edges (p - 1,) from the source on, and their cost."""
    cost = float(np.sum(weights[edges]))
    if not (len(edges) and np.isfinite(cost)):
        return Answer(np.empty(0, dtype=int), np.inf)
    nodes = [problem.source]
    for u, v in problem.graph.edges[edges].tolist():
        nodes.append(v if u == nodes[-1] else u)
    return Answer(np.array(nodes), cost)
