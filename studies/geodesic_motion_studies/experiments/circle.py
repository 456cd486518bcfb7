"""Why the whole arm needs three latent dimensions: circles drawn in several postures, learned in two and in three.

The tool goes round a circle in an upright plane, in families whose elbows are on different sides. Learned as they are,
with the prior N(0, 1) of the paper, they have to find room beside one another. Then geodesics are requested from every
demonstration's code at several shares of its circle to its own code half a circle on. What is decoded should keep the
posture that both ends have; which it has is judged by the nearest demonstrated configuration.

Two models, each for every number of latent dimensions and seed: *ours*, whose geodesics stay inside the support, and
the paper's to the letter (*literal*, `JointTrainingSettings.paper`), searched in the whole latent box. Columns:

error mm        mean distance of the tool in the demonstrations that encoder and decoder give back
paths, none     geodesics that were requested, and pairs of ends that the support does not join
switches        changes from one family to another, over all paths; switching : paths with at least one
off deg         largest distance of a path's configuration from the nearest demonstrated one, over all joints
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import cKDTree

from geodesic_motion_ros.learning.autoencoder import AutoEncoder
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import NEIGHBOURS
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, ORANGE, VERMILION, legend_below, write_figure
from geodesic_motion_studies.experiments.joint_models import (
    commanded,
    decoded,
    models,
    pullback_metric,
    supported,
    tool_error,
)
from geodesic_motion_studies.experiments.latent_pictures import between_samples, draw_haloed, grid_around
from geodesic_motion_studies.experiments.metric_graph import MetricGraph, evenly
from geodesic_motion_studies.experiments.posture_strip import draw_strip, posture_strips
from geodesic_motion_studies.experiments.study import Report, Study, bandwidth_factor, changed, far_sigma, seeds

#: Swivel angles of the families, and demonstrations of each. Near zero the circle passes a singular posture.
SWIVELS, SHOWN = np.radians([-60.0, -25.0, 25.0, 60.0]), 3
SAMPLES = 100
#: Nodes of the grid along each axis, by the latent dimension; free border as a share of the codes' box.
SIDES, _BORDER = {2: 100, 3: 40}, 0.1
#: Shares of a circle where paths begin; they end half a circle on.
BEGINS = (0.05, 0.2, 0.35, 0.45)
_HALF = 0.5
#: Our model with the paper's networks and number of kernels, and as many steps as a skill is learned with.
TRAINING = JointTrainingSettings(
    sheet="raw", hidden=(200, 100), steps=5000, batch=128, samples=SAMPLES, kernels=500, precision_iterations=60,
    precision_samples=2,
)  # fmt: skip
LITERAL = JointTrainingSettings.paper(batch=128, samples=SAMPLES)
_COLOURS = (BLUE, ORANGE, GREEN, VERMILION)


@dataclass(frozen=True)
class Circles:
    """Demonstrated configurations (N, T, 7) [rad], equally many of each family, one family after the other."""

    configurations: np.ndarray
    families: int

    @property
    def per_family(self) -> int:
        return len(self.configurations) // self.families


@dataclass(frozen=True)
class CirclePath:
    """A geodesic (m, d) and the configurations (m, 7) [rad] that it decodes to, the family of its ends, and of each of
    its points (m,); how far off the data it gets [rad].
    """

    latent: np.ndarray
    configurations: np.ndarray
    family: int
    nearest: np.ndarray
    off: float

    @property
    def switches(self) -> int:
        """Changes from one family to another on the path."""
        return int(np.count_nonzero(np.diff(self.nearest)))


@dataclass(frozen=True)
class CircleRow:
    """One model, "ours" or "literal": codes (N, T, d), its paths, and the pairs of ends that are not joined."""

    model: str
    dimension: int
    seed: int
    error_mm: float
    codes: np.ndarray
    paths: tuple[CirclePath, ...]
    apart: int

    @property
    def switches(self) -> int:
        """Over all paths."""
        return sum(path.switches for path in self.paths)

    def figures(self) -> dict[str, float | int]:
        """What the table shows."""
        return {
            "model": self.model, "dimension": self.dimension, "seed": self.seed, "error_mm": self.error_mm,
            "paths": len(self.paths), "none": self.apart, "switches": self.switches,
            "switching": sum(path.switches > 0 for path in self.paths),
            "off_deg": float(np.degrees(max((path.off for path in self.paths), default=np.nan))),
        }  # fmt: skip


@dataclass(frozen=True)
class CircleReport(Report):
    """All rows."""

    shown: Circles
    rows: tuple[CircleRow, ...]

    def ours(self, dimension: int) -> list[CircleRow]:
        """The rows of our model in one number of latent dimensions."""
        return [row for row in self.rows if (row.model, row.dimension) == ("ours", dimension)]

    def as_dict(self) -> dict[str, Any]:
        return {"rows": [row.figures() for row in self.rows]}

    def table(self) -> str:
        """The table as plain text."""
        head = ["model", "latent", "seed", "error mm", "paths", "none", "switches", "switching", "off deg"]
        return text_table(head, [list(row.figures().values()) for row in self.rows], digits=1)

    def draw(self, path: Path) -> None:
        """Of our model, of the seed with most switches both latent spaces and its worst path, the joints along it and
        the arm; of every seed, which family is where.
        """
        figure = Figure(figsize=(10.0, 12.4), layout="constrained")
        grid = figure.add_gridspec(5, 2, height_ratios=(1.25, 1.0, 0.9, 0.55, 0.55))
        for column, dimension in enumerate((2, 3)):
            rows = self.ours(dimension)
            space = figure.add_subplot(grid[0, column], **({"projection": "3d"} if dimension == 3 else {}))
            worst = max(rows, key=lambda row: row.switches)
            _draw_codes(space, self.shown, worst)
            if worst.paths:
                drawn = max(worst.paths, key=lambda item: item.switches)
                draw_haloed(space, drawn.latent, "black", "-")
                space.plot(*drawn.latent[[0, -1]].T, "o", color="black", markeredgecolor="white", zorder=6)
                _draw_joints(figure.add_subplot(grid[2, column]), drawn, "ef"[column])
                strip = posture_strips([drawn.configurations], [{}], width=300, height=200, postures=6)
                name = f"{'gh'[column]}  the arm along the path of {'ab'[column]}"
                draw_strip(figure.add_subplot(grid[3 + column, :]), strip, name)
            title = f"{'ab'[column]}  {dimension} latent dimensions, seed {worst.seed}"
            space.set_title(title, loc="left", fontsize=11)
            axes = figure.add_subplot(grid[1, column])
            _draw_families(axes, rows)
            switches = sum(row.switches for row in rows)
            seeds = "1 seed" if len(rows) == 1 else f"{len(rows)} seeds"
            title = f"{'cd'[column]}  {switches} switches on {sum(len(row.paths) for row in rows)} paths, {seeds}"
            axes.set_title(title, loc="left", fontsize=11)
        handles = [
            Line2D([], [], color=colour, linewidth=2.0, label=f"elbow at {np.degrees(swivel):.0f} deg")
            for colour, swivel in zip(_COLOURS, SWIVELS, strict=True)
        ]
        handles.append(Line2D([], [], color="black", linewidth=2.2, label="geodesic that switches most, or the first"))
        legend_below(figure, handles)
        write_figure(figure, path)


def shown_circles(per_family: int = SHOWN, samples: int = SAMPLES, seed: int = 0) -> Circles:
    """As `simulation.joint_teacher` tells the arm, without physics: each circle in every family's swivel angle."""
    from geodesic_motion_ros.simulation.joint_teacher import CIRCLE_SWIVEL, circle_guidances

    robot, guidances = Robot.named("panda"), circle_guidances(per_family, seed)
    curves = [commanded(robot, each, samples, swivel - CIRCLE_SWIVEL) for swivel in SWIVELS for each in guidances]
    return Circles(np.stack(curves), len(SWIVELS))


