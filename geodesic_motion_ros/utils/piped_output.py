"""What a program does whose output goes into a pipe that nobody reads any more."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from typing import TypeVar

Result = TypeVar("Result")


def until_reader_leaves(run: Callable[[], Result]) -> Result | int:
    """Run what prints; returns its result, or the exit status of SIGPIPE where the reader has left, as `head` does.

    So also where it ends by SystemExit, as argparse does after --help.
    """
    try:
        try:
            result = run()
        except SystemExit:
            sys.stdout.flush()
            raise
        sys.stdout.flush()
        return result
    except BrokenPipeError:
        # What is left to be written at the end goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
