"""One skill of the tool on three arms: does a motion learned from one of them serve the others?

The simulated teacher shows reaches to grasp with a Panda; what is learned are the poses of the tool. For every seed of
the training the same model plans on a Panda, a UR5 and an iiwa 14, each placed by the same rule (`arm_placement`), and
on the Panda where it was shown, as a control. Starts and goals are those of demonstrations that were held out. Every
motion is played in the twin; what counts is how far the tool that was measured is from the held-out demonstration, and
how far the planned path alone is (`transferred_motions`). So for the planner of this package with its own model, and to
the letter: the paper's model with the paper's planner.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, VERMILION, write_figure
from geodesic_motion_studies.experiments.arm_placement import FORWARD, UP, Placement
from geodesic_motion_studies.experiments.grasp_task import HELD_OUT_SEED, TASK, reach_demonstrations
from geodesic_motion_studies.experiments.posture_strip import draw_strip, posture_strips
from geodesic_motion_studies.experiments.study import Report, Study, option, seeds, setting
from geodesic_motion_studies.experiments.trained import BRIEFLY, trained_once
from geodesic_motion_studies.experiments.transferred_motions import RATE_HZ, PlayedMotion, play_literal, play_ours
from geodesic_motion_studies.tools.averages import mean

METHODS = OURS, LITERAL = "ours", "literal"
SHOWN_ON, ARMS = "panda", ("panda", "ur5", "iiwa14")
CONTROL = f"{SHOWN_ON}, as shown"
_COLOURS = dict(zip((CONTROL, *ARMS), ("black", BLUE, VERMILION, GREEN), strict=True))


@dataclass(frozen=True)
class Transfer(Study):
    """Show, train, and play on every arm; literal_shape : nodes of the paper's graph, None as it is by default."""

    shown: int = option(8, "demonstrations", least=1)
    held_out: int = option(8, "demonstrations whose starts and goals are requested of every arm", least=1)
    seeds: tuple[int, ...] = seeds()
    planner: PlannerSettings = field(default_factory=PlannerSettings)
    literal_shape: tuple[int, ...] | None = setting(None)

    def measure(self, out: Path) -> TransferReport:
        shown, held_out = reach_demonstrations(self.shown), reach_demonstrations(self.held_out, HELD_OUT_SEED)
        skills = {
            seed: {
                OURS: trained_once(TASK, shown, TrainingSettings(**BRIEFLY, seed=seed), out / "skills"),
                LITERAL: trained_once(TASK, shown, TrainingSettings.paper(seed=seed), out / "skills"),
            }
            for seed in tqdm(self.seeds, desc="transfer, training", unit="seed")
        }
        return self.played(skills, [item.curve for item in shown], [item.curve for item in held_out])

    def played(
        self, skills: Mapping[int, Mapping[str, Skill]], shown: Sequence[PoseCurve], held_out: Sequence[PoseCurve]
    ) -> TransferReport:
        """Place the arms and play with skills that are trained, by seed and method."""
        placements = [Placement.at(CONTROL, SHOWN_ON, np.zeros(3), shown)]
        placements += [Placement.best(arm, shown) for arm in ARMS]
        motions: list[Transferred] = []
        for placement in tqdm(placements, desc="transfer", unit="arm"):
            with ArmWorld(rate_hz=RATE_HZ, robot=placement.arm) as world:
                for seed, by_method in skills.items():
                    motions += self._on_arm(placement, world, seed, by_method, held_out)
        return TransferReport(self, tuple(placements), tuple(motions), tuple(held_out))

    def _on_arm(
        self,
        placement: Placement,
        world: ArmWorld,
        seed: int,
        skills: Mapping[str, Skill],
        held_out: Sequence[PoseCurve],
    ) -> list[Transferred]:
        ours = ReactivePlanner(replace(skills[OURS], robot=placement.arm), self.planner)
        literal = PaperPlanner(skills[LITERAL], shape=self.literal_shape)
        found = []
        for number, curve in enumerate(held_out):
            for method, motion in (
                (OURS, play_ours(ours, world, placement.frame, curve)),
                (LITERAL, play_literal(literal, world, placement.frame, curve)),
            ):
                found.append(Transferred(method, placement.row, seed, number, motion))
        return found


