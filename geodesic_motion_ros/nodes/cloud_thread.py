"""A thread that turns clouds into distance fields beside the control loop, the newest first.

It must not have a lower priority than the loop: preempted while it holds the interpreter lock, it would stop the loop.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class CloudFigures:
    """The figures of the newest cloud: its points that count, those without a place, those out of reach, those of the
    arm and of the declared scene; how many cubes are remembered, how many clusters it has, and the time [s] that
    reading it and making its field took, without the wait for a joint state. And its number among those that were used.
    """

    points: int = 0
    not_finite: int = 0
    out_of_reach: int = 0
    of_arm: int = 0
    of_scene: int = 0
    remembered: int = 0
    clusters: int = 0
    duration: float = 0.0
    number: int = 0


class CloudThread:
    """A thread that calls `make` with the newest message, and `take` with what that returns and what was noted of the
    message.

    Messages that come while one is worked on replace each other: none waits behind another. `failed` is called with an
    exception, and the next message tried.
    """

    def __init__(
        self,
        make: Callable[[Any], Any],
        take: Callable[[Any, Any], None],
        failed: Callable[[BaseException], None],
    ) -> None:
        self._make, self._take, self._failed = make, take, failed
        self._changed = threading.Condition()
        self._waiting: tuple[Any, Any] | None = None
        self._generation = 0
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="obstacle_cloud", daemon=True)

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    def stop(self, timeout: float = 1.0) -> None:
        """End the thread; harmless when it has ended or never began."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def put(self, message: Any, note: Any = None) -> None:
        """Hand over a message, and what `take` is to know of it."""
        with self._changed:
            self._waiting = message, note
            self._changed.notify()

    def forget(self) -> None:
        """Drop what waits and what is being worked on."""
        with self._changed:
            self._waiting = None
            self._generation += 1

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopping or self._waiting is not None)
                if self._stopping:
                    return
                (message, note), self._waiting = self._waiting, None
                generation = self._generation
            try:
                made = self._make(message)
            except Exception as error:
                self._failed(error)
                continue
            with self._changed:
                if generation == self._generation and made is not None:
                    self._take(made, note)
