"""The control: the nearest demonstration is replayed, whatever blocks it."""

from __future__ import annotations

from typing import Any

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.trajectory.trajectory import PERIOD
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.method import Answer
from geodesic_motion_studies.comparison.scene import Scene


class Replay:
    """The demonstration that began and ended nearest, moved to the scene's start and goal."""

    def __init__(self, arena: Arena) -> None:
        self._arena = arena
        self.settings: dict[str, Any] = {}

    def reset(self, scene: Scene) -> None:
        """Choose the demonstration."""
        self._reference = scene.demonstrations[self._arena.nearest(scene.start, scene.goal)]

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """Sent once."""
        return Answer.playing(self._reference, PERIOD) if now == 0.0 else Answer()
