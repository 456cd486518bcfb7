"""How well a held-out motion of the whole arm is predicted from its first and last configuration alone.

For every fold, skills are trained on the other demonstrations, one per seed. Rows of the table, each for every family
(of the task, see `demonstrations.modes`) and for all:

geodesic            the planner's reference, inside the family of the held-out demonstration
geodesic_fastest    the same, as fast as the limits allow
geodesic_any        the same through whichever family is the cheapest: from starts and goals that families share
latent_line         straight line between the latent ends of geodesic, decoded, carried to start and goal as that is
conditional_mean    what geodesic follows, without a manifold: the demonstrations' weighted mean, carried to start and
                    goal with the skill's fade (`demonstrations.fade`)
mean_demonstration  the mean of the family's demonstrations along their arcs, carried to start and goal, offsets fading
                    linearly
joint_line, nearest_demonstration, dmp_nearest, promp
                    those of `joint_baselines`, of the family's demonstrations, carried to start and goal
reconstruction      the held-out demonstration through encoder and decoder; its start and goal offsets are known
people              how far apart demonstrations of the family are: mean over all pairs

Columns, means over held-out demonstrations and seeds; the tool's are those of `studies.tools.similarity`:

dtw_mm, orientation_deg  mean distance and angle of the tool's poses that are matched by dynamic time warping
joint_dtw_rad            mean distance |dtheta| of the matched configurations, after resampling both motions to as many
                         points along the body's arc (`demonstrations.canonical`) and warping in joint space
pointwise_mm             mean distance of the tool at equal fractions of the body's arc, nothing warped
speed_mm_s               mean difference of the tool's speeds there, of rows and recordings that have times; a ProMP
                         takes as long as its demonstrations on average, a DMP as long as the nearest of them
unanswered               predictions that the planner refused; they count in no mean
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from tqdm import tqdm

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.canonical import ConfigurationForm, body_arc, remove_offsets, sample_body_arc
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.encoder import JointSpaceEncoder
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.configuration_query import ConfigurationGoal, ConfigurationQueryBuilder
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.experiments.baselines import SAMPLES, require_peers
from geodesic_motion_studies.experiments.folds import Fold
from geodesic_motion_studies.experiments.imitation import Progress, stage_shown_on
from geodesic_motion_studies.experiments.joint_baselines import JOINT_PREDICTORS, nearest
from geodesic_motion_studies.tools.averages import mean
from geodesic_motion_studies.tools.similarity import COMPARED_POINTS, compare, dtw_matching

TrainJoints = Callable[[JointDemonstrations, int, Progress], Skill]
"""train(demonstrations, seed, progress) -> skill."""

ROWS = (
    "geodesic", "geodesic_fastest", "geodesic_any", "latent_line", "conditional_mean", "mean_demonstration",
    *JOINT_PREDICTORS, "reconstruction", "people",
)  # fmt: skip
#: What is taken for the time of a step that takes none [s].
_SHORTEST_STEP = 1e-4
COLUMNS = ("dtw_mm", "orientation_deg", "joint_dtw_rad", "pointwise_mm", "speed_mm_s")


@dataclass(frozen=True)
class JointMeasurement:
    """Values of one row for held-out demonstration number `demonstration`, of a family.

    `seed` : where something was trained, else None.
    `refusal` : the planner's reason where it found no path, else empty.
    """

    row: str
    demonstration: int
    family: int
    seed: int | None
    values: dict[str, float]
    refusal: str = ""


@dataclass(frozen=True)
class JointImitationReport:
    """The held-out table of one task, with every single measurement it is made of.

    `families` : (N,) the family of every demonstration of the recording, numbered from 0.
    """

    task: str
    folds: tuple[Fold, ...]
    seeds: tuple[int, ...]
    families: tuple[int, ...]
    measurements: tuple[JointMeasurement, ...] = field(repr=False)

    def means(self, row: str, family: int | None = None) -> dict[str, float | None]:
        """Column -> mean of a row over the demonstrations of one family, or of all; None where there is no value."""
        of_row = [item for item in self.measurements if item.row == row and family in (None, item.family)]
        means = {column: mean([item.values.get(column, math.nan) for item in of_row]) for column in COLUMNS}
        return means | {"unanswered": sum(bool(item.refusal) for item in of_row)}

    def table(self) -> str:
        """The table as plain text, a dash where there is no value."""
        columns = (*COLUMNS, "unanswered")
        head = ["row", "family", *(column.replace("_", " ") for column in columns)]
        body = [
            [row, "all" if family is None else str(family), *(means[column] for column in columns)]
            for row in ROWS
            for family in (*sorted(set(self.families)), None)
            for means in [self.means(row, family)]
        ]
        folds = "/".join(",".join(map(str, fold)) for fold in self.folds)
        title = f"{self.task}: held out {folds}, seeds {', '.join(map(str, self.seeds))}"
        refusals = sorted({f"{item.row}: {item.refusal}" for item in self.measurements if item.refusal})
        return "\n".join([title, text_table(head, body, digits=3), *refusals])

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        families = sorted(set(self.families))
        rows = {
            row: {"all": self.means(row), **{str(family): self.means(row, family) for family in families}}
            for row in ROWS
        }
        return {
            "task": self.task,
            "seeds": list(self.seeds),
            "folds": [list(fold) for fold in self.folds],
            "families": list(self.families),
            "rows": rows,
            "held_out": [
                {
                    "row": item.row, "demonstration": item.demonstration, "family": item.family, "seed": item.seed,
                    "refusal": item.refusal or None, **item.values,
                }
                for item in self.measurements
            ],
        }  # fmt: skip


def evaluate_joints(
    demonstrations: JointDemonstrations,
    folds: Sequence[Fold],
    seeds: Sequence[int],
    train: TrainJoints | None = None,
    task: str = "task",
    show_progress: bool = True,
) -> JointImitationReport:
    """Train on every fold with every seed and measure all rows on the held-out demonstrations.

    Parameters
    ----------
    folds : indices to hold out, see `folds.parse_folds`; seeds : of the trainings.
    train : how a skill is learned; None: `train_skill` with its default settings.
    task : name for the report. show_progress : a progress bar on standard error.

    Raises
    ------
    DemonstrationError, ParameterError : folds or seeds that do not fit, before anything is trained.
    PeersMissingError : movement_primitives is not installed, likewise.
    """
    require_peers()
    folds, seeds = tuple(tuple(fold) for fold in folds), tuple(seeds)
    if not folds or not seeds:
        raise ParameterError("nothing to evaluate: give at least one fold and one seed")
    robot, metric = Robot.named(demonstrations.robot), JointMetricSettings()
    families = ConfigurationForm(demonstrations, robot, metric).modes
    judges = [_Judge(demonstrations, fold, families, robot, metric) for fold in folds]
    measurements: list[JointMeasurement] = []
    with tqdm(total=len(folds) * len(seeds), desc=task, unit="skill", disable=not show_progress) as bar:
        for judge in judges:
            measurements += judge.baselines()
            for seed in seeds:
                measurements += judge.of_skill((train or _train)(judge.shown, seed, stage_shown_on(bar)), seed)
                bar.update()
    people = _people(judges[0].curves, families, robot)
    return JointImitationReport(task, folds, seeds, tuple(families.tolist()), (*measurements, *people))


def within_demonstrations(skill: Skill, shown: np.ndarray) -> Skill:
    """The skill with a support only where some of its demonstrations (mask (N,)) run.

    The kernels of sigma that lie nearer to the codes of the others, and not within their own width of these, are
    switched off: there sigma is as large as far from all data.
    """
    dimension = skill.codes.shape[-1]
    if np.all(shown):
        return skill
    decoder = skill.decoder
    own, others = (
        cKDTree(skill.codes[mask].reshape(-1, dimension)).query(decoder.rbf_centres)[0] for mask in (shown, ~shown)
    )
    kept = (own <= others) | (own < 1.0 / math.sqrt(2.0 * float(decoder.rbf_rate)))
    return replace(skill, decoder=replace(decoder, sigma_weights=np.where(kept, decoder.sigma_weights, 0.0)))


def _train(demonstrations: JointDemonstrations, seed: int, progress: Progress) -> Skill:
    from geodesic_motion_ros.learning.settings import JointTrainingSettings
    from geodesic_motion_ros.learning.training import train_skill

    return train_skill(demonstrations, JointTrainingSettings(seed=seed), progress=progress)


class _Judge:
    """Measures predictions for the held-out demonstrations of one fold.

    `curves` : (N, S, eta) all demonstrations, equally spaced along the body's arc [rad]. `times` : (N, S) [s] theirs.
    """

    def __init__(
        self,
        demonstrations: JointDemonstrations,
        fold: Fold,
        families: np.ndarray,
        robot: Robot,
        metric: JointMetricSettings,
    ) -> None:
        self.shown, _ = demonstrations.split(fold)
        self.curves = np.stack(
            [sample_body_arc(item.configurations, robot, metric, COMPARED_POINTS) for item in demonstrations]
        )
        self.times = ConfigurationForm(demonstrations, robot, metric, fade=1.0).times(COMPARED_POINTS)
        self._has_times = demonstrations.has_times
        self._robot, self._metric, self._fold, self._families = robot, metric, fold, families
        self._shown_families = np.delete(families, fold)
        lost = set(families.tolist()) - set(self._shown_families.tolist())
        if lost:
            raise ParameterError(
                f"holding out {','.join(map(str, fold))} leaves no demonstration of family {min(lost)} to train on"
            )
        self._form = ConfigurationForm(self.shown, robot, metric, fade=1.0).sheet(COMPARED_POINTS)

    def baselines(self) -> list[JointMeasurement]:
        """The rows that need no training."""
        measured = []
        for index in self._fold:
            held_out = self.curves[index]
            own = np.flatnonzero(self._shown_families == self._families[index])
            family = replace(self.shown, items=tuple(self.shown[number] for number in own))
            paths = {"mean_demonstration": self._form.configurations[own].mean(axis=0)}
            paths |= {row: predict(family, *held_out[[0, -1]]) for row, predict in JOINT_PREDICTORS.items()}
            times = _baseline_times(family, *held_out[[0, -1]])
            measured += [
                self._measured(row, index, None, self._meeting(path, held_out), times.get(row))
                for row, path in paths.items()
            ]
        return measured

    def of_skill(self, skill: Skill, seed: int) -> list[JointMeasurement]:
        """The rows of one skill."""
        measured = [self._measured("reconstruction", index, seed, self._rebuilt(skill, index)) for index in self._fold]
        measured += self._planned("geodesic_any", skill, self._fold, seed)
        for family in np.unique(self._families[list(self._fold)]):
            inside = within_demonstrations(skill, self._shown_families == family)
            own = [index for index in self._fold if self._families[index] == family]
            measured += self._planned("geodesic", inside, own, seed)
            measured += self._planned("geodesic_fastest", inside, own, seed, PlannerSettings(timing="fastest"))
            if skill.canonical is not None:
                measured += [self._measured("conditional_mean", i, seed, self._conditional(skill, i)) for i in own]
        return measured

    def _planned(
        self, row: str, skill: Skill, indices: Sequence[int], seed: int, settings: PlannerSettings | None = None
    ) -> Iterator[JointMeasurement]:
        """The planner's path for every demonstration, and beside geodesic the row of the latent line."""
        planner = ReactivePlanner(skill, settings)
        queries = ConfigurationQueryBuilder(skill, planner.graph, planner.settings, planner.robot, planner.collision)
        for index in indices:
            start, goal = self.curves[index, 0], ConfigurationGoal(self.curves[index, -1:], "that of the demonstration")
            plan = planner.plan_configurations(start, goal)
            if plan.reference is None:
                refusal = f"demonstration {index}: {plan.verdict.code.name}: {plan.verdict.reason}"
                yield JointMeasurement(row, index, int(self._families[index]), seed, {}, refusal)
                continue
            reference = plan.reference
            times = np.linspace(0.0, reference.duration, 10 * COMPARED_POINTS)
            yield self._measured(row, index, seed, reference.samples(times)[0], times)
            if row == "geodesic":
                ends = reference.latent[[0, -1]]
                line = ends[0] + np.linspace(0.0, 1.0, COMPARED_POINTS)[:, None] * (ends[1] - ends[0])
                carried = queries.build(start, goal).offsets.carried(
                    skill.decoder.configurations(line), *planner.graph.progress_map(line)
                )
                path = self._meeting(carried, self.curves[index])
                yield self._measured("latent_line", index, seed, path)

    def _conditional(self, skill: Skill, index: int) -> np.ndarray:
        """The weighted mean of a canonical skill's demonstrations of the family, carried to a held-out one's ends."""
        sheet, held_out = skill.canonical, self.curves[index]
        family = self._shown_families == self._families[index]
        poles = (sheet.start_poles, sheet.goal_poles)
        offsets = [held_out[end] - _nearest(poles[end], held_out[end]) for end in (0, -1)]
        # Of all modes the one that holds most of the family.
        mode = int(np.argmax(np.bincount(sheet.modes[family])))
        weights = sheet.weights(*offsets, conditioned=True)[mode]
        return self._meeting(np.einsum("n,nsj->sj", weights, sheet.configurations), held_out, skill.fade)

    def _meeting(self, path: np.ndarray, held_out: np.ndarray, fade: float = 1.0) -> np.ndarray:
        """A path (n, eta) carried so that it begins and ends as the held-out motion."""
        offsets = JointOffsets.between(self._robot, path[[0, -1]], held_out[[0, -1]], fade=fade)
        return path + offsets.displacements(path, np.linspace(0.0, 1.0, len(path)))

    def _rebuilt(self, skill: Skill, index: int) -> np.ndarray:
        """A demonstration through encoder and decoder, in the form that the skill has learned."""
        held_out = self.curves[index]
        encoder = JointSpaceEncoder.from_arrays(skill.encoder_arrays)
        if skill.canonical is None:
            return skill.decoder.configurations(encoder.encode(held_out))
        canonical, poles = as_learned(skill, held_out, self._robot)
        rebuilt = skill.decoder.configurations(encoder.encode(canonical))
        offsets = JointOffsets.between(self._robot, poles, held_out[[0, -1]], fade=skill.fade)
        return rebuilt + offsets.displacements(rebuilt, np.linspace(0.0, 1.0, len(rebuilt)))

    def _measured(
        self, row: str, index: int, seed: int | None, path: np.ndarray, times: np.ndarray | None = None
    ) -> JointMeasurement:
        """The values of a path (n, eta) that is passed at times (n,) [s], if it has any."""
        curve = sample_body_arc(path, self._robot, self._metric, COMPARED_POINTS)
        values = _compared(curve, self.curves[index], self._robot)
        if times is not None and self._has_times:
            arc = body_arc(path, self._robot, self._metric)
            passed = np.interp(np.linspace(0.0, arc[-1], COMPARED_POINTS), arc, times)
            shown = tool_speeds(self.curves[index], self.times[index], self._robot)
            off = tool_speeds(curve, passed, self._robot) - shown
            values["speed_mm_s"] = 1e3 * float(np.abs(off).mean())
        return JointMeasurement(row, index, int(self._families[index]), seed, values)


