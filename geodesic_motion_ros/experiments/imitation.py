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

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial import cKDTree
from tqdm import tqdm

from geodesic_motion_ros.demonstrations.canonical import offsets_between
from geodesic_motion_ros.demonstrations.curves import Pose, PoseCurve
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.similarity import COMPARED_POINTS, compare, distance_to_closest
from geodesic_motion_ros.errors import DemonstrationError, ParameterError
from geodesic_motion_ros.experiments.baselines import PREDICTORS, Prediction, require_peers
from geodesic_motion_ros.experiments.crossing import Crossing, measure_crossings
from geodesic_motion_ros.graph.decoder import rms_sigma
from geodesic_motion_ros.graph.encoder import TaskSpaceEncoder
from geodesic_motion_ros.graph.transport import carried
from geodesic_motion_ros.planner import Plan, PlannerSettings, ReactivePlanner
from geodesic_motion_ros.quaternions import angle_between, continuous_signs
from geodesic_motion_ros.sheet import METRES_PER_RADIAN
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.tables import text_table, write_json

Progress = Callable[[str, int, int], None]
"""Called as progress(stage, step, steps) while a skill is trained."""
Sheet = Literal["canonical", "raw"]
Train = Callable[[Demonstrations, int, Sheet, Progress], Skill]
"""train(demonstrations, seed, sheet, progress) -> skill."""
Values = dict[str, float]
"""Column -> value of one prediction, NaN where it has no meaning."""
Fold = tuple[int, ...]

ROWS = (
    "geodesic",
    "geodesic_ridge",
    "geodesic_canonical",
    "geodesic_raw",
    "latent_line",
    "conditional_mean",
    "sheet_oracle",
    "task_line",
    "nearest_demonstration",
    "mean_demonstration",
    "dmp_nearest",
    "promp",
    "reconstruction",
    "people",
)
COLUMNS = (
    "dtw_mm",
    "frechet_mm",
    "orientation_deg",
    "to_closest_mm",
    "endpoint_before_mm",
    "endpoint_after_mm",
    "off_manifold",
)
ANGLE_COLUMNS = ("endpoint_before_deg", "endpoint_after_deg")
EVERY_END = PlannerSettings(maximum_offset=10.0, maximum_offset_angle=math.pi)
"""Held-out ends lie off the manifold by design; how far is a figure of the table, not a reason to refuse."""


@dataclass(frozen=True)
class Measurement:
    """Values of one row for held-out demonstration number `demonstration`; `seed` where one was trained.

    `refusal` is the planner's reason where it found no path, empty where there is an answer.
    """

    row: str
    demonstration: int
    seed: int | None
    values: Values
    refusal: str = ""


@dataclass(frozen=True)
class ImitationReport:
    """The held-out table of one task, with every single measurement it is made of."""

    task: str
    folds: tuple[Fold, ...]
    seeds: tuple[int, ...]
    people: Values
    measurements: tuple[Measurement, ...] = field(repr=False)
    crossings: tuple[Crossing, ...] = ()

    @property
    def rows(self) -> dict[str, dict[str, float | None]]:
        """Row -> column -> mean, None where there is no value."""
        return {row: self._row(row) for row in ROWS}

    def _row(self, row: str) -> dict[str, float | None]:
        of_row = [item for item in self.measurements if item.row == row]
        columns = (*COLUMNS, *ANGLE_COLUMNS)
        means = {column: _mean([item.values.get(column, math.nan) for item in of_row]) for column in columns}
        if row == "people":
            means |= {column: _finite(value) for column, value in self.people.items()}
        return means | {"unanswered": sum(bool(item.refusal) for item in of_row)}

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes; valid JSON, nothing in it is NaN."""
        return {
            "task": self.task,
            "seeds": list(self.seeds),
            "folds": [list(fold) for fold in self.folds],
            "rows": self.rows,
            "crossing": {
                "median_energy_ratio": float(np.median([item.ratio for item in self.crossings])),
                "flagged": float(np.mean([item.flagged for item in self.crossings])),
            }
            if self.crossings
            else None,
            "held_out": [
                {
                    "row": item.row,
                    "demonstration": item.demonstration,
                    "seed": item.seed,
                    "refusal": item.refusal or None,
                    **{column: _finite(value) for column, value in item.values.items()},
                }
                for item in self.measurements
            ],
        }

    def write_json(self, path: str | Path) -> None:
        """Write `as_dict` to a file, creating its folder."""
        write_json(path, self.as_dict())

    def table(self) -> str:
        """The table as plain text, a dash where a value has no meaning."""
        head = ["row", *(column.replace("_", " ") for column in COLUMNS)]
        body = [[row, *(self.rows[row][column] for column in COLUMNS)] for row in ROWS]
        folds = "/".join(",".join(map(str, fold)) for fold in self.folds)
        notes = [
            f"{row}: {values['unanswered']} prediction(s) without an answer, not in the means"
            for row, values in self.rows.items()
            if values["unanswered"]
        ]
        notes += self._in_words()
        if self.crossings:
            ratio = np.median([item.ratio for item in self.crossings])
            flagged = sum(item.flagged for item in self.crossings)
            notes.append(
                f"crossing to the cluster of -q: {ratio:.3g} times the energy within (median), flagged "
                f"{flagged} of {len(self.crossings)}"
            )
        title = f"{self.task}: held out {folds}, seeds {', '.join(map(str, self.seeds))}"
        return "\n".join([title, text_table(head, body), *notes])

    def _in_words(self) -> list[str]:
        """Where the geodesic's distance from what people did comes from."""
        rows = self.rows
        geodesic, mean, oracle = (rows[row]["dtw_mm"] for row in ("geodesic", "conditional_mean", "sheet_oracle"))
        if geodesic is None or mean is None or oracle is None:
            return []
        return [
            f"where the geodesic's {geodesic:.1f} mm come from: {oracle:.1f} mm no path on the sheet could avoid "
            f"(representation); {mean:.1f} mm the demonstrations' mean misses too, which start and goal do not tell "
            f"(unpredictable); {geodesic - mean:+.1f} mm is the shortest path's own (path choice)"
        ]


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
    demonstrations : at least two; folds : indices to hold out, see `parse_folds`; seeds : of the trainings.
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
            judge = _Judge(shown, demonstrations.has_orientation)
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
    return ImitationReport(task, folds, seeds, _people(demonstrations), tuple(measurements), tuple(crossings))


