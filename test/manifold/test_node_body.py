"""The body at the nodes of a graph: bounds hold what they bound, for an arm and for a tool."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.node_body import LinkBounds, NodeBody
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot


def arm_body(count: int = 20, seed: int = 1) -> NodeBody:
    robot, model = Robot.named("panda"), CollisionModel.named("panda")
    random = np.random.default_rng(seed)
    points = random.uniform(-0.5, 0.5, (count, 2, 3))
    radii = np.array([0.05, 0.1])
    return NodeBody.of_arm(robot.sample(count, random), points, radii, model, LinkBounds.of(model), robot)


def test_links_hold_all_their_spheres() -> None:
    model, body = CollisionModel.named("panda"), arm_body()
    assert body.first[-1] == np.count_nonzero(model.moving)
    for g in range(len(body.link_radii)):
        own = slice(body.first[g], body.first[g + 1])
        assert len(set(model.points.frames[model.moving][own])) == 1
        outermost = np.linalg.norm(body.spheres[:, own] - body.links[:, [g]], axis=-1) + body.sphere_radii[own]
        assert np.all(outermost <= body.link_radii[g] + 1e-9)


@pytest.mark.parametrize("kind", ["arm", "tool"])
def test_the_box_holds_everything(kind: str) -> None:
    body = arm_body()
    if kind == "tool":
        body = NodeBody.of_tool(body.points, body.point_radii)
    for centres, radii in ((body.points, body.point_radii), (body.spheres, body.sphere_radii)):
        assert np.all(centres - radii[:, None] >= body.lower)
        assert np.all(centres + radii[:, None] <= body.upper)
