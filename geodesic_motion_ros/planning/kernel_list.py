"""Which kernels the planners call from Python, and with arguments of which types: as text, and back.

A process of its own that runs this module prints the list: it builds a planner of each kind on the shipped skills with
an empty cache (`python -m geodesic_motion_ros.planning.kernels --write`).
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from importlib import import_module

from numba import types
from numba.core import event
from numba.core.dispatcher import Dispatcher

PACKAGE = __package__.partition(".")[0]
SKILLS = ("panda_reach_to_grasp", "panda_pouring")


def spelled(type_: types.Type) -> str:
    """A type as text that `read_types` understands."""
    if isinstance(type_, types.NamedTuple):
        members, made = ", ".join(map(spelled, type_.types)), type_.instance_class
        return f"named({within_package(made.__module__)!r}, {made.__qualname__!r}, {members})"
    if isinstance(type_, types.UniTuple):
        return f"UniTuple({spelled(type_.dtype)}, {type_.count})"
    if isinstance(type_, types.BaseTuple):
        return f"Tuple(({''.join(f'{spelled(member)}, ' for member in type_.types)}))"
    if isinstance(type_, types.Array):
        return f"Array({type_.dtype}, {type_.ndim}, {type_.layout!r}, {not type_.mutable})"
    return str(type_)


def read_types(text: str) -> tuple[types.Type, ...]:
    """The types of a kernel's arguments."""
    return tuple(eval(f"({text},)" if text else "()", vars(types) | {"named": _named, "bool": types.boolean}))


def _named(module: str, name: str, *members: types.Type) -> types.NamedTuple:
    return types.NamedTuple(members, getattr(import_module(f"{PACKAGE}.{module}"), name))


def within_package(module: str) -> str:
    """The name of a module without that of the package."""
    return module.removeprefix(f"{PACKAGE}.")


def row(kernel: Dispatcher, arguments: tuple[types.Type, ...]) -> tuple[str, str, str]:
    """Module, function and types of a kernel, as the list has them."""
    function = kernel.py_func
    return within_package(function.__module__), function.__name__, ", ".join(map(spelled, arguments))


def build_planners() -> None:
    """A planner of each kind stands then: with every kernel of its ticks."""
    from geodesic_motion_ros.planning.declared_scene import DeclaredScene
    from geodesic_motion_ros.planning.planner import ReactivePlanner
    from geodesic_motion_ros.planning.settings import PlannerSettings
    from geodesic_motion_ros.skill.skill import Skill

    for name in SKILLS:
        ReactivePlanner(Skill.load(name), PlannerSettings(unseen="blocked"), scene=DeclaredScene.empty())


def called() -> list[tuple[str, str, str]]:
    """The kernels that this process has called so far, where the cache holds all that those call."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(f"{PACKAGE}.")]
    kernels = {kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)}
    return [row(kernel, arguments) for kernel in kernels for arguments in kernel.signatures]


class _Stopwatch(event.Listener):
    """Counts the kernels that are compiled; notes for how long [s] each is that no other one needs."""

    def __init__(self) -> None:
        self._depth, self._began, self.kernels = 0, 0.0, 0
        self.seconds: dict[tuple[str, str, str], float] = {}

    def on_start(self, event: event.Event) -> None:
        if self._depth == 0:
            self._began = time.monotonic()
        self._depth += 1
        self.kernels += event.data["dispatcher"].py_func.__module__.startswith(f"{PACKAGE}.")

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds[row(event.data["dispatcher"], event.data["args"])] = time.monotonic() - self._began


def main() -> None:
    """Print the list, longest work first."""
    stopwatch = _Stopwatch()
    with event.install_listener("numba:compile", stopwatch):
        build_planners()
    script = f"from {__spec__.name} import *; build_planners(); print(json.dumps(called()))"
    again = subprocess.run([sys.executable, "-c", script], check=True, stdout=subprocess.PIPE)
    rows = sorted(map(tuple, json.loads(again.stdout)), key=lambda one: (-stopwatch.seconds.get(one, 0.0), one))
    text = ",\n".join(map(json.dumps, rows))
    print(f'{{"kernels": {stopwatch.kernels}, "called": [\n{text}\n]}}')


if __name__ == "__main__":
    main()
