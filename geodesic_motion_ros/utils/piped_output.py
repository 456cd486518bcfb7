"""End a program whose output goes into a pipe that nobody reads any more, or onto a disk that is full."""

from __future__ import annotations

import errno
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

Result = TypeVar("Result")
#: Of a disk, a quota, or a file that is full.
_FULL = errno.ENOSPC, errno.EDQUOT, errno.EFBIG


def until_reader_leaves(run: Callable[[], Result]) -> Result | int:
    """Run what prints; returns its result, or the exit status of SIGPIPE where the reader has left, as `head` does, or
    2 where standard output takes no more, in one line.

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
        _write_nowhere()
        return 128 + signal.SIGPIPE
    except OSError as error:
        # That of a file has its name.
        if error.errno not in _FULL or error.filename is not None:
            raise
        _write_nowhere()
        print(f"{Path(sys.argv[0]).name}: standard output cannot be written: {error.strerror}", file=sys.stderr)
        return 2


def _write_nowhere() -> None:
    """Drop what is left to be written at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
