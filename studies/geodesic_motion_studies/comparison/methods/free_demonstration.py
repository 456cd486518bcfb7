"""The nearest demonstration that is free is played, and another one joined where it is blocked: no learning at all.

Demonstrations are moved to the scene's start and goal. Where the one being played is blocked by what is there,
or will be within the prediction, the arm goes over to one that is free from where it will be to the goal; what it is
off that one there fades until the goal.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.replanning import LATENCY, MARGIN, PREDICTION, RETRY, Replanning, meeting
from geodesic_motion_studies.comparison.scene import Scene

#: Configurations on a path.
POINTS = 100


class FreeDemonstration(Replanning):
    """Demonstrations as paths, the one that passes and ends nearest to the arm and the goal first."""

    def __init__(self, arena: Arena) -> None:
        super().__init__(arena)
        self.settings: dict[str, Any] = {
            "latency": LATENCY, "prediction": PREDICTION, "retry": RETRY, "margin": MARGIN, "points": POINTS,
        }  # fmt: skip

    def prepare(self, scene: Scene) -> None:
        """Take the demonstrations that were moved."""
        self._moved = [(item.latent[:, 0], item.positions) for item in scene.demonstrations]

    def paths(self, start: np.ndarray, progress: float, obstacles: Obstacles) -> Iterator[np.ndarray]:
        """What is left of each."""
        phase = np.linspace(progress, 1.0, POINTS)
        for number in self._arena.by_nearness(start, self._goal, progress):
            shares, positions = self._moved[number]
            path = np.stack([np.interp(phase, shares, joint) for joint in positions.T], axis=1)
            yield meeting(path, start, self._goal)
