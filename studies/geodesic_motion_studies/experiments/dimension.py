"""What more latent dimensions bring and cost: skills of the whole arm in two to six, with the graphs that planners use.

Learned are simulated reaches to grasp in three families of elbows, or a recording of joints (`--demos`). Columns of the
table, a row for each number of dimensions and seed:

learned, held out  mean distance of the tool [mm] in demonstrations that come back from their codes: of those that were
                   learned; and of each third that models trained without it, for SHARE of the steps, give back, as
                   `train --latent auto` compares them
nodes, edges, MB   of the skill's graph; build s : processor time to decode it
median, largest    of several queries, each from a drawn code in the first half of a demonstration to where another one
                   ends: length of the planner's path, searched and refined as a tick does it, over the refined
                   geodesic. That is the shortest of three curves: two that are moved to the least energy under the
                   continuous metric, every point decoded (`tools.chord_geodesic`), one begun as the planner's path,
                   one as the mean path, on a raw sheet as the straight line; and the planner's path itself
none               queries without a path
tick               p50 and p99 [ms] of all ticks of several motions, each crossed by one sphere that is seen elsewhere
                   in every tick (`benchmarks.moving`): by the clock, and processor time, which other programs on the
                   machine change less; each tick counts by its faster play
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.cli.arguments import indices
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.demonstrations.readers import read_joint_demonstrations
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.learning.dimension import compare_dimensions
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.motion.plan import MotionState
from geodesic_motion_ros.motion.retry import Workings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import LearnedModel, Skill
from geodesic_motion_ros.utils.deadline import NEVER
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION, write_figure
from geodesic_motion_studies.benchmarks.moving import MovingBench, MovingTicks
from geodesic_motion_studies.benchmarks.stopwatch import percentiles_ms
from geodesic_motion_studies.experiments.joint_models import commanded
from geodesic_motion_studies.experiments.study import Report, Study, changed, option, seeds, steps
from geodesic_motion_studies.experiments.trained import BRIEFLY, trained_once
from geodesic_motion_studies.tools.chord_geodesic import ChordMetric, shortened

#: Families, demonstrations of each, samples of each, and how long one takes [s].
FAMILIES, PER_FAMILY, SAMPLES, SECONDS = 3, 4, 80, 4.0
#: Of each motion whose ticks are measured.
PLAYS = 2
TRAINING = JointTrainingSettings(**BRIEFLY)
#: The bars: of the median and of the largest length, and of the ticks [ms].
LENGTH_BARS, TICK_BARS = (1.02, 1.1), (1.0, 5.0)


@dataclass(frozen=True)
class DimensionRow:
    """What was measured with one skill."""

    dimension: int
    seed: int
    learned_mm: float
    held_out_mm: float
    nodes: int
    edges: int
    megabytes: float
    build_s: float
    median: float
    largest: float
    none: int
    tick_p50: float
    tick_p99: float
    processor_p50: float
    processor_p99: float


@dataclass(frozen=True)
class DimensionReport(Report):
    """All rows."""

    recording: str
    rows: tuple[DimensionRow, ...]

    def as_dict(self) -> dict[str, Any]:
        return {"recording": self.recording, "rows": [asdict(row) for row in self.rows]}

    def table(self) -> str:
        head = [
            "latent", "seed", "learned mm", "held out", "nodes", "edges", "MB", "build s", "median", "largest", "none",
            "tick p50 ms", "p99", "processor p50", "p99",
        ]  # fmt: skip
        rows = [list(asdict(row).values()) for row in self.rows]
        return "\n".join([self.recording, text_table(head, rows, digits=3)])

    def draw(self, path: Path) -> None:
        """Over the number of latent dimensions: reconstruction, lengths of paths, graphs, ticks; every seed a mark."""
        figure = Figure(figsize=(10.0, 6.4), layout="constrained")
        panels = figure.subplots(2, 2)
        at = [row.dimension for row in self.rows]
        for axes, label, shown in (
            (panels[0, 0], "error, given back [mm]", {"learned": "learned_mm", "held out": "held_out_mm"}),
            (panels[0, 1], "longer than the geodesic [%]", {"median": "median", "largest": "largest"}),
            (panels[1, 0], "of the graph", {"time to build [s]": "build_s", "memory [MB]": "megabytes"}),
            (panels[1, 1], "tick with one sphere [ms]", {"p50": "tick_p50", "p99": "tick_p99"}),
        ):
            for (name, attribute), colour, marker in zip(shown.items(), (BLUE, VERMILION), "os", strict=True):
                values = np.array([getattr(row, attribute) for row in self.rows])
                values = 100.0 * (values - 1.0) if attribute in ("median", "largest") else values
                axes.plot(at, values, marker, color=colour, label=name)
            axes.set(xlabel="latent dimensions", xticks=sorted(set(at)), ylabel=label)
            axes.grid(alpha=0.3)
        for axes, bars in ((panels[0, 1], 100.0 * (np.array(LENGTH_BARS) - 1.0)), (panels[1, 1], TICK_BARS)):
            for bar, colour in zip(bars, (BLUE, VERMILION), strict=True):
                axes.axhline(bar, color=colour, linestyle=":", linewidth=1.2)
            axes.plot([], [], ":", color="black", label="asked")
        for axes, title in zip(panels.flat, ("a  reconstruction", "b  paths", "c  graphs", "d  ticks"), strict=True):
            axes.set_title(title, loc="left", fontsize=11)
            axes.set_ylim(bottom=0.0)
            axes.legend(frameon=False)
        write_figure(figure, path)


def shown_reaches(per_family: int = PER_FAMILY, samples: int = SAMPLES, seed: int = 0) -> JointDemonstrations:
    """As `simulation.joint_teacher` tells the arm, without physics, family by family."""
    from geodesic_motion_ros.simulation.joint_teacher import reach_guidances

    robot = Robot.named("panda")
    curves = [commanded(robot, each, samples) for each in reach_guidances(per_family, seed, FAMILIES, connected=False)]
    times = np.linspace(0.0, SECONDS, samples)
    items = tuple(JointDemonstration(curve, times, f"reach {number}") for number, curve in enumerate(curves))
    return JointDemonstrations(items, robot.joint_names, "panda")


@dataclass(frozen=True)
class Dimension(Study):
    """Learn in each number of dimensions, once for every seed, and measure graph, paths and ticks.

    training : its seed, its latent dimension, and its steps where these are given, are replaced.
    """

    demos: str | None = option(None, "recording of joints; without it simulated reaches", type=str, metavar="FILE")
    robot: str = option("panda", "that was recorded")
    seeds: tuple[int, ...] = seeds("of the trainings and the queries, five trainings each", (0,))
    dimensions: tuple[int, ...] = option((2, 3, 4, 5, 6), "numbers of latent dimensions", type=indices, metavar="D,D")
    steps: int | None = steps()
    queries: int = option(30, "whose paths are measured", least=1)
    motions: int = option(6, "whose ticks are measured", least=1)
    training: JointTrainingSettings = TRAINING

    def measure(self, out: Path) -> DimensionReport:
        name, shown = "reaches", None if self.demos is None else read_joint_demonstrations(Path(self.demos), self.robot)
        if shown is None:
            shown = shown_reaches()
        else:
            name = Path(str(self.demos)).stem
        rows = []
        for dimension, seed in tqdm(list(product(self.dimensions, self.seeds)), desc=name, unit="skill"):
            settings = changed(self.training, seed=seed, latent_dimension=dimension, steps=self.steps)
            skill = trained_once(name, shown, settings, out / "skills")
            held_out = compare_dimensions(shown, settings, dimensions=(dimension,)).means[0]
            rows.append(self._measured(skill, seed, 1e3 * float(held_out)))
        return DimensionReport(name, tuple(rows))

    def _measured(self, skill: Skill, seed: int, held_out_mm: float) -> DimensionRow:
        began = time.process_time()
        # What a skill builds it keeps for the next program, and would only read here.
        built = LearnedModel(**{each.name: getattr(skill, each.name) for each in fields(LearnedModel)}).graph()
        build_s = time.process_time() - began
        megabytes = 1e-6 * sum(array.nbytes for array in built.arrays().values())
        bench, ticks, random = MovingBench(skill, self.motions, PLAYS), MovingTicks(), np.random.default_rng(seed)
        for motion in bench.motions:
            bench.ticks(motion, bench.spheres(motion, 1, random), ticks, compared=1)
        both = [percentiles_ms(each) for each in (ticks.every.wall, ticks.every.cpu)]
        times = [each[which] for each in both for which in ("p50", "p99")]
        planner, graph = bench.planner, bench.planner.graph
        found = [length_over_geodesic(planner, query) for query in drawn_queries(planner, self.queries, seed)]
        ratios = [ratio for ratio in found if ratio is not None]
        median, largest = (float(np.median(ratios)), max(ratios)) if ratios else (math.nan, math.nan)
        return DimensionRow(
            skill.decoder.latent_dimension, seed, skill.quality["training_position_error_mm"], held_out_mm,
            len(graph.latent), len(graph.edges), megabytes, build_s,
            median, largest, len(found) - len(ratios),
            *times,
        )  # fmt: skip


def drawn_queries(planner: ReactivePlanner, count: int, seed: int) -> Iterator[ArmQuery]:
    """So many queries that go on from codes in the first halves of demonstrations to where others end."""
    random, skill, builder = np.random.default_rng(seed), planner.skill, planner.arm.queries
    ends = skill.decoder.configurations(skill.codes[:, -1])
    goals = [builder.goal_by_configuration(end, TaskFrame.identity()) for end in ends]
    begun = builder.build(skill.decoder.configurations(skill.codes[0, :1])[0], goals[0])
    assert not isinstance(begun, Refusal), begun.reason
    while count > 0:
        first, last = random.integers(len(skill.codes), size=2)
        latent = skill.codes[first, random.integers(skill.codes.shape[1] // 2)]
        query = builder.redirect(begun, skill.decoder.configurations(latent[None])[0], latent, goals[last])
        # Of two families that meet nowhere there is none.
        if query is not None and not isinstance(query, Refusal):
            count -= 1
            yield query


def length_over_geodesic(planner: ReactivePlanner, query: ArmQuery) -> float | None:
    """Measure how long the planner's path is over the refined geodesic; None: it finds no path."""
    still = np.zeros_like(query.start)
    state = MotionState(0.0, query.start, still, still, query.start_latent)
    search = planner.arm.solver.search_among(query, state, Obstacles.none(), np.inf, NEVER, Workings())
    path = search.path(1.0)
    if isinstance(path, Refusal):
        return None
    curve, mean_paths, unit = search.refine(path, 1.0).polyline, query.along_mean_paths.mean_paths, query.field.spacing
    decoder, settings, strength = planner.skill.decoder, planner.skill.metric, planner.settings.ridge_strength
    metric = ChordMetric(decoder, settings, planner.robot, unit, mean_paths, strength)
    other = curve[[0, -1]]
    if mean_paths is not None:
        away = np.linalg.norm((mean_paths.centres - curve[0]) / unit, axis=-1)
        mode, sample = np.unravel_index(np.argmin(away), away.shape)
        other = np.concatenate([curve[:1], mean_paths.centres[mode, sample + 1 : -1], curve[-1:]])
    length = metric.length(curve)
    return length / min(length, *(metric.length(shortened(metric, each)) for each in (curve, other)))
