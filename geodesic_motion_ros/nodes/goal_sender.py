"""Sends one goal to a planner that runs, and says what the planner makes of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile

from geodesic_motion_ros.errors import GeodesicMotionError
from geodesic_motion_ros.nodes.messages import pose_message, seconds

#: How long [s] a planner is looked for, and its verdict on the goal is waited for.
PATIENCE = 10.0
# The planner takes a goal in its next cycle; a verdict from before the goal is no answer. Cycles it is given for that.
_CYCLES = 10


class NoPlannerError(GeodesicMotionError):
    """No planner listens, or it does not answer."""


def by_hand(pose: np.ndarray, frame: str) -> str:
    """The command of the `ros2` command line that sends a goal (7,): position [m], quaternion (w, x, y, z)."""
    x, y, z, qw, qx, qy, qz = (round(float(value), 4) for value in pose)
    message = (
        f"{{header: {{frame_id: {frame}}}, pose: {{position: {{x: {x}, y: {y}, z: {z}}}, "
        f"orientation: {{w: {qw}, x: {qx}, y: {qy}, z: {qz}}}}}}}"
    )
    return f'ros2 topic pub --once /goal_pose geometry_msgs/msg/PoseStamped "{message}"'


def send_goal(pose: np.ndarray, frame: str) -> str:
    """Publish a goal (7,) once, as soon as a planner listens; returns the planner's next status, `CODE: reason`.

    Raises
    ------
    NoPlannerError : nobody listens to `goal_pose`, or no status comes back.
    """
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node("goal", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    said: list[tuple[float, str]] = []

    def hear(message: DiagnosticArray) -> None:
        said.append((seconds(message.header.stamp), message.status[0].message))

    try:
        goals = node.create_publisher(PoseStamped, "goal_pose", QoSProfile(depth=1))
        node.create_subscription(DiagnosticArray, "planner/status", hear, 10)
        _spin(executor, goals.get_subscription_count, "nobody listens to goal_pose: start the planner first")
        _spin(executor, lambda: said, "the planner's status cannot be heard")
        sent = node.get_clock().now().to_msg()
        goals.publish(pose_message(pose[:3], pose[3:], frame, sent))

        # Older ones may still stand in the queue.
        def answers() -> list[str]:
            return [text for stamp, text in said if stamp > seconds(sent)]

        _spin(executor, lambda: len(answers()) >= _CYCLES, "the planner has fallen silent")
        return answers()[-1]
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
