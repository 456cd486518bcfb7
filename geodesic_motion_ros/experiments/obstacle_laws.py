"""How the metric may grow towards obstacles: the Gaussian hill, the completed metric, and the hard law compared.

Every scene has a start and a goal as they were demonstrated, and one or two spheres that the arm hits, or comes near
to, on the way that the planner takes between them without obstacles; start and goal stay free. Whether there is another
way is not asked. The same scenes are planned under each law.
Columns of the table, a row per law:

infeasible     share of the scenes in which no way was found that can be certified
clearance      least distance of the arm's collision spheres from the spheres on its way [mm]: median and least
length         of the body points' ways over that without obstacles: median, and exceeded by one in ten
ms             processor time of planning: median

Clearance and length are over those scenes in which every law found a way, so that they are of the same ones.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.arm_queries import ArmQuery, body_spheres, distances, draw_query
from geodesic_motion_ros.graph.ambient import LAWS, AmbientLaw
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.joint_reference import JointReference
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.plots import BLUE, GREEN, VERMILION, write_figure
from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import text_table

#: Radii of spheres [m], and how far their centres are from a place in the arm [m], as a standard deviation.
RADII, OFF = (0.02, 0.06), 0.08
#: Most spheres of a scene; how near the way comes to each, and what start and goal keep from them [m].
SPHERES, NEAR, FREE_END = 2, 0.04, 0.015
#: Part of a way on which spheres are drawn.
INTERIOR = (0.2, 0.8)
#: Time between the postures at which a reference is judged [s].
CHECK_PERIOD = 0.01
#: Places that are tried for a sphere, and queries for a scene.
_PLACES, _QUERIES = 300, 30
_COLOURS = (BLUE, VERMILION, GREEN)


@dataclass(frozen=True)
class LawAnswer:
    """What came of a scene under a law: clearance [m] and length over the free way's, NaN without a way; seconds."""

    law: AmbientLaw
    scene: int
    spheres: int
    answered: bool
    clearance: float
    length: float
    seconds: float


@dataclass(frozen=True)
class LawsReport:
    """Every answer."""

    skill: str
    answers: tuple[LawAnswer, ...]

    def of(self, law: AmbientLaw) -> list[LawAnswer]:
        """The answers under a law, scene by scene."""
        return [answer for answer in self.answers if answer.law == law]

    @property
    def common(self) -> list[int]:
        """Scenes in which every law found a way."""
        refused = {answer.scene for answer in self.answers if not answer.answered}
        return sorted({answer.scene for answer in self.answers} - refused)

    def summary(self) -> dict[str, dict[str, float | int]]:
        """Per law what the table shows; lengths in metres, times in seconds."""
        common, rows = set(self.common), {}
        for law in LAWS:
            mine = self.of(law)
            shared = [answer for answer in mine if answer.scene in common]
            clearance = np.array([answer.clearance for answer in shared] or [math.nan])
            length = np.array([answer.length for answer in shared] or [math.nan])
            rows[law] = {
                "scenes": len(mine),
                "infeasible": float(np.mean([not answer.answered for answer in mine])),
                "clearance_median": float(np.median(clearance)),
                "clearance_least": float(np.min(clearance)),
                "length_median": float(np.median(length)),
                "length_p90": float(np.quantile(length, 0.9)),
                "seconds_median": float(np.median([answer.seconds for answer in mine])),
            }
        return rows

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            "skill": self.skill, "laws": self.summary(), "common": len(self.common),
            "answers": [asdict(answer) for answer in self.answers],
        }  # fmt: skip

    def table(self) -> str:
        """The table as plain text."""
        head = ["law", "scenes", "infeasible", "clearance mm", "least", "length", "p90", "ms"]
        rows = []
        for law, row in self.summary().items():
            rows.append([
                law, row["scenes"], f"{row['infeasible']:.0%}", f"{1e3 * row['clearance_median']:.1f}",
                f"{1e3 * row['clearance_least']:.1f}", f"{row['length_median']:.3f}", f"{row['length_p90']:.3f}",
                f"{1e3 * row['seconds_median']:.1f}",
            ])  # fmt: skip
        note = f"clearance and length: over the {len(self.common)} scenes in which every law found a way"
        return "\n".join([self.skill, text_table(head, rows), note])


