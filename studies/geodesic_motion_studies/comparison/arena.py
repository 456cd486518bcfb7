"""Arena: what all scenes of one skill have in common, whichever method moves the arm.

Every method is given the demonstrations as they were shown, the same limits, and the same collision spheres of the
body that is guarded (`guard.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.sheet import CanonicalSheet
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.guard import Guard, GuardedArm, guard_of, guarded
from geodesic_motion_studies.comparison.tool_demonstrations import followed, moved_curves, shown_curves


@dataclass(frozen=True, eq=False)
class Arena(GuardedArm):
    """A skill, its arm with what is guarded of it, and what was shown.

    Attributes
    ----------
    limits : that every method's references are timed within, but streams of poses, which know none of joints.
    shown : (N, S, eta) demonstrations as they were shown, equally spaced along their arcs [rad].
    modes : (N,) the mode of each of them.
    """

    skill: Skill
    limits: JointLimits
    shown: np.ndarray
    modes: np.ndarray

    @classmethod
    def of(cls, skill: Skill, guard: Guard | None = None) -> Arena:
        """Of a skill on the canonical sheet, with its own guard or the requested one.

        Raises
        ------
        ParameterError : the skill has no such guard, it is on the raw sheet, its demonstrations begin or end in several
            families of configurations, or the arm cannot carry the tool along them.
        RobotError : the arm does not reach where they begin.
        """
        sheet = skill.canonical
        if sheet is None:
            raise ParameterError(f"'{skill.name}' is on the raw sheet: scenes are drawn for skills on a canonical one")
        arm, settings = guarded(skill.robot, guard_of(skill, guard)), PlannerSettings()
        robot: Robot = arm["robot"]
        limits = JointLimits.of(robot, settings.speed_scale, settings.acceleration_scale)
        if isinstance(sheet, CanonicalSheet):
            curves = shown_curves(sheet)
            # The first pose decides which of the arm's postures is taken, for all demonstrations.
            begin = solve(robot, curves[0].positions[0], curves[0].quaternions[0])
            shown = np.stack([followed(robot, curve, begin) for curve in curves])
            return cls(**arm, skill=skill, limits=limits, shown=shown, modes=sheet.modes)
        if len(sheet.start_poles) != 1 or len(sheet.goal_poles) != 1:
            raise ParameterError(
                f"'{skill.name}' begins or ends in several families of configurations: scenes are drawn for skills "
                "whose demonstrations begin alike and end alike"
            )
        ends = np.stack([sheet.start_poles[0] + sheet.start_offsets, sheet.goal_poles[0] + sheet.goal_offsets], axis=1)
        shown = np.stack([_moved(robot, *pair) for pair in zip(sheet.configurations, ends, strict=True)])
        return cls(**arm, skill=skill, limits=limits, shown=shown, modes=sheet.modes)

    @property
    def whole_arm(self) -> bool:
        """Whether the skill is of the whole arm, and not of the tool; what is guarded is another question."""
        return self.skill.space == "joint"

    def moved(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """The demonstrations (N, S, eta) moved so that all begin at a start and end at a goal (eta,) [rad].

        Raises
        ------
        ParameterError : the arm cannot carry the tool along them between these ends.
        """
        sheet = self.skill.canonical
        if isinstance(sheet, CanonicalSheet):
            curves = moved_curves(sheet, self.robot.forward(start), self.robot.forward(goal))
            return np.stack([followed(self.robot, curve, start, goal) for curve in curves])
        ends = np.stack([start, goal])
        return np.stack([_moved(self.robot, item, ends) for item in self.shown])

    def nearest(self, start: np.ndarray, goal: np.ndarray) -> int:
        """The demonstration that begins and ends nearest to a start and a goal (eta,) [rad]."""
        return int(self.by_nearness(start, goal)[0])

    def by_nearness(self, at: np.ndarray, goal: np.ndarray, progress: float = 0.0) -> np.ndarray:
        """The demonstrations (N,), first the one that passes nearest to `at` and ends nearest to a goal (eta,) [rad].

        progress : the share of each of them at which it is compared with `at`.
        """
        passed = self.shown[:, round(progress * (self.shown.shape[1] - 1))]
        off = np.linalg.norm(passed - at, axis=1) + np.linalg.norm(self.shown[:, -1] - goal, axis=1)
        return np.argsort(off, kind="stable")

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


def _moved(robot: Robot, item: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """A demonstration (S, eta) moved to a start and a goal, (2, eta) [rad]."""
    offsets = JointOffsets.between(robot, item[[0, -1]], ends)
    return item + offsets.displacements(item, np.linspace(0.0, 1.0, len(item)))
