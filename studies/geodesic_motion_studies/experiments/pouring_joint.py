"""Pouring with the whole arm, three bottles to three cups: does a geodesic change between the groups that were shown?

The simulated teacher shows three of the nine pairs (`joint_teacher.pouring`), and the paths of the three cross. The
planner plans all nine pairs: from the mean configuration at a bottle to that at a cup. Every motion is played by
the arm in PyBullet, among the stands of that bottle and of all cups. Two rows, each with one skill of all pairs for
every seed: *ours*, and the paper's to the letter (*literal*), learned with `JointTrainingSettings.paper`, planned with
`PaperPlanner` from code to code and played by its follower.

Which group a path is in is judged twice: as the skill sees it, by the ridge that its latent point is nearest to (ours)
or by the nearest code (literal, which knows no ridges); and by the group whose demonstrated tool positions the executed
tool is nearest to, of which the skill knows nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.spatial import cKDTree
from tqdm import tqdm

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.paper.paper_planner import PaperPlanner, PaperSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.gestures import RATE_HZ, STEPS_PER_SAMPLE
from geodesic_motion_ros.simulation.joint_teacher import BOTTLE_PLACES, pouring
from geodesic_motion_ros.simulation.tabletop import TabletopWorld
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.joint_plots import FAMILY_COLOURS, draw_latent_tubes
from geodesic_motion_ros.visualization.plots import BLUE, DrawnPath, write_figure
from geodesic_motion_studies.experiments.arm_players import Families, LiteralArm, OurArm, Player, settings_table
from geodesic_motion_studies.experiments.execution import Execution, play
from geodesic_motion_studies.experiments.grasp_joint_scenes import passed_in_turn
from geodesic_motion_studies.experiments.posture_strip import draw_strip
from geodesic_motion_studies.experiments.pouring_scene import pouring_strip, standing_there
from geodesic_motion_studies.experiments.study import Report, Study, bandwidth_factor, changed, far_sigma, option, seeds
from geodesic_motion_studies.experiments.trained import BRIEFLY, trained_once

TASK = "pouring_in_groups"
PAIRS = len(BOTTLE_PLACES)
ALL_PAIRS = tuple(product(range(PAIRS), repeat=2))


@dataclass(frozen=True)
class PouringJoint(Study):
    """Show, train, plan and play; one skill of each row for each of the `seeds`."""

    shown: int = option(3, "demonstrations of each of three pairs", least=2)
    seeds: tuple[int, ...] = seeds()
    far_sigma: float | None = far_sigma("the literal training")
    bandwidth_factor: float | None = bandwidth_factor("the literal training")
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    literal: PaperSettings = field(default_factory=PaperSettings)

    def measure(self, out: Path) -> PouringJointReport:
        ours, literally = JointTrainingSettings(**BRIEFLY), JointTrainingSettings.paper()
        literally = changed(literally, far_sigma=self.far_sigma, bandwidth_factor=self.bandwidth_factor)
        shown = pouring(self.shown, 0)
        families, tools = Families.of(shown, PAIRS), shown.tool_demonstrations(Robot.named(shown.robot))
        trainings = list(product((ours, literally), self.seeds))
        pourings: list[Pouring] = []
        first: dict[str, Player] = {}
        for training, seed in tqdm(trainings, desc="pouring-joint", unit="skill"):
            skill = trained_once(TASK, shown, replace(training, seed=seed), out / "skills")
            player: Player
            if training is ours:
                player = OurArm(ReactivePlanner(skill, self.planner), families)
            else:
                player = LiteralArm(PaperPlanner(skill, self.literal), families)
            first.setdefault(player.name, player)
            pourings += pour_all(player, families, tools, seed)
        made = settings_table([("ours", first["ours"], ours), ("literal", first["literal"], literally)])
        return PouringJointReport(self, tuple(pourings), made, tools, first["ours"].planner)


@dataclass(frozen=True, eq=False)
class Pouring:
    """From one bottle to one cup.

    Attributes
    ----------
    row, seed, bottle, cup : who plans with which skill, and numbers of the places; a pair was shown if they are equal.
    reason : why the planner refused, else empty; then all that follows is empty or NaN.
    duration : of the motion [s].
    latent : (k, d) latent points of the motion at the times of the execution.
    by_skill, by_tool : (k,) the group at each time, as judged above.
    missed : distance [m] of the executed tool, at the end, from the mean of those shown at this cup.
    off : largest distance [m] of the executed tool from the nearest position that was demonstrated, of any group.
    execution : what the arm did.
    """

    row: str
    seed: int
    bottle: int
    cup: int
    reason: str
    duration: float = math.nan
    latent: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    by_skill: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))
    by_tool: np.ndarray = field(default_factory=lambda: np.empty(0, dtype=int))
    missed: float = math.nan
    off: float = math.nan
    execution: Execution | None = None

    @property
    def shown(self) -> bool:
        return self.bottle == self.cup

    @property
    def turns(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The groups passed in turn, by the skill and by the tool."""
        if self.execution is None:
            return (), ()
        return passed_in_turn(self.by_skill), passed_in_turn(self.by_tool)

    def as_dict(self) -> dict[str, Any]:
        executed = self.execution
        return {
            "row": self.row, "seed": self.seed, "bottle": self.bottle, "cup": self.cup, "shown": self.shown,
            "reason": self.reason, "duration": self.duration,
            "passed_by_skill": self.turns[0], "passed_by_tool": self.turns[1],
            "off_the_demonstrations": self.off, "goal_error": self.missed,
            "tracking_error": None if executed is None else executed.tracking_error,
            "clearance": None if executed is None else executed.clearance,
        }  # fmt: skip


