"""Sends one goal to a planner that runs, and says what the planner makes of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

from geodesic_motion_ros.nodes.messages import pose_message, seconds
from geodesic_motion_ros.nodes.stream_cycle import PREPARING
from geodesic_motion_ros.planning.status import VerdictCode
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError

#: How long [s] a planner is looked for, and its verdict on the goal is waited for.
PATIENCE = 10.0
# The planner hears of a goal in its next cycle, and prepares it for a while; a verdict from before is no answer. Cycles
# it is given to hear of it.
_CYCLES = 10


class NoPlannerError(GeodesicMotionError):
    """No planner listens, or it does not answer."""


class GoalRefusedError(GeodesicMotionError):
    """The planner refuses the goal, and keeps to the one before if there is one."""


@dataclass(frozen=True)
class _Status:
    """When it was sent [s], what it says, and its code and reason for the newest goal."""

    stamp: float
    text: str
    goal_code: str
    goal_reason: str


def by_hand(pose: np.ndarray, frame: str, topic: str = "/goal_pose") -> str:
    """The command of the `ros2` command line that sends a goal (7,): position [m], quaternion (w, x, y, z)."""
    x, y, z, qw, qx, qy, qz = (round(float(value), 4) for value in pose)
    message = (
        f"{{header: {{frame_id: {frame}}}, pose: {{position: {{x: {x}, y: {y}, z: {z}}}, "
        f"orientation: {{w: {qw}, x: {qx}, y: {qy}, z: {qz}}}}}}}"
    )
    return f'ros2 topic pub --once {topic} geometry_msgs/msg/PoseStamped "{message}"'


def send_goal(
    pose: np.ndarray, frame: str, ros_arguments: Sequence[str] = (), sending: Callable[[str], None] = lambda topic: None
) -> str:
    """Publish a goal (7,) once, as soon as a planner listens; returns what the planner says when it has accepted it,
    `CODE: reason`.

    Parameters
    ----------
    ros_arguments : what follows --ros-args on a command line, such as ("-r", "__ns:=/left").
    sending : called with the full name of the topic before anything is waited for.

    Raises
    ------
    NoPlannerError : nobody listens to the topic, or no status comes back.
    GoalRefusedError : with the planner's reason.
    ParameterError : ROS arguments that cannot be read.
    """
    context = rclpy.Context()
    try:
        rclpy.init(args=["goal", "--ros-args", *ros_arguments], context=context)
    except RuntimeError as error:  # what rcl makes of an argument that it cannot read
        raise ParameterError(str(error)) from error
    node = rclpy.create_node("goal", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    received: list[_Status] = []

    def hear(message: DiagnosticArray) -> None:
        status = message.status[0]
        values = {pair.key: pair.value for pair in status.values}
        received.append(
            _Status(seconds(message.header.stamp), status.message, values["goal_code"], values["goal_reason"])
        )

    try:
        goals = node.create_publisher(PoseStamped, "goal_pose", QoSProfile(depth=1))
        node.create_subscription(DiagnosticArray, "planner/status", hear, 10)
        sending(goals.topic_name)
        _spin(executor, goals.get_subscription_count, f"nobody listens to {goals.topic_name}: start the planner first")
        _spin(executor, lambda: received, "the planner's status cannot be heard")
        sent = node.get_clock().now().to_msg()
        goals.publish(pose_message(pose[:3], pose[3:], frame, sent))

        # Older ones may still stand in the queue.
        def answers() -> list[_Status]:
            return [status for status in received if status.stamp > seconds(sent)]

        def answered() -> bool:
            return len(answers()) >= _CYCLES and answers()[-1].goal_reason != PREPARING

        _spin(executor, answered, "the planner has fallen silent, or prepares the goal for ever")
        answer = answers()[-1]
        if answer.goal_code != VerdictCode.OK.name:
            raise GoalRefusedError(f"the planner refuses the goal: {answer.goal_code}: {answer.goal_reason}")
        return answer.text
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def _spin(executor: Any, until: Callable[[], Any], complaint: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not until():
        if time.monotonic() > deadline:
            raise NoPlannerError(f"{complaint} (waited {PATIENCE:g} s; the same ROS_DOMAIN_ID?)")
        executor.spin_once(timeout_sec=0.05)
