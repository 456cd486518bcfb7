"""What the densities of the model are worth: likelihood of held-out demonstrations, and how closely they are predicted.

From every recording some demonstrations are held out, and a skill is trained on the others with each density: of poses
with a diagonal or a full covariance of positions, and with von Mises-Fisher (vMF) or angular central Gaussian (ACG)
orientations; of joints with Gaussian or wrapped ones (`learning.densities`). Columns of the table, means over held-out
demonstrations and seeds:

nats         log density of a sample at its code, of the coordinates in [m] or [rad] and of the quaternion on S^3, of q
             and -q alike (`held_out_likelihood`); of position, of orientation : its two summands
worst tenth  the same, mean over the tenth of the samples that are the least likely
dtw mm, deg  of the planner's path between start and goal of the demonstration, as of `studies.tools.similarity`
over mean    dtw over that of the mean demonstration, ends moved; both of the demonstrations that are answered
unanswered   held-out demonstrations for which the planner has no path, or whose training made no skill
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

from geodesic_motion_ros.demonstrations.canonical import ConfigurationForm
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import SkillError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, ORANGE, VERMILION, write_figure
from geodesic_motion_studies.experiments.baselines import mean_demonstration
from geodesic_motion_studies.experiments.held_out_likelihood import log_densities
from geodesic_motion_studies.experiments.imitation import stage_shown_on
from geodesic_motion_studies.experiments.joint_imitation import tool_curve
from geodesic_motion_studies.experiments.literal import our_prediction, tool_of
from geodesic_motion_studies.experiments.study import OfRecordings, Recording, Report, changed, seeds, steps
from geodesic_motion_studies.experiments.trained import trained_once
from geodesic_motion_studies.tools.similarity import COMPARED_POINTS, compare

_FULL, _AXES = {"position_density": "full"}, {"orientation_density": "angular_central_gaussian"}
#: Settings of the trainings by the densities' names; the first of each are the paper's.
OF_POSES = {
    "diagonal, vMF": {}, "full, vMF": _FULL, "diagonal, ACG": _AXES, "full, ACG": _FULL | _AXES,
}  # fmt: skip
OF_JOINTS = {"Gaussian": {}, "wrapped": {"joint_density": "wrapped"}}
_LEAST_LIKELY = 0.1
_COLOURS = (BLUE, VERMILION, GREEN, ORANGE)


@dataclass(frozen=True)
class DensityRow:
    """What was measured of one recording with one choice of densities; NaN where there is no value."""

    recording: str
    densities: str
    nats: float
    position: float
    orientation: float
    worst_tenth: float
    dtw_mm: float
    turned_deg: float
    over_mean: float
    unanswered: int


@dataclass(frozen=True)
class DensityReport(Report):
    """All rows."""

    rows: tuple[DensityRow, ...]

    def as_dict(self) -> dict[str, Any]:
        return {"rows": [asdict(row) for row in self.rows]}

    def table(self) -> str:
        head = (
            "recording", "densities", "nats", "of position", "of orientation", "worst tenth", "dtw mm", "deg",
            "over mean", "unanswered",
        )  # fmt: skip
        return text_table(head, [tuple(asdict(row).values()) for row in self.rows], left=(0, 1))

    def draw(self, path: Path) -> None:
        """Bars of the likelihood, one for every choice, recording by recording."""
        figure = Figure(figsize=(7.0, 3.2), layout="constrained")
        axes = figure.add_subplot()
        names = list(dict.fromkeys(row.recording for row in self.rows))
        for name, mine in ((name, [row for row in self.rows if row.recording == name]) for name in names):
            at = names.index(name) + 0.2 * (np.arange(len(mine)) - 0.5 * len(mine) + 0.5)
            bars = axes.bar(at, [row.nats for row in mine], 0.18, color=_COLOURS[: len(mine)])
            axes.bar_label(bars, [row.densities for row in mine], rotation=90, fontsize=6, padding=2)
        axes.set_xticks(range(len(names)), names)
        axes.set_ylabel("held-out log density [nats]")
        axes.margins(y=0.3)
        write_figure(figure, path)


@dataclass(frozen=True)
class Densities(OfRecordings):
    """Train with every density on every fold of every recording, and judge by what was held out."""

    joints = True
    seeds: tuple[int, ...] = seeds("one training each of every fold and density", (0,))
    steps: int | None = steps()

    def measure(self, out: Path) -> DensityReport:
        rows = []
        for name, recording, folds in self.split():
            of_joints = isinstance(recording, JointDemonstrations)
            base = changed(JointTrainingSettings() if of_joints else TrainingSettings(), steps=self.steps)
            for densities, choice in (OF_JOINTS if of_joints else OF_POSES).items():
                found = []
                for fold, seed in (bar := tqdm(list(product(folds, self.seeds)), desc=f"{name}: {densities}")):
                    shown, hidden = recording.split(fold)
                    settings = replace(base, seed=seed, **choice)
                    try:
                        skill = trained_once(name, shown, settings, out / "skills", stage_shown_on(bar))
                    except SkillError:
                        skill = None
                    found += _judged(skill, settings, shown, hidden)
                rows.append(_row(name, densities, found))
        return DensityReport(tuple(rows))


#: Of a held-out demonstration: log densities (S, 1 or 2), the planner's path's distance [mm] and angle [deg], NaN where
#: there is none, and the mean's distance.
_Judged = tuple[np.ndarray, float, float, float]


def _judged(
    skill: Skill | None, settings: TrainingSettings | JointTrainingSettings, shown: Recording, hidden: Recording
) -> list[_Judged]:
    if skill is None:
        return [(np.empty((0, 2)), math.nan, math.nan, math.nan) for _ in hidden]
    predict, judged = our_prediction(skill), []
    for item in hidden:
        demonstrated, path = tool_of(item, hidden), predict(item)
        found = None if path is None else compare(path, demonstrated)
        off = (1e3 * found.dtw, math.degrees(found.orientation)) if found else (math.nan, math.nan)
        of_mean = 1e3 * compare(_mean(shown, item), demonstrated).dtw
        judged.append((log_densities(skill, settings, item), *off, of_mean))
    return judged


def _mean(shown: Recording, item: Any) -> PoseCurve:
    """The mean demonstration, carried to the ends of another one."""
    if not isinstance(shown, JointDemonstrations):
        return mean_demonstration(shown, item.curve.start, item.curve.goal).corrected
    robot, metric = Robot.named(shown.robot), JointTrainingSettings().metric
    path = ConfigurationForm(shown, robot, metric, fade=1.0).sheet(COMPARED_POINTS).configurations.mean(axis=0)
    offsets = JointOffsets.between(robot, path[[0, -1]], item.configurations[[0, -1]])
    return tool_curve(path + offsets.displacements(path, np.linspace(0.0, 1.0, len(path))), robot)


def _row(name: str, densities: str, found: list[_Judged]) -> DensityRow:
    samples = [values for values, *_ in found if len(values)]
    values = np.concatenate(samples) if samples else np.full((1, 1), math.nan)
    nats = np.sort(values.sum(axis=1))
    each = [*values.mean(axis=0), math.nan][:2]
    worst = nats[: max(1, int(_LEAST_LIKELY * len(nats)))].mean()
    answered = [off for _, *off in found if math.isfinite(off[0])]
    dtw, turned, mean = np.mean(answered, axis=0) if answered else [math.nan] * 3
    unanswered = len(found) - len(answered)
    return DensityRow(name, densities, nats.mean(), *each, worst, dtw, turned, dtw / mean, unanswered)
