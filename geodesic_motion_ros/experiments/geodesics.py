"""The paper's comparison of ways to a geodesic: gradient descent, and shortest paths on graphs of the latent space.

Between the first pose of one demonstration and the last pose of another, on the skill's own metric:

straight line            in the latent space; no geodesic, the beginning of the first descent
gradient, from line      cubic spline bent by gradient descent, begun as the straight line
gradient, from graph     the same, begun as the path on the densest graph
graph NxN, 8 or 16       polyline of the shortest path on a regular grid with 8 or 16 neighbours a node
   ..., cubic spline     a cubic spline through the nodes of that path, as in the paper
   ..., smoothed         the planner's smoothing of that path

Graphs know the skill's support, gradient descent does not. Every length is measured the same way, whatever found the
curve: with the continuous metric at DENSE points of it. Times are of one path; graphs are built once.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.graph.decoder import rms_sigma
from geodesic_motion_ros.graph.shortest_path import cost_field, shortest_free_path
from geodesic_motion_ros.graph.transport import Offsets
from geodesic_motion_ros.manifold.geodesic import continuous_geodesic
from geodesic_motion_ros.manifold.metric import PullbackMetric, curve_length
from geodesic_motion_ros.manifold.task_space import DecoderNetwork
from geodesic_motion_ros.reference import resample_latent, smooth_latent
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import text_table

#: Points at which the length of every curve is measured.
DENSE = 2000
#: Samples per grid step and their smoothing in the latent space, as the planner begins with.
_SAMPLES_PER_STEP, _SMOOTHING_WIDTH = 1.0, 1.5
GRAPHS = ((50, 8), (50, 16), (100, 8), (100, 16))
"""Nodes along each side of the grid, and neighbours of a node."""


@dataclass(frozen=True)
class Found:
    """One curve (n, d) between two latent points, how long it is and what it took to find it.

    `sigma` is the largest rms sigma [m] along it; `build_ms` belongs to the graph, once, and is NaN for the others.
    """

    method: str
    pair: int
    curve: np.ndarray
    length: float
    sigma: float
    milliseconds: float
    build_ms: float = math.nan


@dataclass(frozen=True)
class GeodesicsReport:
    """All curves between all pairs of ends on one skill."""

    skill: Skill
    found: tuple[Found, ...]

    @property
    def methods(self) -> list[str]:
        return list(dict.fromkeys(item.method for item in self.found))

    def summary(self) -> dict[str, dict[str, float | int]]:
        """Per method: mean and worst length over the shortest one of the same pair, and median times."""
        shortest: dict[int, float] = {}
        for item in self.found:
            shortest[item.pair] = min(item.length, shortest.get(item.pair, math.inf))
        result = {}
        for method in self.methods:
            mine = [item for item in self.found if item.method == method]
            excess = [item.length / shortest[item.pair] for item in mine]
            result[method] = {
                "pairs": len(mine),
                "mean_length": float(np.mean([item.length for item in mine])),
                "mean_over_shortest": float(np.mean(excess)),
                "worst_over_shortest": float(np.max(excess)),
                "left_support": sum(item.sigma > self.skill.sigma_limit for item in mine),
                "median_ms": float(np.median([item.milliseconds for item in mine])),
                "build_ms": mine[0].build_ms,
            }
        return result

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes; the curves are left out."""
        single = [{k: v for k, v in asdict(item).items() if k != "curve"} for item in self.found]
        return {"skill": self.skill.name, "methods": self.summary(), "found": single}

    def table(self) -> str:
        """The table as plain text."""
        head = ["method", "pairs", "length", "over shortest", "worst", "left support", "ms", "build ms"]
        rows = [[method, *figures.values()] for method, figures in self.summary().items()]
        note = "length: Riemannian, mean over pairs; over shortest: mean ratio to the shortest curve of the same pair"
        return "\n".join([self.skill.name, text_table(head, rows, digits=3), note])


def compare_geodesics(skill: Skill, pairs: int = 5) -> GeodesicsReport:
    """Find every curve between several pairs of ends: the start of demonstration i, the goal of demonstration i + 1.

    Parameters
    ----------
    pairs : how many, at most one per demonstration.

    Raises
    ------
    ParameterError : no pairs, or a skill none of whose pairs are connected inside its support.
    """
    if pairs < 1:
        raise ParameterError(f"pairs is {pairs}; at least 1 is needed")
    metric = PullbackMetric(DecoderNetwork.from_numpy(skill.decoder), skill.metric)
    graphs = [_Graph(skill, *size) for size in GRAPHS]
    found: list[Found] = []
    for number, (start, goal) in enumerate(_ends(skill, graphs[-1], pairs)):
        found += [
            _measured(skill, metric, method, number, curve, milliseconds, build)
            for method, curve, milliseconds, build in _curves(metric, graphs, start, goal)
        ]
    if not found:
        raise ParameterError(f"{skill.name}: no demonstration's ends are connected inside the support")
    return GeodesicsReport(skill, tuple(found))


class _Graph:
    """A graph of the skill as it was learned, and how long it took to build."""

    def __init__(self, skill: Skill, side: int, neighbours: int) -> None:
        self.name = f"graph {side}x{side}, {neighbours}"
        self.graph, self.build_ms = _timed(lambda: skill.graph((side, side), neighbours))
        self._base = self.graph.transported(Offsets.none(self.graph.ridge_count), np.zeros((1, 3))).base
        self._tree = cKDTree(self.graph.latent)
        self.path(self.graph.latent[0], self.graph.latent[0])  # loads the kernels, which is not the path's time

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

    def _heuristic(self, target: int) -> np.ndarray:
        return cost_field(self.graph.adjacency, self._base, target)

    def _nodes(self, start: np.ndarray, goal: np.ndarray) -> tuple[int, int]:
        _, nodes = self._tree.query(np.stack([start, goal]))
        return int(nodes[0]), int(nodes[1])


