"""Rounds: motions that end where they began, as wiping, stirring and shaking, one after the other or one by one.

A skill of motions that lead elsewhere has a start and a goal; of a round nothing would be left but its ends. It is
learned on a closed sheet, a cylinder, which asks that each demonstration is one round that ends exactly where it began.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.signal import detrend
from scipy.spatial.distance import cdist

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.flaws import ROTATION_LENGTH
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.demonstrations.splitting import LOOP
from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take
from geodesic_motion_ros.geometry.curves import arc_length, pose_arc_length
from geodesic_motion_ros.geometry.quaternions import continuous_signs, rotate_by, rotation_vector_between
from geodesic_motion_ros.utils.errors import DemonstrationError

#: A motion goes over its own path if more than this share of it comes within NEAR of parts of it that are more than
#: APART further along, in shares of its length: 13 % at most of a letter e, 88 to 100 % where people shake or wipe.
RETRACED, NEAR, APART = 0.5, 0.03, 0.25
_SAMPLES = 120
#: Rounds one after the other are looked for at so many samples of a motion, equally spaced in time.
_GRID = 800
#: A motion repeats itself after a lag at which it correlates with itself by this much.
_CORRELATION = 0.4
#: Rounds that follow one another drift: each ends within this share of its extent from its start, and is closed.
LARGEST_GAP = 0.5
#: Rounds that take this share longer, or shorter, than their median are none.
_UNEVEN = 0.35
#: Rounds one after the other fill at least this share of a motion; what is before and after is left out.
_FILLED = 0.5
#: A motion passes a mark within this share of its usual distance from its middle.
NEAR_MARK = 0.7


@dataclass(frozen=True)
class Rounds:
    """The rounds of a recording: the motions, each of which is one, and what is said of how they were read."""

    motions: tuple[Take, ...]
    flaws: tuple[Flaw, ...]


def find_rounds(motions: Sequence[Take], closed: bool | None = None) -> Rounds | None:
    """Find the rounds in motions: those that follow one another in each, or one that returns to its start.

    closed : True: they are rounds; DemonstrationError names one that is not. None: where at least half of them are;
        None is returned elsewhere.
    """
    like: np.ndarray | None = None
    found: list[tuple[Take, list[Take]]] = []
    for motion in motions:
        parts, mean = _following_rounds(motion, like)
        like = mean if like is None else like
        if not parts and _returns(motion, LARGEST_GAP if closed else LOOP):
            parts = [motion]
        found.append((motion, parts))
    whole = [motion for motion, parts in found if parts]
    if closed is None and len(whole) < 0.5 * len(motions):
        return None
    if not whole:
        raise DemonstrationError(
            f"no demonstration is a round: {_described(motions[0])}; a closed skill is learned from motions that end "
            "where they began"
        )
    rounds, flaws = [], []
    for motion, parts in found:
        begin = float(motion.times[0])
        if not parts:
            flaws.append(Flaw(motion.name, begin, f"is no round: it {_described(motion)}", Action.LEFT_OUT))
        elif len(parts) == 1:
            flaws.append(Flaw(motion.name, begin, _described(motion), Action.READ, "as a round"))
        else:
            lasting = np.median([part.times[-1] - part.times[0] for part in parts])
            what = f"has {len(parts)} rounds of {lasting:.2f} s"
            flaws.append(Flaw(motion.name, begin, what, Action.READ, "as one demonstration each"))
        rounds += parts
    return Rounds(tuple(rounds), tuple(flaws))


def find_returns(motions: Sequence[Take]) -> list[Flaw]:
    """Find the first motion that returns, where at least half do, of a skill that is not to be closed: refused; else
    those that retrace their path.
    """
    returning = [motion for motion in motions if _returns(motion)]
    if returning and len(returning) >= 0.5 * len(motions):
        how = "learn a closed skill, or end demonstrations where they turn back (--split)"
        what = f"returns to its start ({len(returning)} of {len(motions)} do), and {_described(returning[0])}"
        return [Flaw(returning[0].name, float(returning[0].times[-1]), what, Action.REFUSED, how)]
    what, how = "goes over its own path, and", "a skill leads to the goal once: it may leave rounds out"
    return [
        Flaw(motion.name, float(motion.times[-1]), f"{what} {_described(motion)}", Action.KEPT, how)
        for motion in motions
        if _is_retraced(motion)
    ]


def close_rounds(
    demonstrations: Demonstrations | JointDemonstrations, rotation_length: float
) -> Demonstrations | JointDemonstrations:
    """Close each demonstration: what lies between its end and its start is spread over its arc.

    With s the fraction of the arc and g the displacement from the first sample to the last, x(s) - (s - 1/2) g, of
    orientations exp(-(s - 1/2) g) q(s).

    Parameters
    ----------
    rotation_length : length that a turn of one radian counts in the arc of poses [m].

    Raises
    ------
    DemonstrationError : a demonstration does not return to its start, or only after a whole turn of the tool.
    """
    closed = [_closed(item, rotation_length) for item in demonstrations]
    return replace(demonstrations, items=tuple(closed))


def _closed(item: Demonstration | JointDemonstration, rotation_length: float) -> Demonstration | JointDemonstration:
    values = item.configurations if isinstance(item, JointDemonstration) else item.positions
    _refuse_open(item.name, values, rotation_length, item)
    if isinstance(item, JointDemonstration):
        s = _centred(arc_length(values))
        return replace(item, configurations=values - s[:, None] * (values[-1] - values[0]))
    quaternions = continuous_signs(item.quaternions)
    if quaternions[0] @ quaternions[-1] < 0.0:
        raise DemonstrationError(
            f"demonstration '{item.name}' turns the tool by a whole turn in a round: no closed skill is learned of that"
        )
    s = _centred(pose_arc_length(values, quaternions, rotation_length))[:, None]
    turn = rotation_vector_between(quaternions[0], quaternions[-1])
    return replace(
        item, positions=values - s * (values[-1] - values[0]), quaternions=rotate_by(-s * turn, quaternions)
    )


def _refuse_open(
    name: str, values: np.ndarray, rotation_length: float, item: Demonstration | JointDemonstration
) -> None:
    points = values
    if isinstance(item, Demonstration):
        points = np.hstack([values, 2.0 * rotation_length * continuous_signs(item.quaternions)])
    apart, extent = np.linalg.norm(points[-1] - points[0]), np.linalg.norm(points - points[0], axis=1).max()
    if not apart < LARGEST_GAP * extent and not (isinstance(item, Demonstration) and _is_turned(item, apart, extent)):
        raise DemonstrationError(
            f"demonstration '{name}' is no round: it ends {apart / extent:.0%} of its extent from its start, and a "
            f"closed skill is learned from motions that end within {LARGEST_GAP:.0%}"
        )


def _is_turned(item: Demonstration, apart: float, extent: float) -> bool:
    """Whether only the sign of the last quaternion is another: that is refused by its own name."""
    quaternions = continuous_signs(item.quaternions)
    return bool(quaternions[0] @ quaternions[-1] < -0.9)


def _centred(arc: np.ndarray) -> np.ndarray:
    """s - 1/2 of an arc (T,)."""
    return arc / arc[-1] - 0.5


def _described(motion: Take) -> str:
    values, unit = (motion.values, "rad") if motion.is_of_joints else (motion.values[:, :3], "m")
    apart, length = float(np.linalg.norm(values[-1] - values[0])), float(arc_length(values)[-1])
    return f"ends {apart:.3f} {unit} from its start after {length:.2f} {unit}"


def _points(motion: Take) -> np.ndarray:
    """Joints (T, eta) [rad], or positions and quaternions (T, 3 or 7) scaled so that distances are in metres."""
    if motion.is_of_joints:
        return motion.values
    # a quaternion changes by half of the angle
    return np.hstack([motion.values[:, :3], 2.0 * ROTATION_LENGTH * motion.values[:, 3:]])


def _returns(motion: Take, gap: float = LOOP) -> bool:
    points = _points(motion)
    # the opposite quaternion is the same orientation
    ends = [points[-1] * np.where(np.arange(points.shape[1]) < 3, 1.0, sign) for sign in (1.0, -1.0)]
    apart = min(np.linalg.norm(end - points[0]) for end in (ends[:1] if motion.is_of_joints else ends))
    return bool(apart < gap * np.linalg.norm(points - points[0], axis=1).max())


def _is_retraced(motion: Take) -> bool:
    points = _points(motion)
    along = arc_length(points)
    at = np.linspace(0.0, along[-1], _SAMPLES)
    places = np.stack([np.interp(at, along, column) for column in points.T], axis=1)
    apart = np.abs(at[:, None] - at[None]) > APART * along[-1]
    near = (cdist(places, places) < NEAR * along[-1]) & apart
    return bool(np.mean(near.any(axis=1)) > RETRACED)


def _following_rounds(motion: Take, like: np.ndarray | None) -> tuple[list[Take], np.ndarray | None]:
    """The rounds of a motion that follow one another, [] where there are not two; and their mean round (_SAMPLES, D).

    like : the mean round of another motion, whose rounds begin where these are to begin; None: there is none yet.
    """
    times, first = np.unique(motion.times, return_index=True)
    if len(times) < 4:
        return [], None
    grid = np.linspace(times[0], times[-1], _GRID)
    # What drifts is not what repeats itself.
    columns = [np.interp(grid, times, column) for column in _points(motion)[first].T]
    places = detrend(np.stack(columns, axis=1), axis=0)
    lag = _period(places)
    if lag is None:
        return [], None
    passes = _best_passes(places, lag)
    if len(passes) < 3 or passes[-1] - passes[0] < _FILLED * _GRID:
        return [], None
    mean = _mean_round(places, passes)
    if like is not None:
        fits = [np.sum(like * np.roll(mean, -shift, axis=0)) for shift in range(_SAMPLES)]
        shift = int(np.argmax(fits))
        shift -= _SAMPLES if shift > _SAMPLES // 2 else 0
        passes = passes + round(shift * lag / _SAMPLES)
        passes = passes[(passes >= 0) & (passes < _GRID)]
    usual = np.median(np.diff(passes))
    spans = [
        (grid[one], grid[other])
        for one, other in pairwise(passes)
        if abs(other - one - usual) <= _UNEVEN * usual
    ]
    parts = [
        motion.part(np.flatnonzero((motion.times >= begin) & (motion.times <= end)), f"{motion.name}_{number}")
        for number, (begin, end) in enumerate(spans)
    ]
    return [part for part in parts if len(part) > 3 and _returns(part, LARGEST_GAP)], mean


def _best_passes(places: np.ndarray, lag: int) -> np.ndarray:
    """When [samples] a motion (T, D) passes that one of its own places, at that velocity, which it passes best."""
    # Place and velocity count the same where a round is a circle.
    states = np.hstack([places, np.gradient(places, axis=0) * lag / (2.0 * np.pi)])
    middle = len(states) // 2
    tried = [(index, _passes(states, states[index], lag)) for index in range(middle - lag // 2, middle + lag // 2)]
    most = max(len(found) for _, found in tried)
    _, passes = min(
        (one for one in tried if len(one[1]) == most),
        key=lambda one: float(np.mean(np.linalg.norm(states[one[1]] - states[one[0]], axis=1))),
    )
    return passes


def _mean_round(places: np.ndarray, passes: np.ndarray) -> np.ndarray:
    """The mean (_SAMPLES, D) of the rounds of places (T, D) between passes."""
    samples = np.arange(len(places))
    rounds = []
    for one, other in pairwise(passes):
        at = np.linspace(one, other, _SAMPLES, endpoint=False)
        rounds.append(np.stack([np.interp(at, samples, column) for column in places.T], axis=1))
    return np.mean(rounds, axis=0)


def _period(states: np.ndarray) -> int | None:
    """The lag [samples] after which states (T, D) repeat themselves, twice at least; None where they do not."""
    count = len(states)
    correlation = np.ones(count // 2)
    for lag in range(1, count // 2):
        one, other = states[:-lag], states[lag:]
        correlation[lag] = 2.0 * np.sum(one * other) / max(np.sum(one**2) + np.sum(other**2), 1e-12)
    below = np.flatnonzero(correlation < 0.5)
    if len(below) == 0:
        return None
    later = correlation[below[0] :]
    peaks = np.flatnonzero((later[1:-1] >= later[:-2]) & (later[1:-1] > later[2:]) & (later[1:-1] >= _CORRELATION))
    return None if len(peaks) == 0 else int(below[0] + 1 + peaks[0])


def _passes(states: np.ndarray, mark: np.ndarray, lag: int) -> np.ndarray:
    """When [samples] states (T, k) pass a mark (k,), in order: the nearest of each period."""
    distances = np.linalg.norm(states - mark, axis=1)
    near = NEAR_MARK * float(np.median(np.linalg.norm(states, axis=1)))
    passes: list[int] = []
    for index in np.argsort(distances):
        if distances[index] > near:
            break
        if all(abs(index - other) > 0.6 * lag for other in passes):
            passes.append(int(index))
    return np.sort(np.array(passes, dtype=int))
