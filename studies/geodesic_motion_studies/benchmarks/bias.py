"""How much longer than a geodesic a path is that only knows the directions of a grid, before and after refinement.

All lengths are of one metric, that of the graph between its nodes, by many pieces of a curve. The best known geodesic
is the shortest curve of all that were found: of the paths themselves, and of what scipy's L-BFGS makes of each, with
the energy of many pieces and gradients by finite differences. Between random places, without obstacles.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from geodesic_motion_ros.manifold.geodesic_refinement import refined
from geodesic_motion_ros.manifold.metric_field import MetricField, curve_length, evenly, piecewise
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation
from geodesic_motion_ros.manifold.shortest_path import cost_field, shortest_free_path
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.path_smoothing import resample_latent, smooth_latent
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.benchmarks.engine import SearchProblem, mark
from geodesic_motion_studies.benchmarks.stages import SkillBench
from geodesic_motion_studies.benchmarks.stopwatch import Stopwatch, percentiles_ms
from geodesic_motion_studies.benchmarks.synthetic import synthetic_field, synthetic_grid, synthetic_problem

#: Pieces of the curves that L-BFGS bends, its iterations, and the step of its differences in steps of the grid.
_PIECES, _ITERATIONS, _NUDGE = 150, 200, 1e-5
#: Least distance between both ends, as a share of the box's diagonal.
_APART = 0.25
#: Width of the planner's smoothing, in steps of the grid.
_WIDTH = 2.0
#: Pieces much shorter than the average would weigh too much: this share of it. Weight of leaving the nodes.
_SHORTEST, _LEAVING = 0.02, 1e3


@dataclass(frozen=True)
class BiasFigures:
    """Lengths over those of the best known geodesics between the same ends, (p,) for p pairs of them.

    Attributes
    ----------
    graph, smoothed, refined : of the graph's shortest path, of that smoothed as by the planner, of that refined.
    watch : of the refinement.
    """

    name: str
    graph: np.ndarray
    smoothed: np.ndarray
    refined: np.ndarray
    watch: Stopwatch

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        curves = {"graph": self.graph, "smoothed": self.smoothed, "refined": self.refined}
        over = {name: {"p50": float(np.median(one)), "max": float(np.max(one))} for name, one in curves.items()}
        return {"pairs": len(self.graph), "over_best_known": over, "refine_cpu_ms": percentiles_ms(self.watch.cpu)}


def bias_table(rows: list[BiasFigures]) -> str:
    """One line for every graph."""
    lines = []
    for row in rows:
        over = [(np.median(one), np.max(one)) for one in (row.graph, row.smoothed, row.refined)]
        cells = [f"{value:.3f}" for both in over for value in both]
        cpu = percentiles_ms(row.watch.cpu)
        lines.append([row.name, len(row.graph), *cells, f"{cpu['p50']:.2f}", f"{cpu['p99']:.2f}"])
    head = ["graph", "pairs", "path p50", "max", "smoothed p50", "max", "refined p50", "max", "cpu p50", "cpu p99"]
    title = "grid bias: length over the best known geodesic's; refinement in ms"
    return "\n".join([title, text_table(head, lines)])


def skill_bias(skill: Skill, bench: SkillBench, pairs: int, seed: int = 0) -> BiasFigures:
    """Between the beginning and the end of the mean paths, where the planner's paths begin and end; not where the
    planner would refuse the path, for it crosses where nobody moved."""
    graph, random = bench.planner.graph, np.random.default_rng(seed)
    everywhere, steps = np.ones(len(graph.latent), dtype=bool), max(graph.grid.shape)
    lines = skill.codes if skill.mean_paths is None else skill.mean_paths.centres

    def ends() -> Iterator[tuple[int, int]]:
        count, length = lines.shape[:2]
        while True:
            here, there = random.integers(count, size=2)
            begin, end = random.integers(0.3 * length), random.integers(0.7 * length, length)
            source = graph.node_near(lines[here, begin], everywhere, steps)
            target = graph.node_near(lines[there, end], everywhere, steps)
            if source is not None and target is not None:
                yield source, target

    return _compared(bench.problem, bench.query.field, graph.latent, ends(), pairs, graph.energy_limit)


def synthetic_bias(shape: tuple[int, ...], pairs: int, seed: int = 0) -> BiasFigures:
    """Between random nodes of the synthetic graph."""
    random, latent = np.random.default_rng(seed), synthetic_grid(shape).nodes()
    apart = _APART * np.linalg.norm(latent[-1] - latent[0])

    def ends() -> Iterator[tuple[int, int]]:
        while True:
            here, there = random.integers(len(latent), size=2)
            if np.linalg.norm(latent[there] - latent[here]) >= apart:
                yield int(here), int(there)

    return _compared(synthetic_problem(shape), synthetic_field(shape), latent, ends(), pairs)


def _compared(
    problem: SearchProblem,
    field: MetricField,
    latent: np.ndarray,
    ends: Iterator[tuple[int, int]],
    pairs: int,
    energy_limit: float = math.inf,
) -> BiasFigures:
    evaluation, watch = mark(problem, Obstacles.none()), Stopwatch()
    step, rows = float(np.min(field.spacing)), []
    refined(field, evaluation, 0.0, latent[:2])
    while len(rows) < pairs:
        source, target = next(ends)
        to_target = cost_field(problem.adjacency, problem.graph.base, target)
        nodes, edges, _ = shortest_free_path(problem.adjacency, problem.graph.base, to_target, source, target)
        if len(nodes) < 3 or np.max(problem.graph.energies(edges)) > energy_limit:
            continue
        path = latent[nodes]
        with watch:
            curve = refined(field, evaluation, problem.settings.obstacle_margin, path)
        smoothed = smooth_latent(resample_latent(path, step), _WIDTH)
        found = [curve_length(field, evaluation, one) for one in (path, smoothed, curve)]
        best = min(curve_length(field, evaluation, _bent(field, evaluation, one)) for one in (path, smoothed, curve))
        rows.append(np.array(found) / min(best, *found))
    return BiasFigures(problem.name, *np.array(rows).T, watch)


def _bent(field: MetricField, evaluation: NodeEvaluation, path: np.ndarray) -> np.ndarray:
    """A locally shortest curve between a path's ends, slowly."""
    points = evenly(field.coordinates(path), _PIECES)
    dimension = points.shape[1]
    lengths = np.sqrt(piecewise(field, evaluation, points)[0])
    weights = lengths.sum() / np.maximum(lengths, _SHORTEST * lengths.mean())

    def terms(curve: np.ndarray) -> np.ndarray:
        energies, support, _ = piecewise(field, evaluation, curve)
        return weights * energies + _LEAVING * np.maximum(0.0, 0.5 - support) ** 2

    def placed(inner: np.ndarray) -> np.ndarray:
        return np.concatenate([points[:1], inner.reshape(-1, dimension), points[-1:]])

    def energy(inner: np.ndarray) -> tuple[float, np.ndarray]:
        curve = placed(inner)
        slopes = np.zeros_like(curve)
        # Every other point can be moved at once: no piece has two of them.
        for axis in range(dimension):
            for first in (1, 2):
                moved = np.arange(first, _PIECES, 2)
                ahead, behind = curve.copy(), curve.copy()
                ahead[moved, axis] += _NUDGE
                behind[moved, axis] -= _NUDGE
                change = (terms(ahead) - terms(behind)) / (2.0 * _NUDGE)
                slopes[moved, axis] = change[moved - 1] + change[moved]
        return float(terms(curve).sum()), slopes[1:-1].reshape(-1)

    options = {"maxiter": _ITERATIONS, "maxcor": 20}
    found = minimize(energy, points[1:-1].reshape(-1), jac=True, method="L-BFGS-B", options=options)
    return field.latent(placed(found.x))
