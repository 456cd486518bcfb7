"""A process that compiles kernels for `kernels`: those whose numbers on the list it reads, line by line.

Several of them share the work. What kernels of different processes call is compiled by the process that needs it first;
the others wait for that and read the cache. Signatures that are written at a kernel would be compiled as soon as its
module is imported: here they wait until that kernel is needed.
"""

from __future__ import annotations

import ctypes
import fcntl
import hashlib
import json
import os
import signal
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from numba.core.dispatcher import Dispatcher

from geodesic_motion_ros.kernel_list import PACKAGE, read_types, row
from geodesic_motion_ros.kernels import listed

_DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of linux/prctl.h


class Turns:
    """Stands between numba and its dispatchers, for the two things above. `locks` : a folder that the workers share."""

    def __init__(self, locks: Path) -> None:
        self._locks, self._held, self._importing = locks, set(), False
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
        name = hashlib.sha256(repr((row(kernel, ()), types)).encode()).hexdigest()
        if name in self._held:  # it calls itself
            return compile_now(kernel, types)
        self._held.add(name)
        try:
            with (self._locks / name).open("w") as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                return compile_now(kernel, types)
        finally:
            self._held.remove(name)


def main(parent: int, locks: Path) -> None:
    """Answer each number with a line: a list of the (folder of the cache, what went wrong or "") of its kernel."""
    ctypes.CDLL(None).prctl(_DIE_WITH_PARENT, signal.SIGKILL)
    turns, rows = Turns(locks), listed()
    print("[]", flush=True)  # ready
    for line in sys.stdin if os.getppid() == parent else ():
        folder = problem = ""
        module, function, types = rows[int(line)]
        try:
            folder = turns.compile(module, function, types)
        except Exception as error:  # no kernel is worth a program that does not start
            problem = f"{module}.{function}: {' '.join(str(error).split())[:300]}"
        print(json.dumps([(folder, problem)]), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), Path(sys.argv[2]))
