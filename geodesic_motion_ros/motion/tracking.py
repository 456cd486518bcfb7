"""Tracking: how late the arm is, and how far off the path that it was sent along, as the certificate counts it.

An arm whose controller lags is where it was sent a moment ago. Its distance from where it is sent now is no good
measure of that: it is nothing at rest, grows as the arm speeds up, when there may be no stop left that is clear with
so much more, and is forgotten as it stands, so that it sets out again on a path that is too narrow, and stops, for
ever. How *late* it is stays the same. So two things are counted: the time after which the arm is nearest to where it
was sent, and how far it is off then. An arm that is late by that time, and no farther off, passes what stands as the
reference does, and meets what moves that much later.

Both count for a second at least, and besides as long as the arm moves to the goal with which they were
measured, or to the next one: they are known when the arm sets out again, and what was a single push is forgotten.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.motion.retry import TIME_ROUNDING
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot

#: A measurement counts for this time at least [s].
COUNTED = 1.0
#: An arm is no later than this [s]: where it is farther behind, that counts as an error.
LATEST = 0.5
#: Distances from the present place that differ by less than this are the same [m]: the newest of them counts.
_AS_NEAR = 5e-4


@dataclass(frozen=True)
class Tracking:
    """The lag and the error with which an arm follows its commands.

    Attributes
    ----------
    lag : the arm is nearest to where it was sent this long ago [s].
    error : the distance from there of the part of the arm that is farthest off [m].
    """

    lag: float = 0.0
    error: float = 0.0

    def round_up(self) -> Tracking:
        """Return both as whole numbers of `LAG_STEP` and `TRACKING_ERROR_STEP`."""
        lag = _rounded_up(self.lag, constants.LAG_STEP)
        return Tracking(lag, _rounded_up(self.error, constants.TRACKING_ERROR_STEP))


class TrackingMonitor:
    """The worst tracking of the last second, and since the goal before the present one was taken."""

    def __init__(self, robot: Robot, collision: CollisionModel) -> None:
        """collision : the spheres whose centres are compared."""
        self._robot, self._collision = robot, collision
        # When [s] and where its spheres (S, 3) [m] the arm was sent, of the last LATEST.
        self._sent: deque[tuple[float, np.ndarray]] = deque()
        # Of the last second, with times [s]; the worst with the present goal, and with the one before.
        self._newest: deque[tuple[float, Tracking]] = deque()
        self._with_goal = self._with_goal_before = Tracking()

    def add(self, measured: np.ndarray, commanded: np.ndarray, time: float) -> Tracking:
        """Count joints (eta,) [rad] that were measured at a time [s]; returns what now counts.

        commanded : where the arm was to be at that time (eta,) [rad].
        """
        found = self._measure(measured, commanded, time)
        self._newest.append((time, found))
        while self._newest[0][0] < time - COUNTED:
            self._newest.popleft()
        self._with_goal = _worst(self._with_goal, found)
        newest = (one for _, one in self._newest)
        return _worst(self._with_goal, self._with_goal_before, *newest)

    def take_goal(self) -> None:
        """Take note that the arm moves to another goal from now on."""
        self._with_goal_before, self._with_goal = self._with_goal, Tracking()

    def take_collision(self, collision: CollisionModel) -> None:
        """Compare the centres of other spheres from now on; earlier measurements count as long as before."""
        self._collision = collision
        self._sent.clear()

    def forget(self) -> None:
        """Take note that the arm begins anew where it stands."""
        self._sent.clear()
        self._newest.clear()
        self._with_goal = self._with_goal_before = Tracking()

    def _measure(self, measured: np.ndarray, commanded: np.ndarray, time: float) -> Tracking:
        place, sent = self._collision.positions(self._robot, np.stack([measured, commanded]))
        self._sent.append((time, sent))
        while self._sent[0][0] < time - LATEST:
            self._sent.popleft()
        apart = np.array([sent for _, sent in self._sent]) - place
        off = np.sqrt(np.max(np.einsum("nsi,nsi->ns", apart, apart), axis=1))
        newest = int(np.flatnonzero(off <= np.min(off) + _AS_NEAR)[-1])
        return Tracking(float(time - self._sent[newest][0]), float(off[newest]))


def _worst(*each: Tracking) -> Tracking:
    return Tracking(max(one.lag for one in each), max(one.error for one in each))


def _rounded_up(value: float, step: float) -> float:
    return step * math.ceil(value / step - TIME_ROUNDING)
