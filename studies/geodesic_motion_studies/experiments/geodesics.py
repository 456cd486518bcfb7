"""The paper's comparison of methods for a geodesic: gradient descent, and shortest paths on graphs of the latent space.

Between the first pose of one demonstration and the last pose of another, on the skill's own metric:

straight line            in the latent space; no geodesic, the beginning of the first descent
gradient, from line      cubic spline bent by gradient descent, begun as the straight line
gradient, from graph     the same, begun as the path on the densest graph
graph NxN, 8 or 16       polyline of the shortest path on a regular grid with 8 or 16 neighbours a node
   ..., cubic spline     a cubic spline of 10 coefficients fitted to that path by least squares, as in the paper
   ..., smoothed         the planner's smoothing of that path, for skills of the tool
   ..., refined          the planner's continuous refinement of that path, for skills of the whole arm

Graphs know the skill's support, gradient descent does not. Every length is measured alike, whatever found the
curve: with the continuous metric at DENSE points of it. Off mm is how far the tool is, on average, from its path on the
shortest curve of the same pair: what a coarse grid makes of the motion. Times are of one path; graphs are built once.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import cKDTree

from geodesic_motion_ros.geometry.fitted_spline import fitted_spline
from geodesic_motion_ros.learning.autoencoder import DecoderNetwork
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.geodesic_refinement import refined
from geodesic_motion_ros.manifold.metric_field import MetricField, packed_tensors
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation
from geodesic_motion_ros.manifold.shortest_path import cost_field, shortest_free_path
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.path_smoothing import resample_latent, smooth_latent
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.latent_view import magnification_factor
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION, write_figure
from geodesic_motion_studies.experiments.latent_pictures import MAGNIFICATION_LABEL, draw_haloed
from geodesic_motion_studies.experiments.metric_graph import metric_tensors
from geodesic_motion_studies.experiments.study import OfSkill, Report, option
from geodesic_motion_studies.tools.geodesic import continuous_geodesic
from geodesic_motion_studies.tools.metric import PullbackMetric, curve_length

#: Points at which the length of every curve is measured.
DENSE = 2000
#: Ends closer than this share of a grid step are the same.
_SAME_ENDS = 0.1
#: Of the splines.
COEFFICIENTS = 10
#: Samples per grid step and their smoothing in the latent space, as the planner begins with.
_SAMPLES_PER_STEP, _SMOOTHING_WIDTH = 1.0, 1.5
GRAPHS = ((50, 8), (50, 16), (100, 8), (100, 16))
"""Nodes along each side of the grid, and neighbours of a node."""


@dataclass(frozen=True)
class Found:
    """One curve (n, d) between two latent points, how long it is and what it took to find it.

    `positions` (n, 3) [m] are decoded; `sigma` is the largest rms sigma [m] along it; `build_ms` belongs to the graph,
    once, and is NaN for the others.
    """

    method: str
    pair: int
    curve: np.ndarray
    positions: np.ndarray
    length: float
    sigma: float
    milliseconds: float
    build_ms: float = math.nan


@dataclass(frozen=True)
class GeodesicsReport(Report):
    """All curves between all pairs of ends on one skill."""

    skill: Skill
    found: tuple[Found, ...]

    @property
    def methods(self) -> list[str]:
        return list(dict.fromkeys(item.method for item in self.found))

    def summary(self) -> dict[str, dict[str, float | int]]:
        """Per method: mean and worst length over the shortest one of the same pair, and median times."""
        shortest: dict[int, Found] = {}
        for item in self.found:
            if item.pair not in shortest or item.length < shortest[item.pair].length:
                shortest[item.pair] = item
        trees = {pair: cKDTree(item.positions) for pair, item in shortest.items()}
        result = {}
        for method in self.methods:
            mine = [item for item in self.found if item.method == method]
            excess = [item.length / shortest[item.pair].length for item in mine]
            off = [trees[item.pair].query(item.positions)[0].mean() for item in mine]
            result[method] = {
                "pairs": len(mine),
                "mean_length": float(np.mean([item.length for item in mine])),
                "mean_over_shortest": float(np.mean(excess)),
                "worst_over_shortest": float(np.max(excess)),
                "off_mm": 1e3 * float(np.mean(off)),
                "left_support": sum(item.sigma > self.skill.sigma_limit for item in mine),
                "median_ms": float(np.median([item.milliseconds for item in mine])),
                "build_ms": mine[0].build_ms,
            }
        return result

    def as_dict(self) -> dict[str, Any]:
        single = [{k: v for k, v in asdict(item).items() if k not in ("curve", "positions")} for item in self.found]
        return {"skill": self.skill.name, "methods": self.summary(), "found": single}

    def table(self) -> str:
        """The table as plain text."""
        head = ["method", "pairs", "length", "over shortest", "worst", "off mm", "left support", "ms", "build ms"]
        rows = [[method, *figures.values()] for method, figures in self.summary().items()]
        notes = (
            "length: Riemannian, mean over pairs; over shortest: mean ratio to the shortest curve of the same pair",
            f"cubic spline: {COEFFICIENTS} coefficients, fitted by least squares",
            "pairs: with ends that differ; on a canonical sheet all demonstrations have the same ones",
        )
        return "\n".join([self.skill.name, text_table(head, rows, digits=3), *notes])

    def draw(self, path: Path) -> None:
        """The curves of the first pair over the magnification factor, and excess lengths over times of all methods."""
        figure = Figure(figsize=(10.5, 5.4), layout="constrained")
        latent, lengths = figure.subplots(1, 2)
        handles = _draw_curves(figure, latent, self) + _draw_lengths(lengths, self)
        figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
        write_figure(figure, path)


@dataclass(frozen=True)
class Geodesics(OfSkill):
    """Find every curve between several pairs of ends: the start of demonstration i, the goal of demonstration i + 1.

    pairs : how many, at most one per demonstration, and as many as have ends that differ.
    """

    pairs: int = option(3, "pairs of ends", least=1)

    def measured(self, skill: Skill) -> GeodesicsReport:
        """ParameterError: none of the skill's pairs are connected inside its support."""
        metric = PullbackMetric(DecoderNetwork.from_numpy(skill.decoder), skill.metric)
        graphs = [_Graph(skill, metric, *size) for size in GRAPHS]
        found = [
            _measured(skill, metric, method, number, curve, milliseconds, build)
            for number, ends in enumerate(_ends(skill, graphs[-1], self.pairs))
            for method, curve, milliseconds, build in _curves(metric, graphs, *ends)
        ]
        if not found:
            raise ParameterError(f"{skill.name}: no demonstration's ends are connected inside the support")
        return GeodesicsReport(skill, tuple(found))


