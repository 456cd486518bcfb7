"""What more latent dimensions bring and cost: whole-arm demonstrations learned in two to five, searched on two graphs.

A reach to grasp in three families of elbows, one demonstration of each held out. The latent space is searched on

grid        a regular lattice over the codes' box, of which the supported nodes are kept: the planner's path
neighbours  codes drawn from the encoder's densities at the demonstrations, each joined to the nearest of the others

for a path from the first code of each demonstration to its last. Columns of the table, a row for each number of
dimensions, seed and graph:

error, held out  mean distance of the tool in demonstrations that encoder and decoder give back [mm]: in those that
                 were learned, in those that were not
none             demonstrations between whose ends no path was found
length           Riemannian, of the path over the shorter one of both graphs, measured with the continuous metric: mean
off mm           mean distance of the tool on its paths from the nearest point of a demonstration of their family
nodes, MB        of the graph, with edges and lengths; lattice : nodes before what has no support is dropped
build, path      processor time [s], [ms]
"""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from geodesic_motion_ros.learning.autoencoder import AutoEncoder
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION, write_figure
from geodesic_motion_studies.experiments.joint_models import (
    commanded,
    decoded,
    models,
    pullback_metric,
    supported,
    tool_error,
    tool_positions,
)
from geodesic_motion_studies.experiments.latent_pictures import grid_around
from geodesic_motion_studies.experiments.metric_graph import MetricGraph, evenly, latent_length
from geodesic_motion_studies.experiments.study import Report, Study, seeds
from geodesic_motion_studies.tools.joint_metric import JointPullbackMetric

#: Families, demonstrations of each (the last of each is held out), and samples of each.
FAMILIES, SHOWN, SAMPLES = 3, 4, 80
#: Nodes of the lattice along each axis, and directions from each, by the latent dimension: about equally many nodes.
SIDES, DIRECTIONS = {2: 100, 3: 32, 4: 14, 5: 9}, {2: 16, 3: 26, 4: 80, 5: 242}
_BORDER = 0.05
#: Codes drawn at every sample of a demonstration, and neighbours of each.
DRAWN, NEAREST = 4, 12
TRAINING = JointTrainingSettings(
    sheet="raw", hidden=(100, 50), steps=1200, batch=128, samples=SAMPLES, kernels=300, precision_iterations=60,
    precision_samples=2,
)  # fmt: skip
#: Marks on the axis of lengths.
_RATIOS = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0)
_COLOURS = {"grid": BLUE, "neighbours": VERMILION}


@dataclass(frozen=True)
class Reaches:
    """Demonstrations (F, N, T, 7) [rad] by family, of which the last of each is held out."""

    configurations: np.ndarray

    @property
    def shown(self) -> np.ndarray:
        """What is learned, (F (N - 1), T, 7), family by family."""
        return self.configurations[:, :-1].reshape(-1, *self.configurations.shape[2:])

    @property
    def held_out(self) -> np.ndarray:
        return self.configurations[:, -1]


@dataclass(frozen=True)
class DimensionRow:
    """What was measured with one model on one graph; lengths and distances are NaN where no path was found."""

    dimension: int
    seed: int
    graph: str
    error_mm: float
    held_out_mm: float
    none: int
    length: float
    off_mm: float
    lattice: int
    nodes: int
    edges: int
    megabytes: float
    build_s: float
    path_ms: float


@dataclass(frozen=True)
class DimensionReport(Report):
    """All rows."""

    rows: tuple[DimensionRow, ...]

    def as_dict(self) -> dict[str, Any]:
        return {"rows": [asdict(row) for row in self.rows]}

    def table(self) -> str:
        """The table as plain text."""
        head = [
            "latent", "seed", "graph", "error mm", "held out", "none", "length", "off mm", "lattice", "nodes", "edges",
            "MB", "build s", "path ms",
        ]  # fmt: skip
        return text_table(head, [list(asdict(row).values()) for row in self.rows], left=(0, 2))

    def draw(self, path: Path) -> None:
        """Over the number of latent dimensions: reconstruction, quality of paths, time, memory; every seed a mark."""
        figure = Figure(figsize=(10.0, 6.4), layout="constrained")
        panels = figure.subplots(2, 2)
        error = [row for row in self.rows if row.graph == "grid"]
        for name, marker, values in (
            ("learned", "o", [row.error_mm for row in error]),
            ("held out", "s", [row.held_out_mm for row in error]),
        ):
            panels[0, 0].plot([row.dimension for row in error], values, marker, color="black", label=name,
                              markerfacecolor="none" if marker == "s" else "black")  # fmt: skip
        panels[0, 0].set_ylabel("error of the tool, given back [mm]")
        for axes, which, label in (
            (panels[0, 1], "length", "length over the better graph's"),
            (panels[1, 0], "build_s", "time to build the graph [s]"),
            (panels[1, 1], "megabytes", "memory of the graph [MB]"),
        ):
            for graph, colour in _COLOURS.items():
                rows = [row for row in self.rows if row.graph == graph]
                values = [getattr(row, which) for row in rows]
                axes.plot([row.dimension for row in rows], values, "o", color=colour, label=graph)
            axes.set_ylabel(label)
        titles = ("a  reconstruction", "b  path quality", "c  time", "d  memory")
        for axes, title in zip(panels.flat, titles, strict=True):
            axes.set_title(title, loc="left", fontsize=11)
            axes.set(xlabel="latent dimensions", xticks=sorted({row.dimension for row in self.rows}))
            axes.grid(alpha=0.3)
            axes.legend(frameon=False)
        for axes in panels.flat[1:]:
            axes.set_yscale("log")
        panels[0, 1].set_yticks(_RATIOS, [f"{ratio:g}" for ratio in _RATIOS])
        panels[0, 1].minorticks_off()
        write_figure(figure, path)


