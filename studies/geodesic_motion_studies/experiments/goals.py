"""Goals and starts that vary: held-out motions of the simulated multi-goal set, predicted from start and goal alone.

Recordings mostly share one goal. Here (`teacher.multi_goal_demonstrations`) bottles and cups stand anywhere in two
regions: one skill per seed is learned from some demonstrations and queried for others that were drawn from the same
regions, both new with every seed. Rows and columns are those of `imitation`; `people` is how far two demonstrations of
this teacher differ when one of them is carried to the other's ends.

Those ends come from the distribution that was demonstrated. Besides, ends are requested of every skill *along* the
held-out demonstrations and *beyond* both regions, in rings (`requested_ends`); right is the held-out piece, or what
the teacher means to do from there. Beside it stands the nearest demonstration, carried to the ends.

Held-out ends are predicted wherever they lie.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from tqdm import tqdm

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.simulation.tabletop import Region
from geodesic_motion_ros.simulation.teacher import (
    BOTTLE_REGION,
    CUP_REGION,
    multi_goal_demonstrations,
    pouring_motion,
)
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREY, VERMILION, write_figure
from geodesic_motion_studies.experiments.baselines import Prediction, promp
from geodesic_motion_studies.experiments.imitation import evaluate
from geodesic_motion_studies.experiments.imitation_judge import EVERY_END
from geodesic_motion_studies.experiments.imitation_report import ImitationReport, Values
from geodesic_motion_studies.experiments.requested_ends import (
    NEAREST,
    RINGS,
    EndsAnswer,
    RequestedEnds,
    answers_to,
    ends_figures,
    ends_table,
    pieces_of,
    ring_name,
)
from geodesic_motion_studies.experiments.study import OfOwnData, Report, option, seeds, setting, steps
from geodesic_motion_studies.experiments.trained import task_training, trained_once
from geodesic_motion_studies.tools.similarity import compare

TASK = "pouring_anywhere"
#: Held-out demonstrations of seed s are drawn with seed s + HELD_OUT_SEED.
HELD_OUT_SEED = 10_000
#: So many held-out demonstrations are drawn.
EXAMPLES = 4

ROWS = (
    "geodesic",
    "geodesic_ridge",
    "conditional_mean",
    "sheet_oracle",
    "nearest_demonstration",
    "mean_demonstration",
    "promp",
    "dmp_nearest",
    "people",
)
COLUMNS = ("dtw_mm", "orientation_deg", "endpoint_before_mm", "endpoint_after_mm", "unanswered")


@dataclass(frozen=True)
class Goals(OfOwnData):
    """Show, train and predict for every seed, of data and training alike.

    ends : pairs of ends along the held-out demonstrations, and as many in each ring beyond the regions.
    training : its seed is replaced; None: the defaults, but for `steps`.
    """

    shown: int = option(12, "demonstrations that a skill is learned from", least=2)
    held_out: int = option(12, "demonstrations that are predicted", least=1)
    ends: int = setting(12, least=1)
    seeds: tuple[int, ...] = seeds("of data and training, one skill each")
    steps: int | None = steps()
    training: TrainingSettings | None = None

    def measure(self, out: Path) -> GoalsReport:
        """PeersMissingError: movement_primitives is not installed."""
        reports, answers, regressions, people, examples = [], [], [], [], []
        base = self.training or task_training(self.steps)
        for seed in tqdm(self.seeds, desc="goals", unit="seed"):
            everything, fold = drawn(self, seed)
            shown, held_out = everything.split(fold)
            skill = trained_once(TASK, shown, replace(base, seed=seed), out / "skills")
            report = evaluate(
                everything, [fold], [seed], lambda *_, skill=skill: skill, TASK, show_progress=False,
                sheets=["canonical"],
            )  # fmt: skip
            reports.append(report)
            answers += answers_to(requested_ends(held_out, self, seed), {"geodesic": skill}, shown, seed)
            regressions.append(skill.canonical is not None and skill.canonical.regresses)
            people.append(_carried_people(everything))
            if not examples:
                examples.append(_example(skill, shown, [everything[index] for index in fold[:EXAMPLES]]))
        mean = {column: float(np.mean([values[column] for values in people])) for column in people[0]}
        return GoalsReport(
            self, tuple(reports), mean, tuple(answers), tuple(regressions), examples[0]
        )  # fmt: skip

    def saved(self) -> tuple[Demonstrations, str]:
        everything, fold = drawn(self, self.seeds[0])
        return everything, f"the last {len(fold)} are those held out"


@dataclass(frozen=True)
class Predicted:
    """Positions (n, 3) [m] of a held-out demonstration and of what was predicted for it; None without an answer."""

    held_out: np.ndarray
    geodesic: np.ndarray | None
    promp: np.ndarray


@dataclass(frozen=True)
class Example:
    """Motions of one seed to be drawn: positions (n, 3) [m] of the shown ones, and some of the held-out."""

    shown: tuple[np.ndarray, ...]
    predicted: tuple[Predicted, ...]


@dataclass(frozen=True)
class GoalsReport(Report):
    """The held-out table of every seed, answers to ends elsewhere, and motions of the first seed.

    `regressions` says for every seed whether start and goal choose between its demonstrations.
    """

    settings: Goals
    reports: tuple[ImitationReport, ...]
    people: Values
    answers: tuple[EndsAnswer, ...]
    regressions: tuple[bool, ...]
    example: Example = field(repr=False)

    @property
    def rows(self) -> dict[str, dict[str, float | None]]:
        """Row -> column -> mean over all seeds."""
        return _rows(self.reports, self.people)

    def over_promp(self, reports: Sequence[ImitationReport] | None = None) -> float | None:
        """The geodesic's DTW over ProMP's, of all seeds or of some; None where nothing was answered."""
        rows = _rows(self.reports if reports is None else reports, self.people)
        geodesic, promp = rows["geodesic"]["dtw_mm"], rows["promp"]["dtw_mm"]
        return None if geodesic is None or promp is None else geodesic / promp

    def as_dict(self) -> dict[str, Any]:
        return {
            "settings": asdict(self.settings),
            "rows": self.rows,
            "over_promp": self.over_promp(),
            "over_promp_by_seed": {report.seeds[0]: self.over_promp([report]) for report in self.reports},
            "ends": ends_figures(self.answers),
            "seeds": {
                report.seeds[0]: report.as_dict() | {"regresses": regresses}
                for report, regresses in zip(self.reports, self.regressions, strict=True)
            },
        }

    def table(self) -> str:
        """The tables as plain text, and the bar in words."""
        rows, promp = self.rows, self.rows["promp"]["dtw_mm"]
        body = []
        for row in ROWS:
            dtw = rows[row]["dtw_mm"]
            ratio = None if dtw is None or promp is None else dtw / promp
            body.append([row, *(rows[row][column] for column in COLUMNS), ratio])
        head = ["row", *(column.replace("_", " ") for column in COLUMNS), "dtw over promp's"]
        shown = f"{self.settings.shown} shown, {self.settings.held_out} held out"
        return "\n".join([
            f"{TASK}: {shown}, seeds {', '.join(map(str, self.settings.seeds))}", text_table(head, body), "",
            *self._notes(), "", ends_table(self.answers),
        ])  # fmt: skip

    def _notes(self) -> list[str]:
        choosing = f"{sum(self.regressions)} of {len(self.reports)} skills"
        notes = [f"start and goal choose between demonstrations in {choosing}"]
        ratio = self.over_promp()
        if ratio is not None:
            each = {report.seeds[0]: self.over_promp([report]) for report in self.reports}
            seeds = ", ".join(f"seed {seed} {value:.2f}" for seed, value in each.items() if value is not None)
            notes.append(f"geodesic's DTW over ProMP's: {ratio:.2f} ({seeds})")
        return notes

    def draw(self, path: Path) -> None:
        """The first seed from above and from the side, the geodesic's distances beside ProMP's, and those by ring."""
        figure = Figure(figsize=(13.0, 6.4), layout="constrained")
        panels = figure.subplot_mosaic([["above", "distances"], ["behind", "rings"]], width_ratios=(1.5, 1.0))
        above, behind, distances = panels["above"], panels["behind"], panels["distances"]
        for axes, across, names in ((above, (1, 0), ("y", "x")), (behind, (1, 2), ("y", "z"))):
            for positions in self.example.shown:
                axes.plot(*(100.0 * positions[:, across].T), color=GREY, linewidth=0.7, alpha=0.5, label="shown")
            for predicted in self.example.predicted:
                for positions, colour, style, name in (
                    (predicted.held_out, "black", "-", "held out"),
                    (predicted.promp, VERMILION, ":", "ProMP"),
                    (predicted.geodesic, BLUE, "-", "geodesic"),
                ):
                    if positions is not None:
                        axes.plot(*(100.0 * positions[:, across].T), style, color=colour, linewidth=1.4, label=name)
            axes.set(xlabel=f"{names[0]} [cm]", ylabel=f"{names[1]} [cm]", aspect="equal")
        for region, name in ((BOTTLE_REGION, "bottles"), (CUP_REGION, "cups")):
            lower, size = 100.0 * np.array(region.lower), 100.0 * (np.array(region.upper) - region.lower)
            above.add_patch(Rectangle(lower[::-1], size[1], size[0], fill=False, linestyle="--"))
            above.text(*lower[::-1] + 0.5, name, fontsize=8)
        above.set_title(f"seed {self.settings.seeds[0]} from above", loc="left")
        behind.set_title("from behind", loc="left")
        handles, labels = behind.get_legend_handles_labels()
        named = dict(zip(labels, handles, strict=True))
        figure.legend(named.values(), named.keys(), loc="outside lower left", ncols=4)
        found = {row: _by_demonstration(self, row) for row in ("geodesic", "promp")}
        both = [(found["promp"][key], value) for key, value in found["geodesic"].items()]
        if both:
            distances.plot(*zip(*both, strict=True), "o", color=BLUE, alpha=0.7)
            top = 1.1 * max(map(max, both))
            distances.plot([0.0, top], [0.0, top], "k--", linewidth=0.8)
            distances.set(xlim=(0.0, top), ylim=(0.0, top))
        distances.set(xlabel="ProMP [mm]", ylabel="geodesic [mm]")
        distances.set_title("DTW to the held-out, all seeds", loc="left")
        distances.text(0.98, 0.02, "geodesic nearer", transform=distances.transAxes, ha="right")
        _draw_rings(panels["rings"], self.answers)
        write_figure(figure, path)


def drawn(settings: Goals, seed: int) -> tuple[Demonstrations, tuple[int, ...]]:
    """All demonstrations of a seed, first the shown and then the held-out ones, and the indices of the latter."""
    shown = multi_goal_demonstrations(settings.shown, seed)
    held_out = multi_goal_demonstrations(settings.held_out, seed + HELD_OUT_SEED)
    everything = Demonstrations((*shown, *held_out), frame=shown.frame)
    return everything, tuple(range(len(shown), len(everything)))


def requested_ends(held_out: Demonstrations, settings: Goals, seed: int) -> list[RequestedEnds]:
    """Ends along the held-out demonstrations and in every ring beyond the regions of bottles and cups."""
    random = np.random.default_rng([seed, settings.ends])
    requested = pieces_of(held_out, settings.ends, random)
    for distance in RINGS:
        for number in range(settings.ends):
            # Bottle and cup with their yaws, as `pouring_motion` wants them.
            place = random.random(6)
            for region, begin in ((BOTTLE_REGION, 0), (CUP_REGION, 3)):
                place[begin : begin + 2] = _share_outside(region, distance, random)
            wanted = pouring_motion(f"{ring_name(distance)}, {number}", place, random)
            curve = PoseCurve(wanted.positions, wanted.quaternions)
            requested.append(RequestedEnds(ring_name(distance), curve.start, curve.goal, (curve,)))
    return requested


def _share_outside(region: Region, distance: float, random: np.random.Generator) -> np.ndarray:
    """A random point (2,) opposite one of a region's sides, a distance [m] outside, as `Region.at` counts."""
    share, axis = random.random(2), int(random.integers(2))
    outside = distance / (region.upper[axis] - region.lower[axis])
    share[axis] = 1.0 + outside if random.random() < 0.5 else -outside
    return share