@dataclass(frozen=True)
class Circle(Study):
    """Learn the circles with both models in each number of dimensions, once for every seed, and count.

    ours, literal : their seeds and latent dimensions are replaced. shown : None: `shown_circles`.
    """

    seeds: tuple[int, ...] = seeds("four trainings each")
    dimensions: tuple[int, ...] = (2, 3)
    ours: JointTrainingSettings = TRAINING
    literal: JointTrainingSettings = LITERAL
    shown: Circles | None = None
    far_sigma: float | None = far_sigma("the literal training")
    bandwidth_factor: float | None = bandwidth_factor("the literal training")

    def measure(self, out: Path) -> CircleReport:
        robot, shown = Robot.named("panda"), self.shown or shown_circles()
        literally = changed(self.literal, far_sigma=self.far_sigma, bandwidth_factor=self.bandwidth_factor)
        rows = [
            _measured(name, vae, shown, robot, chosen)
            for name, training in (("ours", self.ours), ("literal", literally))
            for vae, chosen in models(
                shown.configurations, robot, self.dimensions, self.seeds, training, out / "models"
            )
        ]  # fmt: skip
        return CircleReport(shown, tuple(rows))


def _measured(model: str, vae: AutoEncoder, shown: Circles, robot: Robot, settings: JointTrainingSettings) -> CircleRow:
    with torch.no_grad():
        codes = vae.encoder(torch.tensor(shown.configurations))[0].numpy()
    dimension = settings.latent_dimension
    grid = grid_around(codes, SIDES[dimension], _BORDER)
    nodes = grid.nodes()
    kept = supported(vae, codes, nodes) if model == "ours" else np.ones(len(nodes), dtype=bool)
    graph = MetricGraph.on_grid(pullback_metric(vae, robot, settings), grid, kept, NEIGHBOURS[dimension])
    paths, apart = circle_paths(graph, codes, shown, partial(decoded, vae))
    error = 1e3 * tool_error(vae, robot, shown.configurations)
    return CircleRow(model, dimension, settings.seed, error, codes, tuple(paths), apart)


