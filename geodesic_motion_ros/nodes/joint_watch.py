"""Whether joint states arrive that a take can be made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from geodesic_motion_ros.demonstrations.message_samples import JointSamples, positions_in, stamp_of
from geodesic_motion_ros.utils.checked_files import brief

#: Without a message for so long [s] none arrive: the slowest driver sends five a second.
SILENCE = 1.0
#: Stamps that do not change for so long [s], while messages arrive, stand still.
STANDING = 0.5


class JointWatch:
    """The joint states that a node hears on a topic. Times are of one steady clock [s]."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._heard, self._usable = -float("inf"), -float("inf")
        # of each joint: drivers may publish them in several messages
        self._joints_heard = np.full(len(self._names), -np.inf)
        self._lacking = ""
        self._stamp, self._stamp_since = 0, 0.0

    def receive(self, message: Any, now: float) -> None:
        """Take a message as it arrives."""
        self._heard = now
        self._joints_heard[np.isfinite(positions_in(message, self._names))] = now
        if now - self._joints_heard.min() > SILENCE:
            one = JointSamples(self._names)
            one.add(0, message)
            self._lacking = one.lacking()
            return
        self._usable = now
        if (stamp := stamp_of(message.header)) != self._stamp or stamp == 0:
            self._stamp, self._stamp_since = stamp, now

    def objection(self, now: float) -> str:
        """Return why no take can be made of what arrives; "" where one can."""
        if now - self._heard > SILENCE:
            ago = "have arrived yet" if self._heard == -float("inf") else f"for {now - self._heard:.1f} s"
            return f"no joint states {ago}"
        if now - self._usable > SILENCE:
            return f"joint states arrive, but {self._lacking}; expected are {brief(', '.join(self._names), 300)}"
        if self._usable - self._stamp_since > STANDING:
            return (
                f"the stamps of the joint states stand still at {1e-9 * self._stamp:.3f} s: is the simulation paused, "
                "or does the driver repeat an old state?"
            )
        return ""
