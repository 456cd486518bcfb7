"""One PyBullet physics server, with PyBullet's functions as its methods."""

from __future__ import annotations

import functools
import os
import sys
from typing import Any

import pybullet

from geodesic_motion_ros.errors import ParameterError


class PhysicsClient:
    """PyBullet's functions bound to a server of their own, so that worlds in one process never mix.

    Parameters
    ----------
    gui : open PyBullet's window instead of running headless.

    Raises
    ------
    ParameterError : a window was asked for where there is no display.
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
