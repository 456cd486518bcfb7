"""The benchmark of the search engine: every scene on two graphs beside its peers, stages of the tick, and scaling.

Ratios to peers are of processor time of the thread, the median over the median: they hold on a loaded machine too.
The engine's tick is the planner's: paths that cost more than a limit count as blocked. Costs are compared with scipy's
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
from typing import TypeVar

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.benchmarks.bias import BiasFigures, skill_bias, synthetic_bias
from geodesic_motion_studies.benchmarks.engine import (
    SearchProblem,
    looked_at,
    mark,
    search,
    search_from_source,
    search_plainly,
)
from geodesic_motion_studies.benchmarks.hurried import HurriedTicks
from geodesic_motion_studies.benchmarks.peers import EdgeWeights, Networkx, Peer, Scipy, installed
from geodesic_motion_studies.benchmarks.report import (
    BenchReport,
    GraphFigures,
    PeerFigures,
    ScalingRow,
    SceneFigures,
)
from geodesic_motion_studies.benchmarks.scenes import NAMES, Scene, scenes_of, spheres_on_path
from geodesic_motion_studies.benchmarks.stages import SkillBench
from geodesic_motion_studies.benchmarks.stopwatch import (
    Stopwatch,
    no_garbage_among_what_stands,
    no_garbage_collection,
)
from geodesic_motion_studies.benchmarks.synthetic import synthetic_problem

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


def measured_alone(skill: Skill, settings: BenchSettings) -> BenchReport:
    """`measure` in a process of its own."""
    return alone(measure, skill, settings)


def alone(call: Callable[..., Output], *arguments: object) -> Output:
    """A call in a process of its own, where linear algebra has one thread; an interrupt here ends it."""
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ[variable] = "1"
    with get_context("spawn").Pool(1, _begin_alone) as pool:
        result = pool.apply_async(call, arguments).get()
        pool.close()
        pool.join()
    return result


def _begin_alone() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # tqdm's own lock is one between processes: the system would be left with it at an interrupt.
    tqdm.set_lock(threading.RLock())


def measure(skill: Skill, settings: BenchSettings, show_progress: bool = True) -> BenchReport:
    """Measure everything.

    Raises
    ------
    ParameterError : the skill is not of joint space, or has no path along its first demonstration.
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
    from_source, _ = _repeated(lambda one: search_from_source(problem, one), moments)
    plain, _ = _repeated(lambda one: search_plainly(problem, one), moments)
    own = {_EXACT: exact, _ASTAR: from_source, _DIJKSTRA: plain}
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
                error = max(error, difference(ours.cost, best.cost), difference(costs[tick], limited))
    no_path = float(np.mean(np.isinf(costs)))
    hurried = HurriedTicks.of(problem, scene, settings.ticks)
    return SceneFigures(len(scene.radii), watch.wall, watch.cpu, looked, no_path, error, hurried, figures)


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
                evaluation = mark(problem, obstacles)
                answer = search(problem, evaluation)
            costs.append(answer.cost)
            looked.append(looked_at(evaluation))
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
    with no_garbage_collection():
        kinematics = bench.kinematics(ticks)
    return {**stages, "tick": tick, "kinematics": kinematics}


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
        row("grid", problem.name, problem, spheres_on_path(problem, 1))
    for count in settings.obstacles:
        row("obstacles", str(count), large, spheres_on_path(large, count))
    for points in settings.points:
        problem = synthetic_problem(settings.points_shape, points)
        row("body points", str(points), problem, spheres_on_path(problem, 1))
    return rows


def difference(ours: float, best: float) -> float:
    """Relative; 0 where neither found a path, inf where one of them did."""
    if math.isinf(ours) or math.isinf(best):
        return 0.0 if ours == best else math.inf
    return abs(ours - best) / best
