"""How well a held-out demonstration is predicted from its start and goal pose alone, beside simpler predictors.

For every fold, skills are trained on the other demonstrations, one per seed and sheet. Rows of the table:

geodesic               the planner's reference with default settings: on the canonical sheet, along the ridge of the
                       demonstrations, start and goal choosing between them where that was found to help
geodesic_ridge         the same without that choice
geodesic_canonical     the same without the ridge as well: the plain pull-back metric on the canonical sheet
geodesic_raw           the paper's: on the raw sheet
latent_line            straight line between the latent end points of geodesic_raw, decoded, ends moved
conditional_mean       what geodesic follows, without a manifold: the demonstrations' weighted mean, carried to the ends
sheet_oracle           the sheet's nearest poses to the held-out demonstration itself: the best path there is on it
task_line              straight line in position, great circle in orientation
nearest_demonstration  the training demonstration that begins and ends nearest, ends moved
mean_demonstration     mean of the training demonstrations over arc length, ends moved
dmp_nearest            Cartesian DMP of the nearest demonstration
promp                  ProMP conditioned on start and goal, ends moved
reconstruction         the held-out demonstration through encoder and decoder of the raw sheet
people                 human variation: mean over all pairs of demonstrations

Columns: means over held-out demonstrations, and seeds where something is trained; null where without meaning:

dtw_mm              mean position distance of the points matched by dynamic time warping, after resampling
                    both motions to 200 points by arc length
orientation_deg     mean angle between the orientations of the same matched points
frechet_mm          discrete Frechet distance of the positions
to_closest_mm       DTW to the closest training demonstration
endpoint_before_mm  mean distance of both ends from the demanded positions, before they are moved there; on a canonical
                    sheet, where carrying the sheet to start and goal comes before planning, after that
endpoint_after_mm   the same afterwards; endpoint_before_deg and endpoint_after_deg are the angles
off_manifold        fraction of the paths that leave the skill's support anywhere: rms sigma beyond 5 times
                    its 99th percentile on the training codes
unanswered          predictions for which the planner found no path; they count in no mean but off_manifold
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import product
from typing import Literal

from tqdm import tqdm

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.baselines import require_peers
from geodesic_motion_studies.experiments.crossing import Crossing, measure_crossings
from geodesic_motion_studies.experiments.folds import Fold
from geodesic_motion_studies.experiments.imitation_judge import Judge, people
from geodesic_motion_studies.experiments.imitation_report import ImitationReport, Measurement

Progress = Callable[[str, int, int], None]
"""Called as progress(stage, step, steps) while a skill is trained."""
Sheet = Literal["canonical", "raw"]
Train = Callable[[Demonstrations, int, Sheet, Progress], Skill]
"""train(demonstrations, seed, sheet, progress) -> skill."""


def evaluate(
    demonstrations: Demonstrations,
    folds: Sequence[Fold],
    seeds: Sequence[int],
    train: Train | None = None,
    task: str = "task",
    show_progress: bool = True,
    sheets: Sequence[Sheet] = ("canonical", "raw"),
) -> ImitationReport:
    """Train on every fold with every seed and measure all rows on the held-out demonstrations.

    Parameters
    ----------
    demonstrations : at least two; folds : indices to hold out, see `folds.parse_folds`; seeds : of the trainings.
    train : how a skill is learned; by default `train_task_space` with its default settings.
    task : name for the report. show_progress : a progress bar on standard error.
    sheets : that skills are trained on. The first is that of the row geodesic; rows of others stay empty.

    Raises
    ------
    DemonstrationError, ParameterError : folds or seeds that do not fit, before anything is trained.
    PeersMissingError : movement_primitives is not installed, likewise.
    """
    require_peers()
    folds, seeds = tuple(tuple(fold) for fold in folds), tuple(seeds)
    if not folds or not seeds:
        raise ParameterError("nothing to evaluate: give at least one fold and one seed")
    splits = [demonstrations.split(fold) for fold in folds]
    measurements: list[Measurement] = []
    crossings: list[Crossing] = []
    with tqdm(total=len(folds) * len(seeds) * len(sheets), desc=task, unit="skill", disable=not show_progress) as bar:
        for fold, (shown, held_out) in zip(folds, splits, strict=True):
            judge = Judge(shown, demonstrations.has_orientation)
            for index, item in zip(fold, held_out, strict=True):
                measurements += judge.baselines(index, item)
            for seed, sheet in product(seeds, sheets):
                skill = (train or train_task_space)(shown, seed, sheet, stage_shown_on(bar))
                measure = judge.on_canonical_sheet if sheet == "canonical" else judge.on_raw_sheet
                found = measure(skill, zip(fold, held_out, strict=True), seed)
                if sheet == sheets[0]:
                    default = "geodesic_conditioned" if sheet == "canonical" else "geodesic_raw"
                    found += [replace(item, row="geodesic") for item in found if item.row == default]
                measurements += found
                if skill.orientation_model == "two_cluster":
                    crossings += measure_crossings(skill, [item.curve for item in shown])
                bar.update()
    return ImitationReport(task, folds, seeds, people(demonstrations), tuple(measurements), tuple(crossings))


def train_task_space(demonstrations: Demonstrations, seed: int, sheet: Sheet, progress: Progress) -> Skill:
    """The default method to learn a skill: a task-space auto-encoder with default settings."""
    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.learning.training import train_skill

    return train_skill(demonstrations, TrainingSettings(seed=seed, sheet=sheet), progress=progress)


def stage_shown_on(bar: tqdm) -> Progress:
    """Show the stage of a training behind the bar; redrawn every twentieth, a training has thousands of steps."""

    def show(stage: str, step: int, steps: int) -> None:
        if step == 1 or 20 * step // steps > 20 * (step - 1) // steps:
            bar.set_postfix_str(f"{stage} {100 * step // steps} %")

    return show
