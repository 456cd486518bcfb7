"""Services that answer every request of a flood: beside the executor, and no faster than their clients read."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

#: Requests that wait, and answers in transit, at most: ROS keeps ten by default, and loses the others without a word.
_QUEUE = QoSProfile(depth=1000)
#: Between two answers [s]: a client keeps ten that it has not read yet.
_PAUSE = 0.01


class BackgroundService:
    """A service that answers one request after the other in a thread of its own, until stopped.

    An executor asks a callback for a response and hands that to `send_response` of the service. Here what it asks for
    and hands over is the future of a response, which is sent once it is there: EventsExecutor awaits no coroutines.
    """

    def __init__(
        self, node: Node, kind: type, name: str, answer: Callable[[Any, Any], Any], at_once: bool = False
    ) -> None:
        """answer : given request and an empty response, returns the response; where it raises, what was sent is the
        empty one, and the log has the error. at_once : whether it is called as the request arrives, by the executor:
        what takes no time waits for no other answer.
        """
        self._node, self._kind, self._answer, self._at_once = node, kind, answer, at_once
        self._next = 0.0
        self._thread = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._stopped = False
        service = node.create_service(kind, name, self._begin, qos_profile=_QUEUE)
        self._send = service.send_response
        service.send_response = self._send_later

    def stop(self) -> None:
        """End the thread: after the answer that it works on, without those that wait. Harmless when it has ended."""
        self._stopped = True
        self._thread.shutdown(wait=True, cancel_futures=True)

    def _begin(self, request: Any, response: Any) -> Future:
        work = partial(self._work, request, response)
        if self._at_once:
            response = work()
            work = lambda: response  # noqa: E731
        try:
            return self._thread.submit(self._paced, work)
        except RuntimeError:
            if not self._stopped:
                raise
            never: Future = Future()
            never.cancel()
            return never

    def _paced(self, work: Callable[[], Any]) -> Any:
        time.sleep(max(0.0, self._next - time.monotonic()))
        response = work()
        self._next = time.monotonic() + _PAUSE
        return response

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
