"""Compiles the kernels of the planners ahead, and says how far it is. Light: no numpy.

numba compiles a kernel where it is first called, and keeps the result in a cache beside the source: after an
installation that takes a minute and a half, without a word. So programs call `compile_kernels` before they load numba.
Where the cache lacks something, a process of its own (`compiler`) calls all kernels.

One process alone: numba's cache may mix up what two of them compile of one function for different types, where both
write at the same moment. `python -m geodesic_motion_ros.kernels.compile_ahead` compiles, and does no more.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from geodesic_motion_ros.utils.cache import PACKAGE, cache_folder, machine

#: The folders of the package that have kernels of planners or call them, and about how many kernels there are.
FOLDERS = (
    "certification", "detours", "filtering", "geometry", "kernels", "manifold", "motion", "obstacles", "planning",
    "queries", "robot", "trajectory",
)  # fmt: skip
ABOUT = 200
#: Between two lines about the progress, and about another process's; between two looks whether that has ended [s].
_SAID_EVERY, _SAID_AGAIN, _LOOKED_AGAIN = 1.0, 10.0, 0.1


def say(text: str) -> None:
    """Write a line to standard error, at once."""
    print(text, file=sys.stderr, flush=True)


def compile_kernels(report: Callable[[str], None] = say) -> None:
    """Compile the kernels that numba's cache lacks; takes milliseconds where all are known to be there.

    report : called with a line about the progress, at most about once a second; never where nothing is to do. Programs
    that start together compile once.
    """
    folder, mark = cache_folder(), _fingerprint()
    if folder is None:
        return
    # numba keeps what each level of optimization compiles: the bytecode differs.
    finished = folder / f"kernels.finished{sys.flags.optimize or ''}"
    if _is_finished(finished, mark):
        return
    with _locked(folder / "kernels.lock", report):
        if not _is_finished(finished, mark) and (folders := _compile(report)) is not None:
            counts = {name: count_cached(name) for name in folders}
            finished.write_text(json.dumps({"mark": mark, "counts": counts}))


def _fingerprint() -> str:
    """Of all that numba's cache depends on: the files with kernels, the versions, the processor."""
    sources = sorted(file for folder in FOLDERS for file in (PACKAGE / folder).glob("*.py"))
    stamps = [(stat.st_mtime_ns, stat.st_size) for stat in (file.stat() for file in sources)]
    return hashlib.sha256(repr((stamps, machine("numba", "llvmlite", variables=("NUMBA_",)))).encode()).hexdigest()


def _is_finished(finished: Path, mark: str) -> bool:
    """Whether all was compiled for a mark, and the cache still holds as many files as then."""
    try:
        known = json.loads(finished.read_text())
        return known["mark"] == mark and all(count_cached(folder) >= n for folder, n in known["counts"].items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return False


def count_cached(folder: str) -> int:
    """How many kernels a folder of numba's cache holds."""
    return sum(name.endswith(".nbi") for name in os.listdir(folder))


@contextmanager
def _locked(path: Path, report: Callable[[str], None]) -> Iterator[None]:
    """Hold a lock on a file, which may not exist yet; says now and then for how long another process holds it."""
    with path.open("w") as file:
        began, said = time.monotonic(), -math.inf
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                now = time.monotonic()
                if now - said > _SAID_AGAIN:
                    said = now
                    report(f"another process compiles the kernels: waiting for it, {now - began:.0f} s so far")
                time.sleep(_LOOKED_AGAIN)
        yield


def _compile(report: Callable[[str], None]) -> list[str] | None:
    """Let a process call all kernels; returns the folders of numba's cache, None where it failed."""
    began, said, kernels = time.monotonic(), -math.inf, 0
    folders = []
    optimized = [f"-{'O' * sys.flags.optimize}"] if sys.flags.optimize else []
    command = [sys.executable, *optimized, "-m", f"{__package__}.compiler"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            for line in map(str.strip, process.stdout):
                if os.path.isabs(line):
                    folders.append(line)
                    continue
                kernels += 1
                if time.monotonic() - said >= _SAID_EVERY:
                    said = time.monotonic()
                    report(f"compiling kernels, once: {kernels} of about {max(ABOUT, kernels)}")
        except BaseException:
            process.kill()
            raise
    if process.returncode:
        report("not all kernels could be compiled ahead: the others are where they are called")
        return None
    if kernels:
        report(f"compiled {kernels} kernels in {time.monotonic() - began:.0f} s")
    return folders


if __name__ == "__main__":
    compile_kernels()
