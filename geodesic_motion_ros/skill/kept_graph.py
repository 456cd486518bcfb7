"""The latent graph of a skill of configurations, kept between programs: to decode it takes seconds, to read it none.

A file of the cache (`utils/cache.py`) holds the arrays of one graph. Its name is the digest of everything that these
follow from: what the skill has learned, the arm, the settings, the code and the machine. So where one of them changes
another file is made, and what is read is what would be decoded, to the last bit. A file that is damaged, or not whole,
is made anew. `python -m geodesic_motion_ros.skill.kept_graph` makes those of the shipped skills.
"""

from __future__ import annotations

import hashlib
import os
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph, build_configuration_graph
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.cache import PACKAGE, cache_folder, machine
from geodesic_motion_ros.utils.checked_files import opened, read_arrays
from geodesic_motion_ros.utils.errors import FileError
from geodesic_motion_ros.utils.whole_files import written_whole

#: Graphs of fewer edges are decoded faster than it is worth.
SMALLEST = 10_000
#: The files that were used last stay, up to this many bytes in all.
LARGEST_CACHE = 1 << 30
#: Folders of the package with the code that makes a graph.
_CODE = "geometry", "manifold", "robot"
#: A graph that takes longer than this [s] is announced.
_SILENT_FOR = 2.0


def read_or_build_graph(name: str, recipe: Mapping[str, Any]) -> ConfigurationGraph:
    """Read the graph that `build_configuration_graph` makes of a recipe, its arguments by name; build and keep it where
    none is kept.

    A line on standard error says when it takes long. name : of the skill, for that line.

    Raises
    ------
    SkillError where nothing of the box is supported.
    """
    folder = cache_folder()
    file = None if folder is None else folder / "graphs" / f"{digest_recipe(recipe)}.npz"
    if file is not None and (graph := _read(file, recipe)) is not None:
        return graph
    with _announced(f"building the latent graph of {name}, once: this may take a minute"):
        began = time.monotonic()
        graph = build_configuration_graph(**recipe)
        arrays = graph.arrays()
    if time.monotonic() - began > _SILENT_FOR:
        print(f"built the latent graph of {name} in {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    if file is not None and len(graph.edges) >= SMALLEST:
        try:
            _write(file, arrays)
        except OSError as error:
            print(f"the latent graph of {name} could not be kept: {error}", file=sys.stderr, flush=True)
    return graph


def _read(file: Path, recipe: Mapping[str, Any]) -> ConfigurationGraph | None:
    """The graph of a file; None where there is none, or it is damaged: an archive has a checksum of every array."""
    try:
        with opened(file, LARGEST_CACHE) as stream:
            # Kernels are compiled for arrays that can be written to.
            arrays = {name: array.copy(order="K") for name, array in read_arrays(stream).items()}
        graph = ConfigurationGraph.from_arrays(arrays, recipe)
    except (OSError, FileError, KeyError):
        return None
    with suppress(OSError):
        os.utime(file)
    return graph


def _write(file: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write a file whole or not at all, and remove those that were not used for longest."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(file) as part, part.open("wb") as stream:
        np.savez(stream, **arrays)
    taken = 0
    for one in sorted(file.parent.iterdir(), key=_last_used, reverse=True):
        with suppress(OSError):  # another process may remove it as well
            taken += one.stat().st_size
            if taken > LARGEST_CACHE:
                one.unlink()


def _last_used(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0


@contextmanager
def _announced(text: str) -> Iterator[None]:
    """Print a line on standard error if what is done inside takes longer than `_SILENT_FOR`."""
    timer = threading.Timer(_SILENT_FOR, lambda: print(text, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def digest_recipe(recipe: Mapping[str, Any]) -> str:
    """Name everything in a recipe by a digest, with the code that makes a graph and for the machine."""
    hasher = hashlib.sha256(_made_by().encode())
    _add(hasher, dict(recipe))
    return hasher.hexdigest()


def _add(hasher: Any, value: Any) -> None:
    """Add a value to a digest, with all that it consists of."""
    if isinstance(value, np.ndarray | np.generic):
        array = np.ascontiguousarray(value)
        hasher.update(f"{array.dtype.str}{np.shape(value)}".encode())
        hasher.update(array.tobytes())
    elif isinstance(value, Robot):
        # What a graph takes from an arm.
        _add(hasher, (value.chain, value.joint_names))
    elif is_dataclass(value):
        _add(hasher, {field.name: getattr(value, field.name) for field in fields(value)})
    elif isinstance(value, dict):
        _add(hasher, tuple(sorted(value.items())))
    elif isinstance(value, tuple | list):
        hasher.update(f"({len(value)}".encode())
        for item in value:
            _add(hasher, item)
    elif value is None or isinstance(value, str | int | float):
        hasher.update(f"{type(value).__name__} {value!r};".encode())
    else:
        raise TypeError(f"no digest of {type(value).__name__}")


@cache
def _made_by() -> str:
    """The code that makes a graph, and the machine that runs it."""
    sources = sorted(file for folder in _CODE for file in (PACKAGE / folder).glob("*.py"))
    code = [hashlib.sha256(file.read_bytes()).hexdigest() for file in sources]
    return repr(code) + machine("numpy", "scipy", "numba", variables=("NUMBA_", "NPY_", "OPENBLAS_CORETYPE"))


def main() -> None:
    """Make the graphs of the shipped skills that are not kept yet."""
    from geodesic_motion_ros.skill.skill import Skill, shipped_skills

    for name in shipped_skills():
        Skill.load(name).graph()


if __name__ == "__main__":
    main()
