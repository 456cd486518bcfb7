"""The benchmark of the search engine: every scene on two graphs beside its peers, stages of the tick, and scaling.

Ratios to peers are of processor time of the thread, the median over the median: they hold on a loaded machine too.
The engine's tick is the planner's: ways that cost more than a limit count as blocked. Costs are held against scipy's
Dijkstra on the graph with all edges weighed anew: that of the search without the limit everywhere, and that of the tick
where it is below.
"""

from __future__ import annotations

import math
import os
import platform
import signal
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.benchmarks.bias import BiasFigures, bias_table, skill_bias, synthetic_bias
from geodesic_motion_ros.benchmarks.engine import SearchProblem, looked_at, mark, search, search_one_way, search_plainly
from geodesic_motion_ros.benchmarks.hurried import DEADLINE_MS, HurriedTicks
from geodesic_motion_ros.benchmarks.peers import EdgeWeights, Networkx, Peer, Scipy, installed
from geodesic_motion_ros.benchmarks.scenes import NAMES, Scene, scenes_of, spheres_on_way
from geodesic_motion_ros.benchmarks.stages import SkillBench
from geodesic_motion_ros.benchmarks.stopwatch import (
    Stopwatch,
    no_garbage_among_what_stands,
    no_garbage_collection,
    percentiles_ms,
)
from geodesic_motion_ros.benchmarks.synthetic import synthetic_problem
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import text_table, write_json

#: Among the peers: our own search without a limit to the cost, our own A* from one end, and our own Dijkstra.
_EXACT, _ASTAR, _DIJKSTRA = "exact", "A*", "dijkstra"

Input, Output = TypeVar("Input"), TypeVar("Output")


@dataclass(frozen=True)
class BenchSettings:
    """How much is measured.

    Attributes
    ----------
    shape, skill_shape : grid of the synthetic graph, and of the skill's graph; None: the skill's own.
    ticks, peer_ticks, networkx_ticks : of every scene.
    scaling_ticks : of every row of the scaling table, which varies `grids`, the number of `obstacles`, and that of body
        `points` on the grid `points_shape`.
    pairs : of ends between which the grid's bias is measured on each graph.
    """

    shape: tuple[int, ...] = (50, 50, 50)
    skill_shape: tuple[int, ...] | None = None
    ticks: int = 300
    peer_ticks: int = 5
    networkx_ticks: int = 1
    scaling_ticks: int = 40
    grids: tuple[tuple[int, ...], ...] = ((100,) * 2, (200,) * 2, (30,) * 3, (50,) * 3, (70,) * 3, (24,) * 4)
    obstacles: tuple[int, ...] = (0, 1, 2, 5, 10, 20, 50)
    points: tuple[int, ...] = (1, 2, 4, 8, 16, 32)
    points_shape: tuple[int, ...] = (30, 30, 30)
    pairs: int = 30

    @classmethod
    def quick(cls) -> BenchSettings:
        """For half a minute: a smaller graph, fewer ticks."""
        return cls(
            shape=(25,) * 3, ticks=60, peer_ticks=2, scaling_ticks=30, grids=((100,) * 2, (30,) * 3, (12,) * 4),
            obstacles=(0, 10, 50), points=(2, 8, 32), points_shape=(20,) * 3,
            pairs=3,
        )  # fmt: skip


@dataclass(frozen=True)
class PeerFigures:
    """A peer's ticks: wall and processor time [s], and that share of the wall time that was not weighing edges."""

    wall: list[float]
    cpu: list[float]
    search: list[float]


