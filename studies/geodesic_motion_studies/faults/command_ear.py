"""Hears the planner's commands, and when each was sent, however late the bench gets to look at it."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile


@dataclass(frozen=True)
class Command:
    """A command as it was sent: steady time [s] by DDS, and the message's bytes."""

    sent: float
    message: bytes


class CommandEar:
    """Keeps the commands of one topic; a node of its own, in a thread of its own, from now until `close`.

    DDS stamps messages when they are published. Of rclpy's executors the single-threaded one hands that on.
    """

    def __init__(self, context: rclpy.Context, kind: type, topic: str) -> None:
        self._heard: list[Command] = []
        self._lock = threading.Lock()
        self._node = rclpy.create_node("command_ear", context=context)
        self._node.create_subscription(kind, topic, self._hear, QoSProfile(depth=100), raw=True)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, name="command ear", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and the node."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()

    @property
    def heard(self) -> list[Command]:
        """All since `take`, oldest first."""
        with self._lock:
            return list(self._heard)

    def take(self) -> list[Command]:
        """All since the last time, oldest first."""
        with self._lock:
            heard, self._heard = self._heard, []
        return heard

    def _spin(self) -> None:
        try:
            self._executor.spin()
        except ExternalShutdownException:
            return

    def _hear(self, message: bytes, info: dict[str, Any]) -> None:
        sent = steady_time(1e-9 * info["source_timestamp"])
        with self._lock:
            self._heard.append(Command(sent, message))


def steady_time(system_time: float) -> float:
    """A time of the system's clock [s] as one of the steady clock."""
    return time.monotonic() - (time.time() - system_time)
