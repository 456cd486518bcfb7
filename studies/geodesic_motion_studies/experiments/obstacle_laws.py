"""How the metric may grow towards obstacles, and what removes nodes: the paper's law, ours, and both halves of ours.

Every scene has a start and a goal as they were demonstrated and a sphere that leaves them free. On the path that the
planner takes without obstacles the arm comes near it in every third scene (*near*), touches it where another family's
mean path is free in the next (*one path*), and touches it, whatever else is free, in the last (*touched*). The same
scenes are planned under these laws:

ignored         the path without obstacles, as a control
soft alone      the Gaussian hill of `manifold/ambient_metric.py`, the paper's law: nothing is removed, nothing
certified. Sheet,
                graph and the rest are the planner's, not the paper's
hard alone      nodes in obstacles are removed, references certified; the metric does not grow
soft and hard   the Gaussian hill, nodes removed, references certified: what the planner does
completed       the metric without a top in the place of the Gaussian; nodes removed, references certified

each but the first and the third with several strengths zeta and widths, those of the Gaussian over the radius of
obstacle and body together. Columns of the table:

infeasible  share of the scenes in which no path was found
hits        paths found on which the arm (its meshes, by PyBullet) touches the sphere, of all that were found
capped      both again where paths that cost too much count as none: more than `cap` times what a demonstration costs
            without obstacles; and how many hits and clear paths that refuses. The planner always does that, with
            `PlannerSettings.cost_cap`; the paper tells blocked paths by it
least       the least distance of the arm's collision spheres from that sphere on any of them [mm], negative inside
clearance   the same distance: mean of the paths [mm]
deviation   of the body points from the path without obstacles, matched by dynamic time warping: mean of the paths [mm]
length      of the body points' paths over that without obstacles: mean
ms          processor time of planning: median

Clearance, deviation and length are over those scenes in which a path was always found, so that they are of the same
ones.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.demonstrations.canonical import sample_body_arc
from geodesic_motion_ros.kernels.loading import load_kernels
from geodesic_motion_ros.manifold.ambient_law import AmbientLaw
from geodesic_motion_ros.manifold.ambient_metric import ambient_factor
from geodesic_motion_ros.motion.plan import MotionState
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal, ConfigurationQueryBuilder
from geodesic_motion_ros.queries.query import Query
from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, VERMILION, write_figure
from geodesic_motion_studies.comparison.methods.geodesic import no_body
from geodesic_motion_studies.experiments.arm_queries import body_spheres, distances
from geodesic_motion_studies.experiments.blocked_arm import arm_clearance, every
from geodesic_motion_studies.experiments.obstacle_law_scenes import CHECK_PERIOD, LawScene, draw_scene
from geodesic_motion_studies.experiments.study import OfSkill, Report, option
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry
from geodesic_motion_studies.tools.similarity import dtw_matching

Kind = Literal["ignored", "soft alone", "hard alone", "soft and hard", "completed"]
#: zeta, and Gaussian width over obstacle and body radius.
STRENGTHS, WIDTHS = (100.0, 1000.0, 10000.0), (0.5, 1.0)
#: The sphere and the strength for which the picture shows the laws [m].
_SHOWN_RADIUS, _SHOWN_STRENGTH = 0.04, 1000.0
_COLOURS: dict[Kind, str] = {"soft alone": VERMILION, "soft and hard": BLUE, "completed": GREEN}
_STYLES = dict(zip(WIDTHS, ("-", "--"), strict=True))
#: How far apart marks of one strength are drawn.
_APART = 0.1
#: Postures, evenly along the body's arc, that are matched with those of the path without obstacles.
_COMPARED = 100


@dataclass(frozen=True)
class Law:
    """A method to plan among obstacles: strength (zeta) and width as of `PlannerSettings`; None where there is none."""

    kind: Kind
    strength: float | None = None
    width: float | None = None

    @property
    def is_hard(self) -> bool:
        """Whether nodes in obstacles are removed and references certified."""
        return self.kind != "soft alone"

    def settings(self, base: PlannerSettings) -> PlannerSettings:
        """The planner's settings under this law."""
        if self.strength is None or self.width is None:
            return replace(base, ambient_law="hard")
        ambient: AmbientLaw = "completed" if self.kind == "completed" else "gaussian"
        return replace(base, ambient_law=ambient, ambient_strength=self.strength, ambient_width_ratio=self.width)


