"""A loop at a fixed rate on the steady clock, in a thread of its own, that counts what it misses."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: Statistics are of the ticks in the last so long [s]: what is published once a second must not be smoothed over many.
_SPAN = 1.0


class Schedule:
    """A schedule that decides when the next tick of a loop with a fixed period is due, and counts the periods that were
    missed.

    Missed periods are skipped, never made up in a burst.
    """

    def __init__(self, period: float, start: float) -> None:
        self.period = period
        self.due = start
        self.misses = 0

    @property
    def earliest(self) -> float:
        """The time at which the period of the next tick begins, at whose end it is due: in a hurry it may begin any
        time in it.
        """
        return self.due - self.period

    def finish(self, now: float) -> int:
        """End the tick that is due at `due`, at `now` [s]; returns the periods until the next one, at
        least 1.

        A tick meets its deadline when it ends before the next one is due. Every later one that passed is a
        miss. After a single miss the next tick starts at once, late by less than a period; after more the ones
        that passed are skipped: there is never a burst.
        """
        missed = max(0, int((now - self.due) / self.period))
        self.misses += missed
        periods = 1 if missed <= 1 else missed + 1
        self.due += periods * self.period
        return periods


@dataclass(frozen=True)
class LoopStatistics:
    """The state of the loop: rate [Hz] in the last second, pauses included, tick durations [s] of that second, counts
    since the start.
    """

    rate: float
    tick_p50: float
    tick_p99: float
    ticks: int
    misses: int


class _Recorder:
    """Ring of the last tick starts and durations."""

    def __init__(self, length: int) -> None:
        self._starts = np.zeros(length)
        self._durations = np.zeros(length)
        self.ticks = 0

    def add(self, start: float, duration: float) -> None:
        slot = self.ticks % len(self._starts)
        self._starts[slot], self._durations[slot] = start, duration
        self.ticks += 1

    @property
    def last_duration(self) -> float:
        return float(self._durations[(self.ticks - 1) % len(self._durations)]) if self.ticks else float("nan")

    def statistics(self, misses: int, expected: float) -> LoopStatistics:
        """expected : by when [s] another tick should have begun."""
        count = min(self.ticks, len(self._starts))
        if count < 2:
            return LoopStatistics(float("nan"), float("nan"), float("nan"), self.ticks, misses)
        order = np.argsort(self._starts[:count])
        starts, durations = self._starts[order], self._durations[order]
        now = max(float(starts[-1]), expected)
        recent = durations[starts > now - _SPAN] if starts[-1] > now - _SPAN else durations[-1:]
        p50, p99 = np.percentile(recent, [50.0, 99.0])
        return LoopStatistics(_rate(starts, now), float(p50), float(p99), self.ticks, misses)


def _rate(starts: np.ndarray, now: float) -> float:
    """Ticks a second of those that began at `starts` (n,) [s], two at least, in the last `_SPAN` before `now` [s].

    A pause counts whole: one at the beginning of that time, by the tick before it, and one that goes on.
    """
    first = max(0, min(int(np.searchsorted(starts, now - _SPAN, side="right")), len(starts) - 1) - 1)
    return float((len(starts) - 1 - first) / (now - starts[first]))


class SteadyLoop:
    """A loop that calls `tick(periods)` at a fixed rate in its own thread until stopped.

    Parameters
    ----------
    tick : receives how many periods have passed since the last call (1, or more after misses). An exception ends the
        loop and is handed to `failed`.
    rate_hz : ticks a second.
    failed : called once, from the loop's thread, with the exception that ended the loop.
    window : number of ticks the statistics look back on.
    """

    def __init__(
        self,
        tick: Callable[[int], None],
        rate_hz: float,
        failed: Callable[[BaseException], None],
        name: str = "loop",
        window: int = 1000,
    ) -> None:
        self._tick = tick
        self._failed = failed
        self._period = 1.0 / rate_hz
        self._recorder = _Recorder(window)
        self._misses, self._last_work = 0, float("nan")
        self._stopping, self._hurried = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin to tick."""
        self._thread.start()

    def hurry(self) -> None:
        """Begin the next tick now, not when it is due, as soon as its period has begun. From any thread."""
        self._hurried.set()

    def stop(self, timeout: float = 1.0) -> bool:
        """Ask the loop to end and wait for it [s]; True when it has ended."""
        self._stopping.set()
        self.hurry()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout)
        return not self._thread.is_alive()

    @property
    def ticks(self) -> int:
        """Ticks finished since the start."""
        return self._recorder.ticks

    @property
    def misses(self) -> int:
        """Deadlines missed since the start."""
        return self._misses

    @property
    def last_duration(self) -> float:
        """The duration of the last finished tick [s]; nan before the first."""
        return self._recorder.last_duration

    @property
    def last_work(self) -> float:
        """Processor time of the loop's thread in the last finished tick [s]; nan before the first. The rest of the
        tick's duration it waited for the machine, or for the process's other threads.
        """
        return self._last_work

    def statistics(self) -> LoopStatistics:
        """Return how the loop has done lately."""
        return self._recorder.statistics(self._misses, time.monotonic() - self._period)

    def _run(self) -> None:
        try:
            self._loop()
        except BaseException as error:  # the owner decides what a dead loop means; it must not die unheard
            self._failed(error)

    def _loop(self) -> None:
        schedule = Schedule(self._period, time.monotonic())
        periods = 1
        while not self._stopping.is_set():
            start, worked = time.monotonic(), time.thread_time()
            self._tick(periods)
            end, self._last_work = time.monotonic(), time.thread_time() - worked
            self._recorder.add(start, end - start)
            periods = schedule.finish(end)
            self._misses = schedule.misses
            self._stopping.wait(max(0.0, schedule.earliest - time.monotonic()))
            self._hurried.wait(max(0.0, schedule.due - time.monotonic()))
            self._hurried.clear()
