"""Compiles the kernels of the planners ahead, all cores at work, and says how far it is.

numba compiles a kernel where it is first called, and keeps the result in a cache beside the source. Right after an
installation that takes a minute, one kernel after the other, without a word. So programs call `compile_kernels` before
they load numba: processes of their own (`kernel_worker`) compile what `kernels.json` lists and the cache lacks.

The list may be out of date: that costs time, never correctness. `python -m geodesic_motion_ros.planning.kernels`
compiles, `python -m geodesic_motion_ros.planning.kernels --write` makes the list anew.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import json
import math
import os
import selectors
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from geodesic_motion_ros.utils.cache import PACKAGE, cache_folder, machine

LIST = Path(__file__).with_name("kernels.json")
#: More processes gain nothing: what remains is one kernel that takes a third of all the time.
_MOST_PROCESSES = 4
#: The option of this interpreter, for workers.
_OPTIMIZED = [f"-{'O' * sys.flags.optimize}"] if sys.flags.optimize else []
#: Between two lines about the progress [s].
_SAID_EVERY = 1.0


def say(text: str) -> None:
    """Write a line to standard error, at once."""
    print(text, file=sys.stderr, flush=True)


def compile_kernels(report: Callable[[str], None] = say) -> None:
    """Compile the listed kernels that numba's cache lacks; takes milliseconds where all are known to be there.

    report : called with a line about the progress, at most about once a second; never where nothing is to do. A kernel
    that cannot be compiled here is reported and left to its first call. Programs that start together compile once.
    """
    folder, mark = cache_folder(), _fingerprint()
    if folder is None:
        return
    # numba keeps what each level of optimization compiles: the bytecode differs.
    finished = folder / f"kernels.finished{sys.flags.optimize or ''}"
    if _is_finished(finished, mark):
        return
    with _locked(folder / "kernels.lock", report):
        if _is_finished(finished, mark):
            return
        counts = _compile_listed(folder / "kernels.turns", report)
        if counts is not None:
            finished.write_text(json.dumps({"mark": mark, "counts": counts}))


def _fingerprint() -> str:
    """Of all that numba's cache depends on: the listed kernels and their files, the versions, the processor."""
    sources = [PACKAGE / f"{name.replace('.', '/')}.py" for name in sorted({row[0] for row in listed()})]
    stamps = [(stat.st_mtime_ns, stat.st_size) for stat in (path.stat() for path in sources if path.exists())]
    whole = LIST.read_text(), stamps, machine("numba", "llvmlite", variables=("NUMBA_",))
    return hashlib.sha256(repr(whole).encode()).hexdigest()


def listed() -> list[list[str]]:
    """The kernels as rows of module (within the package), function, and types of the arguments, longest work first."""
    return json.loads(LIST.read_text())["called"]


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
    """Hold a lock on a file, which may not exist yet; says so where another process holds it."""
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            report("another process compiles the kernels: waiting for it")
            fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _compile_listed(turns: Path, report: Callable[[str], None]) -> dict[str, int] | None:
    """Let workers compile the list; returns how many kernels each folder of the cache holds then.

    turns : a file whose locks tell the workers what the others are at. None where workers ended before the list did.
    """
    content = json.loads(LIST.read_text())
    waiting, asked, total = iter(range(len(content["called"]))), len(content["called"]), content["kernels"]
    began, said, answered = time.monotonic(), -math.inf, 0
    kernels: set[str] = set()
    folders: set[str] = set()
    with ExitStack() as stack, selectors.DefaultSelector() as selector:
        for _ in range(min(_MOST_PROCESSES, len(os.sched_getaffinity(0)))):
            worker = stack.enter_context(_worker(turns))
            assert worker.stdout is not None
            selector.register(worker.stdout, selectors.EVENT_READ, worker)
        while selector.get_map():
            if answered < asked and time.monotonic() - said >= _SAID_EVERY:
                said = time.monotonic()
                report(f"compiling kernels, once: {len(kernels)} of {max(total, len(kernels))}")
            for key, _ in selector.select(_SAID_EVERY):
                line = key.data.stdout.readline()
                if not line:  # it has ended
                    selector.unregister(key.fileobj)
                    continue
                answer = json.loads(line)
                if "kernel" in answer:
                    kernels.add(answer["kernel"])
                    continue
                answered += "ready" not in answer
                if "folder" in answer:
                    folders.add(answer["folder"])
                if "problem" in answer:
                    report(f"not compiled ahead: {answer['problem']}")
                with suppress(BrokenPipeError):  # it has ended, and its next line says so
                    if (number := next(waiting, None)) is None:
                        key.data.stdin.close()
                    else:
                        key.data.stdin.write(b"%d\n" % number)
    report(f"compiled {len(kernels)} kernels in {time.monotonic() - began:.0f} s")
    return {folder: count_cached(folder) for folder in folders} if answered == asked else None


@contextmanager
def _worker(turns: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that compiles the kernels whose numbers it reads; killed on leaving, where it has not ended by itself.

    In a session of its own: Ctrl-C reaches this process alone. Without buffers: a line that has been read already would
    wake no selector.
    """
    worker = subprocess.Popen(
        [sys.executable, *_OPTIMIZED, "-m", f"{__package__}.kernel_worker", str(os.getpid()), str(turns)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, start_new_session=True,
    )  # fmt: skip
    try:
        yield worker
    finally:
        worker.kill()
        worker.wait()


def main() -> None:
    """Compile the listed kernels, or make the list anew."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--write", action="store_true", help=f"make {LIST.name} anew: two minutes")
    if not parser.parse_args().write:
        return compile_kernels()
    with tempfile.TemporaryDirectory() as cache:
        command = [sys.executable, "-m", f"{__package__}.kernel_list"]
        done = subprocess.run(command, env=os.environ | {"NUMBA_CACHE_DIR": cache}, check=True, stdout=subprocess.PIPE)
    LIST.write_bytes(done.stdout)


if __name__ == "__main__":
    main()
