"""Where the programs `planner`, `twin` and `demo` begin: light, so that Ctrl-C ends them cleanly from the first moment.

Their libraries take seconds to load. An interrupt meanwhile would surface as a traceback from deep within any of them;
until the program's own handling is in place, it ends the process at once: nothing was begun.
"""

from __future__ import annotations

import importlib
import os
import signal
from types import FrameType

from geodesic_motion_ros import nodes as _nodes  # noqa: F401  (sets the environment of numpy before it is loaded)


def planner() -> int:
    """Run the planner; returns the exit code."""
    return _start("planner_node", 0)


def twin() -> int:
    """Run the twin; returns the exit code."""
    return _start("twin_node", 0)


def demo() -> int:
    """Run the demo; returns the exit code."""
    return _start("demo_node", 130)


def _start(module: str, interrupted: int) -> int:
    """Load a module of this folder, with `interrupted` as the exit code of a signal meanwhile, and run its `main`."""

    def end(number: int, frame: FrameType | None) -> None:
        os._exit(interrupted)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, end) for number in numbers]
    main = importlib.import_module(f"{__package__}.{module}").main
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)
    return main()
