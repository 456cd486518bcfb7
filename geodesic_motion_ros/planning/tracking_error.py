"""TrackingError: how far the arm is from where it was sent, as the certificate counts it.

An arm that lags is off only while it moves. Were that forgotten as soon as it stands, it would set out again on a path
that is too narrow for it, stop as the error grows, and so on for ever; and the clearance for a lag that comes as it
speeds up would not be kept from the beginning. So an error counts for a second at least, and besides as long as the arm
is on its way to the goal with which it was measured, or to the next one. One that was a single push is forgotten then.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

#: An error counts for so long at least [s].
COUNTED = 1.0


class TrackingError:
    """The largest distance of a part of the arm from where it was sent: of the last second, and since the goal before
    the present one was taken.
    """

    def __init__(self, robot: Robot, collision: CollisionModel) -> None:
        """collision : the spheres whose centres are compared."""
        self._robot, self._collision = robot, collision
        # Times [s] and errors [m] of the last second.
        self._newest: deque[tuple[float, float]] = deque()
        # The largest with the present goal, and with the one before [m].
        self._with_goal = self._with_goal_before = 0.0

    def add(self, measured: np.ndarray, commanded: np.ndarray, time: float) -> float:
        """Count joints (eta,) [rad] that were measured at a time [s]; returns the error that now counts [m]."""
        places = self._collision.positions(self._robot, np.stack([measured, commanded]))
        error = float(np.max(np.linalg.norm(places[0] - places[1], axis=1)))
        self._newest.append((time, error))
        while self._newest[0][0] < time - COUNTED:
            self._newest.popleft()
        self._with_goal = max(self._with_goal, error)
        return max(self._with_goal, self._with_goal_before, *(error for _, error in self._newest))

    def take_goal(self) -> None:
        """The arm is on its way to another goal from now on."""
        self._with_goal_before, self._with_goal = self._with_goal, 0.0

    def forget(self) -> None:
        """The arm begins anew where it stands."""
        self._newest.clear()
        self._with_goal = self._with_goal_before = 0.0
