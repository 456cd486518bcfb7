"""A thread that draws now and then, beside the control loop.

It must not have a lower priority than the loop: preempted while it holds the interpreter lock, it would stop the loop.
"""

from __future__ import annotations

import threading
from collections.abc import Callable


class ViewThread:
    """Calls `draw` every `period` seconds until stopped; an exception goes to
    `failed`, once.
    """

    def __init__(self, draw: Callable[[], None], period: float, failed: Callable[[BaseException], None]) -> None:
        self._draw, self._period, self._failed = draw, period, failed
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="latent_view", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self, timeout: float = 1.0) -> None:
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def _run(self) -> None:
        try:
            while not self._stopping.wait(self._period):
                self._draw()
        except Exception as error:
            self._failed(error)