@dataclass(frozen=True)
class PouringJointReport(Report):
    """All pairs of all rows and seeds, and how the rows came about; what was shown, and our planner of the first seed,
    to be drawn.
    """

    settings: PouringJoint
    pourings: tuple[Pouring, ...]
    made: str
    shown: Demonstrations = field(repr=False)
    drawn: ReactivePlanner = field(repr=False)

    def as_dict(self) -> dict[str, Any]:
        return {"settings": asdict(self.settings), "pourings": [item.as_dict() for item in self.pourings]}

    def table(self) -> str:
        """The table as plain text."""
        head = [
            "bottle to cup", "row", "seed", "shown", "groups by skill", "groups by tool", "off mm", "goal mm",
            "behind rad", "clear mm", "seconds",
        ]  # fmt: skip
        rows: list[list[Cell]] = []
        for item in self.pourings:
            executed = item.execution
            known: list[Cell] = ["refused", None, None, None, None, None, None]
            if executed is not None:
                skill, tool = (" then ".join(map(str, turns)) for turns in item.turns)
                known = [
                    skill, tool, 1e3 * item.off, 1e3 * item.missed, executed.tracking_error,
                    1e3 * executed.clearance, item.duration,
                ]  # fmt: skip
            pair = f"{item.bottle} to {item.cup}"
            rows.append([pair, item.row, item.seed, "yes" if item.shown else "no", *known])
        refused = [
            f"seed {item.seed}, {item.bottle} to {item.cup}: {item.reason}"
            for item in self.pourings if item.execution is None
        ]  # fmt: skip
        notes = [
            "off: largest distance of the executed tool from any demonstrated position; clear: of the arm from what "
            "stands on the table, by PyBullet; goal: of the executed tool, at the end, from the mean of those shown"
        ]
        return "\n".join([self.made, "", text_table(head, rows, left=(0, 1)), *notes, *refused])

    def draw(self, path: Path) -> None:
        """The first seed: our path through the most groups in the latent space and from above, the groups of all our
        pairs over time, and the arm on that path and on the literal planner's between the same places.
        """
        seed = self.settings.seeds[0]
        executed = [item for item in self.pourings if item.seed == seed and item.execution is not None]
        answered = [item for item in executed if item.row == "ours"]
        example = max(answered, key=lambda item: (sum(map(len, item.turns)), abs(item.bottle - item.cup)))
        strips = [item for item in executed if (item.bottle, item.cup) == (example.bottle, example.cup)]
        figure = Figure(figsize=(13.0, 5.5 + 2.1 * len(strips)), layout="constrained")
        grid = figure.add_gridspec(
            1 + len(strips), 3, height_ratios=(4.9, *(2.0 for _ in strips)), width_ratios=(1.6, 0.6, 1.3)
        )
        name = f"geodesic, bottle {example.bottle} to cup {example.cup}"
        drawn = DrawnPath(example.latent, np.empty((0, 3)), name, BLUE)
        title = "a  Ours: latent space, three groups"
        handles = draw_latent_tubes(figure, grid[0, 0], self.drawn, [drawn], (), title, zoom=1.0)
        _from_above(figure.add_subplot(grid[0, 1]), self, example, FAMILY_COLOURS)
        _bands(figure.add_subplot(grid[0, 2]), answered, FAMILY_COLOURS)
        for row, item in enumerate(strips, start=1):
            assert item.execution is not None
            pair, clear = f"bottle {item.bottle} to cup {item.cup}", 1e3 * item.execution.clearance
            title = f"{'def'[row - 1]}  {item.row.capitalize()}: {pair}, {clear:.0f} mm clear of what stands there"
            strip = pouring_strip(item.execution.configurations, item.bottle)
            draw_strip(figure.add_subplot(grid[row, :]), strip, title)
        handles = [handle for handle in handles if not str(handle.get_label()).startswith("demonstrations")]
        handles += [
            Line2D([], [], color=FAMILY_COLOURS[i], linewidth=3.0, label=f"group {i}: bottle {i} to cup {i}")
            for i in range(PAIRS)
        ]
        figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize=9)
        write_figure(figure, path)