CONTROL = Law("ignored")
#: Those that are planned with, in the order of the table.
LAWS: tuple[Law, ...] = tuple(
    law
    for kind in get_args(Kind)[1:]
    for law in (
        [Law(kind)] if kind == "hard alone" else [Law(kind, zeta, width) for width in WIDTHS for zeta in STRENGTHS]
    )
)


@dataclass(frozen=True)
class LawAnswer:
    """What came of a scene under a law; the rest is NaN and False without a path, seconds are NaN of the control.

    Attributes
    ----------
    sphere : what it does, a key of `BETWEEN`.
    answered : whether there is a path; under_cap : whether there is one that does not cost too much.
    hits : whether the arm touches the sphere.
    clearance, length, deviation, seconds : as of the table, in metres and seconds.
    """

    law: Law
    scene: int
    sphere: str
    answered: bool
    under_cap: bool
    seconds: float
    hits: bool = False
    clearance: float = math.nan
    deviation: float = math.nan
    length: float = math.nan


@dataclass(frozen=True)
class LawsReport(Report):
    """Every answer, the control's too, under those laws."""

    skill: str
    answers: tuple[LawAnswer, ...]
    laws: tuple[Law, ...] = LAWS

    def of(self, law: Law) -> list[LawAnswer]:
        """The answers under a law, scene by scene."""
        return [answer for answer in self.answers if answer.law == law]

    @property
    def common(self) -> list[int]:
        """Scenes in which a path was found under every law."""
        refused = {answer.scene for answer in self.answers if not answer.answered}
        return sorted({answer.scene for answer in self.answers} - refused)

    def summary(self) -> list[dict[str, Any]]:
        """Per law what the table shows; lengths in metres, times in seconds."""
        common, rows = set(self.common), []
        for law in (CONTROL, *self.laws):
            mine = self.of(law)
            found = [answer for answer in mine if answer.answered]
            shared = [answer for answer in mine if answer.scene in common]
            rows.append({
                **asdict(law),
                "scenes": len(mine),
                "infeasible": 1.0 - len(found) / len(mine),
                "found": len(found),
                "hits": sum(answer.hits for answer in found),
                "capped_infeasible": float(np.mean([not answer.under_cap for answer in mine])),
                "capped_found": sum(answer.under_cap for answer in mine),
                "capped_hits": sum(answer.hits and answer.under_cap for answer in mine),
                "clearance_least": min((answer.clearance for answer in found), default=math.nan),
                "clearance_mean": _mean([answer.clearance for answer in shared]),
                "deviation_mean": _mean([answer.deviation for answer in shared]),
                "length_mean": _mean([answer.length for answer in shared]),
                "seconds_median": float(np.median([answer.seconds for answer in mine])),
            })  # fmt: skip
        return rows

    def as_dict(self) -> dict[str, Any]:
        return {
            "skill": self.skill, "laws": self.summary(), "common": len(self.common),
            "answers": [asdict(answer) for answer in self.answers],
        }  # fmt: skip

    def table(self) -> str:
        """The table as plain text."""
        head = [
            "obstacles", "zeta", "width", "infeasible", "hits", "capped: infeasible", "hits",
            "hits, clear refused", "least mm", "clearance mm", "deviation mm", "length", "ms",
        ]  # fmt: skip
        rows: list[list[Cell]] = []
        for row in self.summary():
            length = row["length_mean"]
            rows.append([
                row["kind"], None if row["strength"] is None else f"{row['strength']:.0f}",
                None if row["width"] is None else f"{row['width']:g}", f"{row['infeasible']:.0%}",
                f"{row['hits']} of {row['found']}", f"{row['capped_infeasible']:.0%}",
                f"{row['capped_hits']} of {row['capped_found']}", _refused(row), 1e3 * row["clearance_least"],
                1e3 * row["clearance_mean"], 1e3 * row["deviation_mean"],
                None if math.isnan(length) else f"{length:.3f}", 1e3 * row["seconds_median"],
            ])  # fmt: skip
        scenes = len(self.of(CONTROL))
        note = f"{scenes} scenes; clearance, deviation, length: over the {len(self.common)} that always have a path"
        return "\n".join([self.skill, text_table(head, rows, 1), note])

    def draw(self, path: Path) -> None:
        """The laws themselves, and what the table says of each against its strength: filled marks the narrow width."""
        figure = Figure(figsize=(11.0, 6.4), layout="constrained")
        panels = figure.subplots(2, 3).ravel()
        _draw_factors(panels[0])
        rows = self.summary()
        for row in rows:
            row["hit_share"] = row["hits"] / row["found"] if row["found"] else math.nan
        for axes, letter, column, scale, title in (
            (panels[1], "b", "hit_share", 1e2, "paths found that hit the sphere [%]"),
            (panels[2], "c", "clearance_mean", 1e3, "clearance, mean [mm]"),
            (panels[3], "d", "deviation_mean", 1e3, "deviation from the path without [mm]"),
            (panels[4], "e", "infeasible", 1e2, "scenes without a path [%]"),
            (panels[5], "f", "capped_infeasible", 1e2, "without one that costs up to the cap [%]"),
        ):
            _draw_column(axes, rows, column, scale)
            axes.set_title(f"{letter}  {title}", loc="left", fontsize=11)
        handles, names = panels[1].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
        write_figure(figure, path)


