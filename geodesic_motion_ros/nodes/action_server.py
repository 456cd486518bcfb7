"""An action server whose goals end when somebody says so, from any thread.

That of rclpy keeps a callback busy for as long as a goal lasts, or a coroutine that EventsExecutor never resumes.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

#: How long the result of a goal is kept for a client that asks late [s].
_KEPT = 60


class LastingActions(ActionServer):
    """Goals that are accepted are executed from then on until `end`. Who ends them looks
    whether a client has cancelled one (`is_cancel_requested`). Callbacks are called by the node's executor.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        name: str,
        begin: Callable[[ServerGoalHandle], None],
        accepts: Callable[[Any], bool] = lambda goal: True,
    ) -> None:
        """begin : receives each goal that was accepted. accepts : whether one is."""

        def begin_executing(handle: ServerGoalHandle) -> None:
            handle.execute()
            begin(handle)

        super().__init__(
            node, kind, name, execute_callback=_nothing,
            goal_callback=lambda goal: GoalResponse.ACCEPT if accepts(goal) else GoalResponse.REJECT,
            handle_accepted_callback=begin_executing,
            cancel_callback=lambda handle: CancelResponse.ACCEPT, result_timeout=_KEPT,
        )  # fmt: skip

    def notify_execute(self, goal_handle: ServerGoalHandle, execute_callback: Callable | None) -> None:
        """Have nothing called: a goal lasts until `end`."""

    def end(self, handle: ServerGoalHandle, settle: Callable[[], None], result: Any) -> None:
        """End a goal by one of the handle's `succeed`, `abort` and `canceled`, and send the result to who waits for it.
        """
        settle()
        # It never pauses, as what it awaits is there: no executor is needed, which may have ended.
        with suppress(StopIteration):
            self._execute_goal(lambda _: result, handle).send(None)


def _nothing(handle: ServerGoalHandle) -> None:
    raise AssertionError("never called")
