"""How long the machine stood still for the bench: what is late by that is not the nodes' fault."""

from __future__ import annotations

import threading
import time

#: It is looked at so often [s].
_EVERY = 0.002


class Standstill:
    """Looks all the time whether a thread of this process, of its priority, is woken when it is to be."""

    def __init__(self) -> None:
        self._longest = 0.0
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="standstill", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._ended.set()
        self._thread.join()

    def take(self) -> float:
        """The longest time [s] since the last call that the thread was not woken for when it was to be."""
        longest, self._longest = self._longest, 0.0
        return longest

    def _watch(self) -> None:
        while not self._ended.is_set():
            due = time.monotonic() + _EVERY
            time.sleep(_EVERY)
            self._longest = max(self._longest, time.monotonic() - due)