def _example(skill: Skill, shown: Demonstrations, held_out: Sequence[Demonstration]) -> Example:
    planner = PosePathPlanner(skill, EVERY_END)
    predicted = []
    for item in held_out:
        ends = item.curve.start, item.curve.goal
        path = planner.plan(*ends[0], *ends[1])
        geodesic = path.positions if isinstance(path, PosePath) else None
        predicted.append(Predicted(item.positions, geodesic, promp(shown, *ends).corrected.positions))
    return Example(tuple(item.positions for item in shown), tuple(predicted))


def _carried_people(demonstrations: Demonstrations) -> Values:
    """Mean over all ordered pairs of how far one demonstration, its ends moved to the other's, is from the other."""
    found = [
        compare(Prediction.between(first.curve, second.curve.start, second.curve.goal).corrected, second.curve)
        for first, second in permutations(demonstrations, 2)
    ]
    return {
        "dtw_mm": 1e3 * float(np.mean([item.dtw for item in found])),
        "orientation_deg": math.degrees(float(np.mean([item.orientation for item in found]))),
    }


def _rows(reports: Sequence[ImitationReport], people: Values) -> dict[str, dict[str, float | None]]:
    """The chosen rows and columns over the measurements of several reports."""
    measurements = tuple(item for report in reports for item in report.measurements)
    rows = replace(reports[0], measurements=measurements).rows
    chosen = {row: {column: rows[row][column] for column in COLUMNS} for row in ROWS}
    chosen["people"] = dict.fromkeys(COLUMNS) | people
    return chosen


