"""The clock of the bench: the system's, or one of its own on `/clock` that jumps, pauses and runs at any speed."""

from __future__ import annotations

import time
from itertools import pairwise
from typing import NamedTuple

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

#: How often `/clock` is published [s]. Nodes go by what they heard before for so long [s] at most.
_PERIOD, _HEARD_WITHIN = 0.004, 0.1


class _Course(NamedTuple):
    """From a moment of the steady clock [s] on: what is shown then [s], and how much more of it in a second."""

    begin: float
    shown: float
    speed: float

    def at(self, moment: float) -> float:
        return self.shown + self.speed * (moment - self.begin)


class BenchClock:
    """What the nodes take for the time; the system's until `run(True)`.

    Attributes
    ----------
    simulated : whether it is one of its own.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(Clock, "/clock", QoSProfile(depth=1))
        self._message = Clock()
        self.run(False)
        node.create_timer(_PERIOD, self._tell)

    def run(self, simulated: bool) -> None:
        """Begin to be a simulated clock that shows the system's time so far, or be the system's."""
        self.simulated = simulated
        self._courses = [_Course(time.monotonic(), time.time(), 1.0)]

    def set_speed(self, speed: float) -> None:
        """Run at another speed from now on; 0: stand."""
        self._set(0.0, speed)

    def jump(self, seconds: float) -> None:
        """Show so much more, or less, from now on [s]."""
        self._set(seconds, self._courses[-1].speed)

    def at(self, moment: float, near: float | None = None) -> float:
        """What it showed at a moment [s, steady clock] since it runs.

        near : what a node took for the time then [s]. It may not have heard of a change just before: of what it may
            have used, the nearest.
        """
        if not self.simulated:
            return time.time() - (time.monotonic() - moment)
        begun = [course for course in self._courses if course.begin <= moment] or self._courses[:1]
        if near is None:
            return begun[-1].at(moment)
        used = [before for before, course in pairwise(begun) if moment < course.begin + _HEARD_WITHIN]
        return min((course.at(moment) for course in [*used, begun[-1]]), key=lambda shown: abs(shown - near))

    def _set(self, jump: float, speed: float) -> None:
        now = time.monotonic()
        self._courses.append(_Course(now, self.at(now) + jump, speed))

    def _tell(self) -> None:
        if self.simulated:
            nanoseconds = round(1e9 * self.at(time.monotonic()))
            self._message.clock.sec, self._message.clock.nanosec = divmod(nanoseconds, 10**9)
            self._publisher.publish(self._message)
