"""Chunks full of nonsense, offered to a filter in motion among spheres that move: what it makes of them.

Numbers that are none or huge, jumps, times that do not increase, stamps of the past and of the future, wrong kinds and
shapes; and chunks that are right, without which the arm would not move.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_studies.tools.limit_shares import limit_shares

#: Ticks of the filter [s], after which share of them something is offered, and how many spheres move.
TICK, OFTEN, SPHERES = 0.01, 0.4, 2
#: Rounding of what is exactly at a limit, and how far a motion may begin from where the one before is [rad].
_ROUNDING, _SAME_PLACE = 1e-5, 1e-6
_NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-320, 1e4)
_KINDS: tuple[Any, ...] = (None, "words", [], {}, object(), [[1.0], [1.0, 2.0]], np.zeros((2, 2, 2)), [True], 1j, b"1")


@dataclass
class Wild:
    """What was offered, and what came of it.

    Attributes
    ----------
    taken, refused : how many chunks were. unnamed : refusals without a reason, or with another code than BAD_INPUT.
    raised : what was raised. broken : limits of the robot that a motion broke, and motions that begin elsewhere than
        where the one before was.
    motions : that were handed out. share : the largest share of a limit that one of them used.
    """

    taken: int = 0
    refused: int = 0
    unnamed: list[str] = field(default_factory=list)
    raised: list[str] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    motions: int = 0
    share: float = 0.0


class WildChunks:
    """Makes chunks by a seeded generator, for an arm that is commanded to be somewhere."""

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random

    def one(self, here: np.ndarray, speed: np.ndarray, now: float) -> dict[str, Any]:
        """What `MotionFilter.offer` is given: one in three as it should be, the others with something wrong."""
        random = self._random
        count, eta = int(random.integers(1, 30)), len(here)
        times = np.cumsum(random.exponential(0.05, count)) - random.choice([0.0, 0.01])
        drift = speed + np.cumsum(random.normal(scale=10.0 ** random.uniform(-2.5, 0.3), size=(count, eta)), axis=0)
        chunk: dict[str, Any] = {
            "times": np.maximum.accumulate(np.maximum(times, 0.0)) + 1e-4 * np.arange(count),
            "positions": here + np.cumsum(0.03 * drift, axis=0),
            "velocities": drift if random.random() < 0.3 else None,
            "begin": None if random.random() < 0.5 else now + random.normal(scale=0.2),
        }
        if random.random() < 2.0 / 3.0:
            self._spoil(chunk, now)
        return chunk

    def _spoil(self, chunk: dict[str, Any], now: float) -> None:
        random = self._random
        name = str(random.choice(["times", "positions", "velocities"]))
        rows = chunk[name] if chunk[name] is not None else np.zeros_like(chunk["positions"])
        kind = int(random.integers(8))
        if kind == 0:
            rows.flat[random.integers(rows.size)] = random.choice(_NUMBERS)
        elif kind == 1:
            rows = rows + random.normal(scale=10.0 ** random.uniform(-2, 3))
        elif kind == 2:
            rows = random.permutation(rows)
        elif kind == 3:
            rows = _KINDS[random.integers(len(_KINDS))]
        elif kind == 4:
            rows = rows[: random.integers(len(rows) + 1)]
        elif kind == 5:
            rows = rows[..., None] if random.random() < 0.5 else rows.astype(random.choice(["int8", "U5", "complex"]))
        elif kind == 6:
            chunk["begin"] = random.choice([np.nan, np.inf, -1e300, now - 10.0, now + 30.0, now + 1e6])
        else:
            rows = np.repeat(rows, 2, axis=0)
        if kind != 6:
            chunk[name] = rows


def offer_wild(motion_filter: MotionFilter, random: np.random.Generator, count: int) -> Wild:
    """Offer so many chunks to a filter whose arm stands in its ready posture, with ticks and moving spheres between."""
    robot, wild, source = motion_filter.robot, Wild(), WildChunks(random)
    motion_filter.observe(Obstacles.none())
    motion_filter.stand_at(robot.ready, 0.0)
    at, towards = random.uniform(-0.8, 0.8, (2, SPHERES, 3))
    tick = 0
    while wild.taken + wild.refused < count:
        now = TICK * tick
        tick += 1
        state = motion_filter.commanded_state(now)
        assert state is not None
        if tick % 300 == 0:
            at, towards = random.uniform(-0.8, 0.8, (2, SPHERES, 3))
        moved = at + 0.01 * (tick % 300) * 0.3 * towards
        try:
            if tick % 5 == 0:
                motion_filter.observe(Obstacles.of_spheres(moved, np.full(SPHERES, 0.06), 0.3 * towards, now))
            if random.random() < OFTEN:
                chunk = source.one(state[0], state[1], now)
                verdict = motion_filter.offer(**chunk)
                wild.taken, wild.refused = wild.taken + verdict.ok, wild.refused + (not verdict.ok)
                if not verdict.ok and not (verdict.code is VerdictCode.BAD_INPUT and verdict.reason):
                    wild.unnamed.append(verdict.sentence)
            plan = motion_filter.tick(now)
        except Exception as error:
            wild.raised.append(f"tick {tick}: {type(error).__name__}: {error}")
            wild.refused += 1
            continue
        if plan.reference is not None:
            _judge(motion_filter, plan.reference, plan.begin, state, now, wild, tick)
    return wild


def _judge(
    motion_filter: MotionFilter, reference: Any, begin: float, state: Any, now: float, wild: Wild, tick: int
) -> None:
    """Count a motion that was handed out."""
    wild.motions += 1
    shares, limits = limit_shares(reference, motion_filter.limits), motion_filter.limits
    wild.share = max(wild.share, float(np.max(shares)))
    if np.max(shares) > 1.0 + _ROUNDING:
        wild.broken.append(f"tick {tick}: shares of velocity, acceleration, jerk {np.round(shares, 4).tolist()}")
    positions = reference.samples(np.arange(0.0, reference.duration, 0.01))[0]
    if np.any((positions < limits.lower - _ROUNDING) | (positions > limits.upper + _ROUNDING)):
        wild.broken.append(f"tick {tick}: a position beyond its limits")
    # It takes over from the present motion: until then it repeats that.
    begun = reference.sample(now - begin)
    for name, one, other, largest in zip(("position", "velocity"), begun, state, (_SAME_PLACE, 1e-5), strict=False):
        if now >= begin and np.max(np.abs(one - other)) > largest:
            wild.broken.append(f"tick {tick}: its {name} begins {np.max(np.abs(one - other)):.2g} elsewhere")
    if not reference.is_finite:
        wild.broken.append(f"tick {tick}: a number that is none")
