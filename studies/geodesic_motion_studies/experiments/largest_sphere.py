"""The largest sphere that is passed: on the path of the tool, place by place, and by how far a detour may lead.

The motion is the planner's from the start to the goal of a skill without obstacles; how spheres are placed and the
largest is found is for `visualization.largest_sphere`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.cli.arguments import metres
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.largest_sphere import STEP, SpherePlaces, find_largest_passed
from geodesic_motion_ros.visualization.passed_spheres import draw_passed_spheres
from geodesic_motion_studies.experiments.detours import check_detours, free_motion
from geodesic_motion_studies.experiments.study import OfSkill, Report, option

#: A sphere of which it is counted at how many places it is passed [m].
COUNTED = 0.06


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
        named = (f"detour {100.0 * detour:.0f} cm" for detour in self.detours)
        title = f"{self.skill}: the largest sphere that is passed"
        draw_passed_spheres(path, title, self.shares, self.free, dict(zip(named, self.radii.T, strict=True)), COUNTED)


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
        places, ascending = SpherePlaces.of_motion(planner, nominal, self.places), np.unique(self.detours)
        radii, reasons = np.zeros((self.places, len(ascending))), []
        for number in tqdm(range(self.places), desc=skill.name, unit="place"):
            own, radius = [], 0.0
            for column, detour in enumerate(ascending):
                # What is passed with a shorter detour is passed with a longer one.
                planner.set_detour(detour)
                radius, reason = find_largest_passed(planner, places.centres[number], places.free[number], radius)
                radii[number, column] = radius
                own.append(reason)
            reasons.append(tuple(own))
        return LargestSpheres(skill.name, places.shares, ascending, places.free, radii, tuple(reasons))
