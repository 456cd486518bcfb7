"""What experiments with toys share: a grid around codes, values and paths over it, pictures, and finer curves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geodesic_motion_ros.manifold.grid import LatentGrid
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION
from geodesic_motion_studies.experiments.metric_graph import (
    MetricGraph,
    evenly,
    latent_length,
    magnification,
    metric_tensors,
)
from geodesic_motion_studies.tools.geodesic import GeodesicSettings, continuous_geodesic
from geodesic_motion_studies.tools.metric import Metric

DEVIATION_LABEL = r"$\log_{10}\,\sigma$"
MAGNIFICATION_LABEL = r"$\log\sqrt{\det M(z)}$"
#: Directions from each node of a toy's grid.
_NEIGHBOURS = 16


@dataclass(frozen=True)
class Landscape:
    """A latent space over a grid: codes (N, T, 2) and values in the grid's shape, first axis z1.

    `deviation` is log10 of the root mean square of sigma; `magnification` log sqrt det M.
    """

    grid: LatentGrid
    codes: np.ndarray
    deviation: np.ndarray
    magnification: np.ndarray

    @classmethod
    def of(cls, grid: LatentGrid, codes: np.ndarray, sigma: np.ndarray, metric: Metric) -> Landscape:
        """sigma : (prod(shape), c) standard deviations at the grid's nodes."""
        deviation = 0.5 * np.log10(np.mean(sigma**2, axis=1))
        factor = magnification(metric_tensors(metric, grid.nodes()))
        return cls(grid, codes, deviation.reshape(grid.shape), factor.reshape(grid.shape))


@dataclass(frozen=True)
class ToyPaths:
    """Between pairs of ends, latent points (m, 2) each, evenly spaced.

    Attributes
    ----------
    geodesics, lines : shortest paths on the grid, bent by gradient descent, and straight lines between the same ends.
    crossings : shortest paths on the grid from the same starts to goals in the other cluster.
    within, across : mean energy of the shortest paths on the grid, to the goals and to those in the other cluster.
    """

    geodesics: list[np.ndarray]
    lines: list[np.ndarray]
    crossings: list[np.ndarray]
    within: float
    across: float

    @classmethod
    def between(
        cls, metric: Metric, grid: LatentGrid, ends: Sequence[tuple[np.ndarray, ...]], iterations: int
    ) -> ToyPaths:
        """ends : starts (2,), goals (2,) and goals in the other cluster (2,). iterations : of the descent."""
        graph = MetricGraph.on_grid(metric, grid, np.ones(math.prod(grid.shape), dtype=bool), _NEIGHBOURS)
        descent = GeodesicSettings(control_points=15, samples=100, iterations=iterations)
        paths, crossings = ([graph.path(each[0], each[goal]) for each in ends] for goal in (1, 2))
        bent = [
            continuous_geodesic(metric, start, goal, path, descent).curve
            for (start, goal, _), path in zip(ends, paths, strict=True)
        ]
        within, across = (
            float(np.mean([latent_length(metric, path) ** 2 for path in each])) for each in (paths, crossings)
        )
        lines = [evenly(np.stack(each[:2])) for each in ends]
        return cls(list(map(evenly, bent)), lines, list(map(evenly, crossings)), within, across)


def grid_around(codes: np.ndarray, side: int, border: float) -> LatentGrid:
    """A grid over codes (..., d), `side` nodes along each axis, with a free border as a share of the codes' box."""
    flat = codes.reshape(-1, codes.shape[-1])
    margin = border * np.ptp(flat, axis=0)
    return LatentGrid(flat.min(axis=0) - margin, flat.max(axis=0) + margin, (side,) * codes.shape[-1])


def between_samples(curves: np.ndarray, factor: int = 10) -> np.ndarray:
    """Curves (N, T, c), interpolated linearly to `factor` times as many samples: (N, factor T, c)."""
    samples = np.arange(curves.shape[1])
    at = np.linspace(0.0, samples[-1], factor * len(samples))
    return np.stack([np.stack([np.interp(at, samples, column) for column in curve.T], axis=1) for curve in curves])


def draw_values(figure: Figure, axes: Axes, landscape: Landscape, values: np.ndarray, label: str, solid: int) -> None:
    """Values with their scale; the first `solid` codes in full white lines, the others dotted."""
    (left, bottom), (right, top) = landscape.grid.lower, landscape.grid.upper
    image = axes.imshow(values.T, origin="lower", extent=(left, right, bottom, top), cmap="viridis", aspect="auto")
    figure.colorbar(image, ax=axes, label=label, pad=0.02)
    for number, code in enumerate(landscape.codes):
        axes.plot(*code.T, "-" if number < solid else ":", color="white", linewidth=0.9)
    axes.set(xlabel="$z_1$", ylabel="$z_2$")


def draw_haloed(axes: Axes, curve: np.ndarray, colour: str, style: str) -> None:
    """A curve (n, 2 or 3) on a white ground of its own, so that it is seen on any."""
    axes.plot(*curve.T, color="white", linewidth=3.6, zorder=4)
    axes.plot(*curve.T, style, color=colour, linewidth=2.2, zorder=5)


def draw_pairs(axes: Axes, lines: Sequence[np.ndarray], geodesics: Sequence[np.ndarray]) -> None:
    """Straight lines and geodesics (n, 2 or 3) between the same ends."""
    for curves, colour, style in ((lines, VERMILION, "--"), (geodesics, BLUE, "-")):
        for curve in curves:
            draw_haloed(axes, curve, colour, style)


def draw_off(axes: Axes, curves: Sequence[np.ndarray], colour: str, style: str = "-") -> None:
    """Distances [m] from what was shown, (m,) each, over the share of the path."""
    for off in curves:
        axes.plot(np.linspace(0.0, 1.0, len(off)), 1e3 * off, style, color=colour, linewidth=1.6)
    axes.set_xlabel("share of the path")
    axes.grid(alpha=0.3)
