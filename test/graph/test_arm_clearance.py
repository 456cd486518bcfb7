"""Clearances of many configurations, link by link, are those of every sphere against every obstacle."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.graph.ambient import clearances
from geodesic_motion_ros.graph.arm_clearance import ArmSpheres, LinkBounds
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot


@pytest.fixture(scope="module")
def panda() -> tuple[Robot, CollisionModel]:
    return Robot.panda(), CollisionModel.panda()


def test_links_hold_all_their_spheres(panda: tuple[Robot, CollisionModel]) -> None:
    robot, model = panda
    bounds = LinkBounds.of(model)
    arm = ArmSpheres.at(robot.sample(20, np.random.default_rng(1)), model, bounds, robot)
    assert bounds.first[-1] == np.count_nonzero(model.moving)
    for g in range(len(bounds.radii)):
        own = slice(bounds.first[g], bounds.first[g + 1])
        assert len(set(model.points.frames[model.moving][own])) == 1
        outermost = np.linalg.norm(arm.spheres[:, own] - arm.links[:, [g]], axis=-1) + arm.radii[own]
        assert np.all(outermost <= bounds.radii[g] + 1e-9)


@pytest.mark.parametrize("within", [0.0, 0.02, 0.5])
def test_clearances_are_those_of_all_pairs(panda: tuple[Robot, CollisionModel], within: float) -> None:
    robot, model = panda
    random = np.random.default_rng(2)
    arm = ArmSpheres.at(robot.sample(300, random), model, LinkBounds.of(model), robot)
    centres, radii = random.uniform(-0.8, 0.8, (12, 3)) + [0.0, 0.0, 0.6], random.uniform(0.01, 0.2, 12)
    expected = clearances(arm.spheres, arm.radii, centres, radii, within)
    found = arm.clearances(centres, radii, within)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.any(np.isfinite(expected))


def test_no_obstacle_is_infinitely_far(panda: tuple[Robot, CollisionModel]) -> None:
    robot, model = panda
    arm = ArmSpheres.at(robot.ready[None], model, LinkBounds.of(model), robot)
    assert np.all(np.isinf(arm.clearances(np.empty((0, 3)), np.empty(0), 1.0)))
