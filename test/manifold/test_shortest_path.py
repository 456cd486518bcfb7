"""A* with the obstacle-free field against scipy's Dijkstra on the fully reweighted graph."""

import numpy as np
import pytest

from geodesic_motion_ros.manifold.ambient_law import LAWS
from geodesic_motion_ros.manifold.bidirectional_astar import shortest_path_from_both_ends
from geodesic_motion_ros.manifold.obstacle_weights import evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import cost_field, edge_weight, shortest_free_path

SHAPES = [((25, 25), 8), ((25, 25), 16), ((9, 9, 9), 26), ((5, 5, 5, 5), 80)]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
def test_the_cost_is_that_of_dijkstra(Scene, seed, shape, neighbours):
    scene = Scene(seed, shape, neighbours)
    for obstacles in (0, 1, 5):
        evaluation = scene.reshaped(obstacles)
        source, target = scene.random.choice(len(scene.points), 2, replace=False)
        for margin in (0.0, 0.05):
            costs = []
            for heuristic in (True, False):
                unseen = scene.among(evaluation.centres, evaluation.radii)
                nodes, edges, cost = scene.solve(unseen, margin, source, target, heuristic)
                costs.append(cost)
                if np.isfinite(cost):
                    assert (nodes[0], nodes[-1]) == (source, target)
                    assert np.all(unseen.clearance[nodes[1:-1]] >= margin)
                    along = [
                        edge_weight(scene.fixed, scene.shares, unseen.factors, e, u, v)
                        for e, u, v in zip(edges, nodes[:-1], nodes[1:], strict=True)
                    ]
                    assert sum(along) == pytest.approx(cost, rel=1e-12)
            assert costs == pytest.approx([scene.oracle(evaluation, margin, source, target)] * 2, rel=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("shape", "neighbours"), SHAPES)
def test_the_heuristic_is_exact_under_every_law(Scene, shape, neighbours, seed, law):
    scene = Scene(seed, shape, neighbours)
    obstacles = scene.obstacles(3, 1, 20)
    source, target = scene.random.choice(len(scene.points), 2, replace=False)
    # Without the removal of nodes the law alone keeps paths off.
    for margin in (-np.inf, 0.05):
        costs = [
            scene.solve(scene.among_all(obstacles, law), margin, source, target, heuristic)[2]
            for heuristic in (True, False)
        ]
        expected = scene.oracle(scene.among_all(obstacles, law), margin, source, target)
        assert costs == pytest.approx([expected] * 2, rel=1e-9)


def test_when_all_obstacles_have_vanished_every_weight_is_what_it_was(Scene):
    """To the last bit, after 1 to 50 obstacles; while they are there many weigh more."""
    scene = Scene(1, (30, 30), 16)
    before = scene.weights(scene.reshaped(0))
    for count in (1, 2, 5, 10, 20, 50):
        among = scene.weights(scene.reshaped(count))
        assert np.all(among >= before)
        assert np.sum(among > before) > 50
    assert scene.weights(scene.reshaped(0)).tobytes() == before.tobytes()


def test_the_obstacle_free_field_is_a_consistent_heuristic_under_obstacles(Scene):
    scene = Scene(3, (20, 20), 16)
    field = cost_field(scene.adjacency, scene.base, 7)
    evaluation = scene.reshaped(6)
    evaluate_nodes(np.arange(len(evaluation.evaluated)), evaluation)
    weights = [
        edge_weight(scene.fixed, scene.shares, evaluation.factors, e, u, v) for e, (u, v) in enumerate(scene.edges)
    ]
    reached = np.isfinite(field[scene.edges[:, 0]])
    jump = np.abs(field[scene.edges[reached, 0]] - field[scene.edges[reached, 1]])
    assert np.all(jump <= np.array(weights)[reached] * (1.0 + 1e-12))


@pytest.mark.parametrize("seed", range(20))
def test_more_obstacles_never_shorten_a_path(Scene, seed):
    scene = Scene(seed, (20, 20), 16)
    source, target = 3, len(scene.points) - 3
    centres = scene.points[scene.random.integers(len(scene.points), size=6), 0]
    radii = scene.random.uniform(0.05, 0.2, 6)
    cost = 0.0
    for count in range(7):
        _, _, longer = scene.solve(scene.among(centres[:count], radii[:count]), 0.0, source, target)
        assert longer >= cost * (1.0 - 1e-12)
        cost = longer


def test_no_path_through_a_wall_is_reported(Scene):
    scene = Scene(0, (20, 20), 8)
    around = scene.adjacency.node[scene.adjacency.first[0] : scene.adjacency.first[1]]
    wall = scene.among(scene.points[around, 0], np.full(len(around), 1e-3))
    nodes, edges, cost = scene.solve(wall, 0.0, 0, len(scene.points) - 1)
    assert cost == np.inf
    assert len(nodes) == len(edges) == 0


def test_a_path_from_a_node_to_itself_is_that_node(Scene):
    scene = Scene(0, (10, 10), 8)
    nodes, edges, cost = scene.solve(scene.reshaped(0), 0.0, 4, 4)
    assert (nodes.tolist(), len(edges), cost) == ([4], 0, 0.0)
    field = cost_field(scene.adjacency, scene.base, 4)
    graph = scene.adjacency, scene.base, scene.fixed, scene.shares, scene.reshaped(0), 0.0
    nodes, edges, cost, _ = shortest_path_from_both_ends(*graph, field, field, 4, 4)
    assert (nodes.tolist(), len(edges), cost) == ([4], 0, 0.0)


def test_without_obstacles_the_short_form_finds_the_same_path(Scene):
    scene = Scene(5, (20, 20), 16)
    target = 11
    field = cost_field(scene.adjacency, scene.base, target)
    long = scene.solve(scene.reshaped(0), 0.0, 200, target)
    short = shortest_free_path(scene.adjacency, scene.base, field, 200, target)
    np.testing.assert_array_equal(short[0], long[0])
    assert short[2] == long[2] == pytest.approx(field[200], rel=1e-12)


def test_only_what_the_search_reaches_is_looked_at(Scene):
    scene = Scene(2, (20, 20), 16)
    evaluation = scene.reshaped(3)
    scene.solve(evaluation, 0.0, 200, 11)
    assert 0 < np.count_nonzero(evaluation.evaluated) < len(evaluation.evaluated)


def test_shares_of_edges_that_no_obstacle_touches_are_never_read(Scene):
    scene = Scene(2, (20, 20), 16)
    evaluation = scene.reshaped(3)
    expected = scene.solve(evaluation, 0.0, 200, 11)
    evaluate_nodes(np.arange(len(evaluation.evaluated)), evaluation)
    untouched = ~evaluation.affected[scene.edges].any(axis=1)
    assert 0 < np.count_nonzero(untouched) < len(untouched)
    scene.shares[untouched] = np.nan
    nodes, _, cost = scene.solve(scene.among(evaluation.centres, evaluation.radii), 0.0, 200, 11)
    np.testing.assert_array_equal(nodes, expected[0])
    assert cost == expected[2]
