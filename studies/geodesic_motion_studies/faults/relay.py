"""A relay: passes the messages of one topic on to another, late, changed, or not at all."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message, serialize_message

#: How often messages that are late are looked at [s].
_LOOK_EVERY = 0.002


class Relay:
    """Passes messages on, from `source` to `target`, as a fault wants it.

    Attributes
    ----------
    passing : whether anything passes.
    delay : gives the delay of the next message [s]; None: none. overtaking : whether a message may overtake others.
    change : makes of a message those that are passed in its place; None: as it is.
    last_passed : when a message passed last [s, steady clock], -inf before.
    """

    def __init__(self, node: Node, kind: type, source: str, target: str) -> None:
        self.kind = kind
        self._publisher = node.create_publisher(kind, target, QoSProfile(depth=10))
        self._waiting: list[tuple[float, int, bytes]] = []
        self._numbers = count()
        self.last_passed = -float("inf")
        self.release()
        # As bytes: most messages pass as they are.
        node.create_subscription(kind, source, self.hear, QoSProfile(depth=10), raw=True)
        node.create_timer(_LOOK_EVERY, self._look)

    def release(self) -> None:
        """Pass everything on as it comes, from now on."""
        self.passing = True
        self.delay: Callable[[], float] | None = None
        self.overtaking = False
        self.change: Callable[[Any], Iterable[Any]] | None = None
        self._waiting.clear()

    def send(self, message: Any) -> None:
        """Say something of one's own."""
        self._publisher.publish(message)

    @property
    def listeners(self) -> int:
        return self._publisher.get_subscription_count()

    def hear(self, message: bytes) -> None:
        if not self.passing:
            return
        passed = [message]
        if self.change is not None:
            passed = [serialize_message(made) for made in self.change(deserialize_message(message, self.kind))]
        for item in passed:
            if self.delay is None:
                self._pass(item)
            else:
                self._keep(item, time.monotonic() + self.delay())

    def _keep(self, message: bytes, due: float) -> None:
        if not self.overtaking and self._waiting:
            due = max(due, max(self._waiting)[0])
        heapq.heappush(self._waiting, (due, next(self._numbers), message))

    def _look(self) -> None:
        while self._waiting and self._waiting[0][0] <= time.monotonic():
            self._pass(heapq.heappop(self._waiting)[2])

    def _pass(self, message: bytes) -> None:
        self._publisher.publish(message)
        self.last_passed = time.monotonic()