def train_task_space(demonstrations: Demonstrations, seed: int, sheet: Sheet, progress: Progress) -> Skill:
    """The default way to learn a skill: a task-space auto-encoder with default settings."""
    from geodesic_motion_ros.manifold.training import TrainingSettings, train_task_space_skill

    return train_task_space_skill(demonstrations, TrainingSettings(seed=seed, sheet=sheet), progress=progress)


def parse_folds(text: str, count: int) -> tuple[Fold, ...]:
    """Folds out of "0,3,6/1,4,7/2,5,8": indices to hold out, folds apart by slashes.

    Raises
    ------
    ParameterError
        Names the part that is no index of one of the `count` demonstrations, stands twice in a fold, or
        leaves nothing to train on.
    """
    folds = []
    for part in text.split("/"):
        try:
            fold = tuple(int(index) for index in part.split(","))
        except ValueError:
            raise ParameterError(
                f"folds '{text}': '{part}' is not a list of indices; write them like 0,3,6/1,4,7/2,5,8"
            ) from None
        wrong = [index for index in fold if index not in range(count)]
        if wrong:
            raise ParameterError(
                f"folds '{text}': there is no demonstration {wrong[0]}; the {count} are numbered 0 to {count - 1}"
            )
        if len(set(fold)) < len(fold):
            raise ParameterError(f"folds '{text}': '{part}' holds out a demonstration twice")
        if len(fold) == count:
            raise ParameterError(f"folds '{text}': '{part}' leaves no demonstration to train on")
        folds.append(fold)
    return tuple(folds)


def default_folds(count: int, folds: int = 3) -> tuple[Fold, ...]:
    """Every demonstration held out once: fold k holds out k, k + folds, k + 2 folds, ... of `count`."""
    if count < 2:
        raise DemonstrationError(f"{count} demonstration(s): at least 2 are needed to hold one out")
    folds = min(folds, count)
    return tuple(tuple(range(first, count, folds)) for first in range(folds))


def all_folds(count: int, held_out: int = 3) -> tuple[Fold, ...]:
    """Every way to hold out so many of `count` demonstrations; DemonstrationError where none is left to train on."""
    if count <= held_out:
        raise DemonstrationError(f"{count} demonstration(s): holding out {held_out} leaves none to train on")
    return tuple(combinations(range(count), held_out))


