"""One obstacle, several largest detours: the same motion played for each of them, in a table and side by side.

The arm moves from the start to the goal of a skill when a sphere appears on the tool's path ahead, and stands.
It stops in front of it; what it does then is for the setting `detour` to say. The arm follows exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.cli.arguments import metres
from geodesic_motion_ros.contract.settings import LARGEST_DETOUR, PlannerSettings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ExperimentError, ParameterError
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import write_figure
from geodesic_motion_studies.experiments.study import OfSkill, Report, option

#: Between ticks; how long a blocked arm waits before it searches a detour, and an arm is watched that stands [s].
TICK, PATIENCE, WATCHED = 0.01, 0.3, 1.5
#: Of tubes in the picture: the path without the sphere, and that of the tool.
_NOMINAL, _PLAYED = (0.62, 0.65, 0.69), (0.16, 0.50, 0.73)
_WIDTH, _HEIGHT = 560, 520


@dataclass(frozen=True, eq=False)
class DetourRun:
    """What the arm did.

    Attributes
    ----------
    detour : how far it might lead [m]. displacement : how far the tool left what was demonstrated [m].
    postures : (n, eta) [rad] in every tick. reached : whether it came to its goal. reason : why not.
    clearance : smallest distance of the arm from the sphere [m]. duration : until it stands for good [s].
    """

    detour: float
    displacement: float
    postures: np.ndarray
    reached: bool
    reason: str
    clearance: float
    duration: float


@dataclass(frozen=True, eq=False)
class DetoursReport(Report):
    """The sphere, the tool's path where it is not there, (n, 3) [m], and what the arm did with each largest detour."""

    skill: str
    centre: np.ndarray
    radius: float
    nominal: np.ndarray
    runs: tuple[DetourRun, ...]

    def as_dict(self) -> dict[str, Any]:
        return {
            "skill": self.skill, "centre_m": self.centre, "radius_m": self.radius,
            "runs": [
                {
                    "detour_m": run.detour, "displacement_m": run.displacement, "reached": run.reached,
                    "reason": run.reason, "clearance_m": run.clearance, "duration_s": run.duration,
                }
                for run in self.runs
            ],
        }  # fmt: skip

    def table(self) -> str:
        """As plain text."""
        rows: list[list[Cell]] = [
            [f"{100.0 * run.detour:.0f} cm", "reached" if run.reached else "waits", 100.0 * run.displacement,
             1000.0 * run.clearance, run.duration]
            for run in self.runs
        ]  # fmt: skip
        head = ["detour", "goal", "displaced cm", "clearance mm", "seconds"]
        title = f"{self.skill}: a sphere of {100.0 * self.radius:.1f} cm appears on the tool's path"
        return "\n".join([title, text_table(head, rows, digits=1, left=(0, 1))])

    def draw(self, path: Path) -> None:
        """A panel for each largest detour: the tool's path, and the arm where that is farthest from the one without the
        sphere, or where it stopped.
        """
        figure = Figure(figsize=(4.0 * len(self.runs), 4.15), layout="constrained")
        figure.get_layout_engine().set(w_pad=0.02, h_pad=0.02, wspace=0.0, hspace=0.0)
        panels = figure.subplots(1, len(self.runs), squeeze=False)[0]
        with ArmWorld(scene=DeclaredScene.from_name("table")) as world:
            world.set_obstacles({"sphere": (self.centre, self.radius)})
            for axes, run in zip(panels, self.runs, strict=True):
                tool = np.array([world.robot.forward(posture)[0] for posture in run.postures])
                world.add_curve(self.nominal, _NOMINAL, radius=0.003)
                world.add_curve(tool, _PLAYED, radius=0.006)
                away = np.min(np.linalg.norm(tool[:, None] - self.nominal, axis=2), axis=1)
                world.reset(run.postures[int(np.argmax(away)) if run.reached else -1])
                axes.imshow(world.render(_WIDTH, _HEIGHT, "front", oversampling=2))
                world.clear_curves()
                axes.set(xticks=[], yticks=[])
                axes.set_title(f"detour {100.0 * run.detour:.0f} cm: {_outcome(run)}", fontsize=12)
        write_figure(figure, path)


