"""Where detours are searched: that takes longer than a tick has.

A node searches them in a thread of its own (`ThreadWorker`). Where results are to be the same in every run, as in tests
and in the benchmark, each one arrives so long after it was asked for (`SimulatedWorker`).
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from geodesic_motion_ros.planning.detour import Detour

Search = Callable[[], Detour | str]


class DetourJob(Protocol):
    """A search that was begun."""

    def done(self, now: float) -> bool:
        """Whether its result is there at a time [s]."""
        ...

    @property
    def result(self) -> Detour | str:
        """The detour, or why there is none; waits for it where it is not there."""
        ...


class DetourWorker(Protocol):
    """What searches detours."""

    def start(self, search: Search, now: float) -> DetourJob:
        """Begin a search at a time [s]."""
        ...


@dataclass(frozen=True)
class SimulatedWorker:
    """Searches take `delay` [s] of the planner's time, whatever they take of the machine's."""

    delay: float = 0.15

    def start(self, search: Search, now: float) -> DetourJob:
        """Begin a search at a time [s]."""
        return _SimulatedJob(search, now + self.delay)


@dataclass(frozen=True, eq=False)
class _SimulatedJob:
    search: Search
    ready: float

    def done(self, now: float) -> bool:
        return now >= self.ready - 1e-6

    @cached_property
    def result(self) -> Detour | str:
        return self.search()


class ThreadWorker:
    """Searches in one thread beside that of the ticks."""

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="detours")

    def start(self, search: Search, now: float) -> DetourJob:
        """Begin a search; where another one runs, after that."""
        return _ThreadJob(self._executor.submit(search))

    def close(self) -> None:
        """End the thread, after the search that runs."""
        self._executor.shutdown(cancel_futures=True)


@dataclass(frozen=True, eq=False)
class _ThreadJob:
    future: Future[Detour | str]

    def done(self, now: float) -> bool:
        return self.future.done()

    @property
    def result(self) -> Detour | str:
        return self.future.result()
