"""A process that compiles kernels for `kernels`: those whose numbers on the list it reads, line by line.

Several of them share the work. What kernels of different processes call is compiled by the process that needs it first;
the others wait for that and read the cache. Signatures that are written at a kernel would be compiled as soon as its
module is imported: here they wait until that kernel is needed.
"""

from __future__ import annotations

import ctypes
import fcntl
import gc
import hashlib
import json
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

from geodesic_motion_ros.planning.kernel_list import PACKAGE, read_types, row
from geodesic_motion_ros.planning.kernels import listed

_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of linux/prctl.h


class Turns:
    """Lets several processes take turns at compiling kernels, by patching numba's dispatchers.

    turns : a file that the workers share. done : called with the name of each kernel that has been compiled or read.
    """

    def __init__(self, turns: Path, done: Callable[[str], None]) -> None:
        self._turns, self._done, self._importing = turns.open("w"), done, False
        self._written: dict[Dispatcher, Any] = {}
        compile_now, disable, template = Dispatcher.compile, Dispatcher.disable_compile, Dispatcher.get_call_template

        def compile_(kernel: Dispatcher, types: Any) -> Any:
            if self._importing:
                self._written[kernel] = types
                return None
            return self._in_turn(kernel, types, compile_now)

        def disable_compile(kernel: Dispatcher, value: bool = True) -> None:
            if not self._importing:
                disable(kernel, value)

        def get_call_template(kernel: Dispatcher, *arguments: Any) -> Any:
            self._compile_written(kernel)
            return template(kernel, *arguments)

        Dispatcher.compile, Dispatcher.disable_compile = compile_, disable_compile
        Dispatcher.get_call_template = get_call_template

    def compile(self, module: str, function: str, types: str) -> str:
        """Compile a kernel of the list, or read it from the cache; returns the folder of the cache."""
        self._importing = True
        try:
            kernel, arguments = getattr(import_module(f"{PACKAGE}.{module}"), function), read_types(types)
        finally:
            self._importing = False
        self._compile_written(kernel)
        if arguments not in kernel.signatures:
            kernel.compile(arguments)
        return kernel.stats.cache_path

    def _compile_written(self, kernel: Dispatcher) -> None:
        if (types := self._written.pop(kernel, None)) is not None:
            kernel.compile(types)
            kernel.disable_compile()

    def _in_turn(self, kernel: Dispatcher, types: Any, compile_now: Any) -> Any:
        if not kernel.py_func.__module__.startswith(f"{PACKAGE}."):  # numba's own, which no cache holds
            return compile_now(kernel, types)
        name = hashlib.sha256(repr((row(kernel, ()), types)).encode()).hexdigest()
        place = int(name[:15], 16)  # a byte of the shared file for each kernel
        fcntl.lockf(self._turns, fcntl.LOCK_EX, 1, place)
        try:
            result = compile_now(kernel, types)
        finally:
            fcntl.lockf(self._turns, fcntl.LOCK_UN, 1, place)
        self._done(name)
        return result


def main(parent: int, turns: Path) -> None:
    """Answer each number with lines of JSON: {"kernel": NAME} for each kernel that is done; in the end {"folder": of
    the cache}, or {"problem": what went wrong}. The first line, {"ready": true}, answers nothing.
    """
    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    gc.disable()  # collections take a seventh of the time, for a process that soon ends

    def say(**answer: Any) -> None:
        os.write(sys.stdout.fileno(), f"{json.dumps(answer)}\n".encode())

    worker, rows = Turns(turns, lambda name: say(kernel=name)), listed()
    say(ready=True)
    for line in sys.stdin if os.getppid() == parent else ():
        module, function, types = rows[int(line)]
        try:
            say(folder=worker.compile(module, function, types))
        except Exception as error:  # no kernel is worth a program that does not start
            say(problem=f"{module}.{function}: {' '.join(str(error).split())[:300]}")


if __name__ == "__main__":
    with suppress(BrokenPipeError):  # nobody waits for it any more
        main(int(sys.argv[1]), Path(sys.argv[2]))
