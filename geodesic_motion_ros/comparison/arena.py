"""Arena: what all scenes of one skill have in common, whichever method moves the arm.

Every method is given the demonstrations as they were shown, the same limits, and the same collision spheres of the
body that is to be kept clear: the whole arm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.demonstrations.curves import PoseCurve
from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.graph.joint_transport import JointOffsets
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_reference import JointReference, timed_joint_reference
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.quaternions import continuous_signs
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill


@dataclass(frozen=True, eq=False)
class Arena:
    """A skill, its arm, and what was shown.

    Attributes
    ----------
    collision : the spheres that obstacles are to be kept away from.
    limits : that every method's references are timed within.
    shown : (N, S, eta) demonstrations as they were shown, equally spaced along their arcs [rad].
    modes : (N,) which way each of them took.
    """

    skill: Skill
    robot: Robot
    collision: CollisionModel
    limits: JointLimits
    shown: np.ndarray
    modes: np.ndarray

    @classmethod
    def of(cls, skill: Skill) -> Arena:
        """Of a joint-space skill; ParameterError for another one, or where demonstrations begin or end in several
        families of configurations.
        """
        sheet = skill.canonical
        if skill.space != "joint":
            raise ParameterError(f"'{skill.name}' is a skill of {skill.space} space: scenes are drawn for joint space")
        if sheet is None or len(sheet.start_poles) != 1 or len(sheet.goal_poles) != 1:
            raise ParameterError(
                f"'{skill.name}' is on the raw sheet, or begins or ends in several families of configurations: scenes "
                "are drawn for skills on the canonical sheet whose demonstrations begin alike and end alike"
            )
        robot, settings = Robot.named(skill.robot), JointPlannerSettings()
        ends = np.stack([sheet.start_poles[0] + sheet.start_offsets, sheet.goal_poles[0] + sheet.goal_offsets], axis=1)
        shown = np.stack([_moved(robot, *pair) for pair in zip(sheet.configurations, ends, strict=True)])
        limits = JointLimits.of(robot, settings.speed_scale, settings.acceleration_scale)
        return cls(skill, robot, CollisionModel.named(skill.robot), limits, shown, sheet.modes)

    def moved(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """The demonstrations (N, S, eta) moved so that all begin at a start and end at a goal (eta,) [rad]."""
        ends = np.stack([start, goal])
        return np.stack([_moved(self.robot, item, ends) for item in self.shown])

    def nearest(self, start: np.ndarray, goal: np.ndarray) -> int:
        """The demonstration that begins and ends nearest to a start and a goal (eta,) [rad]."""
        off = np.linalg.norm(self.shown[:, 0] - start, axis=1) + np.linalg.norm(self.shown[:, -1] - goal, axis=1)
        return int(np.argmin(off))

    def timed(self, path: np.ndarray) -> JointReference:
        """A path (m, eta) [rad] from rest to rest within the limits.

        Raises
        ------
        ParameterError : it leaves the joints' limits.
        """
        inside = np.clip(path, self.limits.lower, self.limits.upper)
        reference = timed_joint_reference(inside, np.linspace(0.0, 1.0, len(path))[:, None], self.limits)
        if reference is None:
            raise ParameterError("a demonstration cannot be played within the joints' limits")
        return reference

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


def _moved(robot: Robot, item: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """A demonstration (S, eta) moved to a start and a goal, (2, eta) [rad]."""
    offsets = JointOffsets.between(robot, item[[0, -1]], ends)
    return item + offsets.displacements(item, np.linspace(0.0, 1.0, len(item)))
