"""How much of the planner's time its obstacles take, and how many of them would fit."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

# Of each second obstacles may take so much: the rest is for messages on their way and for what else the node does.
_SHARE = 0.5
# Fewer obstacles than this are never too many.
_FEW = 20


class ObstacleLoad:
    """Adds up the processor time that obstacle messages take.

    Parameters
    ----------
    spent : processor time of the calling thread [s]; clock : [s].
    """

    def __init__(
        self, spent: Callable[[], float] = time.thread_time, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._spent, self._clock = spent, clock
        self._lock = threading.Lock()
        self._sum, self._since = 0.0, clock()

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Count what the calling thread does inside."""
        began = self._spent()
        try:
            yield
        finally:
            with self._lock:
                self._sum += self._spent() - began

    def share(self) -> float:
        """Share of the time since the last call that obstacle messages took; 1 is a whole core."""
        now = self._clock()
        with self._lock:
            share = self._sum / max(now - self._since, 1e-3)
            self._sum, self._since = 0.0, now
        return share


def advice(obstacles: int, share: float, rate: float, tick: float) -> str:
    """What to do about a loop that is too slow: where obstacles take most of the time, how many would fit.

    The time that obstacles take, to receive them and to plan among them, grows in proportion to their number; so many
    fit as take half of the time.

    Parameters
    ----------
    obstacles : how many there are; share : of the time that their messages take.
    rate, tick : ticks a second asked for [Hz], and the median of what one takes [s].
    """
    taken = share + rate * tick
    if obstacles < _FEW or taken < _SHARE:
        return "too slow or too busy a machine"
    fit = max(_FEW, int(obstacles * _SHARE / taken))
    digits = 10 ** (len(str(fit)) - 1)
    return (
        f"too many obstacles: {obstacles} take {100.0 * taken:.0f} % of the time, about {fit // digits * digits} would "
        "fit; publish fewer, or less often, or a cloud"
    )
