"""How far an arm that rests stays from where it is commanded. Knows nothing of ROS.

What is commanded is not corrected by it: a step of the command would stop an arm whose drive judges that, and an arm
that is pushed by something must not push back harder and harder. So it is said: with a figure, and in which joint.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from geodesic_motion_ros.nodes.arm_watch import REST_TIME
from geodesic_motion_ros.nodes.deviation import farthest, have_joints_moved

#: From this on [rad] it is a reason in the status, and each further change by as much a line of the log.
NAMED = 1e-3


class SteadyError:
    """The mean distance of the joints from where they are commanded, in the last REST_TIME of a rest.

    Attributes
    ----------
    size : that of the joint that is farthest off [rad], nan before the arm has rested for REST_TIME. joint : its name.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """names : of the joints."""
        self._names = tuple(names)
        self._said = 0.0, ""
        self.forget()

    def forget(self) -> None:
        """Take note that the arm moves, or is not commanded."""
        self._begun = np.inf
        self._errors: deque[tuple[float, np.ndarray]] = deque()
        self.size, self.joint = np.nan, ""

    def add(self, measured: np.ndarray, commanded: np.ndarray, time: float) -> None:
        """Take joints (eta,) [rad] that were measured at a time [s] of the rest, and where they are commanded;
        a state that was taken before changes nothing.
        """
        if self._errors and time <= self._errors[-1][0]:
            return
        if self._errors and have_joints_moved(measured - commanded, self._errors[0][1]):
            self.forget()
        self._begun = min(self._begun, time)
        self._errors.append((time, measured - commanded))
        if time - self._begun < REST_TIME:
            return
        while self._errors[0][0] < time - REST_TIME:
            self._errors.popleft()
        self.size, self.joint = farthest(np.mean([error for _, error in self._errors], axis=0), self._names)

    @property
    def reason(self) -> str:
        """What a person should know of it; "" where it is less than NAMED, or not known."""
        if not self.size >= NAMED:
            return ""
        return f"at rest the arm stays {1e3 * self.size:.1f} mrad in '{self.joint}' from where it is commanded"

    def take_news(self) -> str:
        """Return the reason where it is another one than that which was returned before; "" for nothing new."""
        size, joint = self._said
        if not self.reason or (joint == self.joint and abs(self.size - size) < NAMED):
            return ""
        self._said = self.size, self.joint
        return self.reason