def pour_all(
    player: Player,
    families: Families,
    shown: Demonstrations,
    seed: int,
    pairs: Sequence[tuple[int, int]] = ALL_PAIRS,
) -> list[Pouring]:
    """Pairs of bottle and cup with one skill; of what was shown the first third is of the first pair, and so on."""
    trees = [cKDTree(np.concatenate([item.positions for item in group])) for group in _groups(shown)]
    with TabletopWorld(rate_hz=RATE_HZ * STEPS_PER_SAMPLE) as world:
        return [_pour(player, world, families, trees, seed, *pair) for pair in pairs]


def _pour(
    player: Player,
    world: TabletopWorld,
    families: Families,
    trees: list[cKDTree],
    seed: int,
    bottle: int,
    cup: int,
) -> Pouring:
    played = player.play((bottle,), ((cup,),), np.empty((0, 3)), np.empty(0))
    if isinstance(played, str):
        return Pouring(player.name, seed, bottle, cup, played)
    world.furnish(standing_there(bottle))
    execution = play(world, played.reference, world.furniture_clearance)
    latent = np.array([played.reference.latent_at(time) for time in execution.times])
    away = np.stack([tree.query(execution.tool)[0] for tree in trees])
    goal = world.robot.forward(families.ends((cup,), -1))[0]
    return Pouring(
        player.name, seed, bottle, cup, "", played.reference.duration, latent, player.families_at(latent),
        np.argmin(away, axis=0), float(np.linalg.norm(execution.tool[-1] - goal)), float(away.min(axis=0).max()),
        execution,
    )  # fmt: skip


def _groups(shown: Demonstrations) -> list[Demonstrations]:
    each = len(shown) // PAIRS
    return [replace(shown, items=shown.items[pair * each : (pair + 1) * each]) for pair in range(PAIRS)]


def _from_above(axes: Any, report: PouringJointReport, example: Pouring, colours: tuple[str, ...]) -> None:
    """Demonstrated paths of the tool by group, and the executed one in the colour of the group nearest to it."""
    assert example.execution is not None
    for pair, group in enumerate(_groups(report.shown)):
        for item in group:
            axes.plot(*(100.0 * item.positions[:, :2].T), color=colours[pair], linewidth=0.9, alpha=0.7)
    tool = 100.0 * example.execution.tool[:, :2]
    axes.plot(*tool.T, color="white", linewidth=6.0)
    for begin, end in pairwise(np.flatnonzero(np.diff(example.by_tool, prepend=-1, append=-1))):
        axes.plot(*tool[begin : end + 1].T, color=colours[example.by_tool[begin]], linewidth=3.5, solid_capstyle="butt")
    axes.plot(*tool[0], "o", color="black", markersize=6)
    axes.plot(*tool[-1], "s", color="black", markersize=6)
    axes.set(xlabel="x [cm]", ylabel="y [cm]", aspect="equal")
    axes.set_title("b  Executed, from above", loc="left", fontsize=11)


def _bands(axes: Any, answered: list[Pouring], colours: tuple[str, ...]) -> None:
    """One bar for each pair: the group that the executed tool is nearest to, over the share of the time."""
    for row, item in enumerate(answered):
        bounds = np.flatnonzero(np.diff(item.by_tool, prepend=-1, append=-1))
        for begin, end in pairwise(bounds / len(item.by_tool)):
            group = item.by_tool[min(round(begin * len(item.by_tool)), len(item.by_tool) - 1)]
            axes.barh(row, end - begin, left=begin, height=0.7, color=colours[group])
    axes.set_yticks(range(len(answered)), [f"{item.bottle} to {item.cup}" + " *" * item.shown for item in answered])
    axes.invert_yaxis()
    axes.set(xlim=(0.0, 1.0), xlabel="share of the time", ylabel="bottle to cup (*: shown)")
    axes.set_title("c  Which group the tool is in", loc="left", fontsize=11)
