"""The preparation of what takes longer than a cycle may, beside the control loop: goals, and what the hand is to hold.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Generic, TypeVar

Prepared = TypeVar("Prepared")


class Preparation(Generic[Prepared]):
    """The preparation of one thing after the other; of those requested meanwhile only the newest is next.

    So goals that come faster than they are prepared neither queue up nor keep each other from ever being taken. One
    thread asks.
    """

    def __init__(self, background: Executor | None) -> None:
        """background : prepares them; None: `take_settled` does, and takes as long."""
        self._background = background
        self._running: Future[Prepared] | None = None
        self._next: Callable[[], Prepared] | None = None

    def ask(self, prepare: Callable[[], Prepared]) -> None:
        """Prepare this after what is being prepared, in the place of anything else that was requested."""
        self._next = prepare

    def forget(self) -> None:
        """Forget what has been requested."""
        self._running = self._next = None

    @property
    def busy(self) -> bool:
        """Whether something is being prepared, or is to be."""
        return self._running is not None or self._next is not None

    def take_settled(self) -> Prepared | None:
        """Take what has been prepared, once, and have the next one begun; None while there is nothing. Raises what its
        preparation raised.
        """
        done = self._running if self._running is not None and self._running.done() else None
        if done is not None:
            self._running = None
        if self._running is None and self._next is not None:
            prepare, self._next = self._next, None
            if self._background is None:
                return prepare()
            self._running = self._background.submit(prepare)
        return None if done is None else done.result()
