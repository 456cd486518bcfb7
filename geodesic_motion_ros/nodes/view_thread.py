"""A thread that draws now and then, beside the control loop.

It must not have a lower priority than the loop: preempted while it holds the interpreter lock, it would stop the loop.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

#: How soon somebody who begins to look is seen [s].
_GLANCE = 0.2


class ViewThread:
    """A thread that, while `watched` says so, calls `draw` every `period` seconds, and at once when it begins to: the
    picture that is latched may be of long ago. An exception goes to `failed`, once, and ends it.
    """

    def __init__(
        self,
        draw: Callable[[], None],
        watched: Callable[[], bool],
        period: float,
        failed: Callable[[BaseException], None],
        name: str = "view",
    ) -> None:
        self._draw, self._watched, self._period, self._failed = draw, watched, period, failed
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin to draw."""
        self._thread.start()

    def stop(self, timeout: float = 1.0) -> None:
        """End the thread; harmless when it has ended or never began."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(timeout)

    def _run(self) -> None:
        try:
            glances = math.ceil(self._period / _GLANCE)
            count = 0
            while not self._stopping.wait(self._period / glances):
                watched = self._watched()
                if watched and count % glances == 0:
                    self._draw()
                count = count + 1 if watched else 0
        except Exception as error:
            self._failed(error)
