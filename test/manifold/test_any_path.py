"""Any path is a path, found among far fewer nodes than the cheapest; that there is none is said when it is proved."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geodesic_motion_ros.manifold.any_path import any_path
from geodesic_motion_ros.manifold.bidirectional_astar import ShortestPath
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import cost_field
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

SHAPE, NEIGHBOURS = (20, 20, 20), 26


def found(scene, evaluation: NodeEvaluation, deadline: Deadline = NEVER) -> ShortestPath:
    """Any path from one end of a scene to the other."""
    source, target = 3, len(scene.points) - 3
    adjacency = scene.adjacency
    evaluate_nodes(np.array([source]), evaluation)
    graph = adjacency.first, adjacency.node, adjacency.edge, scene.base, scene.fixed, scene.shares, evaluation, 0.0
    fields = (cost_field(adjacency, scene.base, end) for end in (target, source))
    nodes, edges = np.empty((2, len(scene.points)), dtype=np.int32)
    cost, count, least = any_path(adjacency, graph, *fields, source, target, deadline, nodes, edges)
    return ShortestPath(nodes[: count + 1], edges[:count], cost, least)


def test_it_is_a_path_that_costs_what_it_says_and_few_nodes_are_looked_at(Scene):
    dearer = 0
    for seed in range(10):
        scene = Scene(seed, SHAPE, NEIGHBOURS)
        ends = 3, len(scene.points) - 3
        middle = scene.from_both_ends(scene.reshaped(0), 0.0, *ends).nodes
        around = scene.points[middle[len(middle) // 2], 0][None], np.array([0.3])
        evaluation, again = scene.among(*around), scene.among(*around)
        some = found(scene, evaluation)
        scene.check(some, evaluation, 0.0, *ends)
        cheapest = scene.from_both_ends(again, 0.0, *ends)
        assert cheapest.cost * (1.0 - 1e-12) <= some.cost < 5.0 * cheapest.cost
        dearer += some.cost > cheapest.cost * (1.0 + 1e-9)
        assert np.count_nonzero(evaluation.evaluated) <= np.count_nonzero(again.evaluated)
    assert dearer > 0


def test_that_there_is_none_is_proved_when_every_node_was_reached_and_not_before(Scene):
    scene = Scene(0, SHAPE, NEIGHBOURS)
    target = len(scene.points) - 3
    around = scene.adjacency.node[scene.adjacency.first[target] : scene.adjacency.first[target + 1]]
    wall = scene.points[around, 0], np.full(len(around), 1e-3)
    for deadline, least in ((NEVER, math.inf), (Deadline(-math.inf), 0.0)):
        none = found(scene, scene.among(*wall), deadline)
        assert (len(none.edges), none.cost, none.bound) == (0, math.inf, least)


def test_the_memory_is_given_back_as_it_was(Scene):
    """The next search finds what it finds on a graph that was never searched."""
    scene, fresh = Scene(1, SHAPE, NEIGHBOURS), Scene(1, SHAPE, NEIGHBOURS)
    centres, radii = scene.points[[4000], 0], np.array([0.2])
    found(scene, scene.among(centres, radii))
    ends = 3, len(scene.points) - 3
    after = scene.from_both_ends(scene.among(centres, radii), 0.0, *ends)
    expected = fresh.from_both_ends(fresh.among(centres, radii), 0.0, *ends)
    np.testing.assert_array_equal(after.nodes, expected.nodes)
    assert after.cost == pytest.approx(expected.cost, rel=0.0)
