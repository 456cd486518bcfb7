"""Sends one goal to a planner that runs, and says what the planner makes of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

from geodesic_motion_ros.errors import GeodesicMotionError
from geodesic_motion_ros.nodes.messages import pose_message, seconds
from geodesic_motion_ros.nodes.stream_cycle import PREPARING

#: How long [s] a planner is looked for, and its verdict on the goal is waited for.
PATIENCE = 10.0
# The planner hears of a goal in its next cycle, and prepares it for a while; a verdict from before is no answer. Cycles
# it is given to hear of it.
_CYCLES = 10


class NoPlannerError(GeodesicMotionError):
    """No planner listens, or it does not answer."""


@dataclass(frozen=True)
class _Status:
    """When it was sent [s], what it says, and what it says of the newest goal."""

    stamp: float
    text: str
    goal: str


def by_hand(pose: np.ndarray, frame: str) -> str:
    """The command of the `ros2` command line that sends a goal (7,): position [m], quaternion (w, x, y, z)."""
    x, y, z, qw, qx, qy, qz = (round(float(value), 4) for value in pose)
    message = (
        f"{{header: {{frame_id: {frame}}}, pose: {{position: {{x: {x}, y: {y}, z: {z}}}, "
        f"orientation: {{w: {qw}, x: {qx}, y: {qy}, z: {qz}}}}}}}"
    )
    return f'ros2 topic pub --once /goal_pose geometry_msgs/msg/PoseStamped "{message}"'


def send_goal(pose: np.ndarray, frame: str) -> str:
    """Publish a goal (7,) once, as soon as a planner listens; returns what the planner says next, `CODE: reason`, but
    for that it prepares the goal.

    Raises
    ------
    NoPlannerError : nobody listens to `goal_pose`, or no status comes back.
    """
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("goal", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    said: list[_Status] = []

    def hear(message: DiagnosticArray) -> None:
        status = message.status[0]
        reasons = [pair.value for pair in status.values if pair.key == "goal_reason"]
        said.append(_Status(seconds(message.header.stamp), status.message, "".join(reasons)))

    try:
        goals = node.create_publisher(PoseStamped, "goal_pose", QoSProfile(depth=1))
        node.create_subscription(DiagnosticArray, "planner/status", hear, 10)
        _spin(executor, goals.get_subscription_count, "nobody listens to goal_pose: start the planner first")
        _spin(executor, lambda: said, "the planner's status cannot be heard")
        sent = node.get_clock().now().to_msg()
        goals.publish(pose_message(pose[:3], pose[3:], frame, sent))

        # Older ones may still stand in the queue.
        def answers() -> list[_Status]:
            return [status for status in said if status.stamp > seconds(sent)]

        def answered() -> bool:
            return len(answers()) >= _CYCLES and answers()[-1].goal != PREPARING

        _spin(executor, answered, "the planner has fallen silent, or prepares the goal for ever")
        return answers()[-1].text
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
