"""The paper's toy: a J in the plane with orientations that draw a C on the sphere S^2, each shown with both signs.

Position and orientation are learned together on R^2 x S^2 by the networks that learn poses (`learning.autoencoder`),
with von Mises-Fisher densities on S^2. From the first point of a few demonstrations, each to the last one of the next:

geodesic        shortest path on a grid under the pull-back metric, bent by gradient descent
straight line   between the same points of the latent space: the shortest path there is without the metric

Columns of the table, a row for each learned model (likelihood, seed) and metric:

own sign        share of codes whose nearest code of another demonstration has the same sign: 100 % are two clusters,
                50 % one
geodesic, line  mean and largest distance of the decoded curve from the demonstrations, to the nearest demonstrated
                pose, in mm and degrees
within          energy of the shortest path to the goal with the same sign
across / within that to the goal with the other sign over it

Likelihoods: "single", one density on the doubled data; "mixture", the paper's, half on mu and half on -mu. Metrics:
"angular", with the angular deviation kappa^(-1/2) and sigma counted ten times; "once", the same with sigma once;
"paper", with kappa itself and sigma once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
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
from geodesic_motion_ros.learning.likelihoods import PoseLikelihood
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_model
from geodesic_motion_ros.manifold.pose_graph import MetricSettings
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREY, VERMILION, legend_below, write_figure
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
from geodesic_motion_studies.tools.metric import PullbackMetric

#: Demonstrations and samples of each.
SHOWN, SAMPLES = 7, 100
#: Half the opening of the C, and its radius on the sphere [rad].
_OPENING, _C_RADIUS = np.radians(55.0), np.radians(40.0)
#: Nodes of the latent grid along each axis, and its free border as a share of the codes' box; steps of the descent.
SIDE, _BORDER, _DESCENT = 100, 0.25, 40
#: Pairs of ends, one geodesic each.
PAIRS = 3
LIKELIHOODS = {"single": "two_cluster", "mixture": "sign_blind"}
METRICS = {
    "angular": MetricSettings(), "once": MetricSettings(sigma_weight=1.0),
    "paper": MetricSettings(sigma_weight=1.0, orientation_scale="kappa"),
}  # fmt: skip
ROWS = (("single", "angular"), ("single", "once"), ("single", "paper"), ("mixture", "angular"))
"""Likelihood and metric of the rows."""

#: Learned with less than a skill: two coordinates of position on two of orientation.
TRAINING = TrainingSettings(sheet="raw", hidden=(64, 32), steps=2000, kernels=150)


@dataclass(frozen=True)
class ToyPoses:
    """Demonstrated poses: positions (N, T, 2) [m] and unit directions (N, T, 3)."""

    positions: np.ndarray
    directions: np.ndarray

    @property
    def doubled(self) -> tuple[np.ndarray, np.ndarray]:
        """All poses once more with the other sign: positions (2 N, T, 2) and directions (2 N, T, 3)."""
        doubled = np.concatenate([self.positions, self.positions])
        return doubled, np.concatenate([self.directions, -self.directions])

    def distances(self, positions: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """How far poses (m, 2), (m, 3) are from the nearest that was shown, of either sign: (m, 2), [m] and [rad].

        Nearest is where |dx|^2 + |dq|^2 is least, as the metric counts them, also between samples.
        """
        both = between_samples(np.concatenate([self.positions, self.directions], axis=2)).reshape(-1, 5)
        shown = np.concatenate([both, both * [1.0, 1.0, -1.0, -1.0, -1.0]])
        _, nearest = cKDTree(shown).query(np.concatenate([positions, directions], axis=1))
        off = np.linalg.norm(positions - shown[nearest, :2], axis=1)
        return np.stack([off, np.arccos(np.clip(np.sum(directions * shown[nearest, 2:], axis=1), -1.0, 1.0))], axis=1)


@dataclass(frozen=True)
class ToyCurve:
    """A curve (m, 2) in the latent space, decoded, and how far it is from the demonstrations (m, 2), [m] and [rad]."""

    latent: np.ndarray
    positions: np.ndarray
    directions: np.ndarray
    off: np.ndarray


@dataclass(frozen=True)
class ToyRow:
    """What a model and a metric make of the pairs of ends; distances [m] and [rad], energies [1]."""

    likelihood: str
    metric: str
    seed: int
    own_sign: float
    geodesics: tuple[ToyCurve, ...]
    lines: tuple[ToyCurve, ...]
    within: float
    across: float

    def off(self, which: str) -> tuple[float, float, float, float]:
        """Mean and largest distance [mm], and angle [deg], of "geodesics" or "lines"."""
        all_off = np.concatenate([curve.off for curve in getattr(self, which)]) * [1e3, np.degrees(1.0)]
        (mean, mean_angle), (most, most_angle) = all_off.mean(axis=0), all_off.max(axis=0)
        return float(mean), float(most), float(mean_angle), float(most_angle)


@dataclass(frozen=True)
class ToyTaskReport(Report):
    """All rows, and of the first seed the latent spaces by likelihood."""

    shown: ToyPoses
    apart: tuple[float, float]
    rows: tuple[ToyRow, ...]
    landscapes: dict[str, Landscape]

    def as_dict(self) -> dict[str, Any]:
        rows = [
            {
                "likelihood": row.likelihood, "metric": row.metric, "seed": row.seed, "own_sign": row.own_sign,
                "geodesic_mm_deg": row.off("geodesics"), "line_mm_deg": row.off("lines"),
                "energy_within": row.within, "energy_across": row.across,
            }
            for row in self.rows
        ]  # fmt: skip
        return {"rows": rows, "demonstrations_apart_mm_deg": self.apart}

    def table(self) -> str:
        """The table as plain text."""
        head = [
            "likelihood", "metric", "seed", "own sign", "geodesic mm", "most", "deg", "most",
            "line mm", "most", "deg", "most", "within", "across / within",
        ]  # fmt: skip
        lines = [
            [
                row.likelihood, row.metric, row.seed, f"{row.own_sign:.0%}",
                *(f"{value:.1f}" for value in (*row.off("geodesics"), *row.off("lines"))),
                f"{row.within:.3g}", f"{row.across / row.within:.3g}",
            ]
            for row in self.rows
        ]  # fmt: skip
        note = "a demonstration is {:.1f} mm and {:.1f} deg from the nearest pose of the others, on average"
        return text_table(head, lines, left=(0, 1)) + "\n" + note.format(*self.apart)

    def draw(self, path: Path) -> None:
        """The letters with the first seed's curves, its latent space in three views, how far curves leave the data."""
        figure = Figure(figsize=(10.5, 6.8), layout="constrained")
        grid = figure.add_gridspec(2, 3)
        row = next(row for row in self.rows if (row.likelihood, row.metric) == ROWS[0])
        _draw_plane(figure.add_subplot(grid[0, 0]), self.shown, row)
        _draw_sphere(figure.add_subplot(grid[0, 1], projection="3d", computed_zorder=False), self.shown, row)
        _draw_off(figure.add_subplot(grid[0, 2]), row)
        single, mixture = self.landscapes["single"], self.landscapes["mixture"]
        count, label = len(self.shown.positions), DEVIATION_LABEL + " of positions [m]"
        for place, landscape, values, title, quantity in (
            (grid[1, 0], single, single.deviation, "d  variance measure: two clusters", label),
            (grid[1, 1], single, single.magnification, "e  magnification factor", MAGNIFICATION_LABEL),
            (grid[1, 2], mixture, mixture.deviation, "f  the paper's mixture: one cluster", label),
        ):
            axes = figure.add_subplot(place)
            draw_values(figure, axes, landscape, values, quantity, count)
            axes.set_title(title, loc="left", fontsize=11)
            if landscape is single:
                draw_pairs(axes, *([curves[0].latent] for curves in (row.lines, row.geodesics)))
        handles = [
            Line2D([], [], color=GREY, label="demonstrations, $q$ (in d to f white)"),
            Line2D([], [], color=GREY, linestyle=":", label="demonstrations, $-q$"),
            Line2D([], [], color=BLUE, linewidth=2.2, label="geodesic"),
            Line2D([], [], color=VERMILION, linewidth=2.2, linestyle="--", label="straight line in the latent space"),
        ]
        legend_below(figure, handles)
        write_figure(figure, path)