@dataclass(frozen=True)
class Detours(OfSkill):
    """Play one motion with each largest detour [m].

    place : share of the motion's time at which the tool would be at the sphere's centre. appears : share of that time
    at which it appears.
    """

    detours: tuple[float, ...] = option(
        (0.0, 0.1, 0.2), "how far the tool may leave it [m]", type=metres, metavar="M,M"
    )  # fmt: skip
    radius: float = option(0.065, "of the sphere [m]", metavar="M")
    place: float = option(0.45, "share of the motion at which the tool meets it")
    appears: float = option(0.2, "share of the motion at which it appears")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_detours(self.detours)
        if not (self.radius > 0.0 and 0.0 <= self.appears < self.place < 1.0):
            raise ParameterError(
                f"radius {self.radius}, appears {self.appears}, place {self.place}: a positive radius is needed, and "
                "0 <= appears < place < 1"
            )

    def measured(self, skill: Skill) -> DetoursReport:
        """ExperimentError: no path to the skill's goal."""
        planner = ReactivePlanner(skill, PlannerSettings(patience=PATIENCE), scene=DeclaredScene.empty())
        reference = free_motion(planner)
        forward = planner.robot.forward
        centre = forward(reference.sample(self.place * reference.duration)[0])[0]
        sphere = Obstacles.of_spheres(centre[None], np.array([self.radius]))
        path = reference.samples(np.linspace(0.0, reference.duration, 200))[0]
        begins = reference.positions[0], skill.goal_pose, sphere, self.appears * reference.duration
        runs = [_played(planner, *begins, detour) for detour in self.detours]
        return DetoursReport(skill.name, centre, self.radius, np.array([forward(q)[0] for q in path]), tuple(runs))


def check_detours(detours: Sequence[float]) -> None:
    """ParameterError where there are none, or one that no planner takes."""
    if not detours or not all(0.0 <= detour <= LARGEST_DETOUR for detour in detours):
        raise ParameterError(f"detours {', '.join(map(str, detours))} m: they must be from 0 to {LARGEST_DETOUR} m")


def free_motion(planner: ReactivePlanner) -> JointReference:
    """From the start of the planner's skill to its goal, without obstacles; ExperimentError where there is none."""
    skill = planner.skill
    plan = planner.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3]))
    if plan.reference is None:
        raise ExperimentError(f"skill '{skill.name}' has no path from its start to its goal: {plan.verdict.reason}")
    return plan.reference


def _played(
    planner: ReactivePlanner, start: np.ndarray, goal: np.ndarray, sphere: Obstacles, appears: float, detour: float
) -> DetourRun:
    """From rest at a configuration (eta,) to a pose (7,), a sphere standing on the path from a time [s] on."""
    planner.clear_goal()
    planner.take_obstacles(Obstacles.none())
    planner.stand_at(start, 0.0)
    planner.set_goal(goal[:3], goal[3:])
    planner.set_detour(detour)
    postures, ticks, moved, displacement = [start], 0, 0, 0.0
    while ticks - moved < WATCHED / TICK:
        now = ticks * TICK
        if now >= appears:
            planner.take_obstacles(sphere)
        plan = planner.tick(now)
        displacement = max(displacement, plan.verdict.figures.displacement)
        ticks += 1
        commanded = planner.commanded_state(ticks * TICK)
        assert commanded is not None
        if not np.array_equal(commanded[0], postures[-1]):
            moved = ticks
        postures.append(commanded[0])
    reached = bool(np.linalg.norm(planner.robot.forward(postures[-1])[0] - goal[:3]) < 1e-3)
    apart = [obstacle_clearance(planner.collision, planner.robot, q, sphere)[0] for q in postures]
    return DetourRun(
        detour, displacement, np.array(postures[: moved + 1]), reached, "" if reached else plan.verdict.reason,
        float(min(apart)), moved * TICK,
    )  # fmt: skip


def _outcome(run: DetourRun) -> str:
    if not run.reached:
        return "it stops"
    return f"it passes, {1000.0 * run.clearance:.0f} mm clear"
