"""Evasion targets: free, near, in different directions, with a path back; the paths there begin where the tool is."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.graph.reshaping import Reshaping
from geodesic_motion_ros.graph.shortest_path import shortest_free_path
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planning.evasion_targets import paths_to_targets
from geodesic_motion_ros.planning.pose_path import PosePathPlanner
from geodesic_motion_ros.planning.settings import PlannerSettings

APART, STEPS = 0.01, 12


@pytest.fixture(scope="module")
def planner(fan_skill) -> PosePathPlanner:
    return PosePathPlanner(fan_skill)


def found(planner: PosePathPlanner, radius: float, steps: int = STEPS):
    """The paths on which a tool in the middle of its own evades a sphere around it, and what the search knows."""
    ends = np.split(planner.skill.start_pose, [3]), np.split(planner.skill.goal_pose, [3])
    query = planner.query(*ends[0], *ends[1])
    reference = planner.plan(*ends[0], *ends[1])
    middle = len(reference.latent) // 2
    sphere = Obstacles.of_spheres(reference.positions[middle][None], np.array([radius]))
    settings = PlannerSettings()
    reshaping = Reshaping.of(
        query.body, sphere, settings.ambient_strength, settings.ambient_width_ratio, 0.05, settings.ambient_law
    )
    start = reference.latent[middle]
    return list(paths_to_targets(planner.graph, query, start, reshaping, steps, APART)), start, reshaping, query


def test_targets_are_free_near_and_none_lies_behind_another(planner) -> None:
    paths, start, reshaping, query = found(planner, 0.03)
    assert len(paths) > 1
    ends = np.array([path.nodes[-1] for path in paths])
    assert np.all(reshaping.clearance[ends] >= APART)
    steps = (planner.graph.latent[ends] - start) / planner.graph.grid.spacing
    lengths = np.linalg.norm(steps, axis=1)
    assert np.all(np.diff(lengths) >= 0.0)
    assert np.max(np.abs(steps)) <= STEPS + 0.5
    cosines = (steps @ steps.T) / np.outer(lengths, lengths)
    assert np.max(cosines[~np.eye(len(ends), dtype=bool)]) < 0.7
    assert np.all(query.to_goal[ends] < query.cost_limit)


def test_paths_there_begin_where_the_tool_is_and_lead_from_node_to_node(planner) -> None:
    paths, start, _, _ = found(planner, 0.03)
    for path in paths:
        np.testing.assert_array_equal(path.polyline[0], start)
        np.testing.assert_array_equal(path.polyline[1:], planner.graph.latent[path.nodes])
        steps = np.abs(np.diff(planner.graph.latent[path.nodes], axis=0)) / planner.graph.grid.spacing
        assert np.max(steps, initial=0.0) < 4.0
        assert path.energy > 0.0


def test_paths_there_are_the_cheapest(planner) -> None:
    """Dijkstra's algorithm, without a heuristic, finds the same."""
    paths, _, _, query = found(planner, 0.03)
    for path in paths:
        nodes, _, _ = shortest_free_path(
            planner.graph.adjacency, query.graph.base, np.zeros_like(query.to_goal), path.nodes[0], path.nodes[-1]
        )
        np.testing.assert_array_equal(path.nodes, nodes)


def test_nowhere_free_is_no_path(planner) -> None:
    assert found(planner, 0.03)[0]
    assert not found(planner, 0.6)[0]
    assert not found(planner, 0.03, steps=1)[0]
