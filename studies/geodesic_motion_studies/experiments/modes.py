"""Two modes of a task: does a geodesic follow one of them, and does it take the other when the first is blocked?

The simulated teacher takes something past a pillar, as often on its left as on its right
(`teacher.two_mode_demonstrations`); one skill per seed is learned from all of it. Starts and goals are drawn anew from
what was shown. Then:

- the planner plans. Its answer follows a mode if the middle half of its arc is nearer to that mode than NEAR times the
  distance between the modes, and the tool does not touch the pillar, which the planner does not know;
- a sphere is put on that answer, large enough to block the mode it follows, and the planner plans again. It switched if
  the answer follows the other mode, clear of the sphere.

A mode is judged by the mean of the demonstrations on that side of the pillar, by the teacher's account and not by the
skill's, its ends moved to the present start and goal. Clearances are measured on the dense curve, with nothing of the
planner's own certificate. The control is what a method that knows no modes does: the mean of all demonstrations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from scipy.spatial import cKDTree
from tqdm import tqdm

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.geometry.curves import Pose, PoseCurve, arc_length_fractions, interpolate
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.simulation.teacher import PILLAR, SIDES, draw_passing_query, two_mode_demonstrations
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION
from geodesic_motion_studies.experiments.avoidance import carried, free_share, measured_clearance
from geodesic_motion_studies.experiments.baselines import mean_demonstration
from geodesic_motion_studies.experiments.study import OfOwnData, Report, option, seeds, steps
from geodesic_motion_studies.experiments.trained import task_training, trained_once
from geodesic_motion_studies.tools.averages import mean

TASK = "past_a_pillar"
#: A path follows a mode within this share of the distance between the modes; half would be in between.
NEAR = 0.25
#: Where on the answer the sphere is put, in fractions of its arc length, and its radius [m].
BLOCKED_AT = (0.35, 0.65)
BLOCKING_RADII = (0.06, 0.08)
_SAMPLES = 400


@dataclass(frozen=True)
class Modes(OfOwnData):
    """Show, train, and make the cases of every seed, of data, training and cases alike.

    training : its seed is replaced; None: the defaults, but for `steps`.
    """

    shown: int = option(6, "demonstrations of each mode that a skill is learned from", least=2)
    cases: int = option(40, "starts and goals that are requested of each skill", least=1)
    seeds: tuple[int, ...] = seeds("of data and training, one skill each")
    steps: int | None = steps()
    training: TrainingSettings | None = None
    planner: PlannerSettings = field(default_factory=PlannerSettings)

    def measure(self, out: Path) -> ModesReport:
        base = self.training or task_training(self.steps)
        drawn: list[list[Drawn]] = []
        modes, shown = {}, []
        for seed in tqdm(self.seeds, desc="modes", unit="seed"):
            shown.append(two_mode_demonstrations(self.shown, seed))
            skill = trained_once(TASK, shown[-1], replace(base, seed=seed), out / "skills")
            modes[seed] = () if skill.canonical is None else tuple(skill.canonical.modes.tolist())
            drawn.append(cases_of(skill, shown[-1], seed, self))
        cases = tuple(item.case for of_seed in drawn for item in of_seed)
        return ModesReport(self, cases, modes, tuple(item.positions for item in shown[0]), tuple(drawn[0]))

    def saved(self) -> tuple[Demonstrations, str]:
        shown = two_mode_demonstrations(self.shown, self.seeds[0])
        return shown, f"first {self.shown} on the left of the pillar, then as many on its right"


@dataclass(frozen=True)
class Answer:
    """What the planner returned.

    Attributes
    ----------
    code, reason : the verdict, empty for what no planner returned. answered : whether there was a reference.
    side : the mode that it is nearer to; distance : how far its middle half is from there, on average [m].
    between : how far the modes are from each other there [m].
    pillar : smallest distance of the tool's spheres from the pillar [m]. All of these NaN, "" without a reference.
    """

    code: str
    reason: str
    answered: bool
    side: str = ""
    distance: float = math.nan
    between: float = math.nan
    pillar: float = math.nan

    @property
    def follows(self) -> bool:
        """Whether it follows one of the modes, and not the pillar."""
        return self.answered and self.distance < NEAR * self.between and self.pillar > 0.0


@dataclass(frozen=True)
class FailedAttempts:
    """A sphere on the first answer.

    Attributes
    ----------
    centre, radius : of the sphere [m].
    own_free, other_free : share of the demonstrations of the answer's mode, and of the other, that would stay clear.
    answer : with the sphere there; clearance : of it from the sphere, as measured [m], NaN without a reference.
    """

    centre: tuple[float, float, float]
    radius: float
    own_free: float
    other_free: float
    answer: Answer
    clearance: float


@dataclass(frozen=True)
class Case:
    """One start and goal: the answer without obstacles, then with a sphere on it (None where there was no answer).

    `mean` is the mean of all demonstrations, judged like an answer.
    """

    seed: int
    number: int
    free: Answer
    blocked: FailedAttempts | None
    mean: Answer

    @property
    def switched(self) -> bool:
        """Whether blocking the mode made the planner follow the other one, clear of the sphere."""
        blocked = self.blocked
        return (
            blocked is not None
            and blocked.answer.follows
            and blocked.answer.side != self.free.side
            and blocked.clearance > 0.0
        )


@dataclass(frozen=True)
class Drawn:
    """A case to be drawn: positions (n, 3) [m] of both answers and of the mean, and the case; None where unanswered."""

    case: Case
    free: np.ndarray | None
    blocked: np.ndarray | None
    mean: np.ndarray


@dataclass(frozen=True)
class ModesReport(Report):
    """All cases; by seed which mode the skill found each demonstration in; the first seed's motions.

    `shown` are the positions of the demonstrations, `drawn` the cases.
    """

    settings: Modes
    cases: tuple[Case, ...]
    modes: dict[int, tuple[int, ...]]
    shown: tuple[np.ndarray, ...] = field(repr=False)
    drawn: tuple[Drawn, ...] = field(repr=False)

    def found(self, seed: int) -> bool:
        """Whether the modes that the skill of a seed found are the sides of the pillar."""
        return self.modes[seed] == tuple(side for side in range(len(SIDES)) for _ in range(self.settings.shown))

    def summary(self, seed: int | None = None) -> dict[str, float | int | None]:
        """The figures of one seed or of all."""
        cases = [case for case in self.cases if seed is None or case.seed == seed]
        answers = [case.free for case in cases if case.free.answered]
        blocked = [case.blocked for case in cases if case.blocked is not None]
        clear = [1e3 * item.clearance for item in blocked if item.answer.answered]
        return {
            "cases": len(cases),
            "on_the_left": sum(answer.side == SIDES[0] for answer in answers),
            "follow_percent": mean([100.0 * case.free.follows for case in cases]),
            "farthest_off_mm": 1e3 * max((answer.distance for answer in answers), default=math.nan),
            "between_mm": 1e3 * float(np.mean([case.mean.between for case in cases])),
            "switch_percent": mean([100.0 * case.switched for case in cases]),
            "blocked_unanswered": len(blocked) - len(clear),
            "through_the_sphere": sum(not value > 0.0 for value in clear),
            "least_clearance_mm": min(clear, default=None),
            "own_mode_blocked_percent": mean([100.0 * (item.own_free == 0.0) for item in blocked]),
            "other_mode_free_percent": mean([100.0 * (item.other_free == 1.0) for item in blocked]),
            "mean_follows_percent": mean([100.0 * case.mean.follows for case in cases]),
            "mean_through_pillar_percent": mean([100.0 * (not case.mean.pillar > 0.0) for case in cases]),
        }

    def as_dict(self) -> dict[str, Any]:
        return {
            "settings": asdict(self.settings),
            "summary": self.summary(),
            "seeds": {seed: self.summary(seed) | {"modes_found": self.found(seed)} for seed in self.modes},
            "cases": [asdict(case) | {"follows": case.free.follows, "switched": case.switched} for case in self.cases],
        }

    def table(self) -> str:
        """The table as plain text, with what went wrong."""
        head = [
            "seed", "modes found", "cases", "left", "follow %", "off mm", "of mm", "switch %", "unanswered", "through",
            "least mm", "own blocked %", "other free %", "mean follows %", "mean hits pillar %",
        ]  # fmt: skip
        found = [self.found(seed) for seed in self.modes]
        rows: list[list[Cell]] = [
            [str(seed), "yes" if right else "no", *self.summary(seed).values()]
            for seed, right in zip(self.modes, found, strict=True)
        ]
        rows.append(["all", f"{sum(found)} of {len(found)}", *self.summary().values()])
        notes = [
            f"off mm: largest distance to the nearer mode, of so many mm between the modes; {NEAR} of that is allowed",
            "unanswered to other free: with the sphere there; own blocked, other free: all demonstrations of that mode",
            "mean: of all demonstrations, carried to start and goal",
        ]
        return "\n".join([text_table(head, rows), *notes, *self._failures()])

    def _failures(self) -> list[str]:
        lines = []
        for case in self.cases:
            where = f"seed {case.seed}, case {case.number}"
            if not case.free.follows:
                lines.append(f"{where}: {_in_words(case.free)}")
            if case.blocked is not None and not case.switched:
                lines.append(f"{where}, {case.free.side} blocked: {_in_words(case.blocked.answer)}")
        return lines

    def draw(self, path: Path) -> None:
        """The first seed from above: all answers, one case with its sphere, all answers with spheres on the first."""
        figure = Figure(figsize=(10.5, 7.0), layout="constrained")
        every, one, switched = figure.subplots(1, 3, sharex=True, sharey=True)
        example = next((item for item in self.drawn if item.case.switched), self.drawn[0])
        for axes, items in ((every, self.drawn), (one, [example]), (switched, self.drawn)):
            for positions in self.shown:
                _from_above(axes, positions, GREY, "-", "shown", 0.7)
            for item in items:
                if axes is not switched:
                    _from_above(axes, item.mean, "black", ":", "mean of all that was shown", 0.9)
                    _from_above(axes, item.free, BLUE, "-", "geodesic", 0.9)
                if axes is not every:
                    _from_above(axes, item.blocked, VERMILION, "-", "geodesic with the sphere there", 0.9)
            pillar = 100.0 * np.array(PILLAR.centre[:2])
            axes.add_patch(Circle(pillar, 100.0 * PILLAR.radius, color=GREEN, label="pillar"))
            axes.set(xlabel="x [cm]", ylabel="y [cm]", aspect="equal")
        if example.case.blocked is not None:
            centre, radius = 100.0 * np.array(example.case.blocked.centre[:2]), 100.0 * example.case.blocked.radius
            one.add_patch(Circle(centre, radius, color=ORANGE, alpha=0.8, label="sphere", zorder=3))
            reach = radius + 100.0 * max(self.settings.planner.tool_radii)
            around = Circle(centre, reach, fill=False, color=ORANGE, linestyle="--", label="sphere and tool together")
            one.add_patch(around)
        every.set_title(f"seed {self.settings.seeds[0]}: {len(self.drawn)} cases", loc="left")
        one.set_title("one of them, its mode blocked", loc="left")
        switched.set_title("all, each with its mode blocked", loc="left")
        handles, labels = one.get_legend_handles_labels()
        named = dict(zip(labels, handles, strict=True))
        figure.legend(named.values(), named.keys(), loc="outside lower left", ncols=3)
        figure.savefig(path, dpi=110)


def cases_of(skill: Skill, shown: Demonstrations, seed: int, settings: Modes) -> list[Drawn]:
    """The cases of one skill; of what was shown, the first half is on the left of the pillar."""
    planner = PosePathPlanner(skill, settings.planner)
    sides = [replace(shown, items=shown.items[: settings.shown]), replace(shown, items=shown.items[settings.shown :])]
    random = np.random.default_rng([seed, settings.cases])
    return [
        _case(planner, sides, seed, number, *draw_passing_query(random), random) for number in range(settings.cases)
    ]


def _case(
    planner: PosePathPlanner,
    sides: Sequence[Demonstrations],
    seed: int,
    number: int,
    start: Pose,
    goal: Pose,
    random: np.random.Generator,
) -> Drawn:
    fraction, radius = random.uniform(*BLOCKED_AT), random.uniform(*BLOCKING_RADII)
    means = [mean_demonstration(side, start, goal).corrected for side in sides]
    together = Demonstrations(tuple(item for side in sides for item in side))
    mean = mean_demonstration(together, start, goal).corrected
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    path = planner.plan(*start, *goal)
    free = _answer(path, means, planner.settings)
    blocked, second = None, None
    if isinstance(path, PosePath):
        at = arc_length_fractions(path.positions)
        centre = interpolate(at, path.positions, path.quaternions, np.array([fraction]))[0][0]
        planner.set_obstacles(centre[None], np.array([radius]))
        second = planner.plan(*start, *goal)
        shares = [free_share(carried(side, start, goal), centre, radius, planner.settings) for side in sides]
        own = SIDES.index(free.side)
        clearance = math.nan
        if isinstance(second, PosePath):
            clearance = measured_clearance(second, centre, radius, planner.settings)
        blocked = FailedAttempts(
            tuple(centre.tolist()), radius, shares[own], shares[1 - own],
            _answer(second, means, planner.settings), clearance,
        )  # fmt: skip
    case = Case(seed, number, free, blocked, judged(mean, means, planner.settings))
    return Drawn(case, _positions(path), _positions(second), mean.positions)


def pillar_clearance(curve: PoseCurve, settings: PlannerSettings) -> float:
    """Smallest distance [m] of the tool's spheres from the pillar along a curve; not below minus their radius."""
    positions = curve.resample(_SAMPLES)
    top = PILLAR.centre[2] + 0.5 * PILLAR.height
    axis = np.array([*PILLAR.centre[:2], 0.0])
    distances = []
    for point, radius in zip(settings.tool_points, settings.tool_radii, strict=True):
        body = tool_points(positions.positions, positions.quaternions, np.array([point]))[:, 0] - axis
        beside = np.hypot(body[:, 0], body[:, 1]) - PILLAR.radius
        distances.append(np.hypot(np.maximum(beside, 0.0), np.maximum(body[:, 2] - top, 0.0)) - radius)
    return float(np.min(distances))