def compare_laws(
    skill: Skill, scenes: int = 120, seed: int = 0, settings: JointPlannerSettings | None = None
) -> LawsReport:
    """Plan so many scenes under each law; a scene depends on the seed and its number alone.

    Raises
    ------
    ParameterError : no scenes, a skill of task space or on the raw sheet, or no scene found on it.
    """
    if scenes < 1:
        raise ParameterError(f"scenes is {scenes}; at least 1 is needed")
    if skill.space != "joint":
        raise ParameterError(f"skill '{skill.name}' is of task space: the laws are compared with the whole arm")
    base = settings or JointPlannerSettings()
    planners = {law: JointSpacePlanner(skill, replace(base, ambient_law=law)) for law in LAWS}
    answers = []
    for number in range(scenes):
        query, nominal, centres, radii = _scene(planners["gaussian"], np.random.default_rng([seed, number]), number)
        for law, planner in planners.items():
            answers.append(_answer(planner, law, number, query, nominal, centres, radii))
    return LawsReport(skill.name, tuple(answers))


def _scene(
    planner: JointSpacePlanner, random: np.random.Generator, number: int
) -> tuple[ArmQuery, JointReference, np.ndarray, np.ndarray]:
    """A query, its way without obstacles, and spheres on it: centres (o, 3), radii (o,) [m]."""
    for _ in range(_QUERIES):
        query, nominal = draw_query(planner, random)
        bodies = body_spheres(planner, _postures(nominal))
        ends = body_spheres(planner, np.stack([query.start, query.goal]))
        found = [_sphere(planner, bodies, ends, random) for _ in range(1 + number % SPHERES)]
        if None not in found:
            return query, nominal, np.array([sphere[0] for sphere in found]), np.array([sphere[1] for sphere in found])
    raise ParameterError(f"no spheres were found near any of {_QUERIES} ways that leave start and goal free")


def _sphere(
    planner: JointSpacePlanner, bodies: np.ndarray, ends: np.ndarray, random: np.random.Generator
) -> tuple[np.ndarray, float] | None:
    """A sphere near the arm (n, S, 3) on its way and not at its ends (2, S, 3); None where none was found."""
    for _ in range(_PLACES):
        radius = random.uniform(*RADII)
        along = int(random.uniform(*INTERIOR) * len(bodies))
        centre = bodies[along, random.integers(bodies.shape[1])] + random.normal(scale=OFF, size=3)
        free = distances(planner, ends, centre, radius).min() >= FREE_END
        if free and distances(planner, bodies, centre, radius).min() < NEAR:
            return centre, radius
    return None


def _answer(
    planner: JointSpacePlanner,
    law: AmbientLaw,
    number: int,
    query: ArmQuery,
    nominal: JointReference,
    centres: np.ndarray,
    radii: np.ndarray,
) -> LawAnswer:
    planner.set_obstacles(centres, radii)
    began = time.thread_time()
    plan = query.plan(planner)
    seconds = time.thread_time() - began
    if plan.reference is None:
        return LawAnswer(law, number, len(radii), False, math.nan, math.nan, seconds)
    postures = _postures(plan.reference)
    bodies = body_spheres(planner, postures)
    clearance = min(
        float(distances(planner, bodies, centre, radius).min()) for centre, radius in zip(centres, radii, strict=True)
    )
    length = _length(planner, postures) / _length(planner, _postures(nominal))
    return LawAnswer(law, number, len(radii), True, clearance, length, seconds)


def _postures(reference: JointReference) -> np.ndarray:
    times = np.append(np.arange(0.0, reference.duration, CHECK_PERIOD), reference.duration)
    return np.ascontiguousarray(reference.samples(times)[0])


def _length(planner: JointSpacePlanner, postures: np.ndarray) -> float:
    """Mean over the body points of how far they go [m]."""
    body = planner.graph.body
    points = place_body_points(postures, body.frames, body.offsets, planner.robot.chain)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=2).sum(axis=0).mean())


def draw_laws(report: LawsReport, path: Path) -> None:
    """Clearance over length of every way, a colour for each law."""
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for law, colour in zip(LAWS, _COLOURS, strict=True):
        found: Sequence[LawAnswer] = [answer for answer in report.of(law) if answer.answered]
        lengths, clearances = [item.length for item in found], [1e3 * item.clearance for item in found]
        axes.scatter(lengths, clearances, color=colour, s=14, alpha=0.7, label=f"{law}: {len(found)} ways")
    axes.set_xlabel("length of the way over that without obstacles")
    axes.set_ylabel("least clearance on it [mm]")
    axes.set_yscale("log")
    axes.legend(frameon=False)
    write_figure(figure, path)
