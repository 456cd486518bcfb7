"""Held-out demonstrations by the paper to the letter, beside this package's default planner.

From every recording some demonstrations are held out; two skills are trained on the others, one as the paper has it
(`TrainingSettings.paper`, `JointTrainingSettings.paper`), played by the paper's planner (`paper/`), and one with
default settings, played by this package's. Both are given start and goal of the held-out demonstration. Columns of the
table, means over held-out demonstrations, of the tool also where joints were recorded:

dtw_mm           mean distance of the points that dynamic time warping matches, as of `studies.tools.similarity`
orientation_deg  mean angle between the orientations of the same points
ends_mm          mean distance of both ends of the path from those that were demanded; ours is carried to them
people_mm        dtw of pairs of demonstrations among themselves: human variation
unanswered       held-out demonstrations for which no path was found, or whose training made no skill: its support does
                 not join the ends of any demonstration; they count in no mean

Means are over all seeds. A second table has a row for every training: mean distance of the tool, and mean angle, in
what comes back of the demonstrations that were learned, and for how many of the held-out ones there is a path.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import SkillError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION, write_figure
from geodesic_motion_studies.experiments.folds import Fold
from geodesic_motion_studies.experiments.imitation import Progress, stage_shown_on
from geodesic_motion_studies.experiments.imitation_judge import EVERY_END
from geodesic_motion_studies.experiments.joint_imitation import tool_curve
from geodesic_motion_studies.experiments.study import OfRecordings, Recording, Report, option, seeds, steps
from geodesic_motion_studies.experiments.trained import trained_once
from geodesic_motion_studies.tools.similarity import COMPARED_POINTS, compare

#: Predicts the tool's path of a held-out demonstration, given as configurations (n, eta) or as poses; None: no path.
Predict = Callable[[Any], PoseCurve | None]

LITERAL, OURS = "the paper to the letter", "this package's default"


@dataclass(frozen=True)
class LiteralRow:
    """What one planner predicts of one recording."""

    recording: str
    planner: str
    dtw_mm: float
    orientation_deg: float
    ends_mm: float
    people_mm: float
    unanswered: int


@dataclass(frozen=True)
class LiteralTraining:
    """One training: how far the tool is off in what comes back of its demonstrations (NaN where it made no skill), and
    how many of the demonstrations that it was not shown have a path.
    """

    recording: str
    planner: str
    held_out: str
    seed: int
    error_mm: float
    error_deg: float
    answered: int


@dataclass(frozen=True)
class LiteralReport(Report):
    """Rows, one for every recording and planner; held_out : demonstrations that each is a mean of, with every seed."""

    rows: tuple[LiteralRow, ...]
    trainings: tuple[LiteralTraining, ...]
    held_out: dict[str, int]

    def table(self) -> str:
        head = ("recording", "planner", "dtw mm", "orientation deg", "ends mm", "people mm", "unanswered")
        of_trainings = ("recording", "planner", "held out", "seed", "error mm", "error deg", "with a path")
        return "\n".join([
            text_table(head, [tuple(asdict(row).values()) for row in self.rows], digits=1, left=(0, 1)), "",
            text_table(of_trainings, [tuple(asdict(one).values()) for one in self.trainings], digits=1, left=(0, 1, 2)),
        ])  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        return {name: [asdict(row) for row in getattr(self, name)] for name in ("rows", "trainings")} | {
            "held_out": self.held_out
        }

    def draw(self, path: Path) -> None:
        """Bars of the held-out distance, the literal planner beside ours; dashes: people among themselves."""
        figure = Figure(figsize=(7.0, 3.2), layout="constrained")
        axes = figure.add_subplot()
        names = list(self.held_out)
        for shift, planner, colour in ((-0.2, LITERAL, VERMILION), (0.2, OURS, BLUE)):
            rows = [row for row in self.rows if row.planner == planner]
            if rows:
                axes.bar(np.arange(len(names)) + shift, [row.dtw_mm for row in rows], 0.38, color=colour, label=planner)
        people = [next(row.people_mm for row in self.rows if row.recording == name) for name in names]
        axes.hlines(people, np.arange(len(names)) - 0.42, np.arange(len(names)) + 0.42, "black", "--", label="people")
        axes.set_xticks(np.arange(len(names)), names)
        axes.set_ylabel("DTW to the held-out one [mm]")
        figure.legend(loc="outside lower center", ncols=3, frameon=False)
        write_figure(figure, path)


@dataclass(frozen=True)
class Literal(OfRecordings):
    """Train both kinds of skills on every fold of every recording, and predict what was held out."""

    joints = True
    seeds: tuple[int, ...] = seeds("one training each of every fold", (0,))
    steps: int | None = steps()
    rows: str = option("both", "literal: the paper to the letter alone", choices=("both", "literal"))

    def measure(self, out: Path) -> LiteralReport:
        rows, trainings, held_out = [], [], {}
        planners = (LITERAL,) if self.rows == "literal" else (LITERAL, OURS)
        for name, recording, folds in self.split():
            found: dict[str, list[tuple[PoseCurve, PoseCurve | None]]] = {planner: [] for planner in planners}
            asked = list(product(folds, self.seeds, planners))
            for fold, seed, planner in (bar := tqdm(asked, desc=name, unit="skill")):
                shown, hidden = recording.split(fold)
                settings = _settings(recording, planner, seed, self.steps)
                skill = _trained(name, shown, settings, out / "skills", stage_shown_on(bar))
                predict = (_literal if planner == LITERAL else our_prediction)(skill) if skill else lambda _: None
                pairs = [(tool_of(item, recording), predict(item)) for item in hidden]
                found[planner] += pairs
                trainings.append(_training(name, planner, fold, seed, skill, pairs))
            people = [
                compare(tool_of(one, recording), tool_of(other, recording)).dtw
                for one, other in combinations(recording, 2)
            ]
            rows += [_row(name, planner, pairs, 1e3 * float(np.mean(people))) for planner, pairs in found.items()]
            held_out[name] = sum(len(fold) for fold in folds)
        return LiteralReport(tuple(rows), tuple(trainings), held_out)


def _settings(
    recording: Recording, planner: str, seed: int, steps: int | None
) -> TrainingSettings | JointTrainingSettings:
    kind = JointTrainingSettings if isinstance(recording, JointDemonstrations) else TrainingSettings
    settings = kind.paper(seed=seed) if planner == LITERAL else kind(seed=seed)
    return settings if steps is None else replace(settings, steps=steps)


def tool_of(item: Any, recording: Recording) -> PoseCurve:
    """Return the tool's curve in a demonstration."""
    if isinstance(recording, JointDemonstrations):
        return tool_curve(item.configurations, Robot.named(recording.robot))
    return item.curve