@dataclass(frozen=True)
class SceneFigures:
    """One scene on one graph.

    Attributes
    ----------
    spheres : how many. wall, cpu : [s] of every tick. looked : nodes looked at in every tick.
    no_way : share of the ticks in which there is none below the limit.
    cost_error : largest relative difference of the cost from scipy's.
    hurried : the same ticks with a deadline.
    """

    spheres: int
    wall: list[float]
    cpu: list[float]
    looked: list[int]
    no_way: float
    cost_error: float
    hurried: HurriedTicks
    peers: dict[str, PeerFigures]

    def ratio(self, peer: str) -> float:
        return float(np.median(self.peers[peer].cpu) / np.median(self.cpu))

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        return {
            "spheres": self.spheres,
            "tick_ms": percentiles_ms(self.wall),
            "cpu_ms": percentiles_ms(self.cpu),
            "expanded_p50": int(np.median(self.looked)),
            "cost_error_max": self.cost_error,
            "deadline": {
                "cpu_ms": percentiles_ms(self.hurried.cpu), "in_time": self.hurried.in_time,
                "found": self.hurried.found, "refused": self.hurried.refused, "undecided": self.hurried.undecided,
                "gap_max": None if math.isnan(self.hurried.gap) else self.hurried.gap,
            },
            "no_way": self.no_way,
            "ticks": len(self.wall),
            "peers": {
                name: {
                    "tick_ms_p50": percentiles_ms(peer.wall)["p50"],
                    "cpu_ms_p50": percentiles_ms(peer.cpu)["p50"],
                    "search_ms_p50": percentiles_ms(peer.search)["p50"],
                    "ratio": self.ratio(name),
                    "ticks": len(peer.wall),
                }
                for name, peer in self.peers.items()
            },
        }


@dataclass(frozen=True)
class GraphFigures:
    """Every scene on one graph."""

    name: str
    nodes: int
    edges: int
    points: int
    scenes: dict[str, SceneFigures]

    def as_dict(self) -> dict[str, Any]:
        return {
            "graph": {"name": self.name, "nodes": self.nodes, "edges": self.edges, "body_points": self.points},
            "scenes": {name: figures.as_dict() for name, figures in self.scenes.items()},
        }

    def table(self) -> str:
        """One row for every scene."""
        peers = list(next(iter(self.scenes.values())).peers)
        head = ["scene", "p50", "p99", "cpu", "cpu99", "looked", "none", "error", *peers]
        rows = []
        for name, scene in self.scenes.items():
            times = [percentiles_ms(of)[share] for of in (scene.wall, scene.cpu) for share in ("p50", "p99")]
            rows.append([
                name, *map(_short, times), int(np.median(scene.looked)), f"{scene.no_way:.0%}",
                f"{scene.cost_error:.0e}",
                *(_short(scene.ratio(peer)) for peer in peers),
            ])  # fmt: skip
        title = f"{self.name}: {self.nodes} nodes, {self.edges} edges, {self.points} body points; a tick in ms"
        first = next(iter(self.scenes.values()))
        ticks = ", ".join(f"{name} {len(peer.wall)}" for name, peer in first.peers.items())
        note = f"exact to {peers[-1]}: processor time over ours\nticks: {len(first.wall)}, {ticks}"
        return "\n".join([title, text_table(head, rows), note, "", self._hurried()])

    def _hurried(self) -> str:
        head = ["scene", "cpu", "cpu99", f"<{DEADLINE_MS:.0f}ms", "found", "none", "open", "gap"]
        rows = []
        for name, scene in self.scenes.items():
            ticks, times = scene.hurried, percentiles_ms(scene.hurried.cpu)
            shares = (ticks.in_time, ticks.found, ticks.refused, ticks.undecided)
            rows.append([
                name, _short(times["p50"]), _short(times["p99"]), *(f"{share:.0%}" for share in shares),
                "" if math.isnan(ticks.gap) else f"{ticks.gap:.0%}",
            ])  # fmt: skip
        title = f"{self.name}: the same ticks with a deadline of {DEADLINE_MS:.0f} ms of processor time"
        return "\n".join([title, text_table(head, rows)])


