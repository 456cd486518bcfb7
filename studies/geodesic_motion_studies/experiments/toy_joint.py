"""The paper's toy of joint space: a planar arm of two joints draws an S, in both postures that each point leaves it.

Configurations are learned by the networks that learn whole arms (`learning.autoencoder`), the metric is seen at the
arm's body points. From the first configuration of a few demonstrations, each to the last one of the next of the same
posture:

geodesic        shortest path on a grid under the pull-back metric, bent by gradient descent
straight line   between the same points of the latent space: the shortest path there is without the metric

Columns of the table, a row for each seed and each of these:

own posture     share of codes whose nearest code of another demonstration is of the same posture: 100 % are clusters
geodesic, line  mean and largest distance of the tool from the demonstrated S [mm], of the joints from the nearest
                demonstrated configuration [deg], and how often the elbow changes sides on the path, over all pairs
within          energy of the shortest path to the goal in the same posture
across / within that to the goal in the other posture over it

Rows: "ours", our model with our metric, sigma counted ten times and joints a little besides the body; "ours, sigma
once", the same model, sigma counted once and the body alone; "literal", the paper's model with its metric
(`JointTrainingSettings.paper`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import cKDTree
from tqdm import tqdm

from geodesic_motion_ros.learning.autoencoder import AutoEncoder
from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.learning.likelihoods import ConfigurationLikelihood
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.learning.training import train_model
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.robot.body_points import place_body_points
from geodesic_motion_ros.robot.kinematics import FOLDER, Robot
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION, legend_below, write_figure
from geodesic_motion_studies.experiments.clusters import share_in_own_group
from geodesic_motion_studies.experiments.latent_pictures import (
    DEVIATION_LABEL,
    MAGNIFICATION_LABEL,
    Landscape,
    ToyPaths,
    between_samples,
    draw_off,
    draw_pairs,
    draw_values,
    grid_around,
)
from geodesic_motion_studies.experiments.study import Report, Study, bandwidth_factor, changed, far_sigma, seeds
from geodesic_motion_studies.tools.joint_metric import JointPullbackMetric

#: Demonstrations of each posture, and samples of each.
SHOWN, SAMPLES = 5, 100
#: Middle, width and height of the S [m], and how far demonstrations are from it [m].
_MIDDLE, _SIZE, _SPREAD = np.array([0.38, 0.0]), (0.1, 0.2), 0.006
SIDE, _BORDER = 100, 0.25
PAIRS = 2
"""Pairs of ends in each posture, one geodesic each."""
_SIZES = {
    "latent_dimension": 2, "hidden": (64, 32), "steps": 1500, "samples": SAMPLES, "kernels": 120,
    "bandwidth_factor": 1.3, "precision_iterations": 100,
}  # fmt: skip
TRAINING, LITERAL = JointTrainingSettings(sheet="raw", **_SIZES), JointTrainingSettings.paper(**_SIZES)
_SIGMA_ONCE = JointMetricSettings(sigma_weight=1.0, joint_weight=1e-3)
#: Steps of the descent.
_DESCENT = 20
_POSTURES = ("elbow to the left", "elbow to the right")


@dataclass(frozen=True)
class JointCurve:
    """A curve (m, 2) in the latent space, decoded: configurations (m, 2) [rad] and tool (m, 2) [m].

    `off` (m, 2) is the distance of the tool from the S that was shown [m], and of the joints from the nearest
    demonstrated configuration [rad].
    """

    latent: np.ndarray
    configurations: np.ndarray
    tool: np.ndarray
    off: np.ndarray

    @property
    def switches(self) -> int:
        """How often the elbow changes sides."""
        return int(np.sum(np.diff(np.sign(self.configurations[:, 1])) != 0.0))


@dataclass(frozen=True)
class ToyJointRow:
    """What a model and a metric, by their name, make of the pairs of ends; energies [m^2]."""

    seed: int
    name: str
    own_posture: float
    geodesics: tuple[JointCurve, ...]
    lines: tuple[JointCurve, ...]
    crossing: JointCurve
    within: float
    across: float

    def off(self, which: str) -> tuple[float, float, float, int]:
        """Mean and largest distance of the tool [mm], largest of the joints [deg], changes of posture."""
        curves = getattr(self, which)
        every = np.concatenate([curve.off for curve in curves]) * [1e3, np.degrees(1.0)]
        switches = sum(curve.switches for curve in curves)
        return float(every[:, 0].mean()), float(every[:, 0].max()), float(every[:, 1].max()), switches


@dataclass(frozen=True)
class ToyJointReport(Report):
    """All rows; what was shown, (2 SHOWN, T, 2) [rad]; and the latent space of the first seed."""

    robot: Robot
    shown: np.ndarray
    rows: tuple[ToyJointRow, ...]
    landscape: Landscape

    def as_dict(self) -> dict[str, Any]:
        names = ("tool_mean_mm", "tool_largest_mm", "joints_largest_deg", "switches")
        return {
            "rows": [
                {
                    "seed": row.seed, "row": row.name, "own_posture": row.own_posture, "pairs": len(row.lines),
                    "geodesic": dict(zip(names, row.off("geodesics"), strict=True)),
                    "line": dict(zip(names, row.off("lines"), strict=True)),
                    "energy_within": row.within, "energy_across": row.across,
                }
                for row in self.rows
            ]
        }  # fmt: skip

    def table(self) -> str:
        """The table as plain text."""
        columns = ("mm", "most", "joints deg", "switches")
        head = ["row", "seed", "own posture", *(f"{name} {c}" for name in ("geodesic", "line") for c in columns)]
        head += ["within", "across / within"]
        lines = []
        for row in self.rows:
            cells = [
                f"{v:.1f}" if isinstance(v, float) else v for which in ("geodesics", "lines") for v in row.off(which)
            ]
            energies = f"{row.within:.3g}", f"{row.across / row.within:.3g}"
            lines.append([row.name, row.seed, f"{row.own_posture:.0%}", *cells, *energies])
        return text_table(head, lines)

    def draw(self, path: Path) -> None:
        """Of the first seed: the arm along a geodesic of each posture, joint space, distances, and the latent space."""
        figure = Figure(figsize=(10.5, 6.8), layout="constrained")
        grid = figure.add_gridspec(2, 3)
        row, count = self.rows[0], len(self.shown) // 2
        for place, (number, title) in zip((0, 1), ((0, "a"), (PAIRS, "b")), strict=True):
            axes = figure.add_subplot(grid[0, place])
            _draw_arm(axes, self, row.geodesics[number], row.lines[number])
            axes.set_title(f"{title}  {_POSTURES[place]}", loc="left", fontsize=11)
        _draw_joints(figure.add_subplot(grid[0, 2]), self.shown, row)
        landscape, joints = self.landscape, f"{DEVIATION_LABEL} of joints [rad]"
        for place, values, title, label in (
            (grid[1, 0], landscape.deviation, "d  variance measure: two clusters", joints),
            (grid[1, 1], landscape.magnification, "e  magnification factor", MAGNIFICATION_LABEL),
        ):
            axes = figure.add_subplot(place)
            draw_values(figure, axes, landscape, values, label, count)
            draw_pairs(axes, *([curve.latent for curve in of[::PAIRS]] for of in (row.lines, row.geodesics)))
            axes.set_title(title, loc="left", fontsize=11)
        _draw_off(figure.add_subplot(grid[1, 2]), row)
        handles = [
            Line2D([], [], color=GREY, label="demonstrations (in d, e white)"),
            Line2D([], [], color=GREY, linestyle=":", label="of the other posture"),
            Line2D([], [], color=BLUE, linewidth=2.2, label="geodesic"),
            Line2D([], [], color=VERMILION, linewidth=2.2, linestyle="--", label="straight line in the latent space"),
            Line2D([], [], color=GREEN, linewidth=1.6, label="shortest path to the other posture"),
            Line2D([], [], color=ORANGE, linewidth=1.6, label="the arm along the geodesic"),
        ]
        legend_below(figure, handles)
        write_figure(figure, path)


def planar_arm() -> Robot:
    """Two links of 0.3 m in the plane z = 0."""
    return Robot.from_urdf(FOLDER / "planar_arm.urdf", "base", "tool")


def planar_configurations(points: np.ndarray, side: float) -> np.ndarray:
    """Configurations (..., 2) [rad] of the planar arm whose tool is at points (..., 2) [m]; side: sign of the elbow."""
    link = 0.3
    squared = np.sum(points**2, axis=-1)
    elbow = side * np.arccos(np.clip(squared / (2.0 * link**2) - 1.0, -1.0, 1.0))
    shoulder = np.arctan2(points[..., 1], points[..., 0]) - 0.5 * elbow
    return np.stack([shoulder, elbow], axis=-1)


def toy_configurations(count: int = SHOWN, samples: int = SAMPLES, seed: int = 0) -> np.ndarray:
    """Demonstrations (2 count, samples, 2) [rad]: the S with the elbow to one side, then as often to the other."""
    random = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, samples)
    angle = np.pi * (2.0 * share - 1.0)
    letter = _MIDDLE + np.stack([-_SIZE[0] * np.sin(angle), -_SIZE[1] * angle / np.pi], axis=1)
    curves = []
    for side in (1.0, -1.0):
        for _ in range(count):
            waves = np.stack([np.cos(np.pi * k * share + random.uniform(0.0, 2.0 * np.pi)) for k in (1.0, 2.0)])
            curves.append(planar_configurations(letter + waves.T @ random.normal(0.0, _SPREAD, (2, 2)), side))
    return np.stack(curves)


@dataclass(frozen=True)
class ToyJoint(Study):
    """Learn both postures together, with both models and once for every seed, and measure.

    ours, literal : their seeds are replaced. shown : (2n, T, 2) [rad], n of each posture; None: `toy_configurations`.
    """

    seeds: tuple[int, ...] = seeds("two trainings each")
    ours: JointTrainingSettings = TRAINING
    literal: JointTrainingSettings = LITERAL
    shown: np.ndarray | None = None
    far_sigma: float | None = far_sigma()
    bandwidth_factor: float | None = bandwidth_factor()

    def measure(self, out: Path) -> ToyJointReport:
        robot, shown = planar_arm(), toy_configurations() if self.shown is None else self.shown
        metrics = {"ours": self.ours.metric, "ours, sigma once": _SIGMA_ONCE}, {"literal": self.literal.metric}
        rows, landscapes = [], []
        for seed in tqdm(self.seeds, desc="toy-joint", unit="seed"):
            for training, named in zip((self.ours, self.literal), metrics, strict=True):
                chosen = changed(training, far_sigma=self.far_sigma, bandwidth_factor=self.bandwidth_factor, seed=seed)
                toy = _Toy(robot, shown, train_model((shown,), ConfigurationLikelihood(chosen, robot)))
                landscapes.append(toy.landscape(chosen.metric))
                rows += [_measured(toy, name, metric, seed) for name, metric in named.items()]
        order = [name for named in metrics for name in named]
        rows.sort(key=lambda row: (order.index(row.name), row.seed))
        return ToyJointReport(robot, shown, tuple(rows), landscapes[0])


class _Toy:
    """A learned toy: its codes and the box that is searched."""

    def __init__(self, robot: Robot, shown: np.ndarray, vae: AutoEncoder) -> None:
        self.robot, self.vae, self._shown = robot, vae, between_samples(shown).reshape(-1, 2)
        self._drawn = self.tool(self._shown)
        with torch.no_grad():
            self.codes = vae.encoder(torch.tensor(shown))[0].numpy()
        self.grid = grid_around(self.codes, SIDE, _BORDER)
        self.per_posture = len(shown) // 2

    def tool(self, configurations: np.ndarray) -> np.ndarray:
        body = JointMetricSettings().body_points(self.robot)
        points = place_body_points(np.ascontiguousarray(configurations), body.frames, body.offsets, self.robot.chain)
        return points[:, body.names.index(self.robot.tool_link), :2]

    def metric(self, settings: JointMetricSettings) -> JointPullbackMetric:
        body = BodyLayer(self.robot, settings.body_points(self.robot))
        return JointPullbackMetric(self.vae.decoder, body, settings)

    def decoded(self, latent: np.ndarray) -> JointCurve:
        with torch.no_grad():
            configurations = self.vae.decoder.means(torch.tensor(latent)).coordinates.numpy()
        tool = self.tool(configurations)
        off = [cKDTree(shown).query(found)[0] for shown, found in ((self._drawn, tool), (self._shown, configurations))]
        return JointCurve(latent, configurations, tool, np.stack(off, axis=1))

    def landscape(self, metric: JointMetricSettings) -> Landscape:
        sigma = self.vae.decoder.to_numpy().uncertainty(self.grid.nodes())
        return Landscape.of(self.grid, self.codes, sigma, self.metric(metric))

    def own_posture(self) -> float:
        """Share of codes whose nearest code of another demonstration is of the same posture."""
        numbers = np.arange(len(self.codes))
        return share_in_own_group(self.codes, numbers < self.per_posture, numbers)


def _measured(toy: _Toy, name: str, metric: JointMetricSettings, seed: int) -> ToyJointRow:
    codes, count = toy.codes, toy.per_posture
    ends = [
        (codes[posture * count + number, 0],
         *(codes[side * count + (number + 1) % count, -1] for side in (posture, 1 - posture)))
        for posture in range(2) for number in range(PAIRS)
    ]  # fmt: skip
    found = ToyPaths.between(toy.metric(metric), toy.grid, ends, _DESCENT)
    geodesics, lines = (tuple(map(toy.decoded, curves)) for curves in (found.geodesics, found.lines))
    crossing = toy.decoded(found.crossings[0])
    return ToyJointRow(seed, name, toy.own_posture(), geodesics, lines, crossing, found.within, found.across)


def _draw_arm(axes: Axes, report: ToyJointReport, geodesic: JointCurve, line: JointCurve) -> None:
    tools = planar_tool(report.shown)
    for tool in tools:
        axes.plot(*(100.0 * tool.T), color=GREY, linewidth=0.7)
    for at in np.linspace(0, len(geodesic.latent) - 1, 7).astype(int):
        shoulder, tool = geodesic.configurations[at, 0], geodesic.tool[at]
        elbow = 0.3 * np.array([np.cos(shoulder), np.sin(shoulder)])
        arm = 100.0 * np.stack([np.zeros(2), elbow, tool])
        axes.plot(*arm.T, "-o", color=ORANGE, linewidth=1.3, markersize=2.5, alpha=0.55, zorder=2)
    draw_pairs(axes, [100.0 * line.tool], [100.0 * geodesic.tool])
    axes.set(xlabel="x [cm]", ylabel="y [cm]", aspect="equal")


def planar_tool(configurations: np.ndarray) -> np.ndarray:
    """Where the planar arm's tool is (..., 2) [m] at configurations (..., 2) [rad]."""
    angles = np.cumsum(configurations, axis=-1)
    return 0.3 * np.stack([np.cos(angles).sum(axis=-1), np.sin(angles).sum(axis=-1)], axis=-1)