def _refused(row: dict[str, Any]) -> str:
    """Hits and clear paths that the cap refuses, of a row of the summary."""
    hits = row["hits"] - row["capped_hits"]
    return f"{hits}, {row['found'] - row['capped_found'] - hits}"


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if len(values) else math.nan


@dataclass(frozen=True)
class ObstacleLaws(OfSkill):
    """Plan so many scenes under each law; a scene depends on the seed and its number alone."""

    skill: str = option("panda_reach_to_grasp", "of joint space: its folder, or a shipped name", metavar="SKILL")
    scenes: int = option(120, "of a sphere near the path, or on it", least=1)
    seed: int = option(0, "of the scenes")
    cap: float = option(PlannerSettings.cost_cap, "times what a demonstration costs: dearer paths are capped", least=1)
    laws: tuple[Law, ...] = LAWS
    planner: PlannerSettings = field(default_factory=PlannerSettings)

    def measured(self, skill: Skill) -> LawsReport:
        """ParameterError: a skill of task space or on the raw sheet, or no scene found on it."""
        if skill.space != "joint":
            raise ParameterError(f"skill '{skill.name}' is of task space: the laws are compared with the whole arm")
        compared = _Compared(skill, self.laws, replace(self.planner, cost_cap=self.cap))
        answers = [answer for number in range(self.scenes) for answer in compared.answers(number, self.seed)]
        return LawsReport(skill.name, tuple(answers), self.laws)


class _Compared:
    """Draws scenes on a skill's paths, plans them under every law on one graph, and judges what is found."""

    def __init__(self, skill: Skill, laws: Sequence[Law], settings: PlannerSettings) -> None:
        self._planner = planner = ReactivePlanner(skill, settings)
        load_kernels(planner)
        self._geometry = CollisionGeometry("panda")
        bodies = {True: planner.collision, False: no_body(planner.robot)}
        self._queries = {
            hard: ConfigurationQueryBuilder(skill, planner.graph, settings, planner.robot, body)
            for hard, body in bodies.items()
        }  # fmt: skip
        self._solvers = {
            law: Solver(
                skill, planner.graph, law.settings(settings), planner.robot, bodies[law.is_hard], planner.limits
            )
            for law in laws
        }

    def answers(self, number: int, seed: int) -> list[LawAnswer]:
        """Of one scene, the control's first."""
        scene = draw_scene(self._planner, np.random.default_rng([seed, number]), number)
        nominal, goal = every(CHECK_PERIOD, scene.nominal), ConfigurationGoal(scene.query.goal[None], "drawn")
        built = {hard: builder.build(scene.query.start, goal) for hard, builder in self._queries.items()}
        obstacles = Obstacles.of_spheres(scene.centre[None], np.array([scene.radius]))
        control = LawAnswer(CONTROL, number, scene.sphere, True, True, math.nan)
        answers = [self._judged(control, nominal, nominal, scene)]
        for law, solver in self._solvers.items():
            began = time.thread_time()
            path = _solved(solver, built[law.is_hard], obstacles)
            seconds, under_cap = time.thread_time() - began, path is not None
            if path is None:
                path = _solved(solver, built[law.is_hard], obstacles, capped=False)
            answer = LawAnswer(law, number, scene.sphere, path is not None, under_cap, seconds)
            answers.append(answer if path is None else self._judged(answer, path, nominal, scene))
        return answers

    def _judged(self, answer: LawAnswer, path: np.ndarray, nominal: np.ndarray, scene: LawScene) -> LawAnswer:
        """An answer with the figures of its path (n, eta), beside the one without obstacles (m, eta)."""
        clearance = float(distances(self._planner, body_spheres(self._planner, path), scene.centre, scene.radius).min())
        radii = np.array([scene.radius])
        # The arm's spheres hold its meshes: where they are free so is the arm.
        hits = clearance <= 0.0 and arm_clearance(self._geometry, path, scene.centre[None], radii) <= 0.0
        return replace(
            answer, hits=hits, clearance=clearance, deviation=self._deviation(path, nominal),
            length=_length(self._points(path)) / _length(self._points(nominal)),
        )  # fmt: skip

    def _points(self, postures: np.ndarray) -> np.ndarray:
        """Body points (n, K, 3) [m]."""
        body = self._planner.graph.body
        return place_body_points(np.ascontiguousarray(postures), body.frames, body.offsets, self._planner.robot.chain)

    def _deviation(self, path: np.ndarray, nominal: np.ndarray) -> float:
        """Mean distance [m] of the body points on a path from those on another, at the postures that match."""
        one, other = (
            self._points(sample_body_arc(postures, self._planner.robot, self._planner.skill.metric, _COMPARED))
            for postures in (path, nominal)
        )
        rows, columns = dtw_matching(one.reshape(_COMPARED, -1), other.reshape(_COMPARED, -1)).T
        return float(np.linalg.norm(one[rows] - other[columns], axis=2).mean())


