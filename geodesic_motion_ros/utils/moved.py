"""Import paths of the version before, which go with the next one."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from importlib import import_module
from typing import Any


def forwarding(old: str, new: str, **instead: str) -> Callable[[str], Any]:
    """The `__getattr__` of a module at an old path: it warns, and gives what stands at the new one.

    instead : what is to be used in the place of names that are no more, which are an ImportError.
    """

    def find(name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        found = getattr(import_module(new), name, None)
        if found is None:
            raise ImportError(f"{old}.{name} is no more: use {instead.get(name, new)}")
        warnings.warn(f"{old} is now {new}; the old path goes with the next version", DeprecationWarning, stacklevel=2)
        return found

    return find
