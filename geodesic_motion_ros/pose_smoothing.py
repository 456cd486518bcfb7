"""PoseSmoothing: the stream of poses that is commanded, without steps of acceleration.

References keep limits of speed and acceleration, and their acceleration may step. The mean of the poses of the last
T seconds is a filter with a finite impulse response, constant over T, as in L. Biagiotti and C. Melchiorri, "FIR
filters for online trajectory planning with time- and frequency-domain specifications", Control Engineering Practice,
2012: what passes it keeps these limits, and its jerk is at most 2 a / T. It comes T / 2 later, to rest where the
reference does, and cuts corners by a T^2 / 24 at most: 0.16 mm at 1.5 m/s^2.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from geodesic_motion_ros.motion_curve import MotionLimits
from geodesic_motion_ros.quaternions import normalise

#: T, and by how much a commanded pose comes later than the reference's [s].
SMOOTHING = 0.05
LAG = 0.5 * SMOOTHING


def corners_cut(limits: MotionLimits, strain: float, levers: np.ndarray) -> np.ndarray:
    """How far the mean may take points at distances (K,) [m] from the tool's origin off the way itself, (K,) [m].

    strain : accelerations in multiples of the limits.
    """
    return strain * (limits.acceleration + levers * limits.angular_acceleration) * SMOOTHING**2 / 24.0


class PoseSmoothing:
    """The mean pose of the last `SMOOTHING` seconds of one stream."""

    def __init__(self) -> None:
        # Durations [s] of the newest poses (7,), the newest first; before them the stream stood at the oldest one.
        self._poses: deque[tuple[float, np.ndarray]] = deque()
        self._mean = np.zeros(7)

    def reset(self, position: np.ndarray, quaternion: np.ndarray) -> None:
        """The stream stands at a pose, (3,) [m] and (4,)."""
        self._mean = np.concatenate([position, quaternion])
        self._poses = deque([(0.0, self._mean)])

    def add(self, period: float, position: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The mean after the stream has been at one more pose for a period [s]: position (3,) [m], quaternion (4,).

        period : where it is 0, a simulation stands, and so does the mean.
        quaternion : of the same sign as the one before.
        """
        if period > 0.0:
            self._poses.appendleft((period, np.concatenate([position, quaternion])))
            self._mean = self._of_the_window()
        return self._mean[:3], self._mean[3:]

    def _of_the_window(self) -> np.ndarray:
        while sum(duration for duration, _ in self._poses) - self._poses[-1][0] >= SMOOTHING:
            self._poses.pop()
        durations, poses = map(np.array, zip(*self._poses, strict=True))
        durations[-1] = SMOOTHING - np.sum(durations[:-1])
        # Differences from the newest: a stream that stands is commanded to stand, to the last bit.
        mean = poses[0] + durations @ (poses - poses[0]) / SMOOTHING
        return np.concatenate([mean[:3], normalise(mean[3:])])