def _draw_rings(axes: Any, answers: Sequence[EndsAnswer]) -> None:
    """Mean distance from the right motion with the limits lifted, and which share the usual limits answer."""

    figures = ends_figures(answers)
    for method, colour, shift in (("geodesic", BLUE, -0.2), (NEAREST, VERMILION, 0.2)):
        off = [of[method]["off_unlimited_mm"] for of in figures.values()]
        axes.bar(np.arange(len(off)) + shift, off, 0.38, color=colour, label=method)
    named = [
        "\n".join([*where.rsplit(" ", 1), f"{of['geodesic']['answered']} of {of['geodesic']['requested']}"])
        for where, of in figures.items()
    ]
    axes.set_xticks(np.arange(len(named)), named, fontsize=8)
    axes.set(ylabel="off the right motion [mm]")
    axes.set_title("Ends by place, limits lifted; answered under the usual ones", loc="left", fontsize=11)
    axes.legend(frameon=False)


def _by_demonstration(report: GoalsReport, row: str) -> dict[tuple[int, int], float]:
    """DTW [mm] of the answers of a row by seed and number."""
    return {
        (of_seed.seeds[0], item.demonstration): item.values["dtw_mm"]
        for of_seed in report.reports
        for item in of_seed.measurements
        if item.row == row and "dtw_mm" in item.values
    }
