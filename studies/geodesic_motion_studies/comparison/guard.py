"""Guard: what of an arm is kept clear of spheres and judged: all of it, or the tool alone.

A skill of the whole arm guards all of the arm. One of the tool guards hand and fingers alone, unless all of the arm is
requested: then scenes are drawn, free demonstrations found and contacts judged as with a skill of the whole arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError, RobotError

Guard = Literal["arm", "tool"]
GUARDS: tuple[Guard, ...] = get_args(Guard)


def own_guard(skill: Skill) -> Guard:
    """The guard of a skill for which none is requested."""
    return "arm" if skill.space == "joint" else "tool"


def guard_of(skill: Skill, requested: Guard | None = None) -> Guard:
    """The requested guard of a skill, or its own.

    Raises
    ------
    ParameterError : there is no such guard, or the tool alone is requested with a skill of the whole arm.
    """
    guard = own_guard(skill) if requested is None else requested
    if guard not in GUARDS:
        raise ParameterError(f"the guard is '{guard}': choose from {', '.join(GUARDS)}")
    if guard == "tool" and own_guard(skill) == "arm":
        raise ParameterError(f"'{skill.name}' is a skill of the whole arm, which is guarded: there is no guard 'tool'")
    return guard


@dataclass(frozen=True, eq=False)
class GuardedArm:
    """An arm and the collision spheres of what is guarded of it.

    Attributes
    ----------
    name : of a shipped robot, or the path of a folder.
    hand : the link that counts as its hand.
    """

    name: str
    robot: Robot
    hand: str
    guard: Guard
    collision: CollisionModel

    @classmethod
    def named(cls, robot: str, guard: Guard) -> GuardedArm:
        """RobotError: there is no such robot, or its folder names no hand."""
        return cls(**guarded(robot, guard))

    def body(self, configurations: np.ndarray) -> np.ndarray:
        """Centres (n, B, 3) [m] of the spheres that joints move, in configurations (n, eta) [rad]."""
        return self.collision.positions(self.robot, configurations)[:, self.collision.moving]

    @property
    def body_radii(self) -> np.ndarray:
        """Radii (B,) [m] of the same spheres."""
        return self.collision.radii[self.collision.moving]

    def tool_curve(self, configurations: np.ndarray) -> PoseCurve:
        """The poses of the tool in configurations (n, eta) [rad]."""
        poses = [self.robot.forward(configuration) for configuration in configurations]
        positions, quaternions = map(np.array, zip(*poses, strict=True))
        return PoseCurve(positions, continuous_signs(quaternions))


def guarded(robot: str, guard: Guard) -> dict[str, Any]:
    """The fields of the `GuardedArm` of a robot; errors as its `named`."""
    hand, spheres = RobotDescription.named(robot).hand, CollisionModel.named(robot)
    if hand is None:
        raise RobotError(f"the folder of the robot {robot!r} names no `hand`: scenes are drawn for arms with one")
    kept = spheres if guard == "arm" else spheres.of_link(hand)
    return {"name": robot, "robot": Robot.named(robot), "hand": hand, "guard": guard, "collision": kept}