@dataclass(frozen=True)
class ScalingRow:
    """Ticks of one scene on one graph: wall and processor time [s], and nodes looked at."""

    varied: str
    value: str
    nodes: int
    points: int
    spheres: int
    wall: list[float]
    cpu: list[float]
    looked: list[int]

    def as_dict(self) -> dict[str, Any]:
        return {
            "value": self.value, "nodes": self.nodes, "body_points": self.points, "spheres": self.spheres,
            "tick_ms": percentiles_ms(self.wall), "cpu_ms": percentiles_ms(self.cpu),
            "expanded_p50": int(np.median(self.looked)),
        }  # fmt: skip


@dataclass(frozen=True)
class BenchReport:
    """All that was measured.

    Attributes
    ----------
    synthetic, skill : every scene on the large graph and on the skill's.
    stages : of the planner's tick on the skill, and the tick itself.
    missing : peers that are not installed. machine : what it was measured on.
    """

    synthetic: GraphFigures
    skill: GraphFigures
    stages: dict[str, Stopwatch]
    bias: list[BiasFigures]
    scaling: list[ScalingRow]
    missing: list[str]
    machine: dict[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes: `scenes` are those on the large graph, `skill` holds those on the skill's."""
        scaling: dict[str, list[dict[str, Any]]] = {}
        for row in self.scaling:
            scaling.setdefault(row.varied, []).append(row.as_dict())
        stages = {
            name: {"ms": percentiles_ms(watch.wall), "cpu_ms": percentiles_ms(watch.cpu), "runs": len(watch.wall)}
            for name, watch in self.stages.items()
        }
        return {
            **self.synthetic.as_dict(), "skill": self.skill.as_dict(), "stages": stages, "scaling": scaling,
            "bias": {row.name: row.as_dict() for row in self.bias},
            "missing_peers": self.missing, "machine": self.machine,
        }  # fmt: skip

    def table(self) -> str:
        """All tables as plain text."""
        parts = [self._machine_line(), self.synthetic.table(), self.skill.table(), self._stages()]
        parts += [bias_table(self.bias), self._scaling()]
        if self.missing:
            parts.append(f"not installed: {', '.join(self.missing)}; the extra `bench` brings them")
        return "\n\n".join(parts)

    def write_json(self, path: Path) -> None:
        write_json(path, self.as_dict())

    def _machine_line(self) -> str:
        load, versions = self.machine["load"], self.machine["versions"]
        named = ", ".join(f"{name} {number}" for name, number in versions.items())
        return f"{named}\n{self.machine['cores']} cores, load {load[0]:.1f} before, {load[1]:.1f} after"

    def _stages(self) -> str:
        rows = []
        for name, watch in self.stages.items():
            if watch.wall:
                wall, cpu = percentiles_ms(watch.wall), percentiles_ms(watch.cpu)
                rows.append([name, len(watch.wall), *(f"{value:.3f}" for value in (*wall.values(), *cpu.values()))])
        head = ["stage", "runs", "p50", "p99", "max", "cpu p50", "cpu p99", "cpu max"]
        title = f"{self.skill.name}: stages of the planner's tick among one sphere of 5 cm that moves on the way, in ms"
        return "\n".join([title, text_table(head, rows)])

    def _scaling(self) -> str:
        head = ["varied", "", "nodes", "points", "spheres", "p50", "p99", "max", "cpu p50", "looked at"]
        rows = []
        for row in self.scaling:
            wall = [_short(value) for value in percentiles_ms(row.wall).values()]
            cpu, looked = _short(percentiles_ms(row.cpu)["p50"]), int(np.median(row.looked))
            rows.append([row.varied, row.value, row.nodes, row.points, row.spheres, *wall, cpu, looked])
        title = "scaling: a tick in ms; one sphere of 5 cm in the middle of the way, or so many along it"
        return "\n".join([title, text_table(head, rows)])


def measured_alone(skill: Skill, settings: BenchSettings) -> BenchReport:
    """`measure` in a process of its own, where linear algebra has one thread; an interrupt here ends it."""
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[variable] = "1"
    with get_context("spawn").Pool(1, _begin_alone) as pool:
        report = pool.apply_async(measure, (skill, settings)).get()
        pool.close()
        pool.join()
    return report


def _begin_alone() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # tqdm's own lock is one between processes: the system would be left with it at an interrupt.
    tqdm.set_lock(threading.RLock())


def measure(skill: Skill, settings: BenchSettings, show_progress: bool = True) -> BenchReport:
    """Measure everything.

    Raises
    ------
    ParameterError : the skill is not of joint space, or has no way along its first demonstration.
    """
    before = os.getloadavg()[0]
    peers, missing = installed()
    rows = len(settings.grids) + len(settings.obstacles) + len(settings.points)
    with tqdm(total=2 * len(NAMES) + 4 + rows, unit="row", disable=not show_progress) as bar:
        bench = SkillBench(skill, settings.skill_shape)
        of_skill = _measure_graph(bench.problem, settings, peers, bar)
        stages = _measure_stages(bench, settings.ticks, bar)
        large = synthetic_problem(settings.shape)
        bias = _measure_bias(skill, bench, settings, bar)
        synthetic = _measure_graph(large, settings, peers, bar)
        scaling = _measure_scaling(large, settings, bar)
    versions = {"Python": platform.python_version()}
    versions |= {name: version(name) for name in ("numpy", "numba", *(peer.module for peer in peers))}
    machine = {
        "cores": os.cpu_count(), "processor": platform.processor() or platform.machine(),
        "load": [before, os.getloadavg()[0]], "versions": versions,
    }  # fmt: skip
    return BenchReport(synthetic, of_skill, stages, bias, scaling, missing, machine)


def _measure_graph(
    problem: SearchProblem, settings: BenchSettings, peers: Sequence[type[Peer]], bar: tqdm
) -> GraphFigures:
    bar.set_description(problem.name)
    weights, others = EdgeWeights(problem), [peer(problem) for peer in peers]
    scenes = {}
    with no_garbage_among_what_stands():
        for scene in scenes_of(problem):
            bar.set_description(f"{problem.name} {scene.name}")
            scenes[scene.name] = _measure_scene(problem, scene, settings, weights, others)
            bar.update()
    return GraphFigures(problem.name, problem.nodes, len(problem.graph.edges), problem.body.points.shape[1], scenes)


def _measure_scene(
    problem: SearchProblem, scene: Scene, settings: BenchSettings, weights: EdgeWeights, peers: Sequence[Peer]
) -> SceneFigures:
    watch, costs, looked = _own_ticks(problem, scene, settings.ticks)
    shown = np.linspace(0, settings.ticks - 1, settings.peer_ticks).astype(int)
    moments = [scene.at(int(tick)) for tick in shown]
    exact, exact_answers = _repeated(lambda one: search(problem, mark(problem, one), limited=False), moments)
    one_way, _ = _repeated(lambda one: search_one_way(problem, one), moments)
    plain, _ = _repeated(lambda one: search_plainly(problem, one), moments)
    own = {_EXACT: exact, _ASTAR: one_way, _DIJKSTRA: plain}
    figures = {name: PeerFigures(one.wall, one.cpu, one.wall) for name, one in own.items()}
    weighing, lengths = _repeated(weights.under, moments)
    error = 0.0
    for peer in peers:
        count = settings.networkx_ticks if isinstance(peer, Networkx) else settings.peer_ticks
        searching, answers = _repeated(peer.answer, lengths[:count])
        # What weighing the edges took counts for every library.
        wall = [a + b for a, b in zip(weighing.wall, searching.wall, strict=False)]
        cpu = [a + b for a, b in zip(weighing.cpu, searching.cpu, strict=False)]
        figures[peer.module] = PeerFigures(wall, cpu, searching.wall)
        if isinstance(peer, Scipy):
            for tick, ours, best in zip(shown, exact_answers, answers, strict=True):
                limited = best.cost if best.cost < problem.cost_limit else math.inf
                error = max(error, _difference(ours.cost, best.cost), _difference(costs[tick], limited))
    no_way = float(np.mean(np.isinf(costs)))
    hurried = HurriedTicks.of(problem, scene, settings.ticks)
    return SceneFigures(len(scene.radii), watch.wall, watch.cpu, looked, no_way, error, hurried, figures)


def _repeated(call: Callable[[Input], Output], inputs: Sequence[Input]) -> tuple[Stopwatch, list[Output]]:
    """One thing again and again, without others between that would fill the processor's caches: durations, results."""
    watch, outputs = Stopwatch(), []
    with no_garbage_collection():
        for one in inputs:
            with watch:
                output = call(one)
            outputs.append(output)
    return watch, outputs


def _own_ticks(problem: SearchProblem, scene: Scene, ticks: int) -> tuple[Stopwatch, np.ndarray, list[int]]:
    """Durations, costs (ticks,), and nodes looked at; one tick more goes before them, to load what is compiled."""
    watch, costs, looked = Stopwatch(), [], []
    search(problem, mark(problem, scene.at(0)))
    with no_garbage_collection():
        for tick in range(ticks):
            obstacles = scene.at(tick)
            with watch:
                reshaping = mark(problem, obstacles)
                answer = search(problem, reshaping)
            costs.append(answer.cost)
            looked.append(looked_at(reshaping))
    return watch, np.array(costs), looked


def _measure_stages(bench: SkillBench, ticks: int, bar: tqdm) -> dict[str, Stopwatch]:
    scene = next(scene for scene in scenes_of(bench.problem) if scene.name == "one_r005")
    bar.set_description("stages")
    bench.stages(scene, 1)
    with no_garbage_collection():
        stages = bench.stages(scene, ticks)
    bar.update()
    bench.ticks(scene, 1)
    with no_garbage_collection():
        tick = bench.ticks(scene, ticks)
    bar.update()
    return {**stages, "tick": tick}


def _measure_bias(skill: Skill, bench: SkillBench, settings: BenchSettings, bar: tqdm) -> list[BiasFigures]:
    bar.set_description("bias")
    of_skill = skill_bias(skill, bench, settings.pairs)
    bar.update()
    synthetic = synthetic_bias(settings.shape, settings.pairs)
    bar.update()
    return [of_skill, synthetic]


def _measure_scaling(large: SearchProblem, settings: BenchSettings, bar: tqdm) -> list[ScalingRow]:
    rows = []

    def row(varied: str, value: str, problem: SearchProblem, scene: Scene) -> None:
        bar.set_description(f"{varied} {value}")
        watch, _, looked = _own_ticks(problem, scene, settings.scaling_ticks)
        points, spheres = problem.body.points.shape[1], len(scene.radii)
        rows.append(ScalingRow(varied, value, problem.nodes, points, spheres, watch.wall, watch.cpu, looked))
        bar.update()

    for shape in settings.grids:
        problem = large if shape == settings.shape else synthetic_problem(shape)
        row("grid", problem.name, problem, spheres_on_way(problem, 1))
    for count in settings.obstacles:
        row("obstacles", str(count), large, spheres_on_way(large, count))
    for points in settings.points:
        problem = synthetic_problem(settings.points_shape, points)
        row("body points", str(points), problem, spheres_on_way(problem, 1))
    return rows


def _difference(ours: float, best: float) -> float:
    """Relative; 0 where neither found a way, inf where one of them did."""
    if math.isinf(ours) or math.isinf(best):
        return 0.0 if ours == best else math.inf
    return abs(ours - best) / best


def _short(value: float) -> str:
    """Three figures, or whole numbers."""
    return f"{value:.2f}" if value < 10.0 else f"{value:.1f}" if value < 100.0 else f"{value:.0f}"
