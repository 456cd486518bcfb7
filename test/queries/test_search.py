"""The cheapest path through a skill's graph when time runs out."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.manifold import bidirectional_astar
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.search import KnownPaths, LatentPath, cheapest_path, is_same_path
from geodesic_motion_ros.utils.deadline import Deadline
from geodesic_motion_studies.benchmarks.engine import mark
from geodesic_motion_studies.benchmarks.scenes import spheres_on_path
from geodesic_motion_studies.benchmarks.stages import SkillBench

PASSED = Deadline(-np.inf)


@pytest.fixture(scope="module")
def bench(reach_skill) -> SkillBench:
    return SkillBench(reach_skill)


def search(bench: SkillBench, obstacles: Obstacles, *deadline: Deadline):
    evaluation = mark(bench.problem, obstacles)
    return cheapest_path(bench.planner.graph, bench.query, bench.query.start_latent, evaluation, 0.005, *deadline)


def test_out_of_time_before_a_path_is_found_the_verdict_says_so(bench, monkeypatch) -> None:
    monkeypatch.setattr(bidirectional_astar, "_BATCHES", 1)
    blocked = spheres_on_path(bench.problem, 1).at(0)
    whole = search(bench, blocked)
    assert isinstance(whole, LatentPath)
    assert whole.gap == 0.0
    missed = search(bench, blocked, PASSED)
    assert missed.code is VerdictCode.DEADLINE_MISSED
    assert "out of time" in missed.reason


def test_a_free_path_needs_no_time(bench, monkeypatch) -> None:
    monkeypatch.setattr(bidirectional_astar, "_BATCHES", 1)
    found = search(bench, Obstacles.none(), PASSED)
    assert isinstance(found, LatentPath)
    assert found.gap == 0.0
    np.testing.assert_array_equal(found.nodes, search(bench, Obstacles.none()).nodes)


def test_a_path_is_the_same_where_its_end_is_whatever_node_it_enters_the_graph_by() -> None:
    known = np.arange(10, 30)
    assert is_same_path(known, known)
    assert is_same_path(known[5:], known)
    assert is_same_path(np.concatenate([[3, 2, 1], known[5:]]), known)
    assert not is_same_path(np.concatenate([[4, 3, 2, 1], known[5:]]), known)
    assert not is_same_path(np.append(known, 30), known)
    assert not is_same_path(known[:-1], known)
    assert not is_same_path(np.concatenate([[0], known, [30]]), known)
    assert not is_same_path(known[-3:], known)


def along(nodes: np.ndarray, undisturbed: bool = True) -> LatentPath:
    return LatentPath(nodes, np.empty((0, 2)), 0.0, 0.0, undisturbed)


@pytest.mark.parametrize(
    ("followed", "rejected", "found", "known"),
    [
        (True, True, True, True),
        (True, None, True, False),  # none was judged yet
        (False, True, True, False),  # obstacles have been felt in one of the searches
        (True, False, True, False),
        (True, True, False, False),
    ],
)
def test_where_no_obstacle_is_felt_a_path_over_other_nodes_is_judged_once(
    followed: bool, rejected: bool | None, found: bool, known: bool
) -> None:
    before, other, another = np.arange(10, 30), np.arange(40, 60), np.arange(70, 90)
    paths = KnownPaths(along(before, followed), None if rejected is None else along(other, rejected))
    assert paths.include(along(another, found)) is known
    assert paths.include(along(before[5:], found))


def test_a_path_is_undisturbed_where_no_obstacle_is_felt_in_its_search(bench) -> None:
    far = Obstacles.of_spheres(np.array([[0.0, 0.0, 4.0]]), np.array([0.06]))
    assert search(bench, Obstacles.none()).undisturbed
    assert search(bench, far).undisturbed
    assert not search(bench, spheres_on_path(bench.problem, 1).at(0)).undisturbed