class _Graph:
    """A graph of the skill as it was learned, and how long it took to build."""

    def __init__(self, skill: Skill, metric: PullbackMetric, side: int, neighbours: int) -> None:
        self.name, self._metric = f"graph {side}x{side}, {neighbours}", metric
        self.graph, self.build_ms = _timed(lambda: skill.graph((side, side), neighbours))
        self._base = self.graph.transported(Offsets.none(self.graph.mean_path_count), np.zeros((1, 3))).base
        self._tree = cKDTree(self.graph.latent)
        # loads the kernels, and measures the metric, which is not the path's time
        self.refined(self.graph.latent[:2])
        self.path(self.graph.latent[0], self.graph.latent[0])

    @property
    def step(self) -> float:
        """Distance between neighbouring nodes along the finer axis."""
        return float(np.min(self.graph.grid.spacing))

    def connected(self, start: np.ndarray, goal: np.ndarray) -> bool:
        """Whether two latent points (d,) lie near one connected piece."""
        first, last = self._nodes(start, goal)
        return bool(self.graph.component[first] == self.graph.component[last])

    def path(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
        """Shortest path (m, d) between latent points (d,), ends exact; None where there is none."""
        source, target = self._nodes(start, goal)
        graph = self.graph
        nodes, _, cost = shortest_free_path(graph.adjacency, self._base, self._heuristic(target), source, target)
        return np.concatenate([start[None], graph.latent[nodes[1:-1]], goal[None]]) if math.isfinite(cost) else None

    def refined(self, path: np.ndarray) -> np.ndarray:
        """The planner's continuous refinement of a path (m, d)."""
        return refined(self._field, self._free, 0.0, path)

    @cached_property
    def _field(self) -> MetricField:
        """The metric between the nodes, without obstacles: no share of it is any body point's."""
        grid, latent = self.graph.grid, self.graph.latent
        number = np.full(grid.shape, -1)
        number[tuple(np.rint(grid.coordinates(latent)).astype(int).T)] = np.arange(len(latent))
        tensors = metric_tensors(self._metric, latent) * (grid.spacing[:, None] * grid.spacing)
        return MetricField.of(grid, number, packed_tensors(np.zeros_like(tensors)[:, None], tensors))

    @cached_property
    def _free(self) -> NodeEvaluation:
        body = NodeBody.of_tool(self.graph.decoded.positions[:, None], np.zeros(1))
        return NodeEvaluation.of(body, Obstacles.of_spheres(np.empty((0, 3)), np.empty(0)), 1.0, 1.0, 0.0)

    def _heuristic(self, target: int) -> np.ndarray:
        return cost_field(self.graph.adjacency, self._base, target)

    def _nodes(self, start: np.ndarray, goal: np.ndarray) -> tuple[int, int]:
        _, nodes = self._tree.query(np.stack([start, goal]))
        return int(nodes[0]), int(nodes[1])


def _ends(skill: Skill, graph: _Graph, pairs: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Latent ends: start of one demonstration, goal of the next one, on one connected piece of the manifold.

    Pairs whose ends are those of a pair before are left out: they would be the same measurement again.
    """
    own = skill.codes[: max(1, len(skill.codes) // 2)] if skill.orientation_model == "two_cluster" else skill.codes
    found: list[np.ndarray] = []
    for i in range(min(pairs, len(own))):
        ends = np.stack([own[i, 0], own[(i + 1) % len(own), -1]])
        known = any(np.abs(ends - other).max() < _SAME_ENDS * graph.step for other in found)
        if not known and graph.connected(*ends):
            found.append(ends)
            yield ends[0], ends[1]


def _curves(
    metric: PullbackMetric, graphs: Sequence[_Graph], start: np.ndarray, goal: np.ndarray
) -> Iterator[tuple[str, np.ndarray, float, float]]:
    """Method, curve (n, d), milliseconds and milliseconds of building, of every method that finds one."""
    yield "straight line", np.stack([start, goal]), 0.0, math.nan
    found, spent = _timed(lambda: continuous_geodesic(metric, start, goal))
    yield "gradient, from line", found.curve, spent, math.nan
    densest = None
    for graph in graphs:
        path, searching = _timed(lambda graph=graph: graph.path(start, goal))
        if path is None:
            continue
        yield graph.name, path, searching, graph.build_ms
        for suffix, smooth in ((", cubic spline", _spline), (", smoothed", _smoothed), (", refined", _refined)):
            curve, spent = _timed(lambda smooth=smooth, path=path, graph=graph: smooth(path, graph))
            yield graph.name + suffix, curve, searching + spent, graph.build_ms
        densest = path, searching
    if densest is not None:
        path, searching = densest
        found, spent = _timed(lambda: continuous_geodesic(metric, start, goal, path))
        yield "gradient, from graph", found.curve, searching + spent, math.nan


def _spline(path: np.ndarray, graph: _Graph) -> np.ndarray:
    return fitted_spline(path, COEFFICIENTS)(np.linspace(0.0, 1.0, DENSE))


def _smoothed(path: np.ndarray, graph: _Graph) -> np.ndarray:
    """As the planner smooths a path (m, d) of a skill of the tool."""
    return smooth_latent(resample_latent(path, graph.step / _SAMPLES_PER_STEP), _SMOOTHING_WIDTH * _SAMPLES_PER_STEP)


def _refined(path: np.ndarray, graph: _Graph) -> np.ndarray:
    return graph.refined(path)


def _measured(
    skill: Skill, metric: PullbackMetric, method: str, pair: int, curve: np.ndarray, spent: float, build: float
) -> Found:
    dense = resample_latent(curve, math.inf, minimum=DENSE)
    with torch.no_grad():
        length = float(curve_length(metric, torch.tensor(dense)))
    sigma = float(np.max(rms_sigma(skill.decoder.uncertainty(dense)[0])))
    return Found(method, pair, dense, skill.decoder.decode(dense).positions, length, sigma, spent, build)


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """What it returns, and the milliseconds it took."""
    begin = time.perf_counter()
    result = work()
    return result, 1e3 * (time.perf_counter() - begin)


#: Drawn in the latent space: colour and style.
_DRAWN = {
    "straight line": (GREY, ":"),
    "gradient, from line": (VERMILION, "--"),
    "graph 50x50, 8": (ORANGE, "-"),
    "graph 100x100, 16, refined": (BLUE, "-"),
}
#: What was done with a graph's path, and its colour.
_TREATED = {"path": GREY, "cubic spline": ORANGE, "smoothed": GREEN, "refined": BLUE}
#: Excess lengths below this share are drawn there [%].
_LEAST_EXCESS = 0.1


def _draw_curves(figure: Figure, axes: Axes, report: GeodesicsReport) -> list[Line2D]:
    skill, first = report.skill, report.found[0].pair
    (left, bottom), (right, top) = skill.latent_lower[:2], skill.latent_upper[:2]
    image = axes.imshow(magnification_factor(skill, 300), extent=(left, right, bottom, top), aspect="auto")
    figure.colorbar(image, ax=axes, label=MAGNIFICATION_LABEL, pad=0.02)
    for code in skill.codes:
        axes.plot(*code.T, color="white", linewidth=0.6)
    handles = []
    for item in report.found:
        if item.pair == first and item.method in _DRAWN:
            colour, style = _DRAWN[item.method]
            draw_haloed(axes, item.curve, colour, style)
            label = f"{item.method}: length {item.length:.2f}"
            handles.append(Line2D([], [], color=colour, linestyle=style, linewidth=2.2, label=label))
    axes.set(xlabel="$z_1$", ylabel="$z_2$")
    axes.set_title(f"a  one pair of ends, {skill.name}", loc="left", fontsize=11)
    return handles


def _draw_lengths(axes: Axes, report: GeodesicsReport) -> list[Line2D]:
    markers = {
        f"graph {side}x{side}, {neighbours}": mark for (side, neighbours), mark in zip(GRAPHS, "ovs^", strict=True)
    }
    for method, values in report.summary().items():
        if values["median_ms"] == 0.0:
            continue
        graph = next((name for name in markers if method.startswith(name)), None)
        treated = method.removeprefix(f"{graph}, ") if method != graph else "path"
        colour = VERMILION if graph is None else _TREATED[treated]
        excess = max(100.0 * (values["mean_over_shortest"] - 1.0), _LEAST_EXCESS)
        axes.plot(values["median_ms"], excess, markers.get(graph, "*"), color=colour, markersize=9, alpha=0.9)
        if graph is None:
            axes.annotate(method, (values["median_ms"], excess), (0, 8), textcoords="offset points", ha="right")
    axes.set(xscale="log", yscale="log", xlabel="time of one path [ms]", ylabel="longer than the shortest curve [%]")
    axes.margins(0.12)
    axes.grid(alpha=0.3)
    axes.set_title("b  all methods, mean over pairs", loc="left", fontsize=11)
    graphs = [Line2D([], [], color="black", marker=mark, linestyle="", label=name) for name, mark in markers.items()]
    treated = [Line2D([], [], color=colour, marker="o", linestyle="", label=name) for name, colour in _TREATED.items()]
    return graphs + treated
