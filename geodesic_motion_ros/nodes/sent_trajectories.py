"""Which of the trajectories that were sent the drive follows, where it says what it commands. Knows nothing of ROS.

A drive that judges its commands refuses a trajectory that has come too late to continue what it commands, and a message
may be lost: the arm goes on with the one before. What is planned on from one that was not taken would be refused, too.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.trajectory.receding_horizon import Sent

#: The drive follows a trajectory while no joint is farther from it [rad]; it does not follow one that is farther off
#: than the second: what clocks that differ by some milliseconds make of a fast motion lies between.
FOLLOWED, LEFT = 1e-3, 3e-3
#: A trajectory that may still be in transit is not given up: that long after its takeover [s] it is not.
IN_TRANSIT = 0.1
#: So many are remembered: those of a second.
_KEPT = 100


@dataclass(frozen=True)
class _Takeover:
    """A trajectory that was sent, and when it departs from the one before [s]."""

    sent: Sent
    time: float


class SentTrajectories:
    """The trajectories that the drive may follow, the newest last."""

    def __init__(self) -> None:
        self._takeovers: deque[_Takeover] = deque(maxlen=_KEPT)

    def add(self, sent: Sent, time: float) -> None:
        """Take note of a trajectory that is sent, and takes over at a time [s]."""
        self._takeovers.append(_Takeover(sent, time))

    def forget(self) -> None:
        """What was sent does not count any more."""
        self._takeovers.clear()

    def fall_back(self, drive: np.ndarray, taken: float) -> tuple[Sent, float] | None:
        """Forget what the drive has not taken, and return the trajectory that it goes on with, and for how long it
        should have followed another one [s]; None where it follows the newest, or it is not known what it follows.

        drive : (eta,) [rad] that it commanded at the time `taken` [s].
        """
        due = [one for one in self._takeovers if one.time <= taken]
        if not due:
            return None
        distance = _distance(due[-1], drive, taken)
        if distance <= FOLLOWED:
            # Shortly after a takeover the drive is near the trajectory of before, too.
            while self._takeovers[0] is not due[-1] and _distance(self._takeovers[0], drive, taken) > LEFT:
                self._takeovers.popleft()
        if distance < LEFT:
            return None
        for position in range(len(due) - 2, -1, -1):
            if _distance(due[position], drive, taken) <= FOLLOWED:
                followed, waited = due[position], taken - due[position + 1].time
                if waited < IN_TRANSIT:
                    return None
                self.forget()
                self._takeovers.append(followed)
                return followed.sent, waited
        return None


def _distance(one: _Takeover, drive: np.ndarray, time: float) -> float:
    position = one.sent.reference.sample(time - one.sent.begin)[0]
    return float(np.max(np.abs(position - drive)))
