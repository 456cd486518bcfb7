"""What takes long to make is kept between programs: where, and of which machine. Light: no numpy."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

import geodesic_motion_ros

PACKAGE = Path(geodesic_motion_ros.__path__[0])


def cache_folder() -> Path | None:
    """The folder of what is kept, as numba's cache beside the source if possible; None where nothing can be written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / PACKAGE.name
    for folder in [Path(chosen)] if chosen else [PACKAGE / "__pycache__", user]:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            if os.access(folder, os.W_OK):
                return folder
    return None


def machine(*libraries: str, variables: Sequence[str]) -> str:
    """Describe the processor, Python, some libraries by name, and the environment variables with some prefixes: where
    they differ, so may the last bit of a number.
    """
    processor = [line for line in _lines("/proc/cpuinfo") if line.startswith(("flags", "model name", "Features"))]
    chosen = {name: value for name, value in sorted(os.environ.items()) if name.startswith(tuple(variables))}
    return repr((sys.version, [version(name) for name in libraries], processor[:2], chosen))


def _lines(path: str) -> list[str]:
    try:
        return Path(path).read_text().splitlines()
    except OSError:
        return []
