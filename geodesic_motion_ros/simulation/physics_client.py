"""One PyBullet physics server, with PyBullet's functions as its methods."""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from geodesic_motion_ros.utils.errors import ParameterError


@contextmanager
def _without_standard_error() -> Iterator[None]:
    """Send what C code writes to standard error nowhere; exceptions still say what they have to."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


# PyBullet prints the date of its build when it is imported, into whatever the user is reading.
with _without_standard_error():
    import pybullet


#: What PyBullet raises.
PhysicsError = pybullet.error


class PhysicsClient:
    """PyBullet's functions bound to a server of their own, so that worlds in one process never mix.

    Parameters
    ----------
    gui : open PyBullet's window instead of running headless.

    Raises
    ------
    ParameterError : a window was requested where there is no display.
    """

    def __init__(self, gui: bool = False) -> None:
        # PyBullet itself would end the whole process here
        if gui and sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
            raise ParameterError("gui needs a display, but DISPLAY is not set: run without gui, or set DISPLAY")
        self._server = pybullet.connect(pybullet.GUI if gui else pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(pybullet, name)
        if callable(attribute):
            attribute = functools.partial(attribute, physicsClientId=self._server)
        # kept, so that the next access finds it without coming here
        self.__dict__[name] = attribute
        return attribute