def toy_demonstrations(count: int = SHOWN, samples: int = SAMPLES, seed: int = 0) -> ToyPoses:
    """A J of 30 cm in the plane, and a C of 40 degrees' radius on the sphere, each drawn a little differently.

    Two slow sines of random size move every demonstration off the letter; the same seed gives the same arrays.
    """
    random = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, samples)
    letter, around = _letter_j(share), _OPENING + share * (2.0 * np.pi - 2.0 * _OPENING)
    positions, directions = [], []
    for _ in range(count):
        waves = np.stack([np.cos(np.pi * k * share + random.uniform(0.0, 2.0 * np.pi)) for k in (1.0, 2.0)])
        positions.append(letter + waves.T @ random.normal(0.0, 0.004, (2, 2)))
        radius = _C_RADIUS + waves.T @ random.normal(0.0, 0.02, 2)
        c = np.stack([np.sin(radius) * np.cos(around), np.sin(radius) * np.sin(around), np.cos(radius)], axis=1)
        directions.append(c)
    return ToyPoses(np.stack(positions), np.stack(directions))


def _letter_j(share: np.ndarray) -> np.ndarray:
    """A stem of 20 cm downwards and a hook of 8 cm radius to the left, (T, 2) [m], at shares (T,) of its length."""
    stem, radius = 0.2, 0.08
    hook = np.pi * 0.9 * radius
    along = share * (stem + hook)
    angle = np.maximum(along - stem, 0.0) / radius
    down = 0.28 - np.minimum(along, stem) - radius * np.sin(angle)
    return np.stack([0.16 - radius * (1.0 - np.cos(angle)), down], axis=1)


