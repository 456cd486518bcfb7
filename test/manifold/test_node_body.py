"""The body at the nodes of a graph: bounds hold what they bound, for an arm and for a tool."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.node_body import LinkBounds, NodeBody
from geodesic_motion_ros.robot.body_points import BodyPoints, place_body_points
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot


def arm_body(count: int = 20, seed: int = 1, radius: float = 0.05) -> NodeBody:
    robot, model = Robot.named("panda"), CollisionModel.named("panda")
    points = BodyPoints.of(robot)
    configurations, radii = robot.sample(count, np.random.default_rng(seed)), np.full(len(points), radius)
    return NodeBody.of_arm(configurations, points, radii, model, LinkBounds.of(model), robot)


def test_an_arm_feels_obstacles_at_its_body_points() -> None:
    robot, points = Robot.named("panda"), BodyPoints.of(Robot.named("panda"))
    configurations = robot.sample(20, np.random.default_rng(1))
    placed = place_body_points(configurations, points.frames, points.offsets, robot.chain)
    np.testing.assert_array_equal(arm_body().points, placed)


def test_links_hold_all_their_spheres() -> None:
    model, body = CollisionModel.named("panda"), arm_body()
    assert body.first[-1] == np.count_nonzero(model.moving)
    for g in range(len(body.link_radii)):
        own = slice(body.first[g], body.first[g + 1])
        assert len(set(model.points.frames[model.moving][own])) == 1
        outermost = np.linalg.norm(body.spheres[:, own] - body.links[:, [g]], axis=-1) + body.sphere_radii[own]
        assert np.all(outermost <= body.link_radii[g] + 1e-9)


@pytest.mark.parametrize("kind", ["arm", "arm that feels farther out", "tool"])
def test_the_box_holds_everything(kind: str) -> None:
    body = arm_body(radius=0.1 if kind == "tool" else 0.05)
    if kind == "arm that feels farther out":
        body = body.felt_at(2.0 * body.points, np.full(body.points.shape[1], 0.1))
    if kind == "tool":
        body = NodeBody.of_tool(body.points, body.point_radii)
    for centres, radii in ((body.points, body.point_radii), (body.spheres, body.sphere_radii)):
        assert np.all(centres - radii[:, None] >= body.lower)
        assert np.all(centres + radii[:, None] <= body.upper)
