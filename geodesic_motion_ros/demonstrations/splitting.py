"""One long take -> demonstrations: between standstills, between marks, or at given times.

Every demonstration is cut to its motion: from the last moment of the standstill before it to the first of the next.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take, sizes_by_column
from geodesic_motion_ros.utils.errors import DemonstrationError

#: A take stands still where no column leaves a range of this size for `pause` seconds: joints [rad], positions [m],
#: parts of a quaternion. Hands that guide an arm pause: in 35 real demonstrations of two arms for up to 1.8 s within
#: 3 mrad, for 2.0 s within 5 mrad; sensors at rest stay within a fifth of it.
STILL = {"joint": 0.004, "position": 0.002, "quaternion": 0.004}
PAUSE = 2.5
#: Motions that last shorter [s], or have fewer samples, are a nudge and no demonstration.
SHORTEST, FEWEST = 0.3, 3
#: A motion that leads back fits the demonstrations reversed so much better than forwards.
BACK = 0.5
#: A motion that ends within this share of its extent from its start is a loop.
LOOP = 0.2
_GRID_HZ = 50.0


class Span(NamedTuple):
    """A part of a take, from one time to another [s], and what it is called."""

    begin: float
    end: float
    name: str


@dataclass(frozen=True)
class Split:
    """The rule by which a take is split; one of the three.

    Attributes
    ----------
    times : (begin, end) [s] of each demonstration; (): otherwise.
    marker : topic that marks them; "": otherwise.
    pause : standstills of this many seconds are between demonstrations.
    first : the number, from 1, of the motion that is the first demonstration where others lead back.
    """

    times: tuple[tuple[float, float], ...] = ()
    marker: str = ""
    pause: float = PAUSE
    first: int = 1

    @classmethod
    def parse(cls, text: str, pause: float = PAUSE, first: int = 1) -> Split:
        """Read `standstill`, a topic as `/mark`, or times [s] as `3.2-9.8,14-20.5`; DemonstrationError otherwise."""
        if not (math.isfinite(pause) and pause > 0.0) or first < 1:
            raise DemonstrationError(f"pause {pause:g} s, first motion {first}: both must be positive")
        if text == "standstill":
            return cls(pause=pause, first=first)
        if text.startswith("/"):
            return cls(marker=text)
        times = []
        for part in text.split(","):
            found = re.fullmatch(r"\s*(\d+\.?\d*)\s*-\s*(\d+\.?\d*)\s*", part)
            if found is None or not float(found[1]) < float(found[2]):
                raise DemonstrationError(
                    f"split {text!r}: give standstill, a topic of markers as /mark, or the beginning and end [s] of "
                    "each demonstration as 3.2-9.8,14-20.5"
                )
            times.append((float(found[1]), float(found[2])))
        return cls(times=tuple(times))


def split_take(
    take: Take, how: Split, markers: Sequence[tuple[float, bool | str | None]] = (), breaks: Sequence[float] = ()
) -> tuple[list[Take], list[Flaw]]:
    """Split a take into its demonstrations; with what was not taken for one. DemonstrationError: there is none.

    markers : times [s] and values of the messages of `how.marker`.
    breaks : times [s] of samples that no motion leads to from the one before, as where a simulation was reset.
    """
    if how.times:
        spans = [Span(begin, end, f"{take.name}_{number}") for number, (begin, end) in enumerate(how.times)]
        outside = [span for span in spans if span.end < take.times[0] or span.begin > take.times[-1]]
        if outside:
            raise DemonstrationError(
                f"{take.name}: nothing was recorded from {outside[0].begin:g} to {outside[0].end:g} s; the recording "
                f"lasts from {take.times[0]:.2f} to {take.times[-1]:.2f} s"
            )
        flaws: list[Flaw] = []
    elif how.marker:
        spans, flaws = find_marked_spans(markers, float(take.times[-1]), take.name)
    else:
        spans, flaws = find_moving_spans(take, how.pause, breaks), []
    motions = []
    for span in spans:
        part = _moving_part(take, span, how)
        if part is None:
            flaws.append(Flaw(span.name, span.begin, "does not move", Action.LEFT_OUT))
        elif len(part) < FEWEST or part.times[-1] - part.times[0] < SHORTEST:
            size = f"has {len(part)} samples in {part.times[-1] - part.times[0]:.2f} s"
            flaws.append(Flaw(span.name, span.begin, size, Action.LEFT_OUT, "no demonstration is that short"))
        else:
            motions.append(part)
    if not (how.times or how.marker):
        motions, back = leave_out_returns(motions, how.first)
        flaws += back
        motions = [part.part(slice(None), f"{take.name}_{number}") for number, part in enumerate(motions)]
    if not motions:
        lasting = float(take.times[-1] - take.times[0])
        listed = "; ".join(map(str, flaws)) or f"nothing in it moves between standstills of {how.pause:g} s"
        raise DemonstrationError(f"{take.name}: {listed}; it has {len(take)} samples in {lasting:.1f} s")
    return motions, flaws


def is_still(take: Take, duration: float) -> np.ndarray:
    """Tell whether each sample (T,) lies in a standstill of `duration` [s]; false in gaps that long, where none is.

    Times rise. Judged on a grid of 50 Hz between the samples, so that neither rate nor jitter of a recording counts.
    """
    grid = np.arange(take.times[0], take.times[-1] + 0.5 / _GRID_HZ, 1.0 / _GRID_HZ)
    steps = max(1, round(duration * _GRID_HZ))
    if len(grid) <= steps:
        return np.zeros(len(take), dtype=bool)
    begins = np.ones(len(grid) - steps, dtype=bool)
    for column, still in zip(take.values.T, sizes_by_column(STILL, take.names), strict=True):
        windows = np.lib.stride_tricks.sliding_window_view(np.interp(grid, take.times, column), steps + 1)
        begins &= np.ptp(windows, axis=1) <= still
    covered = np.cumsum(np.bincount(np.flatnonzero(begins), minlength=len(grid) + 1)
                        - np.bincount(np.flatnonzero(begins) + steps + 1, minlength=len(grid) + 1)[: len(grid) + 1])
    nearest = np.clip(np.rint((take.times - grid[0]) * _GRID_HZ).astype(int), 0, len(grid) - 1)
    return covered[nearest] > 0


def find_moving_spans(take: Take, pause: float, breaks: Sequence[float] = ()) -> list[Span]:
    """Find the parts of a take between standstills, gaps, of `pause` seconds, and breaks [s], one after the other."""
    still = is_still(take, pause)
    broken = np.diff(np.searchsorted(np.array(breaks), take.times, "right")) > 0
    gap = np.append((np.diff(take.times) >= pause) | broken, True)
    spans, begin = [], None
    for sample in range(len(take)):
        if not still[sample] and begin is None:
            begin = max(sample - 1, 0) if sample and not gap[sample - 1] else sample
        if begin is not None and (still[sample] or gap[sample]):
            if sample > begin:
                spans.append((begin, sample))
            begin = None
    return [
        Span(float(take.times[first]), float(take.times[last]), f"{take.name}, motion {number}")
        for number, (first, last) in enumerate(spans, 1)
    ]


def find_marked_spans(
    markers: Sequence[tuple[float, bool | str | None]], last: float, name: str
) -> tuple[list[Span], list[Flaw]]:
    """Find the parts between marks, up to the `last` time [s] of the take.

    | marker | begins a demonstration | ends it |
    | Empty  | the first, the third, ... | the second, the fourth, ... |
    | Bool   | true | false |
    | String | a text, its name | an empty text, or the next text |
    """
    spans: list[Span] = []
    flaws: list[Flaw] = []
    begun: tuple[float, str] | None = None
    for time, value in markers:
        label = value.strip() if isinstance(value, str) else ""
        begins = bool(label) if isinstance(value, str) else value if isinstance(value, bool) else begun is None
        if begun is not None and (isinstance(value, str) or not begins):
            spans.append(Span(begun[0], time, begun[1]))
            begun = None
        if begins and begun is None:
            begun = (time, _unused(label or f"{name}_{len(spans)}", spans))
    if begun is not None:
        spans.append(Span(begun[0], last, begun[1]))
        how = "it ends with the recording"
        flaws.append(Flaw(begun[1], begun[0], "has no marker that ends it", Action.REPAIRED, how))
    if not spans:
        raise DemonstrationError(f"{name}: {len(markers)} markers, and none of them begins a demonstration")
    return spans, flaws


def leave_out_returns(motions: list[Take], first: int = 1) -> tuple[list[Take], list[Flaw]]:
    """Leave out the motions that lead back to where the next demonstration starts.

    Between two demonstrations in one take the arm goes back. A motion from b to e leads back where b is a goal, or e a
    start, of a motion before it, clearly more than b is a start or e a goal:

        min_i (|b - e_i|, |e - b_i|) < BACK min_i (|b - b_i|, |e - e_i|),  i over the demonstrations before it,

    and with b_i and e_i exchanged for motions that led back. The first motion is a demonstration, or the one with the
    number `first`, and so a motion that is interrupted does not exchange the others' roles. Where the first motion ends
    near its start (LOOP) nothing has to lead back, and nothing is left out.
    """
    if not motions:
        return [], []
    if first > len(motions):
        raise DemonstrationError(f"motion {first} cannot be the first demonstration: there are {len(motions)} motions")
    scale = sizes_by_column(STILL, motions[0].names)
    ends = [(motion.values[0] / scale, motion.values[-1] / scale) for motion in motions[first - 1 :]]
    if np.linalg.norm(ends[0][1] - ends[0][0]) < LOOP * _extent(motions[first - 1], scale):
        return motions, []
    starts, goals = [ends[0][0]], [ends[0][1]]
    kept, back = [motions[first - 1]], motions[: first - 1]
    for motion, (begin, end) in zip(motions[first:], ends[1:], strict=True):
        returned = min(_to_nearest(begin, goals), _to_nearest(end, starts))
        repeated = min(_to_nearest(begin, starts), _to_nearest(end, goals))
        leads_back = returned < BACK * repeated
        (back if leads_back else kept).append(motion)
        starts.append(end if leads_back else begin)
        goals.append(begin if leads_back else end)
    passed = [
        Flaw(motion.name, float(motion.times[0]), "leads back", Action.PASSED_OVER, f"motion {first} is the first")
        for motion in back
    ]
    return kept, passed


def _to_nearest(place: np.ndarray, others: Sequence[np.ndarray]) -> float:
    """Distance of a place (C,) from the nearest other one."""
    return float(np.min(np.linalg.norm(np.array(others) - place, axis=1)))


def _extent(take: Take, scale: np.ndarray) -> float:
    """How far a motion leads from its start."""
    return float(np.linalg.norm(take.values / scale - take.values[0] / scale, axis=1).max())


def _moving_part(take: Take, span: Span, how: Split) -> Take | None:
    """The samples of a span without standstills at its ends; None where nothing moves."""
    samples = np.flatnonzero((take.times >= span.begin) & (take.times <= span.end))
    if len(samples) < 2:
        return None
    part = take.part(samples, span.name)
    if not (how.times or how.marker):
        return part
    moving = np.flatnonzero(~is_still(part, min(how.pause, 1.0)))
    if not len(moving):
        return None
    return part.part(slice(max(moving[0] - 1, 0), moving[-1] + 2))


def _unused(name: str, spans: Sequence[Span]) -> str:
    """A name that no span has yet."""
    taken = {span.name for span in spans}
    numbered = (f"{name}_{number}" for number in range(1, len(spans) + 2))
    return name if name not in taken else next(each for each in numbered if each not in taken)
