"""TrackingError: how far the arm is from where it was sent, as the certificate counts it."""

from __future__ import annotations

from collections import deque

import numpy as np

from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

#: An error counts for so long [s].
COUNTED = 1.0


class TrackingError:
    """The largest distance of a part of the arm from where it was sent, of the last second."""

    def __init__(self, robot: Robot, collision: CollisionModel) -> None:
        """collision : the spheres whose centres are compared."""
        self._robot, self._collision = robot, collision
        # Times [s] and errors [m].
        self._errors: deque[tuple[float, float]] = deque()

    def add(self, measured: np.ndarray, commanded: np.ndarray, time: float) -> float:
        """Count joints (eta,) [rad] that were measured at a time [s]; returns the error that now counts [m]."""
        places = self._collision.positions(self._robot, np.stack([measured, commanded]))
        self._errors.append((time, float(np.max(np.linalg.norm(places[0] - places[1], axis=1)))))
        while self._errors[0][0] < time - COUNTED:
            self._errors.popleft()
        return max(error for _, error in self._errors)

    def forget(self) -> None:
        """The arm begins anew."""
        self._errors.clear()
