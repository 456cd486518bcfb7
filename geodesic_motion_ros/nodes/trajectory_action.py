"""The action `control_msgs/FollowJointTrajectory`: trajectories sent as its goals, and its server in front of an arm.

Each goal takes the place of the one before while that is played, as trajectories on a topic do.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.action_server import LastingActions
from geodesic_motion_ros.nodes.extras import extra
from geodesic_motion_ros.nodes.publishers import publishers_of, subscribers_of
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.utils.errors import ParameterError

KIND = "control_msgs/action/FollowJointTrajectory"


class TrajectoryGoals:
    """A publisher of trajectories that go out as goals.

    A goal is a message of Python objects, which take a millisecond and more to make: a thread of its own does that for
    the newest trajectory, and the control loop only leaves its bytes there.
    """

    def __init__(self, node: Node, name: str, refusals: RefusalLog) -> None:
        """Raise ParameterError where the action is not installed. refusals : what the server does not take."""
        kind = extra(KIND)
        if kind is None:
            raise ParameterError(f"trajectory_action = {name}: control_msgs is not installed (make ros-extras)")
        self._node, self._kind, self._name, self._refusals = node, kind, name, refusals
        self._client = ActionClient(node, kind, name)
        self.topic_name = node.resolve_service_name(name)
        self._number = 0
        self._newest: bytes | None = None
        self._stopping = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin to send."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread; harmless when it has ended or never began."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(1.0)

    def publish(self, trajectory: bytes) -> None:
        """Send a serialised JointTrajectory, in the place of one that has not left yet."""
        with self._changed:
            self._newest = trajectory
            self._changed.notify()

    def publishers(self) -> tuple[str, ...]:
        """Full names of the nodes that may send goals, this one among them."""
        return subscribers_of(self._node, f"{self.topic_name}/_action/feedback")

    def subscribers(self) -> tuple[str, ...]:
        """Full names of the nodes that serve the action."""
        return publishers_of(self._node, f"{self.topic_name}/_action/status")

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopping or self._newest is not None)
                if self._stopping:
                    return
                trajectory, self._newest = self._newest, None
            with self._refusals.guard(self._name, prefix="not sent to"):
                self._send(trajectory)

    def _send(self, trajectory: bytes) -> None:
        self._number += 1
        goal = self._kind.Goal(trajectory=deserialize_message(trajectory, JointTrajectory))
        self._client.send_goal_async(goal).add_done_callback(partial(self._answered, self._number))

    def _answered(self, number: int, answer: Future) -> None:
        handle = answer.result()
        if handle.accepted:
            handle.get_result_async().add_done_callback(partial(self._ended, number))
        else:
            self._refusals.add(self._name, "the server has rejected a trajectory", prefix="an answer of")

    def _ended(self, number: int, result: Future) -> None:
        ended = result.result()
        # What another one has replaced has ended too.
        if number == self._number and ended.status != GoalStatus.STATUS_SUCCEEDED:
            how = {GoalStatus.STATUS_ABORTED: "aborted", GoalStatus.STATUS_CANCELED: "cancelled"}.get(
                ended.status, "lost"
            )
            reason = f"the trajectory was {how}: {ended.result.error_string or f'code {ended.result.error_code}'}"
            self._refusals.add(self._name, reason, prefix="an answer of")


class TrajectoryServer:
    """The server in front of an arm that plays one trajectory at a time.

    Callbacks are called by the node's executor; `play`, `refuse` and `look` by the thread that moves the arm.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        name: str,
        accepts: Callable[[JointTrajectory], bool],
        ask: Callable[[JointTrajectory, ServerGoalHandle], None],
    ) -> None:
        """accepts : whether a trajectory can be played. ask : has one played soon, or refuses it."""
        self._kind = kind
        self._playing: tuple[ServerGoalHandle, float] | None = None
        self._server = LastingActions(
            node, kind, name, lambda handle: ask(handle.request.trajectory, handle),
            lambda goal: accepts(goal.trajectory),
        )  # fmt: skip

    def play(self, handle: ServerGoalHandle | None, until: float = 0.0) -> None:
        """Take note that a goal is played from now on, until a time [s]; None: something else is."""
        playing, self._playing = self._playing, None if handle is None else (handle, until)
        if playing is not None:
            self._end(playing[0], playing[0].abort, "another command has taken its place")

    def refuse(self, handle: ServerGoalHandle, why: str) -> None:
        """End a goal that is not played."""
        self._end(handle, handle.abort, why, self._kind.Result.INVALID_GOAL)

    def look(self, now: float) -> bool:
        """End the goal that its client has cancelled, or whose trajectory is over at a time [s]; returns whether the
        arm is to hold where it is.
        """
        if self._playing is None:
            return False
        handle, until = self._playing
        is_cancelled = handle.is_cancel_requested
        if is_cancelled or now >= until:
            self._playing = None
            settle, why = (handle.canceled, "cancelled") if is_cancelled else (handle.succeed, "played to its end")
            self._end(handle, settle, why)
        return is_cancelled

    def _end(self, handle: ServerGoalHandle, settle: Callable[[], None], why: str, code: int = 0) -> None:
        result: Any = self._kind.Result(error_code=code, error_string=why)
        self._server.end(handle, settle, result)
