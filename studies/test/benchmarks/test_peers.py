"""Every library answers the same question: the same weights, the same cost."""

from __future__ import annotations

import importlib.util
from itertools import pairwise

import numpy as np
import pytest

from geodesic_motion_ros.manifold.obstacle_weights import evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import edge_weight
from geodesic_motion_studies.benchmarks.engine import (
    SearchProblem,
    mark,
    search,
    search_from_source,
    search_plainly,
)
from geodesic_motion_studies.benchmarks.peers import PEERS, EdgeWeights, Networkx, Peer, Scipy, installed
from geodesic_motion_studies.benchmarks.scenes import NAMES, scenes_of


def cost_along(problem: SearchProblem, weights: np.ndarray, nodes: np.ndarray) -> float:
    number = {tuple(sorted(edge)): i for i, edge in enumerate(problem.graph.edges.tolist())}
    return float(sum(weights[number[tuple(sorted(pair))]] for pair in pairwise(nodes.tolist())))


@pytest.mark.parametrize("name", ["one_r010", "wall_gap", "cloud_10k"])
def test_weights_are_those_that_the_engine_gives_its_edges(name: str, problem: SearchProblem) -> None:
    scene = next(scene for scene in scenes_of(problem) if scene.name == name)
    evaluation = mark(problem, scene.at(8))
    evaluate_nodes(np.arange(problem.nodes), evaluation)
    closed = evaluation.clearance < problem.settings.obstacle_margin
    closed[[problem.source, problem.target]] = False
    graph = problem.graph
    expected = np.array(
        [
            np.inf if closed[u] or closed[v] else edge_weight(graph.fixed, graph.shares, evaluation.factors, e, u, v)
            for e, (u, v) in enumerate(graph.edges.tolist())
        ]
    )
    weights = EdgeWeights(problem).under(scene.at(8))
    np.testing.assert_allclose(weights, expected, rtol=1e-12)
    assert np.any(weights > 1.1 * graph.base)
    assert np.any(weights == graph.base)


@pytest.mark.parametrize("peer", PEERS, ids=[peer.module for peer in PEERS])
def test_all_find_the_cost_that_the_engine_finds(peer: type[Peer], problem: SearchProblem) -> None:
    pytest.importorskip(peer.module)
    library, weights = peer(problem), EdgeWeights(problem)
    finite = 0
    for scene in scenes_of(problem):
        lengths = weights.under(scene.at(5))
        ours, theirs = search(problem, mark(problem, scene.at(5)), limited=False), library.answer(lengths)
        assert theirs.cost == pytest.approx(ours.cost, rel=1e-9)
        for other in (search_from_source, search_plainly):
            assert other(problem, scene.at(5)).cost == pytest.approx(ours.cost, rel=1e-9)
        if np.isfinite(theirs.cost):
            finite += 1
            assert (theirs.nodes[0], theirs.nodes[-1]) == (problem.source, problem.target)
            assert cost_along(problem, lengths, theirs.nodes) == pytest.approx(theirs.cost, rel=1e-9)
        else:
            assert len(theirs.nodes) == 0
    assert 3 <= finite < len(NAMES)


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "igraph" else found(name))
    there, missing = installed()
    assert missing[:1] == ["igraph"]
    assert {Scipy, Networkx} & set(there)
    assert len(there) + len(missing) == len(PEERS)
