"""What it costs to change clusters: a two-cluster skill holds every motion twice, with q and with -q.

A path from the start in one cluster to the goal in the other would turn the tool through orientations nobody
showed. Its energy beside that of the path inside one cluster says how high the wall between them is; the
planner's graph has to offer no such path at all.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.demonstrations.curves import PoseCurve
from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments.learned_paths import LearnedPaths, whole_box
from geodesic_motion_ros.experiments.trained import Trained
from geodesic_motion_ros.graph.encoder import TaskSpaceEncoder
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import text_table


@dataclass(frozen=True)
class Crossing:
    """Paths from the start pose with quaternion q to the goal pose, for one motion.

    Attributes
    ----------
    within, across : energy (squared length in the metric: m^2 of positions, rad^2 / 4 of rotations) of the shortest
        path to the goal with q, and with -q, on a graph of the whole latent box, as of `LearnedPath`.
    edge_within, edge_across : largest squared length of one edge of those paths, what the planner's verdict
        compares with the skill's threshold.
    sign_flip : the decoded quaternion of the path across ends in the other hemisphere than the motion's.
    flagged : the planner's own graph has no path across.
    """

    within: float
    across: float
    edge_within: float
    edge_across: float
    sign_flip: bool
    flagged: bool

    @property
    def ratio(self) -> float:
        """Energy across over energy within."""
        return self.across / self.within

    @property
    def edge_ratio(self) -> float:
        """Dearest edge across over dearest edge within."""
        return self.edge_across / self.edge_within


def measure_crossings(skill: Skill, curves: Sequence[PoseCurve]) -> tuple[Crossing, ...]:
    """Measure for every motion, sign-continuous in its quaternions, in the skill's base frame.

    Give motions the skill was trained on: the code of an unseen end may lie off the manifold, where the path
    within its own cluster begins by climbing out of nowhere.

    Raises
    ------
    ParameterError : the skill is sign-blind and has no clusters to cross between.
    """
    if skill.orientation_model != "two_cluster":
        raise ParameterError(f"a {skill.orientation_model} skill has no two clusters to cross between")
    encoder = TaskSpaceEncoder.from_arrays(skill.encoder_arrays)
    forced, permitted = LearnedPaths(whole_box(skill)), LearnedPaths(skill.graph())
    measured = []
    for curve in curves:
        positions, quaternions = curve.positions[[0, -1, -1]], curve.quaternions[[0, -1, -1]].copy()
        quaternions[2] *= -1.0
        start, goal, opposite = encoder.encode(positions, quaternions)
        within, across = forced.shortest(start, goal), forced.shortest(start, opposite)
        measured.append(
            Crossing(
                within.energy, across.energy, within.dearest, across.dearest,
                sign_flip=bool(forced.graph.decoded.quaternions[across.nodes[-1]] @ curve.quaternions[-1] < 0.0),
                flagged=not math.isfinite(permitted.shortest(start, opposite).length),
            )
        )  # fmt: skip
    return tuple(measured)


@dataclass(frozen=True)
class CrossingReport:
    """Crossings of every motion that the skills were trained on, by task."""

    crossings: dict[str, tuple[Crossing, ...]]

    def summary(self) -> dict[str, dict[str, float | int]]:
        """Per task, and for all: paths, median ratios, smallest ratio, fractions flagged and flipped."""
        everything = tuple(item for items in self.crossings.values() for item in items)
        return {task: _summary(items) for task, items in [*self.crossings.items(), ("all", everything)]}

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        paths = {task: [asdict(item) for item in items] for task, items in self.crossings.items()}
        return {"summary": self.summary(), "paths": paths}

    def table(self) -> str:
        """The table as plain text."""
        head = ["task", "paths", "energy ratio", "smallest", "edge ratio", "sign flips", "flagged"]
        return text_table(head, [[task, *figures.values()] for task, figures in self.summary().items()])


def crossing_report(skills: Iterable[Trained]) -> CrossingReport:
    """Measure the motions that each skill was trained on; ParameterError where a skill has no two clusters."""
    crossings: dict[str, tuple[Crossing, ...]] = {}
    for trained in skills:
        found = measure_crossings(trained.skill, [item.curve for item in trained.shown])
        crossings[trained.task] = (*crossings.get(trained.task, ()), *found)
    return CrossingReport(crossings)


def _summary(items: Sequence[Crossing]) -> dict[str, float | int]:
    ratios = [item.ratio for item in items]
    return {
        "paths": len(items),
        "median_energy_ratio": float(np.median(ratios)),
        "smallest_energy_ratio": float(np.min(ratios)),
        "median_edge_ratio": float(np.median([item.edge_ratio for item in items])),
        "sign_flips": sum(item.sign_flip for item in items),
        "flagged": sum(item.flagged for item in items),
    }


def draw_crossings(report: CrossingReport, path: Path) -> None:
    """Energies across the clusters beside those within, one point for each motion."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6, 5), layout="constrained")
    axes = figure.subplots()
    for task, items in report.crossings.items():
        axes.plot([item.within for item in items], [item.across for item in items], "o", alpha=0.6, label=task)
    within = [item.within for items in report.crossings.values() for item in items]
    line = np.array([min(within), max(within)])
    axes.plot(line, 100.0 * line, "k--", label="100 times")
    axes.set(xscale="log", yscale="log", xlabel="energy within a cluster", ylabel="energy across the clusters")
    axes.legend()
    figure.savefig(path, dpi=110)
