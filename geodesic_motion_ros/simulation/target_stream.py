"""From target poses that arrive one by one to a target that moves smoothly in between."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.geometry.quaternions import rotate_by
from geodesic_motion_ros.robot.inverse_kinematics import pose_error

FASTEST_LINEAR = 2.0
FASTEST_ANGULAR = 6.0


class TargetStream:
    """The newest target pose, carried on as the stream moves until the next one arrives.

    The stream's mean velocity over a period is the difference of successive targets over its smoothed period, not over
    the measured interval: a message that arrives late or early still stands for one period of motion. Until the next
    target is due the velocity goes in a straight line from what it was to what it will be then if the stream goes on to
    accelerate as it did: a target that moves with steady acceleration is followed without steps of its velocity. A pose
    that follows none for `timeout` seconds, or that lies too far off to have been moved to, is a step: its velocity is
    zero.

    Parameters
    ----------
    position, quaternion : where the target rests at first, (3,) [m] and (4,) unit, scalar first, base frame.
    period : first guess of the time between targets [s].
    timeout : time without a target after which the stream counts as ended [s].

    Attributes
    ----------
    twist : (6,) [m/s, rad/s] that the target will have when the next one is due.
    """

    def __init__(
        self, position: np.ndarray, quaternion: np.ndarray, period: float = 0.01, timeout: float = 0.1
    ) -> None:
        self.position, self.quaternion = position, quaternion
        self.period, self.timeout = period, timeout
        self.twist = np.zeros(6)
        self._twist_before = self._mean = np.zeros(6)
        self._arrival = -np.inf

    def accept(self, position: np.ndarray, quaternion: np.ndarray, time: float) -> None:
        """Take the next target pose, which arrived at `time` [s] of the receiver's clock."""
        interval = time - self._arrival
        difference = pose_error(self.position, self.quaternion, position, quaternion)
        before, mean_before = self.sample(time)[2], self._mean
        self.position, self.quaternion, self._arrival = position, quaternion, time
        self.twist = self._twist_before = self._mean = np.zeros(6)
        if interval > self.timeout:
            return
        # lost targets make the interval a multiple of the period
        periods = max(1.0, np.round(interval / self.period))
        if interval > 0.0:  # while a simulation stands no time passes between them
            self.period += 0.1 * (interval / periods - self.period)
        mean = difference / (periods * self.period)
        if np.linalg.norm(mean[:3]) < FASTEST_LINEAR and np.linalg.norm(mean[3:]) < FASTEST_ANGULAR:
            # The means are velocities half of their periods ago; the next target is due a period from now.
            acceleration = (mean - mean_before) / (0.5 * (periods + 1.0))
            self.twist = mean + (0.5 * periods + 1.0) * acceleration
            self._twist_before, self._mean = before, mean

    def sample(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Target position (3,), quaternion (4,) and twist (6,) [m/s, rad/s] at `time` [s].

        The target runs ahead of the last pose by at most one period, and returns to it when the stream ends.
        """
        elapsed = time - self._arrival
        if elapsed > self.timeout:
            return self.position, self.quaternion, np.zeros(6)
        lead = min(elapsed, self.period)
        twist = self._twist_before + lead / self.period * (self.twist - self._twist_before)
        ahead = 0.5 * lead * (self._twist_before + twist)
        position, quaternion = self.position + ahead[:3], rotate_by(ahead[3:], self.quaternion)
        return position, quaternion, twist if elapsed <= 2.0 * self.period else np.zeros(6)
