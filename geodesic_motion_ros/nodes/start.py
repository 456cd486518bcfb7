"""Where the programs `planner`, `twin` and `demo` begin: light, so that --help answers at once, and that Ctrl-C ends
them cleanly from the first moment.

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
from geodesic_motion_ros.kernels import compile_kernels


def planner() -> int:
    """Run the planner; returns the exit code."""
    return _start("planner_node", 0, lambda: _answer("planner"))


def twin() -> int:
    """Run the twin; returns the exit code."""
    return _start("twin_node", 0, lambda: _answer("twin"))


def demo(arguments: Sequence[str] | None = None) -> int:
    """Run the demo with arguments, by default those of this process; returns the exit code."""
    return _start("demo_node", 130, lambda: _parse_demo(arguments), *([] if arguments is None else [arguments]))


def _answer(name: str) -> int | None:
    from geodesic_motion_ros.nodes.usage import answer

    return answer(name, None)


def _parse_demo(arguments: Sequence[str] | None) -> None:
    from geodesic_motion_ros.nodes.demo_options import parsed

    parsed(arguments)  # it leaves by SystemExit where it has answered


def _start(module: str, interrupted: int, answer: Callable[[], int | None], *arguments: Sequence[str]) -> int:
    """Answer a command line that needs no more than that; else compile what is missing, load a module of this folder
    and run its `main`. `interrupted` is the exit code of a signal meanwhile.
    """

    def end(number: int, frame: FrameType | None) -> None:
        os._exit(interrupted)

    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, end) for number in numbers]
    try:
        if (code := answer()) is not None:
            return code
        compile_kernels()
        main = importlib.import_module(f"{__package__}.{module}").main
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
    return main(*arguments)
