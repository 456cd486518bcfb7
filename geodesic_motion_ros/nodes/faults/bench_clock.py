"""The clock of the bench: the system's, or one of its own on `/clock` that jumps, pauses and runs at any speed."""

from __future__ import annotations

import time

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

#: How often `/clock` is told [s].
_PERIOD = 0.004


class BenchClock:
    """What the nodes take for the time.

    Attributes
    ----------
    simulated : whether it is one of its own; it is the system's until `run(True)`.
    speed : seconds of it in a second; 0: it is paused.
    """

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(Clock, "/clock", QoSProfile(depth=1))
        self._timer = node.create_timer(_PERIOD, self._tell)
        self._message = Clock()
        self.run(False)

    def run(self, simulated: bool) -> None:
        """Begin to be a simulated clock that shows the system's time so far, or be the system's."""
        self.simulated, self.speed = simulated, 1.0
        self._shown, self._looked = time.time(), time.monotonic()

    def set_speed(self, speed: float) -> None:
        """Run at another speed from now on."""
        self.now()
        self.speed = speed

    def jump(self, seconds: float) -> None:
        """Show so much more, or less, from now on [s]."""
        self._shown = self.now() + seconds

    def now(self) -> float:
        """What it shows [s]."""
        if not self.simulated:
            return time.time()
        now = time.monotonic()
        self._shown += self.speed * (now - self._looked)
        self._looked = now
        return self._shown

    def at(self, moment: float) -> float:
        """What it showed at a moment [s, steady clock] since it was last set."""
        return self.now() - self.speed * (time.monotonic() - moment)

    def _tell(self) -> None:
        if self.simulated:
            nanoseconds = round(1e9 * self.now())
            self._message.clock.sec, self._message.clock.nanosec = divmod(nanoseconds, 10**9)
            self._publisher.publish(self._message)
