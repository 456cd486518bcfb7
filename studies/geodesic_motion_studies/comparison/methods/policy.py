"""The cloned policy alone: its chunks are played as they come, whatever is in the path."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.cloned_policy import RENEWED, cloned_policy
from geodesic_motion_studies.comparison.method import Answer
from geodesic_motion_studies.comparison.scene import Scene


class PolicyAlone:
    """Plays each chunk until the next one comes: from where the arm was sent by then."""

    def __init__(self, arena: Arena) -> None:
        self._policy = cloned_policy(arena)
        self.settings: dict[str, Any] = self._policy.settings

    def reset(self, scene: Scene) -> None:
        """The arm stands at the start."""
        self._goal, self._begun, self._sent = scene.goal, 0.0, lambda time: scene.start

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """Ask for a chunk where it is time to; a controller takes none that ends in motion."""
        if now > 0.0 and now < self._begun + RENEWED - 1e-6:
            return Answer()
        times, positions = self._policy.chunk(self._sent(now - self._begun), self._goal)
        velocities = np.gradient(positions, times, axis=0)
        velocities[-1] = 0.0
        self._begun, self._sent = now, CubicHermiteSpline(times, positions, velocities)
        return Answer(JointWaypoints(times[1:], positions[1:], velocities[1:]), now)
