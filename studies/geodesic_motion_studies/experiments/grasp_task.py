"""Reach to grasp in task space: targets that were not shown, and what it costs to change between q and -q.

The simulated teacher brings the hand half a metre to an object and turns it by 90 degrees (`joint_teacher.
reach_to_grasp`, one family); what is learned are the poses of the tool. For every seed of the training:

- *targets*: starts and goals are drawn anew from what is shown, and the planner plans on two sheets: the canonical
  one, and the raw one, the paper's, where what was learned is carried to the requested. Beside them the paper to the
  letter (*literal*: `TrainingSettings.paper` and its planner, which goes from the node nearest to the start to that
  nearest to the goal), the straight line with an even turn (slerp), and the nearest demonstration carried to them. What
  counts is how far a path is from the closest demonstration, matched by dynamic time warping along its whole length;
- *ends*: targets come from the distribution that was demonstrated. So ends are also requested along
  demonstrations that were held out, and beyond all that were demonstrated, in rings (`requested_ends`);
- *crossing*: on the raw sheet every motion is there with q and with -q. From the start with q to the goal with q, and
  to the goal with -q, the shortest paths through the whole latent box: their energies, within and across. So for the
  single von Mises-Fisher density, whose clusters are apart, and, for one seed, for the paper's antipodal mixture, which
  knows no signs: there is nothing to cross.

One path across is decoded: its quaternion leaps to the other hemisphere where it leaves the one cluster for the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from tqdm import tqdm

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.geometry.curves import Pose, PoseCurve
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.manifold.encoder import TaskSpaceEncoder
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.queries.pose_path import PosePathPlanner
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.joint_teacher import draw_reaching_query, reach_to_grasp
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import (
    BLUE,
    GREEN,
    GREY,
    VERMILION,
    DrawnPath,
    draw_latent_paths,
    latent_background,
    write_figure,
)
from geodesic_motion_studies.experiments.baselines import task_line
from geodesic_motion_studies.experiments.crossing import (
    GRAPHS,
    Crossing,
    judged_summary,
    judged_table,
    measure_crossings,
)
from geodesic_motion_studies.experiments.learned_paths import LearnedPath, LearnedPaths, whole_box
from geodesic_motion_studies.experiments.posture_strip import draw_strip, posture_strips
from geodesic_motion_studies.experiments.requested_ends import (
    NEAREST,
    RINGS,
    EndsAnswer,
    RequestedEnds,
    answers_to,
    ends_beyond,
    ends_figures,
    ends_table,
    farthest_end,
    nearest_piece,
    pieces_of,
)
from geodesic_motion_studies.experiments.study import Report, Study, option, seeds, setting
from geodesic_motion_studies.experiments.trained import BRIEFLY, trained_once
from geodesic_motion_studies.tools.averages import mean
from geodesic_motion_studies.tools.similarity import distance_to_closest

TASK = "reach"
LITERAL = "literal"
ROWS = ("canonical sheet", "raw sheet", "straight line", NEAREST, LITERAL)
#: Seed of the demonstrations that are held out; those that are shown have 0.
HELD_OUT_SEED = 10_000


@dataclass(frozen=True)
class GraspTask(Study):
    """Show, train and ask; `seeds` are of trainings, targets and ends.

    shown : demonstrations, and as many are held out. ends : along the held-out demonstrations, and in each ring beyond.
    """

    shown: int = option(8, "demonstrations", least=1)
    targets: int = option(20, "random starts and goals for each seed", least=1)
    ends: int = setting(12, least=1)
    seeds: tuple[int, ...] = seeds()
    planner: PlannerSettings = field(default_factory=PlannerSettings)

    def measure(self, out: Path) -> GraspTaskReport:
        shown, held_out = (reach_demonstrations(self.shown, seed) for seed in (0, HELD_OUT_SEED))

        def trained(**changes: Any) -> Skill:
            return trained_once(TASK, shown, TrainingSettings(**(BRIEFLY | changes)), out / "skills")

        targets: list[Target] = []
        answers: list[EndsAnswer] = []
        crossings: dict[int, tuple[Crossing, ...]] = {}
        raw: dict[int, Skill] = {}
        for seed in tqdm(self.seeds, desc="grasp-task", unit="seed"):
            literal = trained_once(TASK, shown, TrainingSettings.paper(seed=seed), out / "skills")
            literally = PaperPlanner(literal).tool_curve
            raw[seed] = trained(seed=seed, sheet="raw")
            sheets = {ROWS[0]: trained(seed=seed, sheet="canonical"), ROWS[1]: raw[seed]}
            targets += ask_targets(sheets, literally, shown, seed, self)
            ends = requested_ends(shown, held_out, self, seed)
            answers += answers_to(ends, sheets, shown, seed, {LITERAL: literally})
            crossings[seed] = measure_crossings(raw[seed], [item.curve for item in shown])
        first = self.seeds[0]
        blind = trained(seed=first, sheet="raw", orientation_model="sign_blind")
        return GraspTaskReport(
            self, tuple(targets), tuple(answers), crossings, sign_blind_ratios(blind, shown), shown,
            path_across(raw[first], shown),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Target:
    """What became of one start and goal.

    Attributes
    ----------
    row : of ROWS. path : None where the planner refused, for a reason.
    carried : how far the learned start and goal were carried to meet the requested ones [m], the mean of both.
    missed : how far the path's ends are from the requested ones [m], the farther of the two.
    turn : angle between the first and the last orientation [rad].
    off : mean distance from the closest demonstration [m].
    """

    row: str
    seed: int
    path: PoseCurve | None
    reason: str = ""
    carried: float = math.nan
    missed: float = math.nan
    turn: float = math.nan
    off: float = math.nan


@dataclass(frozen=True, eq=False)
class Across:
    """Paths of one motion on a raw sheet: within its cluster and across to the other, as nodes' latent points (p, 2)
    and decoded quaternions (p, 4); `recorded` are those of the demonstration (T, 4).
    """

    skill: Skill
    within: np.ndarray
    across: np.ndarray
    quaternions_within: np.ndarray
    quaternions_across: np.ndarray
    recorded: np.ndarray

    @property
    def flip(self) -> int:
        """The step of the path across over which its quaternion turns farthest."""
        return int(np.argmin(np.sum(self.quaternions_across[1:] * self.quaternions_across[:-1], axis=1)))


@dataclass(frozen=True)
class GraspTaskReport(Report):
    """All targets and ends; crossings by seed, and those of the first sign-blind mixture; what is to be drawn."""

    settings: GraspTask
    targets: tuple[Target, ...]
    answers: tuple[EndsAnswer, ...]
    crossings: dict[int, tuple[Crossing, ...]]
    sign_blind: tuple[float, ...]
    shown: Demonstrations = field(repr=False)
    drawn: Across = field(repr=False)

    def summary(self, row: str, seed: int | None = None) -> dict[str, float | int | None]:
        """The figures of one row, of one seed or of all."""
        requested = [item for item in self.targets if item.row == row and seed in (None, item.seed)]
        answered = [item for item in requested if item.path is not None]
        return {
            "targets": len(requested),
            "answered": len(answered),
            "carried_mm": mean([1e3 * item.carried for item in answered]),
            "missed_mm": max((1e3 * item.missed for item in answered), default=None),
            "turn_deg": mean([math.degrees(item.turn) for item in answered]),
            "off_mm": mean([1e3 * item.off for item in answered]),
            "farthest_off_mm": max((1e3 * item.off for item in answered), default=None),
        }

    def crossing_summary(self, seed: int) -> dict[str, float | int]:
        """Energies within a cluster and across, of all demonstrations on the raw sheet of one seed."""
        items = self.crossings[seed]
        within, across = [item.within for item in items], [item.across for item in items]
        return {
            "paths": len(items),
            "within_median": float(np.median(within)),
            "within_most": max(within),
            "across_median": float(np.median(across)),
            "across_least": min(across),
            "least_ratio": min(item.ratio for item in items),
            "sign_flips": sum(item.sign_flip for item in items),
        }

    def as_dict(self) -> dict[str, Any]:
        return {
            "settings": asdict(self.settings),
            "targets": {row: self.summary(row) for row in ROWS},
            "targets_of_seeds": {row: {seed: self.summary(row, seed) for seed in self.crossings} for row in ROWS},
            "ends": ends_figures(self.answers),
            "crossing": {seed: self.crossing_summary(seed) for seed in self.crossings},
            "energy_criterion": {
                seed: {graph: judged_summary(items, graph) for graph in GRAPHS}
                for seed, items in self.crossings.items()
            },
            "sign_blind_across_over_within": self.sign_blind,
        }

    def table(self) -> str:
        """The tables as plain text, with what the planner refused."""
        head = [
            "targets", "seed", "requested", "answered", "carried mm", "missed mm", "turn deg", "off mm",
            "farthest off mm",
        ]  # fmt: skip
        rows: list[list[Cell]] = [
            [row, "all" if seed is None else str(seed), *self.summary(row, seed).values()]
            for row in ROWS for seed in (*self.crossings, None)
        ]  # fmt: skip
        crossing_head = [
            "clusters of q and -q", "paths", "within, median", "within, most", "across, median", "across, least",
            "least ratio", "sign flips",
        ]  # fmt: skip
        crossings: list[list[Cell]] = [
            [f"seed {seed}", *self.crossing_summary(seed).values()] for seed in self.crossings
        ]
        blind = f"sign-blind mixture, seed {self.settings.seeds[0]}: across over within {min(self.sign_blind):.3f} to "
        refused = sorted({f"{item.row}, seed {item.seed}: {item.reason}" for item in self.targets if item.reason})
        return "\n".join([
            text_table(head, rows, 1), *refused,
            "off: mean distance from the closest demonstration; missed: the farthest end from the requested one", "",
            ends_table(self.answers), "",
            text_table(crossing_head, crossings, 4),
            f"{blind}{max(self.sign_blind):.3f}", "",
            judged_table({f"seed {seed}": items for seed, items in self.crossings.items()}),
        ])  # fmt: skip

    def draw(self, path: Path) -> None:
        """Targets in space; both clusters with a path within and one across; the quaternions of both."""
        drawn = self.drawn
        figure = Figure(figsize=(13.0, 10.8), layout="constrained")
        grid = figure.add_gridspec(3, 2, height_ratios=(1.15, 1.0, 0.5))
        axes = figure.add_subplot(grid[0, 0])
        handles = latent_background(figure, axes, drawn.skill)
        handles += draw_latent_paths(axes, [
            DrawnPath(drawn.within, np.empty((0, 3)), "within a cluster", BLUE),
            DrawnPath(drawn.across, np.empty((0, 3)), "across the clusters", VERMILION),
        ])  # fmt: skip
        flip = drawn.across[drawn.flip : drawn.flip + 2].mean(axis=0)
        axes.plot(*flip, "X", color="black", markersize=11, markeredgecolor="white", zorder=7)
        handles.append(Line2D([], [], marker="X", linestyle="", color="black", label="the quaternion's sign flips"))
        axes.legend(
            handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=9, frameon=False
        )  # fmt: skip
        axes.set_title("a  Raw sheet: every motion is there with q and with -q", loc="left", fontsize=11)
        _side_view(figure.add_subplot(grid[0, 1]), self)
        panels = [
            (drawn.quaternions_within, "c  Quaternion within a cluster"),
            (drawn.quaternions_across, "d  Quaternion across: the sign flips"),
        ]
        for column, (quaternions, title) in enumerate(panels):
            axes = figure.add_subplot(grid[1, column])
            _components(axes, quaternions, drawn.recorded)
            if column == 1:
                at = (drawn.flip + 0.5) / (len(quaternions) - 1)
                axes.axvline(at, color="black", linestyle="--", linewidth=1.4)
                axes.annotate("sign flip", (at, -0.6), xytext=(6, 0), textcoords="offset points", fontsize=10)
            else:
                axes.legend(ncols=5, loc="center", bbox_to_anchor=(0.5, 0.82), fontsize=9, frameon=False)
            axes.set_title(title, loc="left", fontsize=11)
        found = next((item.path for item in self.targets if item.row == ROWS[0] and item.path is not None), None)
        if found is not None:
            strip = posture_strips([arm_along(found)], [{}], width=300, height=200, postures=6)
            title = "e  The arm on a path to a target that was not shown"
            draw_strip(figure.add_subplot(grid[2, :]), strip, title)
        write_figure(figure, path)


def reach_demonstrations(count: int, seed: int = 0) -> Demonstrations:
    """Poses of the tool in simulated reaches to grasp, the elbow up."""
    return reach_to_grasp(count, seed, families=1).tool_demonstrations(Robot.named("panda"))


def requested_ends(
    shown: Demonstrations, held_out: Demonstrations, settings: GraspTask, seed: int
) -> list[RequestedEnds]:
    """Ends along the held-out demonstrations, and in every ring beyond those that are shown."""
    random = np.random.default_rng([seed, settings.ends])
    along = pieces_of(held_out, settings.ends, random)
    return along + [ends for ring in RINGS for ends in ends_beyond(shown, ring, settings.ends, random)]


def ask_targets(
    skills: dict[str, Skill],
    literally: Callable[[Pose, Pose], PoseCurve],
    shown: Demonstrations,
    seed: int,
    settings: GraspTask,
) -> list[Target]:
    """Starts and goals drawn from a seed, requested of skills by their rows and of the paper's planner, and both
    controls between them.
    """
    planners = {row: PosePathPlanner(skill, settings.planner) for row, skill in skills.items()}
    random, curves = np.random.default_rng([seed, settings.targets]), [item.curve for item in shown]
    found = []
    for _ in range(settings.targets):
        start, goal = draw_reaching_query(random)
        for row, planner in planners.items():
            path = planner.plan(*start, *goal)
            if isinstance(path, Refusal):
                found.append(Target(row, seed, None, path.reason))
                continue
            carried = 0.5 * (path.figures.start_offset + path.figures.goal_offset)
            found.append(_target(row, seed, path, (start, goal), curves, carried))
        others = task_line(shown, start, goal).corrected, nearest_piece(shown, start, goal), literally(start, goal)
        found += [_target(row, seed, path, (start, goal), curves) for row, path in zip(ROWS[2:], others, strict=True)]
    return found


def _target(
    row: str, seed: int, path: PoseCurve, ends: tuple[Pose, Pose], shown: Sequence[PoseCurve], carried: float = math.nan
) -> Target:
    turn = float(angle_between(path.quaternions[0], path.quaternions[-1]))
    missed = farthest_end(path, *ends)
    return Target(row, seed, path, "", carried, missed, turn, distance_to_closest(path, shown))


def path_across(skill: Skill, shown: Demonstrations) -> Across:
    """The paths of the first demonstration on a raw sheet with two clusters."""
    motion = shown[0].curve
    paths = LearnedPaths(whole_box(skill))
    within, across = _to_both_goals(skill, paths, motion)
    latent, quaternions = paths.graph.latent, paths.graph.decoded.quaternions
    return Across(
        skill, latent[within.nodes], latent[across.nodes], quaternions[within.nodes], quaternions[across.nodes],
        motion.quaternions,
    )  # fmt: skip


def sign_blind_ratios(skill: Skill, shown: Demonstrations) -> tuple[float, ...]:
    """Energy of the path to the goal with -q over that with q, on a sheet that knows no signs, of every motion."""
    paths = LearnedPaths(whole_box(skill))
    found = [_to_both_goals(skill, paths, item.curve) for item in shown]
    return tuple(across.energy / within.energy for within, across in found)


def _to_both_goals(skill: Skill, paths: LearnedPaths, motion: PoseCurve) -> tuple[LearnedPath, LearnedPath]:
    """From the start of a motion to its goal with q, and with -q."""
    positions, quaternions = motion.positions[[0, -1, -1]], motion.quaternions[[0, -1, -1]].copy()
    quaternions[2] *= -1.0
    start, same, opposite = TaskSpaceEncoder.from_arrays(skill.encoder_arrays).encode(positions, quaternions)
    return paths.shortest(start, same), paths.shortest(start, opposite)


def arm_along(curve: PoseCurve, postures: int = 60) -> np.ndarray:
    """Configurations (postures, 7) [rad] of a Panda whose tool follows a curve, each the one nearest to that before."""
    robot, even, configuration, found = Robot.named("panda"), curve.resample(postures), None, []
    for position, quaternion in zip(even.positions, even.quaternions, strict=True):
        configuration = solve(robot, position, quaternion, configuration)
        found.append(configuration)
    return np.stack(found)


def _side_view(axes: Any, report: GraspTaskReport) -> None:
    """Paths to targets on the canonical sheet, and straight lines, among the demonstrations; seen along x."""
    seed = report.settings.seeds[0]
    drawn = {
        row: [item.path for item in report.targets if (item.row, item.seed) == (row, seed) and item.path is not None]
        for row in ROWS
    }
    lines = [
        ("straight lines", drawn[ROWS[2]], VERMILION, "--", 0.8),
        ("demonstrations", [item.curve for item in report.shown], GREY, "-", 1.0),
        ("geodesics to targets that were not shown", drawn[ROWS[0]], BLUE, "-", 1.0),
    ]
    for name, paths, colour, style, width in lines:
        for path in paths:
            axes.plot(*(100.0 * path.positions[:, 1:].T), style, color=colour, linewidth=width, alpha=0.8)
        axes.plot([], [], style, color=colour, label=name)
    for path in drawn[ROWS[0]]:
        axes.plot(*(100.0 * path.positions[0, 1:]), "o", color=BLUE, markersize=3.5)
        axes.plot(*(100.0 * path.positions[-1, 1:]), "s", color=BLUE, markersize=3.5)
    axes.set(xlabel="y [cm]", ylabel="z [cm]", aspect="equal")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, fontsize=9, frameon=False)
    answered = f"{len(drawn[ROWS[0]])} of {report.settings.targets}"
    axes.set_title(f"b  Canonical sheet: {answered} random targets, from the side", loc="left", fontsize=11)


def _components(axes: Any, quaternions: np.ndarray, recorded: np.ndarray) -> None:
    """The four components along a path, thick, and those of a demonstration with both signs, thin and grey."""
    share = np.linspace(0.0, 1.0, len(quaternions))
    for name, colour, component in zip("wxyz", (BLUE, VERMILION, GREEN, "#CC79A7"), quaternions.T, strict=True):
        axes.plot(share, component, color=colour, linewidth=2.2, label=f"$q_{name}$")
    for sign in (1.0, -1.0):
        axes.plot(np.linspace(0.0, 1.0, len(recorded)), sign * recorded, color=GREY, linewidth=0.7, alpha=0.7, zorder=1)
    axes.plot([], [], color=GREY, linewidth=0.9, label="a demonstration, $\\pm q$")
    axes.set(xlim=(0.0, 1.0), ylim=(-1.05, 1.05), xlabel="share of the path's nodes", ylabel="component")
    axes.grid(alpha=0.3)
