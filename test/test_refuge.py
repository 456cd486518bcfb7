"""Refuges: free, near, in different directions, and with a way back; the ways there begin where the tool is."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.graph.reshaping import Reshaping
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.planning.pose_path import PosePathPlanner
from geodesic_motion_ros.refuge import ways_aside

APART, STEPS = 0.01, 12


@pytest.fixture(scope="module")
def planner(fan_skill) -> PosePathPlanner:
    return PosePathPlanner(fan_skill)


def asked(planner: PosePathPlanner, radius: float, steps: int = STEPS):
    """Where a tool in the middle of its way would go aside from a sphere around it, and what it is told of nodes."""
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
    return list(ways_aside(planner.graph, query, start, reshaping, steps, APART)), start, reshaping, query


def test_refuges_are_free_near_and_none_lies_behind_another(planner) -> None:
    ways, start, reshaping, query = asked(planner, 0.03)
    assert len(ways) > 1
    ends = np.array([way.nodes[-1] for way in ways])
    assert np.all(reshaping.clearance[ends] >= APART)
    steps = (planner.graph.latent[ends] - start) / planner.graph.grid.spacing
    lengths = np.linalg.norm(steps, axis=1)
    assert np.all(np.diff(lengths) >= 0.0)
    assert np.max(np.abs(steps)) <= STEPS + 0.5
    cosines = (steps @ steps.T) / np.outer(lengths, lengths)
    assert np.max(cosines[~np.eye(len(ends), dtype=bool)]) < 0.7
    assert np.all(query.to_goal[ends] < query.cost_limit)


def test_ways_there_begin_where_the_tool_is_and_go_from_node_to_node(planner) -> None:
    ways, start, _, _ = asked(planner, 0.03)
    for way in ways:
        np.testing.assert_array_equal(way.polyline[0], start)
        np.testing.assert_array_equal(way.polyline[1:], planner.graph.latent[way.nodes])
        steps = np.abs(np.diff(planner.graph.latent[way.nodes], axis=0)) / planner.graph.grid.spacing
        assert np.max(steps, initial=0.0) < 4.0
        assert way.energy > 0.0


def test_nowhere_free_is_no_way(planner) -> None:
    assert asked(planner, 0.03)[0]
    assert not asked(planner, 0.6)[0]
    assert not asked(planner, 0.03, steps=1)[0]