def _answer(path: PosePath | Refusal, means: Sequence[PoseCurve], settings: PlannerSettings) -> Answer:
    if isinstance(path, Refusal):
        return Answer(path.code.name, path.reason, False)
    return judged(path, means, settings, VerdictCode.OK.name)


def judged(
    curve: PoseCurve, means: Sequence[PoseCurve], settings: PlannerSettings, code: str = "", reason: str = ""
) -> Answer:
    """Which of the two modes a curve is nearer to, how near, and how far from the pillar."""
    distances = [_middle_distance(curve, mean) for mean in means]
    nearest = int(np.argmin(distances))
    between = 0.5 * (_middle_distance(means[0], means[1]) + _middle_distance(means[1], means[0]))
    return Answer(
        code, reason, True, SIDES[nearest], distances[nearest], between, pillar_clearance(curve, settings)
    )  # fmt: skip


def _middle_distance(curve: PoseCurve, other: PoseCurve) -> float:
    """Mean distance [m] of the middle half of a curve's arc to the nearest points of another."""
    middle = curve.resample(_SAMPLES).positions[_SAMPLES // 4 : -_SAMPLES // 4]
    return float(cKDTree(other.resample(_SAMPLES).positions).query(middle)[0].mean())


def _positions(path: PosePath | Refusal | None) -> np.ndarray | None:
    return path.positions if isinstance(path, PosePath) else None


def _in_words(answer: Answer) -> str:
    if not answer.answered:
        return f"{answer.code}: {answer.reason}"
    return (
        f"on the {answer.side}, {1e3 * answer.distance:.0f} mm off of {1e3 * answer.between:.0f} mm between the modes,"
        f" {1e3 * answer.pillar:.0f} mm from the pillar"
    )


def _from_above(axes: Any, positions: np.ndarray | None, colour: str, style: str, name: str, width: float) -> None:
    if positions is not None:
        axes.plot(*(100.0 * positions[:, :2].T), style, color=colour, linewidth=width, alpha=0.8, label=name)
