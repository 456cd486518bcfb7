"""CameraProcess: a depth camera that renders in a process of its own, so that it takes nothing of who asks it."""

from __future__ import annotations

import signal
from collections.abc import Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.simulation.depth_camera import DepthCamera, DepthCameraSettings


class CameraProcess:
    """Pictures are asked for with `look`, and come when they are ready: `take` never waits."""

    def __init__(self, robot: str | Path, settings: DepthCameraSettings, scene: DeclaredScene) -> None:
        """robot, scene : as of `DepthCamera`."""
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        # A daemon: it ends with its parent.
        self._process = context.Process(target=_render, args=(theirs, robot, settings, scene), daemon=True)
        self._process.start()
        theirs.close()
        self._asked: Any = None

    def look(self, note: Any, joints: np.ndarray, spheres: Mapping[str, tuple[np.ndarray, float]]) -> bool:
        """Ask for a picture, as of `DepthCamera.points`; False where the last one is not ready yet.

        note : anything but None, which `take` returns with it.
        """
        if self._asked is not None or self._pipe.closed:
            return False
        self._pipe.send((joints, dict(spheres)))
        self._asked = note
        return True

    def take(self) -> tuple[Any, np.ndarray] | None:
        """Return a note, and points (n, 3) [m] in the frame of the camera; None where no picture is ready.

        Raises
        ------
        EOFError : the process has ended.
        """
        if self._asked is None or not self._pipe.poll():
            return None
        points, note, self._asked = self._pipe.recv(), self._asked, None
        return note, points

    def stop(self) -> None:
        """End the process; harmless when it has ended."""
        self._asked = None
        self._pipe.close()
        self._process.join(5.0)
        if self._process.is_alive():
            self._process.kill()


def _render(pipe: Connection, robot: str | Path, settings: DepthCameraSettings, scene: DeclaredScene) -> None:
    """Answer until the other end of a pipe is closed."""
    # An interrupt from a keyboard goes to parent and child: the parent ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    camera, random = DepthCamera(robot, settings, scene), np.random.default_rng()
    try:
        while True:
            joints, spheres = pipe.recv()
            pipe.send(camera.points(joints, spheres, random))
    except (EOFError, BrokenPipeError, ConnectionResetError):
        camera.close()
