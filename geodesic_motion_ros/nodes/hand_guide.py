"""A hand for the twin: it pulls the tool along the demonstrations of a skill, as a person guides an arm.

With a node `record` beside it, each path is a take.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from geodesic_motion_ros.nodes.messages import pose_message, read_pose
from geodesic_motion_ros.simulation.hand_paths import HandPath, hand_paths
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError

#: How long [s] a service or the arm is waited for.
PATIENCE = 20.0
# The hand moves so often [Hz], and stands still for so long [s] before and after each path.
_RATE, _STANDSTILL = 100.0, 0.5
# The arm has come to where the hand stands within this [m].
_REACHED = 0.005


class GuideError(GeodesicMotionError):
    """The twin, or the node `record`, does not answer or refuses."""


def guide(
    skill: Skill,
    count: int,
    seed: int = 0,
    duration: float = 5.0,
    record: bool = False,
    ros_arguments: Sequence[str] = (),
    shown: Callable[[str], None] = print,
) -> int:
    """Pull the twin's tool along `count` paths of about `duration` [s] (`hand_paths`), and back between them.

    Parameters
    ----------
    record : let the node `record` begin a take before each path and end it afterwards.
    ros_arguments : what follows --ros-args on a command line.
    shown : called with one line for each path.

    Returns
    -------
    How many paths there were, or takes that were kept.

    Raises
    ------
    GuideError : a node does not answer, or refuses to begin. ParameterError : arguments that cannot be used.
    """
    paths = hand_paths(skill, count, seed, duration)
    context = rclpy.Context()
    try:
        rclpy.init(args=["hand", "--ros-args", *ros_arguments], context=context)
    except RuntimeError as error:  # what rcl makes of an argument that it cannot read
        raise ParameterError(str(error)) from error
    hand = _Hand(context, skill.base_frame)
    try:
        hand.take_the_arm()
        try:
            return sum(hand.lead(path, number, record, shown) for number, path in enumerate(paths, 1))
        finally:
            # Ctrl-C may come at any time: an arm that nobody leads is to be held by its motors
            with suppress(GuideError):
                hand.release_the_arm()
    finally:
        hand.close()


class _Hand:
    """Where the hand is, and the twin and recorder that it talks to."""

    def __init__(self, context: Any, frame: str) -> None:
        self._context, self._frame = context, frame
        self._node = rclpy.create_node("hand", context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._poses = self._node.create_publisher(PoseStamped, "twin/hand_pose", QoSProfile(depth=1))
        self._tool: tuple[np.ndarray, np.ndarray] | None = None
        self._last: HandPath | None = None
        self._node.create_subscription(PoseStamped, "ee_pose", self._hear, QoSProfile(depth=1))

    def _hear(self, message: PoseStamped) -> None:
        self._tool = read_pose(message, self._frame)

    def take_the_arm(self) -> None:
        self._free_drive(True)
        self._spin_until(lambda: self._tool is not None, "the twin publishes no ee_pose")
        self._spin_until(lambda: self._now() > 0.0, "nothing is published on /clock")

    def release_the_arm(self) -> None:
        self._free_drive(False)

    def lead(self, path: HandPath, number: int, record: bool, shown: Callable[[str], None]) -> bool:
        """Lead the tool to the start of a path and along it; returns whether the take was kept, if there is one."""
        if self._last is not None:
            self._pull(self._last.back())
        self._pull(HandPath.between(self._tool, path.start))
        self._stand(path.start)
        if record:
            begun = self._call(Trigger, "record/begin", Trigger.Request())
            if not begun.success:
                raise GuideError(begun.message)
        self._pull(path)
        self._stand(path.at(path.times[-1]))
        self._last = path
        kept, said = True, f"{path.times[-1]:.1f} s"
        if record:
            ended = self._call(Trigger, "record/end", Trigger.Request())
            kept, said = ended.success, ended.message if ended.success else f"refused: {ended.message}"
        shown(f"path {number}: {said}")
        return kept

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _pull(self, path: HandPath) -> None:
        begin = self._now()
        while (passed := self._now() - begin) < path.times[-1]:
            self._hold(path.at(passed))

    def _stand(self, pose: tuple[np.ndarray, np.ndarray]) -> None:
        """Hold the tool in a pose until the arm is there, and for a while."""
        reached = False
        until = self._now() + PATIENCE
        while self._now() < until:
            self._hold(pose)
            if not reached and np.linalg.norm(self._tool[0] - pose[0]) < _REACHED:
                reached, until = True, self._now() + _STANDSTILL
        if not reached:
            apart = 1e3 * float(np.linalg.norm(self._tool[0] - pose[0]))
            raise GuideError(f"the arm stays {apart:.0f} mm from where the hand pulls it: something is in between")

    def _hold(self, pose: tuple[np.ndarray, np.ndarray]) -> None:
        """Publish a pose of the hand, and listen until the next one is due."""
        due = self._now() + 1.0 / _RATE
        self._poses.publish(pose_message(*pose, self._frame, self._node.get_clock().now().to_msg()))
        while (left := due - self._now()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def _now(self) -> float:
        """The time [s], of a simulation where the node lives by one."""
        return 1e-9 * self._node.get_clock().now().nanoseconds

    def _free_drive(self, on: bool) -> None:
        answer = self._call(SetBool, "twin/free_drive", SetBool.Request(data=on))
        if not answer.success:
            raise GuideError(answer.message)

    def _call(self, kind: type, name: str, request: Any) -> Any:
        client = self._node.create_client(kind, name)
        node, full = name.partition("/")[0], self._node.resolve_service_name(name)
        try:
            self._spin_until(client.service_is_ready, f"nobody offers {full}: start the node `{node}` first")
            future = client.call_async(request)
            self._spin_until(future.done, f"{full} does not answer")
            return future.result()
        finally:
            self._node.destroy_client(client)

    def _spin_until(self, condition: Callable[[], bool], complaint: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > deadline:
                raise GuideError(f"{complaint} (waited {PATIENCE:g} s; the same ROS_DOMAIN_ID?)")
            self._executor.spin_once(timeout_sec=0.05)
