"""What the demo shows of a skill: a path, an obstacle that moves into it, and pictures of what came of both."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.parameters import Value
from geodesic_motion_ros.nodes.planner_parameters import defaults_of_robot, planner_settings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import SkillError

#: Parameters of the planner node as they are by default.
DEFAULTS: dict[str, Value] = {parameter.name: parameter.default for parameter in PLANNER}
#: Until the goal is sent the sphere is this far [m] from the arm; the undisturbed arm goes this deep [m] into it.
ROOM, DEPTH = 0.10, 0.02


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
        SkillError : the skill has no path from its own start to its goal, or no sphere is a fair obstacle to that.
        """
        self.skill = skill
        # as the planner node makes it of the skill
        settings = planner_settings(DEFAULTS | defaults_of_robot(skill, DEFAULTS) | self.patience)
        self.planner = ReactivePlanner(skill, settings, scene=declared)
        self.goal = skill.goal_pose
        plan = self._plan()
        if plan.reference is None:
            reason = plan.verdict.reason
            raise SkillError(f"skill {skill.name} has no path from its own start to its goal: {reason}")
        self.nominal: JointReference = plan.reference
        obstacle = next((sphere for sphere in self._obstacles() if self._is_fair(sphere)), None)
        if obstacle is None:
            raise SkillError(
                f"skill {skill.name}: the demo has no sphere for it that is {100 * ROOM:.0f} cm from the arm at its "
                "start, in the path of its motion, and leaves another path to its goal"
            )
        self.obstacle = obstacle

    @abstractmethod
    def _obstacles(self) -> Iterator[LineObstacle]:
        """Spheres that move into the undisturbed motion; the first that is fair is taken."""

    def _is_fair(self, sphere: LineObstacle) -> bool:
        """Whether a sphere is far from the arm at its start, never in its base, would be hit, and leaves a path."""
        nominal, robot, model = self.nominal, self.planner.robot, self.planner.collision
        centres = np.array([sphere.position(time) for time in nominal.times])
        arm = model.positions(robot, np.ascontiguousarray(nominal.positions))
        gaps = np.linalg.norm(arm - centres[:, None], axis=2) - model.radii - sphere.radius
        if np.min(gaps[0]) < ROOM or np.min(gaps[:, ~model.moving], initial=np.inf) < 0.0:
            return False
        return np.min(gaps[:, model.moving]) < -DEPTH and self._leaves_a_path(sphere)

    def _leaves_a_path(self, sphere: LineObstacle) -> bool:
        """Whether the planner finds one, be it a detour, past a sphere that has come to rest."""
        self.planner.set_obstacles(np.array([sphere.end]), np.array([sphere.radius]))
        reached = self._plan().verdict.ok
        self.planner.set_obstacles(np.empty((0, 3)), np.empty(0))
        return reached

    def _plan(self) -> Plan:
        """From the skill's mean start to its mean goal, among the planner's obstacles."""
        start, goal = self.skill.start_pose, self.skill.goal_pose
        return self.planner.plan(start[:3], start[3:], goal[:3], goal[3:])

    def families(self, recording: Recording) -> list[int] | None:
        """Families of demonstrations that the arm was in, one after the other; None where the scene has none."""
        return None

    @abstractmethod
    def draw(self, recordings: Mapping[str, Recording], out: Path) -> None:
        """Write latent.png, paths.png, strip.png and arm.gif to a folder.

        recordings : of the runs `no_obstacle`, `avoidance_off` and `avoidance_on`.
        """
