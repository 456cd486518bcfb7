"""What is worked out of a node when it is looked at, against every body point and sphere beside every obstacle."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.graph.ambient import ambient_factor, clearances
from geodesic_motion_ros.graph.node_body import LinkBounds, NodeBody
from geodesic_motion_ros.graph.reshaping import Reshaping, look_at
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

NODES = 300


def body(seed: int = 2) -> NodeBody:
    robot, model, random = Robot.panda(), CollisionModel.panda(), np.random.default_rng(seed)
    configurations = robot.sample(NODES, random)
    points = np.stack([robot.forward(configuration)[0] for configuration in configurations])[:, None]
    points = np.concatenate([points, 0.5 * points], axis=1)
    return NodeBody.of_arm(configurations, points, np.array([0.05, 0.08]), model, LinkBounds.of(model), robot)


def obstacles(count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    return random.uniform(-0.8, 0.8, (count, 3)) + [0.0, 0.0, 0.6], random.uniform(0.01, 0.2, count)


@pytest.mark.parametrize("count", [0, 1, 12])
@pytest.mark.parametrize("within", [0.0, 0.02, 0.5])
def test_factors_and_clearances_are_those_of_all_pairs(count: int, within: float) -> None:
    arm, (centres, radii) = body(), obstacles(count)
    reshaping = Reshaping.of(arm, centres, radii, 1e3, 0.5, within)
    look_at(np.arange(len(reshaping.looked)), reshaping)
    expected = [
        [ambient_factor(*x, r, centres, radii, 1e3, 0.5) for x, r in zip(node, arm.point_radii, strict=True)]
        for node in arm.points
    ]
    np.testing.assert_allclose(reshaping.factors, expected, rtol=1e-12)
    np.testing.assert_array_equal(reshaping.touched, (reshaping.factors > 1.0).any(axis=1))
    clearance = clearances(arm.spheres, arm.sphere_radii, centres, radii, within)
    np.testing.assert_allclose(reshaping.clearance, clearance, atol=1e-12)
    if count == 12:
        assert np.any(reshaping.touched)
        assert np.any(reshaping.clearance < 0.0)


def test_obstacles_out_of_reach_are_left_out() -> None:
    centres, radii = obstacles(5)
    centres[2:] += [0.0, 0.0, 5.0]
    reshaping = Reshaping.of(body(), centres, radii, 1e3, 0.5, 0.1)
    np.testing.assert_array_equal(reshaping.centres, centres[:2])


def test_a_node_is_looked_at_once_and_alone() -> None:
    reshaping = Reshaping.of(body(), *obstacles(12), 1e3, 0.5, 0.1)
    look_at(np.array([7]), reshaping)
    assert np.flatnonzero(reshaping.looked).tolist() == [7]
    reshaping.factors[7] = -1.0
    look_at(np.array([7]), reshaping)
    assert np.all(reshaping.factors[7] == -1.0)
