"""Held-out rounds of a closed skill, predicted from where they begin alone: by the planner, and without a manifold.

rows      geodesic (the planner as it comes), mean_demonstration (the mean of the rounds that are shown, moved to the
          start), nearest_demonstration (the one of them that begins nearest, moved there)
columns   dtw_mm, frechet_mm, orientation_deg of the tool's path beside the held-out one, as of `tools.similarity`;
          unanswered, how many rounds were refused
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from tqdm import tqdm

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.demonstrations.rounds import close_rounds
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import continuous_signs, mean_rotation
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.experiments.folds import Fold
from geodesic_motion_studies.experiments.joint_imitation import tool_curve
from geodesic_motion_studies.tools.similarity import compare

Rounds = Demonstrations | JointDemonstrations
ROWS = ("geodesic", "mean_demonstration", "nearest_demonstration")
COLUMNS = ("dtw_mm", "frechet_mm", "orientation_deg")
_SAMPLES = 300


@dataclass(frozen=True)
class RoundReport:
    """Values (R, C) of each row and column by the number of the held-out demonstration and the seed; NaN where the
    planner refused. paths : of the tool, the one answered last and that of each row; () where none was.
    """

    task: str
    folds: tuple[Fold, ...]
    seeds: tuple[int, ...]
    held_out: dict[tuple[int, int], np.ndarray]
    paths: tuple[PoseCurve, ...]

    @property
    def rows(self) -> dict[str, dict[str, float | None]]:
        """Row -> column -> mean of what was answered, None where nothing was."""
        values = np.stack(list(self.held_out.values()))
        unanswered = np.isnan(values[:, :, 0])
        means = [[float(each.mean()) if len(each := values[~lost, row, column]) else None
                  for column in range(len(COLUMNS))] for row, lost in enumerate(unanswered.T)]  # fmt: skip
        return {
            name: dict(zip(COLUMNS, row, strict=True)) | {"unanswered": int(lost.sum())}
            for name, row, lost in zip(ROWS, means, unanswered.T, strict=True)
        }

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        each = [
            {"demonstration": number, "seed": seed, "row": row}
            | {column: None if np.isnan(value) else float(value) for column, value in zip(COLUMNS, of_row, strict=True)}
            for (number, seed), values in self.held_out.items()
            for row, of_row in zip(ROWS, values, strict=True)
        ]
        folds = [list(fold) for fold in self.folds]
        return {"task": self.task, "seeds": list(self.seeds), "folds": folds, "rows": self.rows, "held_out": each}

    def table(self) -> str:
        """The table as plain text."""
        folds = "/".join(",".join(map(str, fold)) for fold in self.folds)
        title = f"{self.task}, rounds: held out {folds}, seeds {', '.join(map(str, self.seeds))}"
        head = ["row", *(column.replace("_", " ") for column in COLUMNS), "unanswered"]
        return "\n".join([title, text_table(head, [[row, *values.values()] for row, values in self.rows.items()])])


def evaluate_rounds(
    rounds: Rounds,
    folds: Sequence[Fold],
    seeds: Sequence[int],
    train: Callable[[Rounds, int], Skill],
    task: str,
    show_progress: bool = True,
) -> RoundReport:
    """Predict each held-out round with a skill that `train` makes of the others and a seed, for all folds and seeds."""
    held_out, paths = {}, ()
    for seed, fold in tqdm([(seed, fold) for seed in seeds for fold in folds], desc=task, disable=not show_progress):
        shown, hidden = rounds.split(fold)
        planner = ReactivePlanner(train(shown, seed), PlannerSettings(), scene=DeclaredScene.empty())
        for number, item in zip(fold, hidden, strict=True):
            truth = _demonstrated_curve(item, planner.robot)
            predicted = [_planned(planner, item), *_without_manifold(shown, item, planner.robot)]
            held_out[number, seed] = np.array([_compared(curve, truth) for curve in predicted])
            if predicted[0] is not None:
                paths = truth, *predicted
    return RoundReport(task, tuple(folds), tuple(seeds), held_out, paths)


def _compared(curve: PoseCurve | None, truth: PoseCurve) -> tuple[float, float, float]:
    if curve is None:
        return np.nan, np.nan, np.nan
    found = compare(curve, truth)
    return 1e3 * found.dtw, 1e3 * found.frechet, float(np.degrees(found.orientation))


def _planned(planner: ReactivePlanner, item: Demonstration | JointDemonstration) -> PoseCurve | None:
    """The tool's path in the planned round from a round's first sample back to it; None: it is refused."""
    if isinstance(item, JointDemonstration):
        here = item.configurations[0]
        goal = planner.arm.queries.goal_by_configuration(here, TaskFrame.identity())
        plan = planner.plan_configurations(here, goal)
    else:
        pose = item.positions[0], item.quaternions[0]
        plan = planner.plan(*pose, *pose)
    return None if plan.reference is None else tool_curve(plan.reference.positions, planner.robot)


def _without_manifold(
    shown: Rounds, item: Demonstration | JointDemonstration, robot: Robot
) -> tuple[PoseCurve, PoseCurve]:
    """The tool's paths in the mean round and in the nearest one, moved to a round's first sample."""
    even = shown.resample(_SAMPLES)
    if isinstance(item, JointDemonstration):
        closed = np.stack([one.configurations for one in close_rounds(even, 0.0)])
        here = item.configurations[0]
        nearest = np.linalg.norm(closed[:, 0] - here, axis=1).argmin()
        mean, near = (tool_curve(path + here - path[0], robot) for path in (closed.mean(axis=0), closed[nearest]))
        return mean, near
    closed_poses = close_rounds(even, TrainingSettings.rotation_length)
    positions = np.stack([one.positions for one in closed_poses])
    turns = continuous_signs(mean_rotation(np.stack([one.quaternions for one in closed_poses])))
    nearest = np.linalg.norm(positions[:, 0] - item.positions[0], axis=1).argmin()
    mean, near = (path + item.positions[0] - path[0] for path in (positions.mean(axis=0), positions[nearest]))
    return PoseCurve(mean, turns), PoseCurve(near, closed_poses[int(nearest)].quaternions)


def _demonstrated_curve(item: Demonstration | JointDemonstration, robot: Robot) -> PoseCurve:
    if isinstance(item, JointDemonstration):
        return tool_curve(item.configurations, robot)
    return PoseCurve(item.positions, item.quaternions)