def _trained(
    name: str,
    shown: Recording,
    settings: TrainingSettings | JointTrainingSettings,
    cache: Path,
    progress: Progress,
) -> Skill | None:
    try:
        return trained_once(name, shown, settings, cache, progress)
    except SkillError:
        return None


def _training(
    name: str, planner: str, fold: Fold, seed: int, skill: Skill | None, pairs: list[tuple[PoseCurve, PoseCurve | None]]
) -> LiteralTraining:
    errors = [
        skill.quality[f"training_{error}"] if skill else math.nan
        for error in ("position_error_mm", "orientation_error_deg")
    ]
    answered = sum(path is not None for _, path in pairs)
    return LiteralTraining(name, planner, ",".join(map(str, fold)), seed, *errors, answered)


def _literal(skill: Skill) -> Predict:
    planner = PaperPlanner(skill)

    def predict(item: Any) -> PoseCurve:
        if skill.space == "joint":
            ends = [planner.robot.forward(item.configurations[end]) for end in (0, -1)]
        else:
            ends = [item.curve.start, item.curve.goal]
        return planner.tool_curve(*ends)

    return predict


def our_prediction(skill: Skill) -> Predict:
    """Predict by this package's planner."""
    if skill.space == "joint":
        arm = ReactivePlanner(skill)

        def predict_joints(item: Any) -> PoseCurve | None:
            goal = ConfigurationGoal(item.configurations[-1:], "that of the demonstration")
            reference = arm.plan_configurations(item.configurations[0], goal).reference
            if reference is None:
                return None
            times = np.linspace(0.0, reference.duration, 2 * COMPARED_POINTS)
            return tool_curve(reference.samples(times)[0], arm.robot)

        return predict_joints
    tool = PosePathPlanner(skill, EVERY_END)

    def predict(item: Any) -> PoseCurve | None:
        path = tool.plan(*item.curve.start, *item.curve.goal)
        return path if isinstance(path, PosePath) else None

    return predict


def _row(name: str, planner: str, pairs: list[tuple[PoseCurve, PoseCurve | None]], people: float) -> LiteralRow:
    answered = [(shown, path) for shown, path in pairs if path is not None]
    found = [compare(path, shown) for shown, path in answered]
    ends = [
        np.linalg.norm(path.positions[[0, -1]] - shown.positions[[0, -1]], axis=1).mean() for shown, path in answered
    ]

    def mean(values: list[float]) -> float:
        return float(np.mean(values)) if values else math.nan

    return LiteralRow(
        name, planner, 1e3 * mean([each.dtw for each in found]),
        math.degrees(mean([each.orientation for each in found])), 1e3 * mean(ends), people, len(pairs) - len(answered),
    )  # fmt: skip