@dataclass(frozen=True)
class ToyTask(Study):
    """Learn the letters with either likelihood, once for every seed, and measure.

    training : its seed and its orientation model are replaced. shown : None: `toy_demonstrations`.
    """

    seeds: tuple[int, ...] = seeds("one training each")
    training: TrainingSettings = TRAINING
    shown: ToyPoses | None = None
    far_sigma: float | None = far_sigma()
    bandwidth_factor: float | None = bandwidth_factor()

    def measure(self, out: Path) -> ToyTaskReport:
        shown = self.shown or toy_demonstrations()
        training = changed(self.training, far_sigma=self.far_sigma, bandwidth_factor=self.bandwidth_factor)
        rows, landscapes = [], {}
        for seed in tqdm(self.seeds, desc="toy-task", unit="seed"):
            for likelihood, orientation_model in LIKELIHOODS.items():
                chosen = replace(training, seed=seed, orientation_model=orientation_model)
                toy = _Toy(shown, train_model(shown.doubled, PoseLikelihood(chosen)))
                landscapes.setdefault(likelihood, toy.landscape())
                rows += [_measured(toy, metric, likelihood, seed) for of, metric in ROWS if of == likelihood]
        order = {name: number for number, name in enumerate(ROWS)}
        rows.sort(key=lambda row: (order[row.likelihood, row.metric], row.seed))
        return ToyTaskReport(shown, _apart(shown), tuple(rows), landscapes)


