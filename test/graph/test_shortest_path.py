"""A* with the obstacle-free field against scipy's Dijkstra on the fully reweighted graph."""

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from geodesic_motion_ros.graph.ambient import ambient_factors, clearances
from geodesic_motion_ros.graph.grid import Adjacency, LatentGrid
from geodesic_motion_ros.graph.shortest_path import (
    cost_field,
    edge_weight,
    shortest_free_path,
    shortest_path,
    touched_nodes,
)


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

    def factors(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        centres = self.points[self.random.integers(len(self.points), size=count), 0]
        radii = self.random.uniform(0.05, 0.3, count)
        factors = ambient_factors(self.points, self.radii, centres, radii, 1e3, 0.5)
        return factors, clearances(self.points, self.radii, centres, radii, 0.0) < 0.0

    def oracle(self, factors: np.ndarray, blocked: np.ndarray, source: int) -> np.ndarray:
        mean = 0.5 * (factors[self.edges[:, 0]] + factors[self.edges[:, 1]])
        weights = np.sqrt(self.fixed + np.sum(mean * self.shares, axis=1))
        free = ~(blocked[self.edges[:, 0]] | blocked[self.edges[:, 1]])
        rows, columns = self.edges[free].T
        graph = coo_matrix((weights[free], (rows, columns)), shape=(len(blocked), len(blocked)))
        return dijkstra(graph.tocsr(), directed=False, indices=source)

    def solve(self, factors: np.ndarray, blocked: np.ndarray, source: int, target: int, heuristic: bool = True):
        field = cost_field(self.adjacency, self.base, target)
        return shortest_path(
            self.adjacency, self.base, self.fixed, self.shares, factors, touched_nodes(factors), blocked,
            field if heuristic else np.zeros(len(blocked)), source, target,
        )  # fmt: skip


SHAPES = [((25, 25), 8), ((25, 25), 16), ((9, 9, 9), 26), ((5, 5, 5, 5), 80)]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
def test_the_cost_is_that_of_dijkstra(seed, shape, neighbours):
    scene = Scene(seed, shape, neighbours)
    for obstacles in (0, 1, 5):
        factors, blocked = scene.factors(obstacles)
        free = np.flatnonzero(~blocked)
        source, target = scene.random.choice(free, 2, replace=False)
        expected = scene.oracle(factors, blocked, source)[target]
        for heuristic in (True, False):
            nodes, edges, cost = scene.solve(factors, blocked, source, target, heuristic)
            assert cost == pytest.approx(expected, rel=1e-9)
            if np.isfinite(cost):
                assert nodes[0] == source
                assert nodes[-1] == target
                assert not np.any(blocked[nodes])
                along = [
                    edge_weight(scene.fixed, scene.shares, factors, e, u, v)
                    for e, u, v in zip(edges, nodes[:-1], nodes[1:], strict=True)
                ]
                assert sum(along) == pytest.approx(cost, rel=1e-12)


def test_the_obstacle_free_field_is_a_consistent_heuristic_under_obstacles():
    scene = Scene(3, (20, 20), 16)
    field = cost_field(scene.adjacency, scene.base, 7)
    factors, _ = scene.factors(6)
    weights = [edge_weight(scene.fixed, scene.shares, factors, e, u, v) for e, (u, v) in enumerate(scene.edges)]
    reached = np.isfinite(field[scene.edges[:, 0]])
    jump = np.abs(field[scene.edges[reached, 0]] - field[scene.edges[reached, 1]])
    assert np.all(jump <= np.array(weights)[reached] * (1.0 + 1e-12))


@pytest.mark.parametrize("seed", range(20))
def test_more_obstacles_never_shorten_a_path(seed):
    scene = Scene(seed, (20, 20), 16)
    source, target = 3, len(scene.points) - 3
    centres = scene.points[scene.random.integers(len(scene.points), size=6), 0]
    radii = scene.random.uniform(0.05, 0.2, 6)
    cost = 0.0
    for count in range(7):
        factors = ambient_factors(scene.points, scene.radii, centres[:count], radii[:count], 1e3, 0.5)
        blocked = clearances(scene.points, scene.radii, centres[:count], radii[:count], 0.0) < 0.0
        _, _, longer = scene.solve(factors, blocked, source, target)
        assert longer >= cost
        cost = longer


def test_no_way_through_a_wall_is_said():
    scene = Scene(0, (20, 20), 8)
    blocked = np.zeros(len(scene.points), dtype=bool)
    blocked[scene.adjacency.node[scene.adjacency.first[0] : scene.adjacency.first[1]]] = True
    nodes, edges, cost = scene.solve(np.ones((len(blocked), 2)), blocked, 0, len(blocked) - 1)
    assert cost == np.inf
    assert len(nodes) == len(edges) == 0


def test_a_path_from_a_node_to_itself_is_that_node():
    scene = Scene(0, (10, 10), 8)
    nodes, edges, cost = scene.solve(np.ones((len(scene.points), 2)), np.zeros(len(scene.points), bool), 4, 4)
    assert (nodes.tolist(), len(edges), cost) == ([4], 0, 0.0)


def test_without_obstacles_the_short_form_finds_the_same_path():
    scene = Scene(5, (20, 20), 16)
    nowhere, target = np.zeros(len(scene.points), dtype=bool), 11
    field = cost_field(scene.adjacency, scene.base, target)
    long = scene.solve(np.ones((len(nowhere), 2)), nowhere, 200, target)
    short = shortest_free_path(scene.adjacency, scene.base, field, 200, target)
    np.testing.assert_array_equal(short[0], long[0])
    assert short[2] == long[2] == pytest.approx(field[200], rel=1e-12)


def test_shares_of_edges_that_no_obstacle_touches_are_never_read():
    scene = Scene(2, (20, 20), 16)
    factors, blocked = scene.factors(3)
    source, target = scene.random.choice(np.flatnonzero(~blocked), 2, replace=False)
    expected = scene.solve(factors, blocked, source, target)
    touched = touched_nodes(factors)
    untouched = ~(touched[scene.edges[:, 0]] | touched[scene.edges[:, 1]])
    assert 0 < np.count_nonzero(untouched) < len(untouched)
    scene.shares[untouched] = np.nan
    nodes, _, cost = scene.solve(factors, blocked, source, target)
    np.testing.assert_array_equal(nodes, expected[0])
    assert cost == expected[2]


def test_touched_nodes_are_those_with_a_factor_above_one():
    factors = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-12], [3.0, 1.0]])
    np.testing.assert_array_equal(touched_nodes(factors), [False, True, True])