@dataclass(frozen=True)
class _Built:
    """A graph, what it was made from and what that took."""

    name: str
    graph: MetricGraph
    lattice: int
    seconds: float


def shown_reaches(per_family: int = SHOWN, samples: int = SAMPLES, seed: int = 0) -> Reaches:
    """As `simulation.joint_teacher` tells the arm, without physics."""
    from geodesic_motion_ros.simulation.joint_teacher import reach_guidances

    robot = Robot.named("panda")
    curves = [commanded(robot, each, samples) for each in reach_guidances(per_family, seed, FAMILIES, connected=False)]
    return Reaches(np.stack(curves).reshape(FAMILIES, per_family, samples, -1))


@dataclass(frozen=True)
class Dimension(Study):
    """Learn in each number of dimensions, once for every seed, and search on both graphs.

    training : its seed and its latent dimension are replaced. shown : None: `shown_reaches`.
    """

    seeds: tuple[int, ...] = seeds("four trainings each", (0, 1))
    dimensions: tuple[int, ...] = (2, 3, 4, 5)
    training: JointTrainingSettings = TRAINING
    shown: Reaches | None = None

    def measure(self, out: Path) -> DimensionReport:
        robot, shown = Robot.named("panda"), self.shown or shown_reaches()
        learned = models(shown.shown, robot, self.dimensions, self.seeds, self.training)
        return DimensionReport(tuple(row for vae, chosen in learned for row in _measured(vae, shown, robot, chosen)))


def _measured(vae: AutoEncoder, shown: Reaches, robot: Robot, settings: JointTrainingSettings) -> list[DimensionRow]:
    metric = pullback_metric(vae, robot, settings)
    with torch.no_grad():
        codes = vae.encoder(torch.tensor(shown.shown))[0].numpy()
    built = [_on_grid(vae, metric, codes, settings), _of_neighbours(vae, metric, shown, codes, settings)]
    families = shown.configurations.shape[0]
    tools = tool_positions(robot, shown.shown)
    trees = [cKDTree(part.reshape(-1, 3)) for part in np.split(tools, families)]
    paths = {item.name: [_timed_path(item.graph, code) for code in codes] for item in built}
    lengths = {
        name: np.array([math.nan if path is None else latent_length(metric, path) for path, _ in found])
        for name, found in paths.items()
    }
    shorter = np.fmin(*lengths.values())
    rows = []
    for item in built:
        off = [
            trees[number * families // len(codes)].query(tool_positions(robot, decoded(vae, evenly(path))))[0].mean()
            for number, (path, _) in enumerate(paths[item.name])
            if path is not None
        ]
        joined = np.isfinite(lengths[item.name])
        rows.append(
            DimensionRow(
                settings.latent_dimension, settings.seed, item.name, 1e3 * tool_error(vae, robot, shown.shown),
                1e3 * tool_error(vae, robot, shown.held_out), int(np.sum(~joined)),
                float(np.mean((lengths[item.name] / shorter)[joined])) if joined.any() else math.nan,
                1e3 * float(np.mean(off)) if off else math.nan, item.lattice, len(item.graph.latent),
                len(item.graph.edges), 1e-6 * item.graph.bytes, item.seconds,
                1e3 * float(np.median([seconds for _, seconds in paths[item.name]])),
            )
        )  # fmt: skip
    return rows


def _on_grid(
    vae: AutoEncoder, metric: JointPullbackMetric, codes: np.ndarray, settings: JointTrainingSettings
) -> _Built:
    dimension, began = settings.latent_dimension, time.thread_time()
    grid = grid_around(codes, SIDES[dimension], _BORDER)
    graph = MetricGraph.on_grid(metric, grid, supported(vae, codes, grid.nodes()), DIRECTIONS[dimension])
    return _Built("grid", graph, math.prod(grid.shape), time.thread_time() - began)


def _of_neighbours(
    vae: AutoEncoder, metric: JointPullbackMetric, shown: Reaches, codes: np.ndarray, settings: JointTrainingSettings
) -> _Built:
    began, random = time.thread_time(), np.random.default_rng(settings.seed)
    with torch.no_grad():
        deviation = torch.exp(0.5 * vae.encoder(torch.tensor(shown.shown))[1]).numpy()
    noise = random.normal(size=(DRAWN, *codes.shape))
    drawn = (codes + deviation * noise).reshape(-1, codes.shape[-1])
    nodes = np.concatenate([codes.reshape(-1, codes.shape[-1]), drawn[supported(vae, codes, drawn)]])
    graph = MetricGraph.of_neighbours(metric, nodes, NEAREST)
    return _Built("neighbours", graph, len(nodes), time.thread_time() - began)


def _timed_path(graph: MetricGraph, code: np.ndarray) -> tuple[np.ndarray | None, float]:
    began = time.thread_time()
    path = graph.path(code[0], code[-1])
    return path, time.thread_time() - began
