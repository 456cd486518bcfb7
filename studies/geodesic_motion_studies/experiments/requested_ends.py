"""Starts and goals along what was demonstrated and beyond it, requested of planners beside a control.

*Along*: a piece of a demonstration that was held out, from a random point of its first 40 % to one of its last 40 %.
*Beyond*: start and goal, each so far outside the convex hull of the demonstrated ones, in rings. Every pair of ends
comes with the motions that would be right for it.

The control is the nearest demonstration: of all pieces of demonstrations the one whose ends are nearest to the
requested ones, carried to them. It refuses nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.geometry.curves import Pose, PoseCurve
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.skill.sheet import METRES_PER_RADIAN
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import Cell, text_table
from geodesic_motion_studies.experiments.baselines import SAMPLES, Prediction
from geodesic_motion_studies.tools.averages import mean
from geodesic_motion_studies.tools.similarity import distance_to_closest

ALONG = "along"
#: How far outside of what was demonstrated start and goal lie [m].
RINGS = (0.025, 0.05, 0.1, 0.2)
NEAREST = "nearest demonstration"
#: A piece begins within this share of its demonstration and ends within as large a share of the other side.
_PIECE_MARGIN = 0.4


@dataclass(frozen=True, eq=False)
class RequestedEnds:
    """A start and a goal; `where` they lie, ALONG or a `ring_name`; `right` : motions, each of which is right."""

    where: str
    start: Pose
    goal: Pose
    right: tuple[PoseCurve, ...]


@dataclass(frozen=True)
class EndsAnswer:
    """An answer of `method` to requested ends.

    Attributes
    ----------
    reason : why the planner refuses under its usual limits, else empty.
    missed : how far the motion's ends are from the requested ones [m], the farther of the two.
    off : mean distance from the closest of the right motions [m], matched by dynamic time warping.
    off_unlimited : the same with the limits lifted; NaN where there is no motion even so.
    """

    where: str
    method: str
    seed: int
    reason: str
    missed: float
    off: float
    off_unlimited: float


def ring_name(distance: float) -> str:
    """How ends so far [m] outside of what was demonstrated are called."""
    return f"{1e3 * distance:.0f} mm beyond"


def pieces_of(held_out: Demonstrations, count: int, random: np.random.Generator) -> list[RequestedEnds]:
    """Ends of pieces of demonstrations, which are right for them."""
    found = []
    for _ in range(count):
        curve = held_out[int(random.integers(len(held_out)))].curve.resample(SAMPLES)
        first, last = random.uniform(0.0, _PIECE_MARGIN), random.uniform(1.0 - _PIECE_MARGIN, 1.0)
        kept = slice(int(first * SAMPLES), math.ceil(last * SAMPLES))
        piece = PoseCurve(curve.positions[kept], curve.quaternions[kept])
        found.append(RequestedEnds(ALONG, piece.start, piece.goal, (piece,)))
    return found


def ends_beyond(
    shown: Demonstrations, distance: float, count: int, random: np.random.Generator
) -> list[RequestedEnds]:
    """Demonstrated starts and goals that are outermost in random directions, moved on by a distance [m].

    So far are they outside the convex hull of the demonstrated positions. Every demonstration counts as right.
    """
    curves = tuple(item.curve for item in shown)
    found = []
    for _ in range(count):
        start, goal = (
            _moved_out([getattr(curve, end) for curve in curves], distance, random) for end in ("start", "goal")
        )
        found.append(RequestedEnds(ring_name(distance), start, goal, curves))
    return found


def _moved_out(poses: Sequence[Pose], distance: float, random: np.random.Generator) -> Pose:
    direction = random.normal(size=3)
    direction /= np.linalg.norm(direction)
    position, quaternion = max(poses, key=lambda pose: float(pose[0] @ direction))
    return position + distance * direction, quaternion


def nearest_piece(shown: Demonstrations, start: Pose, goal: Pose) -> PoseCurve:
    """The piece of a demonstration whose ends are together nearest to the requested ones, carried to them."""
    found = []
    for item in shown:
        curve = item.curve.resample(SAMPLES)
        to_start, to_goal = (_distances(curve, end) for end in (start, goal))
        sums = np.minimum.accumulate(to_start)[:-1] + to_goal[1:]
        last = int(np.argmin(sums)) + 1
        first = int(np.argmin(to_start[:last]))
        kept = slice(first, last + 1)
        found.append((float(sums[last - 1]), PoseCurve(curve.positions[kept], curve.quaternions[kept])))
    _, piece = min(found, key=lambda pair: pair[0])
    return Prediction.between(piece, start, goal).corrected


def _distances(curve: PoseCurve, pose: Pose) -> np.ndarray:
    """Of every pose of a curve (n,) [m], turns counted as in `sheet`."""
    turns = angle_between(curve.quaternions, pose[1])
    return np.hypot(np.linalg.norm(curve.positions - pose[0], axis=1), METRES_PER_RADIAN * turns)


def answers_to(
    requested: Sequence[RequestedEnds],
    skills: Mapping[str, Skill],
    shown: Demonstrations,
    seed: int,
    others: Mapping[str, Callable[[Pose, Pose], PoseCurve]] | None = None,
) -> list[EndsAnswer]:
    """What the planner makes of the ends on every skill, by the name of its method, and the control.

    others : methods that refuse nothing, by their names: the motion from a start to a goal.
    """
    refusing_nothing = {**(others or {}), NEAREST: partial(nearest_piece, shown)}
    usual = PlannerSettings()
    unlimited = replace(usual, maximum_offset=10.0, maximum_offset_angle=math.pi)
    planners = {
        method: (PosePathPlanner(skill, usual), PosePathPlanner(skill, unlimited)) for method, skill in skills.items()
    }
    found = []
    for ends in requested:
        for method, pair in planners.items():
            answers = [planner.plan(*ends.start, *ends.goal) for planner in pair]
            reason = "" if isinstance(answers[0], PosePath) else answers[0].reason
            paths = [answer if isinstance(answer, PosePath) else None for answer in answers]
            found.append(_answer(ends, method, seed, reason, *paths))
        for method, motion in refusing_nothing.items():
            curve = motion(ends.start, ends.goal)
            found.append(_answer(ends, method, seed, "", curve, curve))
    return found


def _answer(
    ends: RequestedEnds, method: str, seed: int, reason: str, path: PoseCurve | None, unlimited: PoseCurve | None
) -> EndsAnswer:
    off, off_unlimited = (
        math.nan if curve is None else distance_to_closest(curve, ends.right) for curve in (path, unlimited)
    )
    missed = math.nan if path is None else farthest_end(path, ends.start, ends.goal)
    return EndsAnswer(ends.where, method, seed, reason, missed, off, off_unlimited)


def farthest_end(path: PoseCurve, start: Pose, goal: Pose) -> float:
    """Distance [m] of the tool at the ends of a path from requested ones, the farther of the two."""
    gaps = path.start[0] - start[0], path.goal[0] - goal[0]
    return max(float(np.linalg.norm(gap)) for gap in gaps)


def ends_summary(answers: Sequence[EndsAnswer], where: str, method: str) -> dict[str, float | int | None]:
    """Figures of one method on the ends that lie at one place, over all seeds."""
    found = [item for item in answers if (item.where, item.method) == (where, method)]
    answered = [item for item in found if not item.reason]
    return {
        "requested": len(found),
        "answered": len(answered),
        "missed_mm": max((1e3 * item.missed for item in answered), default=None),
        "off_mm": mean([1e3 * item.off for item in answered]),
        "off_unlimited_mm": mean([1e3 * item.off_unlimited for item in found]),
    }


def places_and_methods(answers: Sequence[EndsAnswer]) -> list[tuple[str, str]]:
    """Where the ends lie with every method, in the order of the answers."""
    return list(dict.fromkeys((item.where, item.method) for item in answers))


def ends_figures(answers: Sequence[EndsAnswer]) -> dict[str, dict[str, dict[str, float | int | None]]]:
    """Where -> method -> figures, as `--json` writes them."""
    figures: dict[str, dict[str, dict[str, float | int | None]]] = {}
    for where, method in places_and_methods(answers):
        figures.setdefault(where, {})[method] = ends_summary(answers, where, method)
    return figures


def ends_table(answers: Sequence[EndsAnswer]) -> str:
    """The figures as plain text."""
    head = ["ends", "method", "requested", "answered", "missed mm", "off mm", "off mm, limits lifted"]
    rows: list[list[Cell]] = [
        [where, method, *ends_summary(answers, where, method).values()]
        for where, method in places_and_methods(answers)
    ]
    return text_table(head, rows, 1, left=(0, 1))