def tool_speeds(configurations: np.ndarray, times: np.ndarray, robot: Robot) -> np.ndarray:
    """Mean speeds (n - 1,) [m/s] of the tool between configurations (n, eta) at times (n,) [s]."""
    steps = np.linalg.norm(np.diff(tool_curve(configurations, robot).positions, axis=0), axis=1)
    return steps / np.maximum(np.diff(times), _SHORTEST_STEP)


def _baseline_times(train: JointDemonstrations, start: np.ndarray, goal: np.ndarray) -> dict[str, np.ndarray]:
    """Times (SAMPLES,) [s] of the baselines' motions, by their names."""
    durations = [item.times[-1] - item.times[0] for item in train]
    shown = nearest(train, start, goal)
    return {
        "nearest_demonstration": shown.resample(SAMPLES).times - shown.times[0],
        "dmp_nearest": np.linspace(0.0, shown.times[-1] - shown.times[0], SAMPLES),
        "promp": np.linspace(0.0, np.mean(durations), SAMPLES),
    }


def as_learned(skill: Skill, curve: np.ndarray, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Take a motion (S, eta) to the canonical sheet of a skill; with the poles (2, eta) that its ends are nearest to.

    It is equally spaced along the body's arc.
    """
    sheet = skill.canonical
    poles = np.stack([_nearest(sheet.start_poles, curve[0]), _nearest(sheet.goal_poles, curve[-1])])
    return remove_offsets(curve, poles, curve[[0, -1]], robot, skill.fade), poles


def _nearest(poles: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The one of poles (G, eta) that is nearest to an end (eta,)."""
    return poles[np.argmin(np.linalg.norm(poles - end, axis=1))]


def _compared(first: np.ndarray, second: np.ndarray, robot: Robot) -> dict[str, float]:
    """The columns for two motions (S, eta), equally spaced along the body's arc."""
    one, other = tool_curve(first, robot), tool_curve(second, robot)
    found = compare(one, other)
    rows, columns = dtw_matching(first, second).T
    return {
        "dtw_mm": 1e3 * found.dtw,
        "orientation_deg": math.degrees(found.orientation),
        "joint_dtw_rad": float(np.linalg.norm(first[rows] - second[columns], axis=1).mean()),
        "pointwise_mm": 1e3 * float(np.linalg.norm(one.positions - other.positions, axis=1).mean()),
    }


def tool_curve(configurations: np.ndarray, robot: Robot) -> PoseCurve:
    positions, quaternions = end_effector_poses(np.ascontiguousarray(configurations), robot.chain)
    return PoseCurve(positions, continuous_signs(quaternions))


def _people(curves: np.ndarray, families: np.ndarray, robot: Robot) -> list[JointMeasurement]:
    """How far apart demonstrations of one family are, a measurement per pair."""
    return [
        JointMeasurement("people", first, int(families[first]), None, _compared(curves[first], curves[second], robot))
        for first, second in combinations(range(len(curves)), 2)
        if families[first] == families[second]
    ]
