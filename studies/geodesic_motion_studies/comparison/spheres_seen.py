"""SpheresSeen: spheres as the planner node's cycle hands them over, with how far off their velocities may be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.obstacles.velocity_history import VelocityHistory

#: What is within this of where a sphere was the tick before is the same sphere [m].
SAME_SPHERE = 0.02


class SpheresSeen:
    """The spheres of one scene, by where they were in the ticks before."""

    def __init__(self) -> None:
        self._seen: list[tuple[np.ndarray, VelocityHistory]] = []

    def with_errors(self, now: float, obstacles: Obstacles) -> Obstacles:
        """Return obstacles at `now` [s] with the errors of their velocities. A tracker, by which what moves has an age,
        has worked them out itself.
        """
        if obstacles.ages.any():
            return obstacles
        return replace(obstacles, velocity_errors=self._velocity_errors(now, obstacles))

    def _velocity_errors(self, now: float, obstacles: Obstacles) -> np.ndarray:
        """(o,) [m/s] by where the spheres truly were in the ticks before."""
        before, self._seen = self._seen, []
        for centre in obstacles.centres:
            apart = [float(np.linalg.norm(centre - place)) for place, _ in before]
            nearest = int(np.argmin(apart)) if apart and min(apart) <= SAME_SPHERE else None
            history = VelocityHistory() if nearest is None else before[nearest][1]
            history.see(tuple(centre.tolist()), now)
            self._seen.append((centre, history))
        pairs = zip(self._seen, obstacles.velocities, strict=True)
        return np.array([history.error(tuple(velocity.tolist())) for (_, history), velocity in pairs])
