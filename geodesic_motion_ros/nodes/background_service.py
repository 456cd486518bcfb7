"""A service whose answers are worked out beside the executor, whose other callbacks go on meanwhile."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from rclpy.node import Node


class BackgroundService:
    """Answers one request after the other in a thread of its own, until stopped.

    An executor asks a callback for a response and hands that to `send_response` of the service. Here what it asks for
    and hands over is the future of a response, which is sent once it is there: EventsExecutor awaits no coroutines.
    """

    def __init__(self, node: Node, kind: type, name: str, answer: Callable[[Any, Any], Any]) -> None:
        """answer : given request and an empty response, returns the response; where it raises, what was sent is the
        empty one, and the log has the error."""
        self._node, self._kind, self._answer = node, kind, answer
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._stopped = False
        service = node.create_service(kind, name, self._begin)
        self._send = service.send_response
        service.send_response = self._send_later

    def stop(self) -> None:
        """End the thread: after the answer that it works on, without those that wait. Harmless when it has ended."""
        self._stopped = True
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _begin(self, request: Any, response: Any) -> Future:
        try:
            return self._thread.submit(self._work, request, response)
        except RuntimeError:
            if not self._stopped:
                raise
            never: Future = Future()
            never.cancel()
            return never

    def _work(self, request: Any, response: Any) -> Any:
        try:
            return self._answer(request, response)
        except Exception as error:  # the client must get a response
            self._node.get_logger().error("".join(traceback.format_exception(error)), throttle_duration_sec=1.0)
            return self._kind.Response()

    def _send_later(self, answer: Future, header: Any) -> None:
        answer.add_done_callback(partial(self._send_now, header))

    def _send_now(self, header: Any, answer: Future) -> None:
        if not answer.cancelled():
            self._send(answer.result(), header)