def _solved(
    solver: Solver, query: Query | Refusal, obstacles: Obstacles, capped: bool = True
) -> np.ndarray | None:
    """Configurations (n, eta) on the path from rest at the start to the goal; None where there is none.

    capped : whether it may cost no more than the query allows.
    """
    if isinstance(query, Refusal):
        return None
    if not capped:
        query = replace(query, cost_limit=math.inf)
    still = np.zeros_like(query.start)
    state = MotionState(0.0, query.start, still, still, query.start_latent)
    reference = solver.solve(query, state, obstacles, solver.attempts).reference
    return None if reference is None else every(CHECK_PERIOD, reference)


def _length(points: np.ndarray) -> float:
    """Mean over the body points (n, K, 3) of how far they go [m]."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=2).sum(axis=0).mean())


def _draw_factors(axes: Axes) -> None:
    """The ambient factor of a body point over its distance from a sphere's surface."""
    away = np.linspace(0.002, 0.25, 300)
    body = PlannerSettings().body_radius
    centres, radii = np.zeros((1, 3)), np.array([_SHOWN_RADIUS])
    for kind in ("soft and hard", "completed"):
        for width, style in _STYLES.items():
            factors = [
                ambient_factor(
                    _SHOWN_RADIUS + d, 0.0, 0.0, body, centres, radii, _SHOWN_STRENGTH, width, kind == "completed"
                )
                for d in away
            ]  # fmt: skip
            axes.plot(100.0 * away, factors, style, color=_COLOURS[kind])
    axes.axvline(100.0 * body, color=GREY, linewidth=0.8)
    axes.annotate("the body touches", (100.0 * body, 2e4), xytext=(4, 0), textcoords="offset points", fontsize=8)
    surface = f"body point from a sphere of {100.0 * _SHOWN_RADIUS:.0f} cm [cm]"
    axes.set(yscale="log", ylim=(0.8, 1e5), xlabel=surface)
    axes.set_title(f"a  ambient factor, zeta {_SHOWN_STRENGTH:.0f}", loc="left", fontsize=11)
    axes.annotate(f"dashed: width {WIDTHS[-1]:g}", (24.5, 6e2), ha="right", fontsize=8)
    axes.grid(alpha=0.3)


def _draw_column(axes: Axes, rows: Sequence[dict[str, Any]], column: str, scale: float) -> None:
    """One column of the table against the strength, a mark for each law and width."""
    for number, (kind, width) in enumerate(product(_COLOURS, WIDTHS)):
        values = [scale * row[column] for row in rows if (row["kind"], row["width"]) == (kind, width)]
        axes.plot(
            np.arange(len(values)) + _APART * (number - 2.5), values, "o", color=_COLOURS[kind], markersize=6,
            markerfacecolor="white" if width == WIDTHS[-1] else None, label=f"{kind}, width {width:g}",
        )  # fmt: skip
    for kind, style in (("hard alone", "-"), ("ignored", ":")):
        for row in rows:
            if row["kind"] == kind:
                axes.axhline(scale * row[column], color="black", linestyle=style, linewidth=1.2, label=kind, zorder=1)
    axes.set_xticks(range(len(STRENGTHS)), [f"{strength:.0f}" for strength in STRENGTHS])
    axes.set_xlabel("zeta")
    axes.grid(alpha=0.3)
