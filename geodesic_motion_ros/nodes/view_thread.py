"""A thread that draws now and then and always gives way to the control loop."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable

_NICENESS = 15


class ViewThread:
    """Calls `draw` every `period` seconds, at a low priority, until stopped; an exception goes to
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
        # On Linux niceness belongs to the thread, whatever POSIX says.
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
        try:
            while not self._stopping.wait(self._period):
                self._draw()
        except Exception as error:
            self._failed(error)
