"""The start of the programs `planner`, `filter`, `twin`, `record`, `franka` and `view`, and how others of their kind
do: light, so that --help answers at once, and that Ctrl-C ends them cleanly from the first moment.

Their libraries take seconds to load, and after an installation half a minute to compile. An interrupt meanwhile would
surface as a traceback from deep within any of them; until the program's own handling is in place, it ends the process
at once: nothing was begun.
"""

from __future__ import annotations

import importlib
import os
import signal
from collections.abc import Callable, Sequence
from types import FrameType

from geodesic_motion_ros import nodes as _nodes  # noqa: F401  (sets the environment of numpy before it is loaded)
from geodesic_motion_ros.kernels.compile_ahead import compile_kernels
from geodesic_motion_ros.utils.piped_output import until_reader_leaves


def planner() -> int:
    """Run the planner; returns the exit code."""
    return start(f"{__package__}.planner_node", 0, lambda: _answer("planner"))


def filter() -> int:
    """Run the filter; returns the exit code."""
    return start(f"{__package__}.filter_node", 0, lambda: _answer("filter"))


def twin() -> int:
    """Run the twin; returns the exit code."""
    return start(f"{__package__}.twin_node", 0, lambda: _answer("twin"))


def record() -> int:
    """Record demonstrations; returns the exit code."""
    return start(f"{__package__}.record_node", 0, lambda: _answer("record"))


def franka() -> int:
    """Drive a Franka Research 3; returns the exit code."""
    return start(f"{__package__}.franka_node", 0, lambda: _answer("franka"))


def view() -> int:
    """Show the arm in the browser; returns the exit code."""
    return start(f"{__package__}.view_node", 0, lambda: _answer("view"))


def _answer(name: str) -> int | None:
    from geodesic_motion_ros.nodes.usage import PROGRAMS, answer

    return answer(PROGRAMS[name], None)


def start(module: str, interrupted: int, answer: Callable[[], int | None], *arguments: Sequence[str]) -> int:
    """Answer a command line that needs no more than that; else compile what is missing, load a module and run its
    `main`. `interrupted` is the exit code of a signal meanwhile.
    """

    def end(number: int, frame: FrameType | None) -> None:
        os._exit(interrupted)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, end) for number in numbers]
    try:
        if (code := until_reader_leaves(answer)) is not None:
            return code
        compile_kernels()
        main = importlib.import_module(module).main
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
    return main(*arguments)