def _draw_joints(axes: Axes, shown: np.ndarray, row: ToyJointRow) -> None:
    count = len(shown) // 2
    for number, configurations in enumerate(shown):
        style = "-" if number < count else ":"
        axes.plot(*np.degrees(configurations.T), style, color=GREY, linewidth=0.8)
    axes.plot(*np.degrees(row.crossing.configurations.T), color=GREEN, linewidth=1.6)
    drawn = ([np.degrees(curve.configurations) for curve in of[::PAIRS]] for of in (row.lines, row.geodesics))
    draw_pairs(axes, *drawn)
    axes.set(xlabel="shoulder [deg]", ylabel="elbow [deg]")
    axes.set_title("c  joint space", loc="left", fontsize=11)


def _draw_off(axes: Axes, row: ToyJointRow) -> None:
    draw_off(axes, [curve.off[:, 0] for curve in row.lines], VERMILION, "--")
    draw_off(axes, [curve.off[:, 0] for curve in row.geodesics], BLUE)
    draw_off(axes, [row.crossing.off[:, 0]], GREEN)
    axes.set(ylabel="distance of the tool from the S [mm]", yscale="log", ylim=(1.0, 300.0))
    axes.set_title(f"f  off the data: {len(row.lines)} pairs of ends", loc="left", fontsize=11)
