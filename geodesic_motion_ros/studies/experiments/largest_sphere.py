"""The largest sphere that is passed: on the path of the tool, place by place, and by how far a detour may lead.

The motion is the planner's from the start to the goal of a skill without obstacles. At evenly spaced places
of the tool's path one sphere stands with its centre on it. It grows until there is no certified motion from start to
goal any more; the last one is the largest that is passed. Near its ends the arm itself has no room: a sphere that
touches the arm at start or goal stops any planner, and how large that is stands beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.cli.arguments import metres
from geodesic_motion_ros.geometry.curves import arc_length_fractions
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.arm_clearance import obstacle_clearance
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.studies.experiments.detours import check_detours, free_motion
from geodesic_motion_ros.studies.experiments.study import OfSkill, Report, option
from geodesic_motion_ros.trajectory.trajectory import interpolated
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION, write_figure

#: Radii are multiples of the first [m]; none is larger than the other.
STEP, LARGEST = 0.005, 0.12
#: Places of the tool's path are between these shares of its length.
INTERIOR = (0.05, 0.95)
#: A sphere of which it is counted at how many places it is passed [m].
COUNTED = 0.06
#: Samples of the path that places are taken from.
_SAMPLES = 400
_COLOURS = (GREY, BLUE, VERMILION, GREEN, ORANGE)


@dataclass(frozen=True, eq=False)
class LargestSpheres(Report):
    """What was passed along one motion, at n places and with d largest detours.

    Attributes
    ----------
    shares : (n,) of the tool's path. detours : (d,) [m].
    free : (n,) radius [m] of the largest sphere that touches the arm neither at the start nor at the goal.
    radii : (n, d) [m] of the largest sphere that is passed; 0: the smallest one is not.
    reasons : why the next one is not, n tuples of d.
    """

    skill: str
    shares: np.ndarray
    detours: np.ndarray
    free: np.ndarray
    radii: np.ndarray
    reasons: tuple[tuple[str, ...], ...]

    def as_dict(self) -> dict[str, Any]:
        return {
            "skill": self.skill, "shares": self.shares, "detours_m": self.detours, "free_radii_m": self.free,
            "radii_m": self.radii, "reasons": self.reasons, "counted_radius_m": COUNTED,
            "places_where_it_is_passed": self._passed().sum(axis=0),
            "places_where_it_leaves_the_ends_free": int(self._possible().sum()),
        }  # fmt: skip

    def table(self) -> str:
        """As plain text: a row for each place, and how often a sphere of `COUNTED` is passed."""
        rows: list[list[Cell]] = [
            [f"{100.0 * share:.0f} %", 100.0 * free, *(100.0 * radii).tolist()]
            for share, free, radii in zip(self.shares, self.free, self.radii, strict=True)
        ]
        head = ["place", "ends free", *(f"detour {100.0 * detour:.0f} cm" for detour in self.detours)]
        passed, possible, size = self._passed(), self._possible(), f"{100.0 * COUNTED:.0f} cm"
        lines = [
            f"detour {100.0 * detour:.0f} cm: {size} passed at {int(own.sum())} of {len(own)} places; at "
            f"{int((own & possible).sum())} of the {int(possible.sum())} where a sphere of {size} leaves both ends free"
            for detour, own in zip(self.detours, passed.T, strict=True)
        ]
        title = f"{self.skill}: radius of the largest sphere on the tool's path that is passed, in cm"
        return "\n".join([title, text_table(head, rows, digits=1), *lines])

    def _passed(self) -> np.ndarray:
        """(n, d) where a sphere of `COUNTED` is passed."""
        return self.radii > COUNTED - 0.5 * STEP

    def _possible(self) -> np.ndarray:
        """(n,) where one touches the arm at neither end."""
        return self.free > COUNTED

    def draw(self, path: Path) -> None:
        """Radii along the motion, a line for each detour; grey is what touches the arm at start or goal."""
        figure = Figure(figsize=(6.4, 3.4), layout="constrained")
        axes = figure.subplots()
        places, top = 100.0 * self.shares, 100.0 * LARGEST
        axes.fill_between(
            places, np.minimum(100.0 * self.free, top), top, color=GREY, alpha=0.2, linewidth=0.0,
            label="touches start or goal",
        )  # fmt: skip
        for detour, radii, colour in zip(self.detours, self.radii.T, _COLOURS, strict=False):
            label = f"detour {100.0 * detour:.0f} cm"
            axes.plot(places, 100.0 * radii, color=colour, marker="o", markersize=3.5, linewidth=1.6, label=label)
        axes.axhline(100.0 * COUNTED, color="black", linewidth=0.8, linestyle=":")
        axes.set(
            xlabel="place on the tool's path [%]", ylabel="radius passed [cm]", ylim=(-0.2, top), xlim=(0.0, 100.0),
            title=f"{self.skill}: the largest sphere that is passed",
        )  # fmt: skip
        axes.grid(alpha=0.3)
        figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=9)
        write_figure(figure, path)


@dataclass(frozen=True)
class LargestSphere(OfSkill):
    """Measure one skill at so many places with detours up to each of several lengths [m]."""

    places: int = option(20, "on the tool's path", least=2)
    detours: tuple[float, ...] = option(
        (0.0, 0.1, 0.22), "how far the tool may leave it [m]", type=metres, metavar="M,M"
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        check_detours(self.detours)

    def measured(self, skill: Skill) -> LargestSpheres:
        """ExperimentError: no path to the skill's goal."""
        planner = ReactivePlanner(skill, scene=DeclaredScene.empty())
        nominal = free_motion(planner)
        ends = (skill.start_pose[:3], skill.start_pose[3:], skill.goal_pose[:3], skill.goal_pose[3:])
        postures = nominal.samples(np.linspace(0.0, nominal.duration, _SAMPLES))[0]
        tool = np.array([planner.robot.forward(posture)[0] for posture in postures])
        shares, ascending = np.linspace(*INTERIOR, self.places), np.unique(self.detours)
        centres = interpolated(shares, arc_length_fractions(tool), tool)
        radii, reasons = np.zeros((self.places, len(ascending))), []
        for number, centre in enumerate(tqdm(centres, desc=skill.name, unit="place")):
            own, radius = [], 0.0
            for column, detour in enumerate(ascending):
                # What is passed with a shorter detour is passed with a longer one.
                planner.set_detour(detour)
                radius, reason = _grown(planner, ends, centre, radius)
                radii[number, column] = radius
                own.append(reason)
            reasons.append(tuple(own))
        free = np.array([_free_ends(planner, postures[[0, -1]], centre) for centre in centres])
        return LargestSpheres(skill.name, shares, ascending, free, radii, tuple(reasons))


def _grown(
    planner: ReactivePlanner, ends: tuple[np.ndarray, ...], centre: np.ndarray, passed: float
) -> tuple[float, str]:
    """Radius of the largest sphere that is passed, from one on that is [m], and why the next one is not."""
    while passed < LARGEST - 0.5 * STEP:
        planner.set_obstacles(centre[None], np.array([passed + STEP]))
        plan = planner.plan(*ends)
        if plan.reference is None:
            return passed, plan.verdict.reason
        passed += STEP
    return passed, ""


def _free_ends(planner: ReactivePlanner, ends: np.ndarray, centre: np.ndarray) -> float:
    """Distance [m] of a point from the arm at both ends (2, eta), 0 inside."""
    point = Obstacles.of_spheres(centre[None], np.zeros(1))
    return max(0.0, min(obstacle_clearance(planner.collision, planner.robot, end, point)[0] for end in ends))
