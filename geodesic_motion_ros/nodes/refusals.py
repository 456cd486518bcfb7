"""Refused inputs: counted by topic, told once a second, the newest remembered."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType

from geodesic_motion_ros.nodes.messages import MessageRefused


class Refusals:
    """Counts refusals by topic and warns of them, for each topic at most once in `quiet` seconds.

    `with refusals.guard("goal_pose"):` swallows a MessageRefused raised inside and books it. So it does with any other
    exception, whose traceback is told as well: one message must not end the node.
    """

    def __init__(self, warn: Callable[[str], None], quiet: float = 1.0) -> None:
        self._warn, self._quiet = warn, quiet
        self._lock = threading.Lock()
        self._counts: dict[str, int] = {}
        self._warned: dict[str, float] = {}
        self._newest, self._newest_at = "", -float("inf")

    def add(self, topic: str, reason: str, details: str = "") -> None:
        """details : lines for the warning alone."""
        now = time.monotonic()
        with self._lock:
            self._counts[topic] = self._counts.get(topic, 0) + 1
            self._newest, self._newest_at = f"{topic}: {reason}", now
            quiet = now - self._warned.get(topic, -float("inf")) < self._quiet
            if not quiet:
                self._warned[topic] = now
        if not quiet:
            self._warn(f"refused a message on {topic}: {reason}{details}")

    def guard(self, topic: str) -> AbstractContextManager[None]:
        return _Guard(self, topic)

    @property
    def counts(self) -> dict[str, int]:
        with self._lock:
            return dict(self._counts)

    def newest(self, within: float) -> str:
        """`topic: reason` of the newest refusal if it is younger than `within` seconds, else an empty
        text.
        """
        with self._lock:
            return self._newest if time.monotonic() - self._newest_at < within else ""


class _Guard(AbstractContextManager):
    def __init__(self, refusals: Refusals, topic: str) -> None:
        self._refusals, self._topic = refusals, topic

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if isinstance(error, MessageRefused):
            self._refusals.add(self._topic, str(error))
        elif isinstance(error, Exception):
            details = "\n" + "".join(traceback.format_exception(error))
            self._refusals.add(self._topic, f"internal error, see the log: {error!r}", details)
        else:
            return False
        return True
