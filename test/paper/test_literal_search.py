"""The search of the paper's planner: what Dijkstra's algorithm finds on the graph that is reweighted as a whole."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from geodesic_motion_ros.paper.literal_search import LiteralSearch
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.utils.deadline import Deadline


@pytest.fixture
def spheres(shared: PaperPlanner):
    """Draws centres (o, 3) near body points of some nodes, and radii (o,) [m]."""
    points = shared.weights.body_points.reshape(-1, 3)

    def drawn(random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        some = points[random.integers(len(points), size=count)]
        return some + random.normal(scale=0.03, size=(count, 3)), random.uniform(0.02, 0.12, size=count)

    return drawn


def reweighted(planner: PaperPlanner, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Weights (m,) of all edges, by the paper's formula as it is written."""
    weights, stretch = planner.weights, np.ones(planner.weights.body_points.shape[:2])
    for centre, radius in zip(centres, radii, strict=True):
        squared = np.sum((weights.body_points - centre) ** 2, axis=-1)
        stretch += planner.settings.strength * np.exp(-squared / (2.0 * radius**2))
    mean = stretch[weights.edges].mean(axis=1)
    return np.sqrt(weights.fixed + np.sum(mean * weights.shares, axis=1))


def dijkstra_cost(planner: PaperPlanner, weights: np.ndarray, source: int, target: int) -> float:
    nodes, (first, second) = len(planner.graph.latent), planner.weights.edges.T
    graph = csr_matrix((weights, (first, second)), shape=(nodes, nodes))
    return float(dijkstra(graph, directed=False, indices=source)[target])


def search_of(planner: PaperPlanner) -> LiteralSearch:
    return LiteralSearch(planner.graph.adjacency, planner.weights, planner.settings.strength)


def test_costs_are_dijkstras_on_the_whole_reweighted_graph(shared, spheres) -> None:
    random, search = np.random.default_rng(0), search_of(shared)
    dearer = 0
    for query in range(12):
        source, target = (int(node) for node in random.choice(len(shared.graph.latent), 2, replace=False))
        obstacles = spheres(random, query % 11)
        search.aim(target, search.field(target))
        search.begin(source, *obstacles)
        at_first = search.cost
        search.go_on()
        expected = dijkstra_cost(shared, reweighted(shared, *obstacles), source, target)
        assert search.finished
        assert search.gap == 0.0
        np.testing.assert_allclose(search.cost, expected, rtol=1e-9)
        assert (search.nodes[0], search.nodes[-1]) == (source, target)
        np.testing.assert_allclose(search.path_cost(search.nodes), search.cost, rtol=1e-9)
        dearer += at_first > expected * (1.0 + 1e-6)
    assert dearer > 0  # that obstacles did make the first path known too dear, in some query


def test_a_search_in_pieces_bounds_the_cost_and_ends_where_the_whole_one_does(shared, spheres) -> None:
    random = np.random.default_rng(3)
    ends = [int(node) for node in random.choice(len(shared.graph.latent), 2, replace=False)]
    obstacles, whole, pieces = spheres(random, 6), search_of(shared), search_of(shared)
    for search in (whole, pieces):
        search.aim(ends[1], search.field(ends[1]))
        search.begin(ends[0], *obstacles)
    whole.go_on()
    bounds = [pieces.bound]
    while not pieces.finished:
        # A clock on which one batch of nodes fits between two looks.
        pieces.go_on(Deadline(0.5, itertools.count().__next__))
        bounds.append(pieces.bound)
        np.testing.assert_allclose(pieces.path_cost(pieces.nodes), pieces.cost, rtol=1e-9)
        assert pieces.bound <= whole.cost * (1.0 + 1e-12) <= pieces.cost * (1.0 + 2e-12)
        assert pieces.cost <= (1.0 + pieces.gap) * whole.cost * (1.0 + 1e-9)
    assert len(bounds) > 3
    assert all(later >= earlier for earlier, later in itertools.pairwise(bounds))
    assert pieces.cost == whole.cost
    np.testing.assert_array_equal(pieces.nodes, whole.nodes)


def test_obstacles_that_leave_leave_no_trace(shared, spheres) -> None:
    random, search = np.random.default_rng(1), search_of(shared)
    source, target = (int(node) for node in random.choice(len(shared.graph.latent), 2, replace=False))
    search.aim(target, search.field(target))
    nothing = np.empty((0, 3)), np.empty(0)
    search.begin(source, *nothing)
    search.go_on()
    nodes, cost = search.nodes, search.cost
    search.begin(source, *spheres(random, 8))
    search.go_on()
    search.begin(source, *nothing)
    search.go_on()
    np.testing.assert_array_equal(search.nodes, nodes)
    assert search.cost == cost


def test_a_path_that_is_known_already_is_kept_until_a_cheaper_one_is_found(shared, spheres) -> None:
    random, search = np.random.default_rng(2), search_of(shared)
    source, target = (int(node) for node in random.choice(len(shared.graph.latent), 2, replace=False))
    obstacles = spheres(random, 5)
    search.aim(target, search.field(target))
    search.begin(source, *obstacles)
    search.go_on()
    best = search.nodes
    search.begin(source, *obstacles, known=best)
    np.testing.assert_array_equal(search.nodes, best)
    search.go_on()
    np.testing.assert_array_equal(search.nodes, best)
