"""What the demo shows of a skill: a path, an obstacle that moves into it, and pictures of what came of both."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from geodesic_motion_ros.demo.demo_run import DemoError, Recording
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.parameters import Value
from geodesic_motion_ros.nodes.skill_kinds import of_robot, planner_settings
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference

#: Parameters of the planner node as they are by default.
DEFAULTS: dict[str, Value] = {parameter.name: parameter.default for parameter in PLANNER}


class DemoScene(ABC):
    """A skill from its mean start to its mean goal, and the sphere that moves into that motion.

    Attributes
    ----------
    planner : of the skill, among what was declared alone.
    nominal : the undisturbed motion, a reference.
    goal : (7,) tool pose: x, y, z [m], w, x, y, z.
    obstacle : counts its time from when the goal is sent.
    patience : parameters of the planner node in which the demo is more patient with a busy machine than the defaults.
    """

    patience: Mapping[str, Value] = MappingProxyType({})

    def __init__(self, skill: Skill, declared: DeclaredScene | None = None) -> None:
        """declared : what always stands around the arm; None: nothing was declared.

        Raises
        ------
        DemoError : the skill has no path from its own start to its goal.
        """
        self.skill = skill
        # as the planner node makes it of the skill
        settings = planner_settings(DEFAULTS | of_robot(skill, DEFAULTS) | self.patience)
        self.planner = ReactivePlanner(skill, settings, scene=declared)
        start, self.goal = skill.start_pose, skill.goal_pose
        plan = self.planner.plan(start[:3], start[3:], self.goal[:3], self.goal[3:])
        if plan.reference is None:
            reason = plan.verdict.reason
            raise DemoError(f"skill {skill.name} has no path from its own start to its goal: {reason}")
        self.nominal: JointReference = plan.reference
        self.obstacle = self._obstacle()

    @abstractmethod
    def _obstacle(self) -> LineObstacle:
        """The sphere that moves into the undisturbed motion."""

    def families(self, recording: Recording) -> list[int] | None:
        """Families of demonstrations that the arm was in, one after the other; None where the scene has none."""
        return None

    @abstractmethod
    def draw(self, recordings: Mapping[str, Recording], out: Path) -> None:
        """Write latent.png, paths.png, strip.png and arm.gif to a folder.

        recordings : of the runs `no_obstacle`, `avoidance_off` and `avoidance_on`.
        """
