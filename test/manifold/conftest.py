"""What the tests of searches share: small graphs among random obstacles, and what Dijkstra says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.shapes import solid_rows
from geodesic_motion_ros.manifold.ambient_law import AmbientLaw
from geodesic_motion_ros.manifold.bidirectional_astar import ShortestPath, shortest_path_from_both_ends
from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import cost_field, edge_weight, shortest_path
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.utils.deadline import NEVER, Deadline


class Scene:
    """A random smooth embedding of a grid into a workspace, with K body points and a fixed part."""

    def __init__(self, seed: int, shape: tuple[int, ...], neighbours: int, body_points: int = 2) -> None:
        self.random = np.random.default_rng(seed)
        grid = LatentGrid(np.zeros(len(shape)), np.ones(len(shape)), shape)
        kept = self.random.random(np.prod(shape)) < 0.9
        nodes = grid.nodes()[kept]
        self.edges = grid.edges(grid.numbering(kept), neighbours)
        self.adjacency = Adjacency.from_edges(self.edges, len(nodes))
        waves = self.random.normal(size=(len(shape), 3 * body_points))
        self.points = np.sin(2.0 * nodes @ waves).reshape(len(nodes), body_points, 3)
        steps = self.points[self.edges[:, 0]] - self.points[self.edges[:, 1]]
        self.shares = np.sum(steps**2, axis=-1)
        self.fixed = self.random.exponential(1e-3, len(self.edges))
        self.radii = np.full(body_points, 0.02)
        self.base = np.sqrt(self.fixed + self.shares.sum(axis=1))

    def reshaped(self, count: int) -> NodeEvaluation:
        """Among random obstacles on the nodes, each with its reach into the whole."""
        centres = self.points[self.random.integers(len(self.points), size=count), 0]
        return self.among(centres, self.random.uniform(0.05, 0.3, count))

    def among(self, centres: np.ndarray, radii: np.ndarray) -> NodeEvaluation:
        return self.among_all(Obstacles.of_spheres(centres, radii))

    def weights(self, evaluation: NodeEvaluation) -> np.ndarray:
        """Of all edges (m,)."""
        evaluate_nodes(np.arange(len(self.points)), evaluation)
        known = self.fixed, self.shares, evaluation.factors
        return np.array([edge_weight(*known, edge, *ends) for edge, ends in enumerate(self.edges)])

    def among_all(self, obstacles: Obstacles, law: AmbientLaw = "gaussian") -> NodeEvaluation:
        return NodeEvaluation.of(NodeBody.of_tool(self.points, self.radii), obstacles, 1e3, 0.5, 0.1, law)

    def obstacles(self, spheres: int, solids: int, cloud: int) -> Obstacles:
        """So many of each kind on random nodes; the cloud has so many points."""
        centres, boxes, points = (
            self.points[self.random.integers(len(self.points), size=count), 0] for count in (spheres, solids, cloud)
        )
        rows = solid_rows(
            boxes, Rotation.random(solids, random_state=self.random).as_matrix(),
            self.random.uniform(0.0, 0.2, (solids, 3)), self.random.uniform(0.02, 0.1, solids),
        )  # fmt: skip
        return replace(
            Obstacles.of_spheres(centres, self.random.uniform(0.02, 0.2, spheres)), solids=rows,
            solid_velocities=np.zeros((solids, 3)), cloud=DistanceField.of(points, 0.02, 0.02, 0.05),
        )  # fmt: skip

    def from_both_ends(
        self, evaluation: NodeEvaluation, margin: float, source: int, target: int, deadline: Deadline = NEVER
    ) -> ShortestPath:
        fields = (cost_field(self.adjacency, self.base, end) for end in (target, source))
        graph = self.adjacency, self.base, self.fixed, self.shares, evaluation, margin
        return shortest_path_from_both_ends(*graph, *fields, source, target, deadline=deadline)

    def check(self, found: ShortestPath, evaluation: NodeEvaluation, margin: float, source: int, target: int) -> None:
        """It leads from source to target, keeps the margin, and costs what it says."""
        assert (found.nodes[0], found.nodes[-1]) == (source, target)
        assert np.all(evaluation.clearance[found.nodes[1:-1]] >= margin)
        along = [
            edge_weight(self.fixed, self.shares, evaluation.factors, e, u, v)
            for e, u, v in zip(found.edges, found.nodes[:-1], found.nodes[1:], strict=True)
        ]
        assert sum(along) == pytest.approx(found.cost, rel=1e-12)

    def oracle(self, evaluation: NodeEvaluation, margin: float, source: int, target: int) -> float:
        """Dijkstra's cost on the fully reweighted graph without the nodes that are too near."""
        evaluate_nodes(np.arange(len(evaluation.evaluated)), evaluation)
        mean = 0.5 * (evaluation.factors[self.edges[:, 0]] + evaluation.factors[self.edges[:, 1]])
        weights = np.sqrt(self.fixed + np.sum(mean * self.shares, axis=1))
        entered = evaluation.clearance >= margin
        entered[[source, target]] = True
        free = entered[self.edges].all(axis=1)
        rows, columns = self.edges[free].T
        graph = coo_matrix((weights[free], (rows, columns)), shape=(len(entered), len(entered)))
        return dijkstra(graph.tocsr(), directed=False, indices=source)[target]

    def solve(self, evaluation: NodeEvaluation, margin: float, source: int, target: int, heuristic: bool = True):
        field = cost_field(self.adjacency, self.base, target)
        return shortest_path(
            self.adjacency, self.base, self.fixed, self.shares, evaluation, margin,
            field if heuristic else np.zeros(len(field)), source, target,
        )  # fmt: skip


@pytest.fixture(scope="session", name="Scene")
def scene_class() -> type[Scene]:
    """`Scene(seed, shape, neighbours)` makes one."""
    return Scene
