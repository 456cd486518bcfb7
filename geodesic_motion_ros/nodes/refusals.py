"""Refused inputs and failed callbacks: counted by topic or service, reported now and then, the newest remembered."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import TracebackType
from typing import Any

from geodesic_motion_ros.nodes.messages import MessageRefused, TransformAwaited

#: So many times longer than of another reason it takes until the same one is warned of again.
_REPEATED = 10.0


class RefusalLog:
    """A count of refusals by topic, which warns of them, for each topic at most once in `quiet` seconds, and of one
    reason again in ten times that: what is refused for ever must not fill the log.

    `with refusals.guard("goal_pose") as guard:` swallows a MessageRefused raised inside and books it. So it does with
    any other exception, whose traceback is logged as well: one message, request or timer must not end the node. Only
    TransformAwaited passes.
    Afterwards `guard.reason` says why, or is empty.
    """

    def __init__(self, warn: Callable[[str], None], quiet: float = 1.0) -> None:
        self._warn, self._quiet = warn, quiet
        self._lock = threading.Lock()
        self._counts: dict[str, int] = {}
        self._warned: dict[str, tuple[float, str]] = {}
        self._newest, self._newest_at = "", -float("inf")

    def add(self, topic: str, reason: str, details: str = "", prefix: str = "refused a message on") -> None:
        """Count a refusal. details : lines for the warning alone, prefix : how it begins."""
        now = time.monotonic()
        with self._lock:
            self._counts[topic] = self._counts.get(topic, 0) + 1
            self._newest, self._newest_at = f"{topic}: {reason}", now
            warned_at, warned_of = self._warned.get(topic, (-float("inf"), ""))
            quiet = now - warned_at < self._quiet * (_REPEATED if reason == warned_of else 1.0)
            if not quiet:
                self._warned[topic] = now, reason
        if not quiet:
            self._warn(f"{prefix} {topic}: {reason}{details}")

    def guard(self, topic: str, prefix: str = "refused a message on") -> Guard:
        """Return a context that counts the errors of a message of a topic; prefix : as of `add`."""
        return Guard(self, topic, prefix)

    def answer(self, service: str, response: Any, work: Callable[[], str]) -> Any:
        """Answer a request of std_srvs with the message that `work` returns; where that raises, with the reason and no
        success.
        """
        with self.guard(service, prefix="refused") as guard:
            response.message = work()
        response.success = not guard.reason
        if guard.reason:
            response.message = guard.reason
        return response

    @property
    def counts(self) -> dict[str, int]:
        with self._lock:
            return dict(self._counts)

    def newest(self, within: float) -> str:
        """Return `topic: reason` of the newest refusal if it is younger than `within` seconds, else an empty text."""
        with self._lock:
            return self._newest if time.monotonic() - self._newest_at < within else ""


class Guard(AbstractContextManager):
    """Context that swallows the errors of one message and counts them in `RefusalLog`, so that the node lives on.

    reason : of the error that was swallowed; "" where there was none.
    """

    def __init__(self, refusals: RefusalLog, topic: str, prefix: str) -> None:
        self._refusals, self._topic, self._prefix = refusals, topic, prefix
        self.reason = ""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        if isinstance(error, MessageRefused):
            self.reason = str(error) or repr(error)
            self._refusals.add(self._topic, self.reason, prefix=self._prefix)
        elif isinstance(error, Exception) and not isinstance(error, TransformAwaited):
            self.reason = f"internal error, see the log: {error!r}"
            details = "\n" + "".join(traceback.format_exception(error))
            self._refusals.add(self._topic, self.reason, details, prefix="an error in")
        else:
            return False
        return True
