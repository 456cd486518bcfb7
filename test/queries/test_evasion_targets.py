"""Evasion targets: free, near, in different directions, with a path back, or beside the graph; the paths there begin
where the tool is.
"""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.arm_in_scene import ArmInScene
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation
from geodesic_motion_ros.manifold.shortest_path import shortest_free_path
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.evasion_targets import displaced_paths, paths_to_targets
from geodesic_motion_ros.queries.pose_path import PosePathPlanner
from geodesic_motion_ros.robot.body_points import BodyPoints
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

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
    evaluation = NodeEvaluation.of(
        query.body, sphere, settings.ambient_strength, settings.ambient_width_ratio, 0.05, settings.ambient_law
    )
    start = reference.latent[middle]
    return list(paths_to_targets(planner.graph, query, start, evaluation, steps, APART)), start, evaluation, query


def test_targets_are_free_near_and_none_lies_behind_another(planner) -> None:
    paths, start, evaluation, query = found(planner, 0.03)
    assert len(paths) > 1
    ends = np.array([path.nodes[-1] for path in paths])
    assert np.all(evaluation.clearance[ends] >= APART)
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
        source, target = path.nodes[[0, -1]].tolist()
        nodes, _, _ = shortest_free_path(
            planner.graph.adjacency, query.graph.base, np.zeros_like(query.to_goal), source, target
        )
        np.testing.assert_array_equal(path.nodes, nodes)


def test_nowhere_free_is_no_path(planner) -> None:
    assert found(planner, 0.03)[0]
    assert not found(planner, 0.6)[0]
    assert not found(planner, 0.03, steps=1)[0]


def beside(sphere: Obstacles, reach: float = 0.3, away: float = 0.0) -> list[np.ndarray]:
    """Displaced paths of a Panda that stands ready, its tool so far [m] from where it would be on the graph."""
    robot, model = Robot.named("panda"), CollisionModel.named("panda")
    undisplaced = robot.forward(robot.ready)[0] + [0.0, away, 0.0]
    arm = ArmInScene.of(robot, model, sphere)
    return list(displaced_paths(robot, arm, robot.ready.copy(), undisplaced, reach, APART))


def at_the_tool(offset: list[float], radius: float = 0.05) -> Obstacles:
    robot = Robot.named("panda")
    return Obstacles.of_spheres((robot.forward(robot.ready)[0] + offset)[None], np.array([radius]))


def test_displaced_paths_are_straight_and_end_clear_the_near_ones_first() -> None:
    robot, model, sphere = Robot.named("panda"), CollisionModel.named("panda"), at_the_tool([0.12, 0.0, 0.0])
    position, quaternion = robot.forward(robot.ready)
    paths = beside(sphere)
    lengths = np.array([len(path) for path in paths])
    # The near ones are over where they are no longer sorted.
    near = int(np.argmax(np.diff(lengths) < 0)) + 1
    assert len(lengths) - 10 > near > 10
    assert np.all(np.diff(lengths)[np.arange(len(lengths) - 1) != near - 1] >= 0)
    for number, path in enumerate(paths):
        np.testing.assert_array_equal(path[0], robot.ready)
        assert obstacle_clearance(model, robot, path[-1], sphere)[0] >= APART - 1e-9
        assert np.all((path >= robot.lower) & (path <= robot.upper))
        places = [robot.forward(configuration) for configuration in path]
        assert max(angle_between(turned, quaternion) for _, turned in places) < 1e-3
        offsets = np.array([place - position for place, _ in places])
        length = np.linalg.norm(offsets[-1])
        if length > 1e-3:
            step = (1.0 if number < near else 2.0) * constants.EVASION_DISPLACEMENT / 3
            assert length == pytest.approx((len(path) - 1) * step, abs=1e-4)
            np.testing.assert_allclose(offsets, np.linspace(0.0, 1.0, len(path))[:, None] * offsets[-1], atol=1e-4)
        else:
            assert np.linalg.norm(path[-1] - path[0]) > 0.1


def test_displaced_paths_lead_no_farther_from_the_graph_than_they_may() -> None:
    """The control: in all directions where the tool is on it, and none where it is too far off already but back."""
    robot, sphere = Robot.named("panda"), at_the_tool([0.0, 0.0, 0.5])
    towards = [robot.forward(path[-1])[0][1] - robot.forward(robot.ready)[0][1] for path in beside(sphere)]
    assert min(towards) < -0.01
    assert max(towards) > 0.01
    moved = [robot.forward(path[-1])[0] - robot.forward(robot.ready)[0] for path in beside(sphere, 0.1, 0.12)]
    assert moved
    assert all(np.linalg.norm(offset - [0.0, 0.12, 0.0]) <= 0.1 + 1e-6 for offset in moved)
    assert not beside(sphere, 0.05, 0.25)


def test_where_all_that_is_near_is_covered_there_is_no_displaced_path() -> None:
    assert not beside(at_the_tool([0.0, 0.0, 0.0], 0.5))


def test_an_arm_of_six_joints_is_displaced_but_does_not_swivel(six: Robot) -> None:
    points = BodyPoints(("l6",), np.array([six.link_names.index("l6")]), np.zeros((1, 3)))
    model = CollisionModel(points, np.array([0.02]), np.ones(1, dtype=bool), np.empty((0, 2), dtype=np.int64))
    start = np.array([0.0, 0.4, 0.9, 0.3, 0.8, 0.1])
    position, _ = six.forward(start)
    far = Obstacles.of_spheres(np.full((1, 3), 5.0), np.array([0.1]))
    paths = list(displaced_paths(six, ArmInScene.of(six, model, far), start, position, 0.3, APART))
    assert paths
    assert min(np.linalg.norm(six.forward(path[-1])[0] - position) for path in paths) > 0.01