@dataclass(frozen=True, eq=False)
class Transferred:
    """What became of a held-out demonstration, by its number, on an arm: a motion, or why there is none."""

    method: str
    row: str
    seed: int
    number: int
    motion: PlayedMotion | str


@dataclass(frozen=True)
class TransferReport(Report):
    """Where the arms stand, and all that was asked of them."""

    settings: Transfer
    placements: tuple[Placement, ...]
    motions: tuple[Transferred, ...]
    held_out: tuple[PoseCurve, ...] = field(repr=False)

    def summary(self, method: str, row: str, seed: int | None = None) -> dict[str, float | int | None]:
        """The figures of one method on one arm, of one seed or of all."""
        asked = [
            item.motion for item in self.motions if (item.method, item.row) == (method, row)
            and seed in (None, item.seed)
        ]  # fmt: skip
        played = [motion for motion in asked if isinstance(motion, PlayedMotion)]
        clearances = [motion.clearance for motion in played]
        nearest = min((1e3 * each for each in clearances if math.isfinite(each)), default=None)
        return {
            "asked": len(asked),
            "answered": len(played),
            "planned_mm": mean([1e3 * motion.planned.dtw for motion in played]),
            "planned_deg": mean([math.degrees(motion.planned.orientation) for motion in played]),
            "played_mm": mean([1e3 * motion.played.dtw for motion in played]),
            "played_deg": mean([math.degrees(motion.played.orientation) for motion in played]),
            "largest_lag_mm": max((1e3 * motion.lag for motion in played), default=None),
            "largest_lag_deg": max((math.degrees(motion.lag_angle) for motion in played), default=None),
            "duration_s": mean([motion.duration for motion in played]),
            "least_own_clearance_mm": nearest,
            "touched_itself": sum(each <= 0.0 for each in clearances),
        }

    def refusals(self, method: str, row: str) -> Counter[str]:
        """Why there is no motion, and how often."""
        return Counter(
            item.motion for item in self.motions
            if (item.method, item.row) == (method, row) and isinstance(item.motion, str)
        )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        rows = [placement.row for placement in self.placements]
        return {
            "settings": asdict(self.settings),
            "placements": {
                item.row: {
                    "move_m": item.move, "held": item.held, "dexterity": item.dexterity, "places": item.places,
                }
                for item in self.placements
            },
            "figures": {method: {row: self.summary(method, row) for row in rows} for method in METHODS},
            "figures_of_seeds": {
                method: {row: {seed: self.summary(method, row, seed) for seed in self.settings.seeds} for row in rows}
                for method in METHODS
            },
            "refusals": {method: {row: dict(self.refusals(method, row)) for row in rows} for method in METHODS},
        }

    def table(self) -> str:
        """The tables as plain text, with the reasons of refusals."""
        places = text_table(
            [
                "arm", "demonstrations moved forward, up cm", "of these held", "least singular value",
                f"all held by, of {len(FORWARD) * len(UP)} moves",
            ],
            [
                [
                    item.row, "{:.0f}, {:.0f}".format(*(100.0 * item.move[[0, 2]])), item.held, item.dexterity,
                    item.places,
                ]
                for item in self.placements
            ],
        )  # fmt: skip
        head = [
            "arm", "method", "asked", "answered", "planned mm", "deg", "played mm", "deg", "largest lag mm", "deg",
            "time s", "least from itself mm", "touched itself",
        ]  # fmt: skip
        rows: list[list[Cell]] = []
        refused = []
        for method in METHODS:
            for placement in self.placements:
                rows.append([placement.row, method, *self.summary(method, placement.row).values()])
                refused += [
                    f"{placement.row}, {method}: {count} x {reason}"
                    for reason, count in self.refusals(method, placement.row).items()
                ]
        return "\n".join([places, "", text_table(head, rows, 2, left=(0, 1)), *refused])

    def draw(self, path: Path) -> None:
        """Postures of every arm along the geodesic of one demonstration; the tools that were measured; errors."""
        example = self._example()
        figure = Figure(figsize=(13.0, 12.0), layout="constrained")
        grid = figure.add_gridspec(len(ARMS) + 1, 2, height_ratios=(*[1.0] * len(ARMS), 1.6))
        for row, arm in enumerate(ARMS):
            axes = figure.add_subplot(grid[row, :])
            motion = example.get(arm)
            if motion is None:
                axes.set_axis_off()
                axes.set_title(f"{'abc'[row]}  {arm}: no motion that all arms made", loc="left", fontsize=11)
                continue
            strip = posture_strips([motion.configurations], [{}], width=320, height=230, robot=arm)
            title = f"{'abc'[row]}  {arm}: the tool {1e3 * motion.played.dtw:.1f} mm off the held-out demonstration"
            draw_strip(axes, strip, title)
        _tools(figure.add_subplot(grid[-1, 0]), self, example)
        _errors(figure.add_subplot(grid[-1, 1]), self)
        write_figure(figure, path)

    def _example(self) -> dict[str, PlayedMotion]:
        """Our motions of the first seed, by the row, of the first demonstration that every arm answered."""
        by_number: dict[int, dict[str, PlayedMotion]] = {}
        for item in self.motions:
            if (item.method, item.seed) == (OURS, self.settings.seeds[0]) and isinstance(item.motion, PlayedMotion):
                by_number.setdefault(item.number, {})[item.row] = item.motion
        complete = [rows for _, rows in sorted(by_number.items()) if len(rows) == len(self.placements)]
        return complete[0] if complete else {}


