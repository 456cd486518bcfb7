"""What it costs to change clusters: a two-cluster skill holds every motion twice, with q and with -q.

A path from the start in one cluster to the goal in the other would turn the tool through orientations that nobody
demonstrated. Its energy beside that of the path inside one cluster says how high the wall between them is.

The planner's own graph never offers such a path: edges between clusters and hemispheres are deleted from it. Whether
the *energy criterion*, the paper's, would refuse it is measured on two graphs from which nothing was deleted for that:
the whole latent box, and the support alone. Refused is a path with an edge dearer than the skill's threshold.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.manifold.encoder import TaskSpaceEncoder
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_studies.experiments.learned_paths import LearnedPaths, supported_box, whole_box
from geodesic_motion_studies.experiments.study import Report
from geodesic_motion_studies.experiments.trained import OfTrainings, Trained

#: Graphs that the energy criterion is measured on, without the planner's deletions.
GRAPHS = ("whole box", "support")


@dataclass(frozen=True)
class Judged:
    """A shortest path under the energy criterion.

    Attributes
    ----------
    offered : whether the graph has a path at all.
    changes : edges of it from one cluster's nodes to the other's.
    refused : an edge of it is dearer than the skill's threshold.
    """

    offered: bool
    changes: int
    refused: bool


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
    judged_within, judged_across : by the graphs of `GRAPHS`, what the energy criterion says of both paths.
    """

    within: float
    across: float
    edge_within: float
    edge_across: float
    sign_flip: bool
    judged_within: dict[str, Judged]
    judged_across: dict[str, Judged]

    @property
    def refused(self) -> bool:
        """The energy criterion refuses the path across the whole box."""
        return self.judged_across[GRAPHS[0]].refused

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
    graphs = zip(GRAPHS, (whole_box(skill), supported_box(skill)), strict=True)
    criteria = {name: _Criterion(graph, skill) for name, graph in graphs}
    forced = criteria[GRAPHS[0]].paths
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
                judged_within={name: criterion.judged(start, goal) for name, criterion in criteria.items()},
                judged_across={name: criterion.judged(start, opposite) for name, criterion in criteria.items()},
            )
        )  # fmt: skip
    return tuple(measured)


class _Criterion:
    """Judges shortest paths on a graph by a skill's threshold."""

    def __init__(self, graph: PoseGraph, skill: Skill) -> None:
        self.paths, self._limit = LearnedPaths(graph), skill.energy_per_edge
        _, nearest = cKDTree(skill.codes.reshape(-1, skill.codes.shape[-1])).query(graph.latent)
        # The first half of the codes are those of q, the others those of -q.
        self._second = nearest >= skill.codes[..., 0].size // 2

    def judged(self, start: np.ndarray, goal: np.ndarray) -> Judged:
        path = self.paths.shortest(start, goal)
        if not math.isfinite(path.length):
            return Judged(False, 0, False)
        changes = int(np.count_nonzero(np.diff(self._second[path.nodes])))
        return Judged(True, changes, path.dearest > self._limit)


def judged_summary(items: Sequence[Crossing], graph: str) -> dict[str, int]:
    """How many paths a graph offers within and across, how often they change the cluster, how many are refused."""
    summary: dict[str, int] = {}
    for direction in ("within", "across"):
        judged = [getattr(item, f"judged_{direction}")[graph] for item in items]
        summary |= {
            f"{direction}_offered": sum(item.offered for item in judged),
            f"{direction}_changes": sum(item.changes for item in judged),
            f"{direction}_refused": sum(item.refused for item in judged),
        }
    return summary


def judged_table(named: Mapping[str, Sequence[Crossing]]) -> str:
    """What the energy criterion says of the crossings of every name, on both graphs, as plain text."""
    head = [
        "energy criterion", "graph", "paths", "within: offered", "changes of cluster", "refused", "across: offered",
        "changes of cluster", "refused",
    ]  # fmt: skip
    rows: list[list[Cell]] = [
        [name, graph, len(items), *judged_summary(items, graph).values()]
        for name, items in named.items() for graph in GRAPHS
    ]  # fmt: skip
    return text_table(head, rows, left=(0, 1))


@dataclass(frozen=True)
class CrossingReport(Report):
    """Crossings of every motion that the skills were trained on, by task."""

    crossings: dict[str, tuple[Crossing, ...]]

    def summary(self) -> dict[str, dict[str, float | int]]:
        """Per task, and for all: paths, median ratios, smallest ratio, and how many flip the sign."""
        return {task: _summary(items) for task, items in self._with_all().items()}

    def _with_all(self) -> dict[str, tuple[Crossing, ...]]:
        return self.crossings | {"all": tuple(item for items in self.crossings.values() for item in items)}

    def as_dict(self) -> dict[str, Any]:
        paths = {task: [asdict(item) for item in items] for task, items in self.crossings.items()}
        criterion = {
            task: {graph: judged_summary(items, graph) for graph in GRAPHS} for task, items in self._with_all().items()
        }
        return {"summary": self.summary(), "energy_criterion": criterion, "paths": paths}

    def table(self) -> str:
        """Both tables as plain text."""
        head = ["task", "paths", "energy ratio", "smallest", "edge ratio", "sign flips"]
        ratios = text_table(head, [[task, *figures.values()] for task, figures in self.summary().items()])
        return f"{ratios}\n\n{judged_table(self._with_all())}"

    def draw(self, path: Path) -> None:
        """Energies across the clusters beside those within, one point for each motion."""
        figure = Figure(figsize=(6, 5), layout="constrained")
        axes = figure.subplots()
        for task, items in self.crossings.items():
            axes.plot([item.within for item in items], [item.across for item in items], "o", alpha=0.6, label=task)
        within = [item.within for items in self.crossings.values() for item in items]
        line = np.array([min(within), max(within)])
        axes.plot(line, 100.0 * line, "k--", label="100 times")
        axes.set(xscale="log", yscale="log", xlabel="energy within a cluster", ylabel="energy across the clusters")
        axes.legend()
        figure.savefig(path, dpi=110)


@dataclass(frozen=True)
class CrossingClusters(OfTrainings):
    """Measure the motions that each skill was trained on; clusters of q and -q are the paper's, on the raw sheet."""

    sheet: str = "raw"

    def measured(self, skills: Iterable[Trained]) -> CrossingReport:
        """ParameterError: a skill has no two clusters."""
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
    }
