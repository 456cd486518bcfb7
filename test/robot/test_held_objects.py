"""Held objects: their spheres hold all of them and stick out no farther than is said; bad ones are refused by name."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.held_objects import MOST_SPHERES, PROTRUSION, HeldObject, check_held
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError

#: With how far their spheres may stick out [m].
OBJECTS = [
    (HeldObject("ball", "sphere", (0.05,)), 0.0),
    (HeldObject("bottle", "cylinder", (0.03, 0.2)), PROTRUSION),
    (HeldObject("cup", "cylinder", (0.04, 0.1)), PROTRUSION),
    (HeldObject("pot", "cylinder", (0.1, 0.12)), 0.045),
    (HeldObject("plate", "cylinder", (0.12, 0.01)), 0.025),
    (HeldObject("rod", "box", (0.01, 0.01, 0.5)), PROTRUSION),
    (HeldObject("brick", "box", (0.2, 0.1, 0.06)), PROTRUSION),
    (HeldObject("carton", "box", (0.3, 0.2, 0.25)), 0.04),
]
PLACES = [((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)), ((0.05, -0.1, 0.02), (0.5, -0.5, 0.5, 0.5))]


def points_in(held: HeldObject, count: int) -> np.ndarray:
    """Points (n, 3) [m] in the tool frame, spread over the inside and, half of them, over the surface."""
    rng = np.random.default_rng(7)
    unit = rng.uniform(-1.0, 1.0, (count, 3))
    unit[: count // 2] /= np.max(np.abs(unit[: count // 2]), axis=1, keepdims=True)
    if held.shape == "box":
        local = 0.5 * np.array(held.dimensions) * unit
    else:
        # A square is carried onto a disc, a cube onto a ball, shells onto shells.
        flat = unit if held.shape == "sphere" else unit[:, :2]
        size = np.max(np.abs(flat), axis=1, keepdims=True)
        local = held.dimensions[0] * size * flat / np.linalg.norm(flat, axis=1, keepdims=True)
        if held.shape == "cylinder":
            local = np.column_stack([local, 0.5 * held.dimensions[1] * unit[:, 2]])
    return to_rotation(np.array(held.quaternion)).apply(local) + np.array(held.position)


def placed(held: HeldObject, place: tuple[tuple[float, ...], tuple[float, ...]]) -> HeldObject:
    return HeldObject(held.name, held.shape, held.dimensions, *place)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("held", "largest"), OBJECTS, ids=lambda value: getattr(value, "name", ""))
def test_spheres_hold_all_of_an_object_and_stick_out_no_farther_than_is_said(held, largest, place) -> None:
    held = placed(held, place)
    centres, radii = held.spheres
    points = points_in(held, 20_000)
    depths = radii - np.linalg.norm(points[:, None] - centres, axis=2)
    assert np.min(np.max(depths, axis=1)) > -1e-9
    assert len(radii) <= MOST_SPHERES
    assert held.protrusion <= largest
    # Straight out of its faces, no point of a sphere is farther out than the protrusion.
    local = to_rotation(np.array(held.quaternion)).inv().apply(centres - np.array(held.position))
    if held.shape == "box":
        out = np.max(np.abs(local) + radii[:, None] - 0.5 * np.array(held.dimensions))
    else:
        out = np.max(np.hypot(local[:, 0], local[:, 1]) + radii - held.dimensions[0])
        if held.shape == "cylinder":
            out = max(out, float(np.max(np.abs(local[:, 2]) + radii - 0.5 * held.dimensions[1])))
    assert out == pytest.approx(held.protrusion, abs=1e-9)
    assert np.max(np.linalg.norm(points, axis=1)) <= held.extent + 1e-9


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"name": ""}, "no name"),
        ({"shape": ""}, "'bottle' has the shape '': expected one of sphere, box, cylinder"),
        ({"shape": "mesh"}, "'mesh'"),
        ({"dimensions": ()}, "expected radius, height along z"),
        ({"dimensions": (0.03,)}, "expected radius, height along z"),
        ({"dimensions": (0.03, -0.2)}, "finite, and none shorter than"),
        ({"dimensions": (math.nan, 0.2)}, "finite, and none shorter than"),
        ({"position": (0.0, math.inf, 0.0)}, "expected finite"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "unit quaternion"),
        ({"quaternion": (math.nan, 0.0, 0.0, 0.0)}, "unit quaternion"),
    ],
)
def test_what_is_no_object_is_refused_by_name(changes, reason) -> None:
    with pytest.raises(RobotError, match=reason):
        HeldObject(**{"name": "bottle", "shape": "cylinder", "dimensions": (0.03, 0.2)} | changes)


def test_what_a_hand_cannot_hold_at_once_is_refused_by_name() -> None:
    robot = Robot.named("panda")
    bottle = HeldObject("bottle", "cylinder", (0.03, 0.2))
    check_held([bottle, HeldObject("cup", "cylinder", (0.04, 0.1))], robot)
    with pytest.raises(RobotError, match="two held objects are called 'bottle'"):
        check_held([bottle, HeldObject("bottle", "sphere", (0.03,))], robot)
    with pytest.raises(RobotError, match=r"'bottle' reaches 200.00 m from 'panda_grasptarget'.*in metres"):
        check_held([HeldObject("bottle", "sphere", (200.0,))], robot)


def test_an_arm_keeps_what_it_holds_off_its_own_links() -> None:
    robot, arm = Robot.named("panda"), CollisionModel.named("panda")
    bottle = HeldObject("bottle", "cylinder", (0.03, 0.2), (0.04, 0.0, 0.0), (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0))
    assert self_clearance(arm, robot, robot.ready)[0] > 0.0
    assert self_clearance(arm.holding(robot, [bottle]), robot, robot.ready)[0] > 0.0
    # A rod beside the hand that leads back beyond the forearm.
    holding = arm.holding(robot, [HeldObject("rod", "box", (0.02, 0.02, 0.7), (-0.1, 0.0, -0.2))])
    clearance, (one, other) = self_clearance(holding, robot, robot.ready)
    assert clearance < 0.0
    assert (holding.link_of(one), holding.link_of(other)) == ("rod", "panda_link5")


def test_an_arm_that_holds_nothing_is_the_arm() -> None:
    robot, arm = Robot.named("panda"), CollisionModel.named("panda")
    assert arm.holding(robot, ()) is arm