class _Toy:
    """A learned toy: its codes and the box that is searched."""

    def __init__(self, shown: ToyPoses, vae: AutoEncoder) -> None:
        self.shown, self.vae = shown, vae
        with torch.no_grad():
            codes = vae.encoder(*map(torch.tensor, shown.doubled))[0].numpy()
        self.codes = codes
        self.grid = grid_around(self.codes, SIDE, _BORDER)

    def metric(self, name: str) -> PullbackMetric:
        return PullbackMetric(self.vae.decoder, METRICS[name])

    def decoded(self, latent: np.ndarray) -> ToyCurve:
        with torch.no_grad():
            positions, directions = (values.numpy() for values in self.vae.decoder.means(torch.tensor(latent))[:2])
        return ToyCurve(latent, positions, directions, self.shown.distances(positions, directions))

    def landscape(self) -> Landscape:
        with torch.no_grad():
            sigma = 1.0 / self.vae.decoder.precisions(torch.tensor(self.grid.nodes())).inverse_sigma.numpy()
        return Landscape.of(self.grid, self.codes, sigma, self.metric("angular"))

    def own_sign(self) -> float:
        """Share of codes whose nearest code of another demonstration was shown with the same sign."""
        numbers, count = np.arange(len(self.codes)), len(self.codes) // 2
        return share_in_own_group(self.codes, numbers < count, numbers % count)


def _measured(toy: _Toy, metric_name: str, likelihood: str, seed: int) -> ToyRow:
    codes, count = toy.codes, len(toy.codes) // 2
    following = [(number, (number + 1) % count) for number in range(min(PAIRS, count))]
    ends = [(codes[begin, 0], codes[end, -1], codes[end + count, -1]) for begin, end in following]
    found = ToyPaths.between(toy.metric(metric_name), toy.grid, ends, _DESCENT)
    geodesics, lines = (tuple(map(toy.decoded, curves)) for curves in (found.geodesics, found.lines))
    return ToyRow(
        likelihood, metric_name, seed, toy.own_sign(), geodesics, lines, found.within, found.across
    )  # fmt: skip


def _apart(shown: ToyPoses) -> tuple[float, float]:
    """Mean distance [mm] and angle [deg] of each demonstration's poses from the nearest of the others."""
    off = []
    for number in range(len(shown.positions)):
        others = ToyPoses(np.delete(shown.positions, number, axis=0), np.delete(shown.directions, number, axis=0))
        off.append(others.distances(shown.positions[number], shown.directions[number]))
    distance, angle = np.concatenate(off).mean(axis=0)
    return 1e3 * float(distance), math.degrees(angle)


def _draw_plane(axes: Axes, shown: ToyPoses, row: ToyRow) -> None:
    for positions in shown.positions:
        axes.plot(*(100.0 * positions.T), color=GREY, linewidth=0.8)
    draw_pairs(axes, *([100.0 * curves[0].positions] for curves in (row.lines, row.geodesics)))
    axes.set(xlabel="$x_1$ [cm]", ylabel="$x_2$ [cm]", aspect="equal")
    axes.margins(0.15)
    axes.set_title("a  positions in the plane", loc="left", fontsize=11)


def _draw_sphere(axes: Axes, shown: ToyPoses, row: ToyRow) -> None:
    polar, around = np.meshgrid(np.linspace(0.0, np.pi, 40), np.linspace(0.0, 2.0 * np.pi, 60))
    ball = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])
    axes.plot_surface(*ball, color="#e8edf2", alpha=0.35, linewidth=0, zorder=0)
    for directions in shown.directions:
        axes.plot(*directions.T, color=GREY, linewidth=0.8, zorder=2)
        axes.plot(*-directions.T, ":", color=GREY, linewidth=0.8, zorder=1)
    draw_pairs(axes, *([curves[0].directions] for curves in (row.lines, row.geodesics)))
    axes.view_init(50.0, -75.0)
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.45)
    axes.set_axis_off()
    axes.set_title("b  orientations on the sphere", loc="left", fontsize=11)


def _draw_off(axes: Axes, row: ToyRow) -> None:
    draw_off(axes, [curve.off[:, 0] for curve in row.geodesics], BLUE)
    draw_off(axes, [curve.off[:, 0] for curve in row.lines], VERMILION, "--")
    axes.set_ylabel("distance of positions from the data [mm]")
    axes.set_title(f"c  off the data: {len(row.lines)} pairs of ends", loc="left", fontsize=11)
