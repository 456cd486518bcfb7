"""Worker: searches in a thread of its own what takes longer than a tick has, detours and the next round."""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Generic, TypeVar

from geodesic_motion_ros.contract.status import Refusal, VerdictCode

Result = TypeVar("Result")
_LOGGER = logging.getLogger(__name__)
#: The time from the request of a detour to its arrival [s], where a planner is given no other worker.
DETOUR_DELAY = 0.15
#: Of times [s].
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Job(Generic[Result]):
    """A search that was begun; its result arrives at a time `ready` [s], None: when it is there."""

    future: Future[Result]
    ready: float | None

    def is_done(self, now: float) -> bool:
        """Whether the result has arrived at a time [s]."""
        return self.future.done() if self.ready is None else now >= self.ready - _ROUNDING

    @property
    def result(self) -> Result:
        """What was found, or why nothing was; waits for it where the search still runs."""
        return self.future.result()


class Worker:
    """One thread that makes one search after the other."""

    def __init__(self, delay: float | None = None) -> None:
        """delay : a result arrives this long [s] after its request, however long the search takes: then a planner does
        the same in every run, as tests and the benchmark require. None: a result arrives when the search ends.
        """
        self._delay = delay
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="searches")

    def start(self, search: Callable[[], Result | Refusal], now: float) -> Job[Result | Refusal]:
        """Begin a search at a time [s], or as soon as those begun before have ended."""
        ready = None if self._delay is None else now + self._delay
        return Job(self._executor.submit(_explained, search), ready)

    def close(self) -> None:
        """End the thread, after the search that runs."""
        self._executor.shutdown(cancel_futures=True)


def _explained(search: Callable[[], Result | Refusal]) -> Result | Refusal:
    """The result of a search; an error in it becomes a refusal, as ticks must go on without it."""
    try:
        return search()
    except Exception as error:
        _LOGGER.exception("a search beside the ticks failed")
        return Refusal(VerdictCode.NO_FEASIBLE_PATH, f"its search failed, see the log: {error!r}")
