"""Import paths of the version before: they warn, and go with the next version."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

PACKAGE = __name__.partition(".")[0]
#: Modules that pages named, by their old paths within the package: what users may import from. Nothing else is found.
OLD_PATHS = {
    "errors": "utils.errors",
    "joint_planner": "planning.planner",
    "joint_reference": "trajectory.trajectory",
    "manifold.joint_training": "learning.joint_training",
    "manifold.training": "learning.training",
    "planner": "planning.planner",
    "planner_settings": "planning.settings",
    "quaternions": "geometry.quaternions",
    "query": "planning.pose_query",
    "task_frame": "geometry.task_frame",
    "verdict": "planning.status",
}
#: What is to be used in the place of names that are no more.
_INSTEAD = {
    "joint_planner.JointSpacePlanner": "planning.planner.ReactivePlanner",
    "query.Query": "planning.pose_query.PoseQuery",
    "query.QueryBuilder": "planning.pose_query.PoseQueryBuilder",
}
#: Names that have left their module since.
_LEFT = {
    "manifold.joint_training.JointTrainingSettings": "learning.settings",
    "manifold.training.TrainingSettings": "learning.settings",
}


class _OldPaths(MetaPathFinder, Loader):
    """Finds a module at an old path, where no other finder has found one: it is empty, and looks its names up."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: ModuleType | None = None) -> ModuleSpec | None:
        package, _, old = name.partition(".")
        return ModuleSpec(name, self) if package == PACKAGE and old in OLD_PATHS else None

    def exec_module(self, module: ModuleType) -> None:
        old = module.__name__.partition(".")[2]

        def find(name: str) -> Any:
            if name.startswith("__"):
                raise AttributeError(name)
            new = _LEFT.get(f"{old}.{name}", OLD_PATHS[old])
            found = getattr(import_module(f"{PACKAGE}.{new}"), name, None)
            if found is None:
                instead = _INSTEAD.get(f"{old}.{name}", new)
                raise ImportError(f"{PACKAGE}.{old}.{name} is no more: use {PACKAGE}.{instead}")
            _warn(f"{PACKAGE}.{old}", f"{PACKAGE}.{new}")
            return found

        module.__getattr__ = find  # type: ignore[method-assign]


def find_old_paths() -> None:
    """Let Python find the modules of `OLD_PATHS` from now on."""
    if not any(isinstance(finder, _OldPaths) for finder in sys.meta_path):
        sys.meta_path.append(_OldPaths())


def forwarding(folder: str, name: str, module: str) -> Callable[[str], Any]:
    """The `__getattr__` of a folder that was a module: one name of it warns, and is that of a module in it."""

    def find(wanted: str) -> Any:
        if wanted != name:
            raise AttributeError(f"module {folder!r} has no attribute {wanted!r}")
        _warn(folder, f"{folder}.{module}")
        return getattr(import_module(f"{folder}.{module}"), name)

    return find


def _warn(old: str, new: str) -> None:
    """At the line that takes a name."""
    warnings.warn(f"{old} is now {new}; the old path goes with the next version", DeprecationWarning, stacklevel=3)
