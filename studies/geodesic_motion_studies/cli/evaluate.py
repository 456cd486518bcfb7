"""`evaluate`: how well held-out demonstrations are predicted, beside simpler predictors."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from geodesic_motion_ros.cli.arguments import (
    RECORDING_OPTIONS,
    HelpFormatter,
    add_json,
    add_recording,
    indices,
    writable,
)
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json

if TYPE_CHECKING:
    from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
    from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_studies.experiments.folds import Fold
    from geodesic_motion_studies.experiments.imitation import Progress, Sheet
    from geodesic_motion_studies.experiments.imitation_report import ImitationReport
    from geodesic_motion_studies.experiments.joint_imitation import JointImitationReport
    from geodesic_motion_studies.experiments.round_prediction import RoundReport, Rounds

_SHEETS = ("canonical", "raw")

_DESCRIPTION = """\
Trains on every fold with every seed and predicts the demonstrations that were held out from their start and goal
alone. Prints one row for the geodesic of the learned manifold and one for each simpler predictor.
"""
_EPILOG = """\
of the tool's poses
rows:     geodesic (the planner as it comes: canonical sheet, ridge, conditioning), geodesic_ridge (no conditioning),
          geodesic_canonical (no ridge), geodesic_raw (the paper's sheet), latent_line (straight in the raw latent
          space), conditional_mean (no manifold), sheet_oracle (the best there is on the sheet), task_line (straight in
          space), nearest_demonstration, mean_demonstration, dmp_nearest, promp, reconstruction (through the network),
          people (how far apart they are)
columns:  dtw_mm, frechet_mm, orientation_deg, to_closest_mm, endpoint_before_mm, endpoint_after_mm, off_manifold

of an arm's joints, for every family of demonstrations and for all
rows:     geodesic (inside the family of the demonstration), geodesic_any (through whichever is cheapest), latent_line,
          conditional_mean (no manifold), mean_demonstration, joint_line (straight in joint space),
          nearest_demonstration, dmp_nearest, promp, reconstruction, people
columns:  dtw_mm, orientation_deg, joint_dtw_rad, pointwise_mm, unanswered

of rounds, poses or joints, from which `train` learns a closed skill; each is predicted from where it begins
rows:     geodesic, mean_demonstration and nearest_demonstration, moved to the start
columns:  dtw_mm, frechet_mm, orientation_deg, unanswered

examples:
  geodesic-motion evaluate --demos pouring.npy --units cm --folds 0,3,6/1,4,7/2,5,8 --seeds 0,1,2 --json out/p.json
  geodesic-motion evaluate --demos letters.npy --units cm --columns px,py
  geodesic-motion evaluate --demos reach.npz --folds 4,9,14
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "evaluate", help="measure held-out demonstrations: the manifold beside simpler predictors",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    add_recording(parser, joints=True)
    parser.add_argument(
        "--folds", metavar="FOLDS",
        help="demonstrations to hold out, by number from 0, folds apart by slashes: 0,3,6/1,4,7/2,5,8; without it "
        "three folds that hold out each demonstration once",
    )  # fmt: skip
    parser.add_argument(
        "--splits", choices=("folds", "all"), default="folds",
        help="all: every choice of three held-out demonstrations, instead of --folds; 84 for nine, which takes hours",
    )  # fmt: skip
    parser.add_argument(
        "--sheets", type=_sheets, metavar="SHEETS",
        help="that are trained on, canonical,raw without it; the first is that of the row geodesic",
    )  # fmt: skip
    parser.add_argument(
        "--skills", type=Path, default=Path("out/experiments/skills"), metavar="FOLDER",
        help="where trained skills are kept; taken from there when data, settings and training code are the same",
    )  # fmt: skip
    parser.add_argument("--seeds", type=indices, default="0", metavar="SEEDS", help="one training each: 0,1,2")
    add_json(parser)
    parser.set_defaults(run=run)


def _sheets(text: str) -> tuple[str, ...]:
    sheets = tuple(text.split(","))
    if not set(sheets) <= {"canonical", "raw"} or len(set(sheets)) < len(sheets):
        raise argparse.ArgumentTypeError(f"{text!r} must be canonical, raw, or both apart by a comma")
    return sheets


def run(arguments: argparse.Namespace) -> None:
    """Measure, print the table, write the file."""
    from geodesic_motion_ros.cli.recorded import (
        read_joint_recording,
        read_recording,
        read_rounds,
        recorded_space,
        refuse_other_space,
    )
    from geodesic_motion_studies.experiments.folds import all_folds, default_folds, parse_folds

    space = recorded_space(arguments, arguments.demos)
    refuse_other_space(arguments, space, {"task": (*RECORDING_OPTIONS["task"], "sheets"), "joint": ("robot",)},
                       arguments.demos)
    read = read_joint_recording if space == "joint" else read_recording
    demonstrations = read(arguments, arguments.demos)
    rounds = read_rounds(arguments, arguments.demos, space)
    if rounds is not None and arguments.sheets is not None:
        raise ParameterError(f"--sheets: {arguments.demos} has rounds, which are learned on the canonical sheet alone")
    count = len(rounds or demonstrations)
    if arguments.splits == "all":
        folds = all_folds(count)
    else:
        folds = parse_folds(arguments.folds, count) if arguments.folds else default_folds(count)
    writable(arguments.json)
    if rounds is not None:
        report = _of_rounds(rounds, folds, arguments)
    else:
        report = (_of_joints if space == "joint" else _of_poses)(demonstrations, folds, arguments)
    print(report.table())
    if arguments.json is not None:
        write_json(arguments.json, report.as_dict())
        print(f"wrote {arguments.json}")


def _of_rounds(rounds: Rounds, folds: Sequence[Fold], arguments: argparse.Namespace) -> RoundReport:
    from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
    from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings
    from geodesic_motion_studies.experiments.round_prediction import evaluate_rounds
    from geodesic_motion_studies.experiments.trained import trained_once

    task, kind = arguments.demos.stem, JointTrainingSettings
    if not isinstance(rounds, JointDemonstrations):
        kind = TrainingSettings

    def train(shown: Rounds, seed: int) -> Skill:
        return trained_once(task, shown, kind(seed=seed, closed=True), arguments.skills)

    return evaluate_rounds(rounds, folds, arguments.seeds, train, task)


def _of_poses(demonstrations: Demonstrations, folds: Sequence[Fold], arguments: argparse.Namespace) -> ImitationReport:
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_studies.experiments.imitation import evaluate
    from geodesic_motion_studies.experiments.trained import trained_once

    task = arguments.demos.stem

    def train(shown: Demonstrations, seed: int, sheet: Sheet, progress: Progress) -> Skill:
        return trained_once(task, shown, TrainingSettings(seed=seed, sheet=sheet), arguments.skills, progress)

    sheets = arguments.sheets or _SHEETS
    return evaluate(demonstrations, folds, arguments.seeds, train, task, sheets=sheets)


def _of_joints(
    demonstrations: JointDemonstrations, folds: Sequence[Fold], arguments: argparse.Namespace
) -> JointImitationReport:
    from geodesic_motion_ros.learning.settings import JointTrainingSettings
    from geodesic_motion_studies.experiments.joint_imitation import evaluate_joints
    from geodesic_motion_studies.experiments.trained import trained_once

    task = arguments.demos.stem

    def train(shown: JointDemonstrations, seed: int, progress: Progress) -> Skill:
        return trained_once(task, shown, JointTrainingSettings(seed=seed), arguments.skills, progress)

    return evaluate_joints(demonstrations, folds, arguments.seeds, train, task)
