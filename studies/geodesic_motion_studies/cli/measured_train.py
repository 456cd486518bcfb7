"""`train` that also measures how well held-out demonstrations are predicted, as `evaluate` does."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from geodesic_motion_ros.cli import train

if TYPE_CHECKING:
    from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
    from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
    from geodesic_motion_ros.skill.skill import Skill

#: Rows of `evaluate` that the figures of a skill stand beside.
_BESIDE = ("people", "mean_demonstration", "promp", "dmp_nearest")
_BESIDE_JOINTS = ("reconstruction", *_BESIDE, "joint_line")


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    measures = {"task": train.Measure(_peers, _of_poses), "joint": train.Measure(_peers, _of_joints)}
    train.add_command(commands, measures)


def _peers() -> None:
    from geodesic_motion_studies.experiments.baselines import require_peers

    require_peers()


def _of_poses(demonstrations: Demonstrations, held_out: tuple[int, ...], seed: int, skill: Skill) -> dict[str, Any]:
    """Figures of the rows geodesic, people and simpler predictors of `evaluate`, for one skill."""
    from geodesic_motion_studies.experiments.imitation import evaluate

    if skill.period is not None:
        return _of_rounds(demonstrations, held_out, seed, skill)

    rows = evaluate(
        demonstrations, [held_out], [seed], lambda *_: skill, show_progress=False, sheets=[skill.sheet]
    ).rows  # fmt: skip
    figures = {f"held_out_{column}": value for column, value in rows["geodesic"].items()}
    figures |= {f"{row}_{column}": rows[row][column] for row in _BESIDE for column in ("dtw_mm", "orientation_deg")}
    return {name: value for name, value in figures.items() if value is not None}


def _of_joints(
    demonstrations: JointDemonstrations, held_out: tuple[int, ...], seed: int, skill: Skill
) -> dict[str, Any]:
    """Figures of the rows geodesic, reconstruction, people and simpler predictors of `evaluate`, for one skill."""
    from geodesic_motion_studies.experiments.joint_imitation import evaluate_joints

    if skill.period is not None:
        return _of_rounds(demonstrations, held_out, seed, skill)
    report = evaluate_joints(demonstrations, [held_out], [seed], lambda *_: skill, show_progress=False)
    return {
        f"{name}_{column}": value
        for name, row in (("held_out", "geodesic"), *((row, row) for row in _BESIDE_JOINTS))
        for column, value in report.means(row).items()
        if value is not None
    }


def _of_rounds(
    rounds: Demonstrations | JointDemonstrations, held_out: tuple[int, ...], seed: int, skill: Skill
) -> dict[str, Any]:
    """Figures of all rows of `evaluate`, for one closed skill."""
    from geodesic_motion_studies.experiments.round_prediction import evaluate_rounds

    rows = evaluate_rounds(rounds, [held_out], [seed], lambda *_: skill, skill.name, show_progress=False).rows
    return {
        f"{'held_out' if row == 'geodesic' else row}_{column}": value
        for row, values in rows.items()
        for column, value in values.items()
        if value is not None
    }