def _ends(skill: Skill, graph: _Graph, pairs: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Latent ends: start of one demonstration, goal of the next one, on one connected piece of the manifold."""
    own = skill.codes[: max(1, len(skill.codes) // 2)] if skill.orientation_model == "two_cluster" else skill.codes
    for i in range(min(pairs, len(own))):
        start, goal = own[i, 0], own[(i + 1) % len(own), -1]
        if graph.connected(start, goal):
            yield start, goal


def _curves(
    metric: PullbackMetric, graphs: Sequence[_Graph], start: np.ndarray, goal: np.ndarray
) -> Iterator[tuple[str, np.ndarray, float, float]]:
    """Method, curve (n, d), milliseconds and milliseconds of building, of every way that leads there."""
    yield "straight line", np.stack([start, goal]), 0.0, math.nan
    found, spent = _timed(lambda: continuous_geodesic(metric, start, goal))
    yield "gradient, from line", found.curve, spent, math.nan
    densest = None
    for graph in graphs:
        path, searching = _timed(lambda graph=graph: graph.path(start, goal))
        if path is None:
            continue
        yield graph.name, path, searching, graph.build_ms
        for suffix, smooth in ((", cubic spline", _spline), (", smoothed", _smoothed)):
            curve, spent = _timed(lambda smooth=smooth, path=path, graph=graph: smooth(path, graph.step))
            yield graph.name + suffix, curve, searching + spent, graph.build_ms
        densest = path, searching
    if densest is not None:
        path, searching = densest
        found, spent = _timed(lambda: continuous_geodesic(metric, start, goal, path))
        yield "gradient, from graph", found.curve, searching + spent, math.nan


def _spline(path: np.ndarray, step: float) -> np.ndarray:
    """Natural cubic spline through the nodes (m, d), by the length of the polyline."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    kept = path[np.concatenate([[True], steps > 1e-9])]
    length = np.concatenate([[0.0], np.cumsum(steps[steps > 1e-9])])
    return CubicSpline(length, kept, bc_type="natural")(np.linspace(0.0, length[-1], DENSE))


def _smoothed(path: np.ndarray, step: float) -> np.ndarray:
    """As the planner smooths a path (m, d) on a grid with a distance of `step` between its nodes."""
    return smooth_latent(resample_latent(path, step / _SAMPLES_PER_STEP), _SMOOTHING_WIDTH * _SAMPLES_PER_STEP)


def _measured(
    skill: Skill, metric: PullbackMetric, method: str, pair: int, curve: np.ndarray, spent: float, build: float
) -> Found:
    dense = resample_latent(curve, math.inf, minimum=DENSE)
    with torch.no_grad():
        length = float(curve_length(metric, torch.tensor(dense)))
    sigma = float(np.max(rms_sigma(skill.decoder.uncertainty(dense)[0])))
    return Found(method, pair, dense, length, sigma, spent, build)


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """What it returns, and the milliseconds it took."""
    begin = time.perf_counter()
    result = work()
    return result, 1e3 * (time.perf_counter() - begin)


def draw_geodesics(report: GeodesicsReport, path: Path) -> None:
    """The curves of the first pair over the magnification factor, and lengths against times of all methods."""
    from matplotlib.figure import Figure

    from geodesic_motion_ros.latent_view import magnification_factor

    skill = report.skill
    figure = Figure(figsize=(13, 6), layout="constrained")
    latent, lengths = figure.subplots(1, 2)
    (left, bottom), (right, top) = skill.latent_lower[:2], skill.latent_upper[:2]
    extent = (left, right, bottom, top)
    shown = latent.imshow(magnification_factor(skill, 300), extent=extent, cmap="viridis", aspect="auto")
    figure.colorbar(shown, ax=latent, label="log sqrt det M")
    for code in skill.codes:
        latent.plot(code[:, 0], code[:, 1], color="white", linewidth=0.6)
    first = report.found[0].pair
    chosen = ("straight line", "gradient, from line", "graph 50x50, 16", "graph 100x100, 16", "gradient, from graph")
    for item in report.found:
        if item.pair == first and item.method in chosen:
            latent.plot(item.curve[:, 0], item.curve[:, 1], linewidth=2, label=f"{item.method}: {item.length:.2f}")
    latent.set(title=f"{skill.name}: one pair of ends, Riemannian lengths", xlabel="z1", ylabel="z2")
    latent.legend(fontsize=8)
    timed = {method: values for method, values in report.summary().items() if values["median_ms"] > 0.0}
    for (method, values), marker in zip(timed.items(), itertools.cycle("osD^v<>Pph*X"), strict=False):
        lengths.plot(values["median_ms"], values["mean_over_shortest"], marker, markersize=8, label=method)
    lengths.legend(fontsize=8, loc="upper center", ncols=2)
    lengths.margins(y=0.3)
    lengths.set(xscale="log", yscale="log")
    lengths.set(xlabel="time of one path [ms]", ylabel="length over the shortest found (mean)")
    figure.savefig(path, dpi=110)