class _Judge:
    """Measures predictions for held-out demonstrations against these and the training demonstrations."""

    def __init__(self, shown: Demonstrations, has_orientation: bool) -> None:
        self.shown = shown
        self.has_orientation = has_orientation
        self._shown_curves = [item.curve for item in shown]

    def baselines(self, index: int, held_out: Demonstration) -> list[Measurement]:
        """The rows that need no training, and the distance of a person's motion to the closest one shown."""
        start, goal = held_out.curve.start, held_out.curve.goal
        measured = [
            Measurement(row, index, None, self._values(predict(self.shown, start, goal), held_out))
            for row, predict in PREDICTORS.items()
        ]
        closest = {"to_closest_mm": 1e3 * distance_to_closest(held_out.curve, self._shown_curves)}
        return [*measured, Measurement("people", index, None, closest)]

    def on_canonical_sheet(
        self, skill: Skill, held_out: Iterable[tuple[int, Demonstration]], seed: int
    ) -> list[Measurement]:
        """The rows of one skill with a canonical sheet."""
        planners = {
            "geodesic_conditioned": ReactivePlanner(skill, EVERY_END),
            "geodesic_ridge": ReactivePlanner(skill, replace(EVERY_END, query_conditioning=False)),
            "geodesic_canonical": ReactivePlanner(skill, replace(EVERY_END, ridge_strength=0.0)),
        }
        measured = []
        for index, item in held_out:
            for row, planner in planners.items():
                measured.append(self._geodesic(row, index, item, planner, seed)[0])
            mean = Prediction.between(conditional_mean(skill, *_ends(item)), *_ends(item))
            oracle = sheet_oracle(planners["geodesic_ridge"], item)
            measured.append(Measurement("conditional_mean", index, seed, self._values(mean, item)))
            if oracle is not None:
                measured.append(Measurement("sheet_oracle", index, seed, self._compared(oracle, item)))
        return measured

    def on_raw_sheet(
        self, skill: Skill, held_out: Iterable[tuple[int, Demonstration]], seed: int
    ) -> list[Measurement]:
        """The rows of one skill with a raw sheet."""
        planner = ReactivePlanner(skill, EVERY_END)
        measured = []
        for index, item in held_out:
            geodesic, plan = self._geodesic("geodesic_raw", index, item, planner, seed)
            line: Values = {}
            if plan.reference is not None:
                ends = plan.reference.latent[[0, -1]]
                straight = ends[0] + np.linspace(0.0, 1.0, len(plan.reference.latent))[:, None] * (ends[1] - ends[0])
                line = self._latent_line(skill, straight, item)
            measured.append(geodesic)
            measured.append(Measurement("latent_line", index, seed, line, geodesic.refusal))
            measured.append(Measurement("reconstruction", index, seed, self._reconstruction(skill, item)))
        return measured

    def _geodesic(
        self, row: str, index: int, held_out: Demonstration, planner: ReactivePlanner, seed: int
    ) -> tuple[Measurement, Plan]:
        start, goal = held_out.curve.start, held_out.curve.goal
        plan = planner.plan(*start, *goal)
        reference, verdict = plan.reference, plan.verdict
        if reference is None:
            refusal = f"{verdict.code.name}: {verdict.reason}"
            return Measurement(row, index, seed, {"off_manifold": _left_support(plan)}, refusal), plan
        curve = PoseCurve(reference.positions, reference.quaternions)
        values = self._compared(curve, held_out) | self._ends(curve, held_out, "after")
        if planner.skill.canonical is None:
            values["endpoint_before_mm"] = 500.0 * (verdict.start_offset + verdict.goal_offset)
            values["endpoint_before_deg"] = self._degrees([verdict.start_offset_angle, verdict.goal_offset_angle])
        else:
            values["endpoint_before_mm"] = 1e3 * verdict.end_correction
        values["off_manifold"] = _off_manifold(planner.skill, reference.latent)
        return Measurement(row, index, seed, values), plan

    def _latent_line(self, skill: Skill, latent: np.ndarray, held_out: Demonstration) -> Values:
        prediction = Prediction.between(_decoded(skill, latent), held_out.curve.start, held_out.curve.goal)
        return self._values(prediction, held_out) | {"off_manifold": _off_manifold(skill, latent)}

    def _reconstruction(self, skill: Skill, held_out: Demonstration) -> Values:
        curve = held_out.curve.resampled(200)
        latent = TaskSpaceEncoder.from_arrays(skill.encoder_arrays).encode(curve.positions, curve.quaternions)
        decoded = _decoded(skill, latent)
        values = self._compared(decoded, held_out) | self._ends(decoded, held_out, "before")
        return values | {"off_manifold": _off_manifold(skill, latent)}

    def _values(self, prediction: Prediction, held_out: Demonstration) -> Values:
        return (
            self._compared(prediction.corrected, held_out)
            | self._ends(prediction.uncorrected, held_out, "before")
            | self._ends(prediction.corrected, held_out, "after")
        )

    def _compared(self, curve: PoseCurve, held_out: Demonstration) -> Values:
        found = compare(curve, held_out.curve)
        return {
            "dtw_mm": 1e3 * found.dtw,
            "frechet_mm": 1e3 * found.frechet,
            "orientation_deg": self._degrees([found.orientation]),
            "to_closest_mm": 1e3 * distance_to_closest(curve, self._shown_curves),
        }

    def _ends(self, curve: PoseCurve, held_out: Demonstration, when: str) -> Values:
        """Mean distance [mm] and angle [deg] of both ends from the demanded poses."""
        pairs: list[tuple[Pose, Pose]] = [
            (curve.start, held_out.curve.start),
            (curve.goal, held_out.curve.goal),
        ]
        distances = [float(np.linalg.norm(reached[0] - asked[0])) for reached, asked in pairs]
        angles = [float(angle_between(reached[1], asked[1])) for reached, asked in pairs]
        return {
            f"endpoint_{when}_mm": 1e3 * float(np.mean(distances)),
            f"endpoint_{when}_deg": self._degrees(angles),
        }

    def _degrees(self, angles: list[float]) -> float:
        """Mean in degrees; NaN for recordings without orientation."""
        return math.degrees(float(np.mean(angles))) if self.has_orientation else math.nan


