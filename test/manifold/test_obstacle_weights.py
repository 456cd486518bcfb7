"""What is worked out of a node when it is evaluated, against every body point and sphere beside every obstacle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.shapes import solid_rows
from geodesic_motion_ros.manifold.ambient_metric import ambient_factor, cloud_factor, obstacle_clearances, solid_factor
from geodesic_motion_ros.manifold.node_body import LinkBounds, NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes, first_clear
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.body_points import NO_POINTS
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

NODES = 300


def body(seed: int = 2) -> NodeBody:
    robot, model, random = Robot.named("panda"), CollisionModel.named("panda"), np.random.default_rng(seed)
    configurations = robot.sample(NODES, random)
    points = np.stack([robot.forward(configuration)[0] for configuration in configurations])[:, None]
    points = np.concatenate([points, 0.5 * points], axis=1)
    arm = NodeBody.of_arm(configurations, NO_POINTS, np.empty(0), model, LinkBounds.of(model), robot)
    return arm.felt_at(points, np.array([0.05, 0.08]))


def obstacles(count: int, seed: int = 3) -> Obstacles:
    random = np.random.default_rng(seed)
    centres = random.uniform(-0.8, 0.8, (count, 3)) + [0.0, 0.0, 0.6]
    return Obstacles.of_spheres(centres, random.uniform(0.01, 0.2, count))


def with_solids_and_cloud(spheres: Obstacles, solids: int, cloud: int, seed: int = 4) -> Obstacles:
    random = np.random.default_rng(seed)
    centres = random.uniform(-0.8, 0.8, (solids, 3)) + [0.0, 0.0, 0.6]
    rows = solid_rows(
        centres, Rotation.random(solids, random_state=seed).as_matrix(), random.uniform(0.0, 0.2, (solids, 3)),
        random.uniform(0.01, 0.1, solids),
    )  # fmt: skip
    points = random.uniform(-0.6, 0.6, (cloud, 3)) + [0.0, 0.0, 0.6]
    return replace(
        spheres, solids=rows, solid_velocities=np.zeros((solids, 3)), cloud=DistanceField.of(points, 0.02, 0.02, 0.05)
    )


def factor(x: float, y: float, z: float, radius: float, around: Obstacles) -> float:
    result = ambient_factor(x, y, z, radius, around.centres, around.radii, 1e3, 0.5)
    result += solid_factor(x, y, z, radius, around.solids, 1e3, 0.5)
    if around.cloud.squares.size:
        result += cloud_factor(x, y, z, radius, *around.cloud, 1e3, 0.5)
    return result


@pytest.mark.parametrize(
    ("count", "solids", "cloud"), [(0, 0, 0), (1, 0, 0), (12, 0, 0), (0, 9, 0), (0, 0, 9), (5, 5, 5)]
)
@pytest.mark.parametrize("within", [0.0, 0.02, 0.5])
def test_factors_and_clearances_are_those_of_all_pairs(count: int, solids: int, cloud: int, within: float) -> None:
    arm, around = body(), with_solids_and_cloud(obstacles(count), solids, cloud)
    evaluation = NodeEvaluation.of(arm, around, 1e3, 0.5, within)
    evaluate_nodes(np.arange(len(evaluation.evaluated)), evaluation)
    expected = [[factor(*x, r, around) for x, r in zip(node, arm.point_radii, strict=True)] for node in arm.points]
    np.testing.assert_allclose(evaluation.factors, expected, rtol=1e-12)
    np.testing.assert_array_equal(evaluation.affected, (evaluation.factors > 1.0).any(axis=1))
    clearance = obstacle_clearances(arm.spheres, arm.sphere_radii, around, within)
    np.testing.assert_allclose(evaluation.clearance, clearance, atol=1e-12)
    if count + solids + cloud > 1:
        assert np.any(evaluation.affected)
        assert np.any(evaluation.clearance < 0.0)


def test_obstacles_out_of_reach_are_left_out() -> None:
    around = with_solids_and_cloud(obstacles(5), 5, 0)
    around.centres[2:] += [0.0, 0.0, 5.0]
    around.solids[3:, :3] += [0.0, 0.0, 5.0]
    evaluation = NodeEvaluation.of(body(), around, 1e3, 0.5, 0.1)
    np.testing.assert_array_equal(evaluation.centres, around.centres[:2])
    np.testing.assert_array_equal(evaluation.solids, around.solids[:3])


@pytest.mark.parametrize("size", [1e3, 1e30, 1e150])
def test_an_obstacle_may_be_larger_than_the_world(size: float) -> None:
    """Half of space, as a box and as a sphere."""
    arm = body()
    ground = solid_rows(np.array([[0.0, 0.0, 0.3 - size]]), np.eye(3)[None], np.full((1, 3), size), np.zeros(1))
    box = replace(Obstacles.none(), solids=ground, solid_velocities=np.zeros((1, 3)))
    sphere = Obstacles.of_spheres(np.array([[0.0, 0.0, 0.3]]), np.array([size]))
    for around in (box, sphere):
        evaluation = NodeEvaluation.of(arm, around, 1e3, 0.5, 0.02)
        evaluate_nodes(np.arange(NODES), evaluation)
        expected = obstacle_clearances(arm.spheres, arm.sphere_radii, around, 0.02)
        np.testing.assert_array_equal(evaluation.clearance < 0.0, expected < 0.0)
        assert np.all(np.isfinite(evaluation.factors))
        assert np.any(evaluation.clearance < 0.0)


def test_a_node_is_looked_at_once_and_alone() -> None:
    evaluation = NodeEvaluation.of(body(), obstacles(12), 1e3, 0.5, 0.1)
    evaluate_nodes(np.array([7]), evaluation)
    assert np.flatnonzero(evaluation.evaluated).tolist() == [7]
    evaluation.factors[7] = -1.0
    evaluate_nodes(np.array([7]), evaluation)
    assert np.all(evaluation.factors[7] == -1.0)


def test_the_first_clear_node_is_found_without_a_look_at_those_after_it() -> None:
    margin, whole = 0.02, NodeEvaluation.of(body(), obstacles(12), 1e3, 0.5, 0.1)
    evaluate_nodes(np.arange(NODES), whole)
    nodes = np.argsort(whole.clearance, kind="stable")
    number = int(np.argmax(whole.clearance[nodes] >= margin))
    assert 0 < number < NODES - 1
    evaluation = NodeEvaluation.of(body(), obstacles(12), 1e3, 0.5, 0.1)
    assert first_clear(nodes, -1, evaluation, margin) == nodes[number]
    assert np.flatnonzero(evaluation.evaluated).tolist() == sorted(nodes[: number + 1].tolist())
    # A goal may be nearer to an obstacle.
    assert first_clear(nodes, int(nodes[0]), evaluation, margin) == nodes[0]
    assert first_clear(nodes[:number], -1, evaluation, margin) == -1