def _tools(axes: Any, report: TransferReport, example: Mapping[str, PlayedMotion]) -> None:
    """The measured tools of an example in the frame of the demonstrations, among the held-out ones; seen along x."""
    for curve in report.held_out:
        axes.plot(*(100.0 * curve.positions[:, 1:].T), color=GREY, linewidth=0.8)
    axes.plot([], [], color=GREY, label="held-out demonstrations")
    for row, motion in example.items():
        dashes = "--" if row == CONTROL else "-"
        axes.plot(*(100.0 * motion.tool.positions[:, 1:].T), dashes, color=_COLOURS[row], linewidth=1.4, label=row)
    axes.set(xlabel="y [cm]", ylabel="z [cm]", aspect="equal")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=3, fontsize=9, frameon=False)
    axes.set_title("d  The tools as measured, in the frame of the demonstrations", loc="left", fontsize=11)


def _errors(axes: Any, report: TransferReport) -> None:
    """Mean distances from the held-out demonstrations, planned and played, of every method and arm."""
    rows, width = [placement.row for placement in report.placements], 0.38
    for group, method in enumerate(METHODS):
        for place, row in enumerate(rows):
            at, figures = group * (len(rows) + 1) + place, report.summary(method, row)
            for side, name in enumerate(("planned_mm", "played_mm")):
                height = figures[name]
                if height is not None:
                    axes.bar(at + (side - 0.5) * width, height, width, color=_COLOURS[row], alpha=(0.4, 1.0)[side])
    ticks = [group * (len(rows) + 1) + place for group in range(len(METHODS)) for place in range(len(rows))]
    labels = [f"{row}\n{method}".replace(", ", ",\n") for method in METHODS for row in rows]
    axes.set_xticks(ticks, labels, fontsize=8)
    axes.set(ylabel="off the held-out demonstration [mm]")
    axes.grid(alpha=0.3, axis="y")
    axes.set_title("e  Planned (pale) and played", loc="left", fontsize=11)
