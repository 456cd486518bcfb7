"""Wall time and processor time of repeated calls: what the second shows, other work on the machine does not change."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np


class Stopwatch:
    """Durations [s] of what runs inside `with stopwatch:`, one after another; in one thread.

    Attributes
    ----------
    wall : by the clock; cpu : processor time of the thread.
    """

    def __init__(self) -> None:
        self.wall: list[float] = []
        self.cpu: list[float] = []

    def __enter__(self) -> Stopwatch:
        self._cpu, self._wall = time.thread_time(), time.perf_counter()
        return self

    def __exit__(self, *_: object) -> None:
        wall, cpu = time.perf_counter(), time.thread_time()
        self.wall.append(wall - self._wall)
        self.cpu.append(cpu - self._cpu)

    @classmethod
    def fastest(cls, watches: Sequence[Stopwatch]) -> Stopwatch:
        """The shorter of what the same work took several times, one after the other."""
        shortest = cls()
        shortest.wall = [min(times) for times in zip(*(watch.wall for watch in watches), strict=True)]
        shortest.cpu = [min(times) for times in zip(*(watch.cpu for watch in watches), strict=True)]
        return shortest

    def add(self, other: Stopwatch, numbers: Iterable[int]) -> None:
        """Take over some of another's durations."""
        for number in numbers:
            self.wall.append(other.wall[number])
            self.cpu.append(other.cpu[number])


def percentiles_ms(seconds: list[float] | np.ndarray) -> dict[str, float]:
    """p50, p99 and max [ms] of durations [s]; nan of none."""
    values = 1e3 * np.percentile(seconds, [50.0, 99.0, 100.0]) if len(seconds) else np.full(3, np.nan)
    return dict(zip(("p50", "p99", "max"), values.tolist(), strict=True))


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Python's garbage is collected before and after, not meanwhile."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@contextmanager
def no_garbage_among_what_stands() -> Iterator[None]:
    """What is there already is no garbage: every collection inside would look through all of it, graphs of millions of
    objects among it, again and again."""
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