def conditional_mean(skill: Skill, start: Pose, goal: Pose) -> PoseCurve:
    """What a canonical skill's demonstrations predict for a query with no manifold: their weighted mean, carried."""
    sheet = skill.canonical
    assert sheet is not None
    offsets = [
        offsets_between(mean, pose[0][None], pose[1][None])[0]
        for mean, pose in ((skill.start_pose, start), (skill.goal_pose, goal))
    ]
    positions, quaternions = sheet.mean_curves(sheet.weights(*offsets, conditioned=True))
    s = np.linspace(0.0, 1.0, positions.shape[1])[:, None]
    # The mode that most demonstrations belong to.
    largest = int(np.argmax(np.bincount(sheet.modes)))
    blend = (1.0 - s) * offsets[0] + s * offsets[1]
    return PoseCurve(*carried(positions[largest], continuous_signs(quaternions[largest]), blend))


def sheet_oracle(planner: ReactivePlanner, held_out: Demonstration) -> PoseCurve | None:
    """The nearest supported pose of the sheet, carried to a demonstration's ends, to each pose of the demonstration.

    None where the sheet cannot be carried there.
    """
    query = planner.query(*held_out.curve.start, *held_out.curve.goal)
    if query is None:
        return None
    wanted = held_out.curve.resampled(COMPARED_POINTS)
    features = np.concatenate([query.graph.positions, METRES_PER_RADIAN * 2.0 * query.graph.quaternions], axis=1)
    tree = cKDTree(np.concatenate([features, features * [1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0]]))
    asked = np.concatenate([wanted.positions, METRES_PER_RADIAN * 2.0 * wanted.quaternions], axis=1)
    nearest = tree.query(asked)[1] % len(features)
    return PoseCurve(query.graph.positions[nearest], continuous_signs(query.graph.quaternions[nearest]))


def _ends(demonstration: Demonstration) -> tuple[Pose, Pose]:
    return demonstration.curve.start, demonstration.curve.goal


def _people(demonstrations: Demonstrations) -> Values:
    """How far apart people's own demonstrations are: means over all pairs."""
    pairs = [compare(first.curve, second.curve) for first, second in combinations(demonstrations, 2)]
    turned = float(np.mean([pair.orientation for pair in pairs]))
    return {
        "dtw_mm": 1e3 * float(np.mean([pair.dtw for pair in pairs])),
        "frechet_mm": 1e3 * float(np.mean([pair.frechet for pair in pairs])),
        "orientation_deg": math.degrees(turned) if demonstrations.has_orientation else math.nan,
    }


def _decoded(skill: Skill, latent: np.ndarray) -> PoseCurve:
    decoded = skill.decoder.decode(latent)
    return PoseCurve(decoded.positions, continuous_signs(decoded.quaternions))


def _off_manifold(skill: Skill, latent: np.ndarray) -> float:
    """1 where any point (n, d) of a path lies outside the support, else 0."""
    sigma, _ = skill.decoder.uncertainty(latent)
    return float(np.max(rms_sigma(sigma)) > skill.sigma_limit)


def _left_support(plan: Plan) -> float:
    """1 or 0 where a path was found and refused, NaN where there was none to judge."""
    return float(not plan.verdict.in_support) if math.isfinite(plan.verdict.energy_per_edge) else math.nan


def stage_shown_on(bar: tqdm) -> Progress:
    """Show the stage of a training behind the bar; redrawn every twentieth, a training has thousands of steps."""

    def show(stage: str, step: int, steps: int) -> None:
        if step == 1 or 20 * step // steps > 20 * (step - 1) // steps:
            bar.set_postfix_str(f"{stage} {100 * step // steps} %")

    return show


def _mean(values: list[float]) -> float | None:
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else None


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