def circle_paths(
    graph: MetricGraph, codes: np.ndarray, shown: Circles, decode: Callable[[np.ndarray], np.ndarray]
) -> tuple[list[CirclePath], int]:
    """Geodesics from codes (N, T, d) of every demonstration to its own half a circle on, and how many pairs of ends the
    graph does not join.

    decode : configurations (n, 7) [rad] at latent points (n, d).
    """
    fine = between_samples(shown.configurations)
    tree = cKDTree(fine.reshape(-1, fine.shape[-1]))
    paths, apart = [], 0
    samples = shown.configurations.shape[1]
    for number, code in enumerate(codes):
        for begin in BEGINS:
            first, last = (int(share * (samples - 1)) for share in (begin, begin + _HALF))
            path = graph.path(code[first], code[last])
            if path is None:
                apart += 1
                continue
            latent = evenly(path)
            configurations = decode(latent)
            off, nearest = tree.query(configurations)
            families = nearest // (fine.shape[1] * shown.per_family)
            paths.append(CirclePath(latent, configurations, number // shown.per_family, families, float(off.max())))
    return paths, apart


def _draw_joints(axes: Axes, path: CirclePath, letter: str) -> None:
    """Joints along a path: where it switches between families they jump."""
    share = np.linspace(0.0, 1.0, len(path.configurations))
    axes.plot(share, np.degrees(path.configurations - path.configurations[0]), linewidth=1.2)
    axes.set(xlabel="share of the path", ylabel="joints from their start [deg]", xlim=(0.0, 1.0))
    fastest = np.degrees(np.abs(np.diff(path.configurations, axis=0)).max() / (share[1] - share[0]))
    title = f"{letter}  its seven joints, {path.switches} switches, {fastest:.0f} deg per path at most"
    axes.set_title(title, loc="left", fontsize=11)


def _draw_codes(axes: Axes, shown: Circles, row: CircleRow) -> None:
    for number, code in enumerate(row.codes):
        axes.plot(*code.T, color=_COLOURS[number // shown.per_family], linewidth=1.0)
    for name, number in zip("xyz", range(1, row.dimension + 1), strict=False):
        getattr(axes, f"set_{name}label")(f"$z_{number}$")


def _draw_families(axes: Axes, rows: Sequence[CircleRow]) -> None:
    paths = sorted((path for row in rows for path in row.paths), key=lambda path: path.family)
    picture = np.array([path.nearest for path in paths]).reshape(len(paths), -1)
    axes.imshow(
        picture, cmap=ListedColormap(_COLOURS), vmin=-0.5, vmax=len(_COLOURS) - 0.5, aspect="auto",
        interpolation="nearest", extent=(0.0, 1.0, len(paths), 0),
    )  # fmt: skip
    axes.set(xlabel="share of the path", ylabel="paths, by the family of their ends")
