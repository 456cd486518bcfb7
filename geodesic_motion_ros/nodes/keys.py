"""Single keys from the terminal that a program was started in."""

from __future__ import annotations

import os
import select
import termios
import tty


class Keys:
    """The keys that are typed, without waiting for the end of a line; Ctrl-C stays a signal.

    Nothing is read where the descriptor is no terminal, or is that of a program in the foreground while this one runs
    in the background: it would be stopped for reading.
    """

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        self._before = termios.tcgetattr(descriptor) if _is_ours(descriptor) else None
        if self._before is not None:
            tty.setcbreak(descriptor, termios.TCSANOW)

    def __bool__(self) -> bool:
        """Whether keys can be pressed."""
        return self._before is not None

    def read(self) -> str:
        """Return what was typed since the last call."""
        if self._before is None or not select.select([self._descriptor], [], [], 0.0)[0]:
            return ""
        return os.read(self._descriptor, 100).decode(errors="replace")

    def close(self) -> None:
        """Leave the terminal as it was; harmless when done before."""
        if self._before is not None:
            termios.tcsetattr(self._descriptor, termios.TCSANOW, self._before)
            self._before = None


def _is_ours(descriptor: int) -> bool:
    if not os.isatty(descriptor):
        return False
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:  # a terminal, and not that of this session: nobody else reads there
        return True
