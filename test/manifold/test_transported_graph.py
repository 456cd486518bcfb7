"""The graph carried to a query, against a plain evaluation, on both sheets, with and without a conformal factor."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import cost_field, shortest_path
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.obstacles.obstacles import Obstacles

POINTS = {
    "one": np.zeros((1, 3)),
    "one off the origin": np.array([[0.02, -0.01, 0.1]]),
    "three": np.array([[0.0, 0.0, 0.0], [0.0, 0.1, -0.05], [0.03, 0.0, 0.08]]),
}


@pytest.fixture(scope="module", params=["raw", "canonical"])
def skill(request):
    return request.getfixturevalue("fan_skill" if request.param == "raw" else "canonical_fan_skill")


@pytest.fixture(scope="module")
def graph(skill):
    return skill.graph((60, 60))


def some_offsets(graph, seed: int = 0) -> Offsets:
    random = np.random.default_rng(seed)
    scale = np.repeat([0.05, 0.3], 3)
    corrections = random.normal(scale=0.05 * scale, size=(graph.mean_path_count, 9, 6))
    return Offsets(*random.normal(scale=scale, size=(2, 6)), 0.1, 0.9, corrections)


def some_factors(graph, seed: int = 0) -> np.ndarray:
    """Conformal factors (n,) from 1 to e^2."""
    return np.exp(np.random.default_rng(seed).uniform(0.0, 2.0, len(graph.latent)))


def test_the_ends_are_carried_exactly_and_the_graph_stays_as_it_is(graph):
    offsets = some_offsets(graph)
    before = graph.decoded.positions.copy()
    moved = graph.transported(offsets, POINTS["one"])
    displacements = offsets.displacements(graph.progress, graph.mean_path_shares)
    expected = carried(graph.decoded.positions, graph.decoded.quaternions, displacements)
    np.testing.assert_allclose(moved.positions, expected[0], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(moved.quaternions, expected[1], rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(graph.decoded.positions, before)


def test_without_offsets_nothing_moves(graph):
    moved = graph.transported(Offsets.none(graph.mean_path_count), POINTS["one"])
    np.testing.assert_array_equal(moved.positions, graph.decoded.positions)
    np.testing.assert_array_equal(moved.quaternions, graph.decoded.quaternions)
    np.testing.assert_allclose(moved.body_points[:, 0], graph.decoded.positions, atol=1e-15)


@pytest.mark.parametrize("conformal", [False, True])
@pytest.mark.parametrize("name", POINTS)
def test_edges_are_the_chords_of_the_carried_samples(skill, graph, name, conformal):
    """The kernels against a plain evaluation of the same sum."""
    offsets, points = some_offsets(graph, 1), POINTS[name]
    factors = some_factors(graph) if conformal else np.ones(len(graph.latent))
    carried_graph = graph.transported(offsets, points, factors if conformal else None)
    for e in np.random.default_rng(0).integers(len(graph.edges), size=20):
        ends = graph.latent[graph.edges[e]]
        latent = ends[0] + np.linspace(0.0, 1.0, 4)[:, None] * (ends[1] - ends[0])
        decoded = skill.decoder.decode(latent)
        moved = offsets.displacements(*graph.progress_map(latent))
        positions, quaternions = carried(decoded.positions, decoded.quaternions, moved)
        body = tool_points(positions, quaternions, points)
        sigma = 3.0 * np.sum((skill.metric.sigma_weight * np.diff(decoded.sigma, axis=0)) ** 2)
        chords = 3.0 * np.sum(np.diff(body, axis=0) ** 2, axis=(0, 2))
        factor = factors[graph.edges[e]].mean()
        np.testing.assert_allclose(carried_graph.shares[e], factor * (chords + sigma) / len(points), rtol=1e-6)
        turn = 3.0 * np.sum(np.diff(quaternions, axis=0) ** 2) + 3.0 * np.sum(np.diff(decoded.spread) ** 2)
        assert carried_graph.fixed[e] == pytest.approx(factor * turn, rel=1e-6)


def test_energies_are_without_the_conformal_factor(graph):
    plain = graph.transported(some_offsets(graph), POINTS["one"])
    factored = graph.transported(some_offsets(graph), POINTS["one"], some_factors(graph))
    np.testing.assert_allclose(factored.energies(), plain.energies(), rtol=1e-12)
    np.testing.assert_allclose(plain.energies(), plain.base**2, rtol=1e-12)
    assert np.all(factored.base >= plain.base)
    some = np.array([3, 1, 4])
    np.testing.assert_allclose(factored.energies(some), factored.energies()[some], rtol=1e-12)


def test_equal_tool_points_weigh_as_much_as_one(graph):
    one = graph.transported(some_offsets(graph), np.zeros((1, 3)))
    three = graph.transported(some_offsets(graph), np.zeros((3, 3)))
    np.testing.assert_allclose(three.base, one.base, rtol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_astar_costs_what_dijkstra_does_with_conformal_factor_and_obstacles(graph, seed):
    random = np.random.default_rng(seed)
    carried_graph = graph.transported(some_offsets(graph, seed), POINTS["three"], some_factors(graph, seed))
    radii = np.array([0.03, 0.0, 0.01])
    centres = carried_graph.body_points[random.integers(len(graph.latent), size=4), 0]
    body = NodeBody.of_tool(carried_graph.body_points, radii)
    obstacles = Obstacles.of_spheres(centres, random.uniform(0.01, 0.05, 4)), 1e3, 0.5, 0.05
    everything = NodeEvaluation.of(body, *obstacles)
    evaluate_nodes(np.arange(len(everything.evaluated)), everything)
    factors, blocked = everything.factors, everything.clearance < 0.0
    mean = 0.5 * (factors[graph.edges[:, 0]] + factors[graph.edges[:, 1]])
    weights = np.sqrt(carried_graph.fixed + np.sum(mean * carried_graph.shares, axis=1))
    free = ~blocked[graph.edges].any(axis=1)
    size = (len(graph.latent), len(graph.latent))
    matrix = coo_matrix((weights[free], tuple(graph.edges[free].T)), shape=size).tocsr()
    candidates = np.flatnonzero(~blocked & (graph.component == np.bincount(graph.component).argmax()))
    assert 0 < np.count_nonzero(blocked) < len(blocked)
    for source, target in random.choice(candidates, (4, 2), replace=False):
        field = cost_field(graph.adjacency, carried_graph.base, target)
        _, _, cost = shortest_path(
            graph.adjacency, carried_graph.base, carried_graph.fixed, carried_graph.shares,
            NodeEvaluation.of(body, *obstacles), 0.0, field, source, target,
        )  # fmt: skip
        expected = dijkstra(matrix, directed=False, indices=source)[target]
        assert cost == pytest.approx(expected, rel=1e-8)
        assert field[source] <= cost * (1.0 + 1e-9)
