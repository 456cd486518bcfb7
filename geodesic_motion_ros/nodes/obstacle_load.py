"""The share of the planner's time that its obstacles take, and how many of them would fit."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

# Of each second obstacles may take so much: the rest is for messages in transit and for what else the node does.
_SHARE = 0.5
# Their messages alone may take so much of a core: with 200 markers 30 times a second (0.23) the loop kept its rate,
# with 500 (0.59) it fell to 80 of 100 Hz.
_SHARE_OF_MESSAGES = 0.25
# Fewer obstacles than this are never too many.
_FEW = 20


class Load(NamedTuple):
    """The processor time that obstacle messages cost.

    share : of one core. received : markers per second.
    """

    share: float
    received: float


class ObstacleLoad:
    """The sum of the processor time that obstacle messages take.

    Parameters
    ----------
    spent : processor time of the calling thread [s]; clock : [s].
    """

    def __init__(
        self, spent: Callable[[], float] = time.thread_time, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._spent, self._clock = spent, clock
        self._lock = threading.Lock()
        self._sum, self._received, self._since = 0.0, 0, clock()

    @contextmanager
    def count_time(self) -> Iterator[None]:
        """Count what the calling thread does inside."""
        began = self._spent()
        try:
            yield
        finally:
            with self._lock:
                self._sum += self._spent() - began

    def count(self, obstacles: int) -> None:
        """Count the obstacles of a message of markers."""
        with self._lock:
            self._received += obstacles

    def take(self) -> Load:
        """Take the load since the last call, and begin to count anew."""
        now = self._clock()
        with self._lock:
            duration = max(now - self._since, 1e-3)
            load = Load(self._sum / duration, self._received / duration)
            self._sum, self._received, self._since = 0.0, 0, now
        return load


def advice(obstacles: int, load: Load, rate: float, tick: float) -> str:
    """Return what to do about a loop that is too slow: where obstacles take most of the time, how many would fit.

    Receiving takes time in proportion to the obstacles a second, which a loop that cannot keep up does not all
    receive: as many fit as take a quarter of a core. Planning takes time in proportion to their number: as many fit as
    take half of a core. Points and clouds are not counted; where markers alone do not explain the load, planning does.

    Parameters
    ----------
    obstacles : how many there are; load : that of their messages.
    rate, tick : ticks a second requested [Hz], and the median of what one takes [s].
    """
    planning = rate * tick
    if obstacles < _FEW or load.share + planning < _SHARE:
        return "too slow or too busy a machine"
    if load.share < planning or load.received < obstacles:
        fit = max(_FEW, int(obstacles * _SHARE / max(planning, load.share)))
        return f"too many obstacles: {obstacles} are planned among, about {_rounded(fit)} would fit"
    fit = max(30 * _FEW, int(load.received * _SHARE_OF_MESSAGES / load.share))
    return (
        f"too many obstacles: {load.received:.0f} a second are received, about {_rounded(fit)} would fit, as "
        f"{_rounded(fit // 30)} of them 30 times a second: publish fewer, or less often, or a cloud"
    )


def _rounded(number: int) -> int:
    """Down to its first digit."""
    digits = 10 ** (len(str(number)) - 1)
    return number // digits * digits
