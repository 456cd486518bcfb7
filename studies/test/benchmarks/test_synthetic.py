"""The made-up graph: weights of the form that the search wants, tubes and walls, the same every time."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_studies.benchmarks.engine import SearchProblem, free_path
from geodesic_motion_studies.benchmarks.synthetic import synthetic_problem


@pytest.mark.parametrize(("shape", "neighbours"), [((9, 9), 8), ((6, 7, 5), 26), ((4, 4, 4, 4), 80)])
def test_every_node_is_kept_and_inner_ones_have_all_neighbours(shape: tuple[int, ...], neighbours: int) -> None:
    problem = synthetic_problem(shape, 3)
    counts = np.diff(problem.adjacency.first).reshape(shape)
    assert counts[(slice(1, -1),) * len(shape)].min() == neighbours
    assert problem.body.points.shape == (np.prod(shape), 3, 3)
    assert np.all(np.isfinite(problem.to_goal))


def test_squared_lengths_are_the_sum_of_their_parts(problem: SearchProblem) -> None:
    graph = problem.graph
    np.testing.assert_allclose(graph.base**2, graph.fixed + graph.shares.sum(axis=1))
    assert graph.shares.min() >= 0.0
    assert graph.fixed.min() > 0.0


def test_tubes_are_cheap_and_walls_are_not(problem: SearchProblem) -> None:
    assert np.max(problem.graph.base) > 1e3 * np.min(problem.graph.base)
    path = free_path(problem)
    assert (path[0], path[-1]) == (problem.source, problem.target)
    assert problem.to_goal[path].max() < 0.1 * np.median(problem.to_goal)


def test_the_same_seed_makes_the_same_graph(problem: SearchProblem) -> None:
    again, other = synthetic_problem((16, 16, 16)), synthetic_problem((16, 16, 16), seed=1)
    np.testing.assert_array_equal(again.graph.base, problem.graph.base)
    assert not np.allclose(other.graph.base, problem.graph.base)


@pytest.mark.parametrize("points", [1, 8, 32])
def test_the_last_body_point_is_the_tool(points: int) -> None:
    few, one = synthetic_problem((5, 5, 5), points), synthetic_problem((5, 5, 5), 1)
    np.testing.assert_array_equal(few.body.points[:, few.tool], one.body.points[:, 0])
    assert len(np.unique(few.body.points[0], axis=0)) == points
