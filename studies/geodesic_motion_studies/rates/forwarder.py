"""A node that forwards what a filter hears as its commands, as it is: what DDS and a node in Python take at least."""

from __future__ import annotations

from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile
from trajectory_msgs.msg import JointTrajectory


def main() -> None:
    """Forward until the process is interrupted."""
    rclpy.init()
    node = rclpy.create_node("filter")
    commands = node.create_publisher(JointTrajectory, "joint_trajectory", QoSProfile(depth=1))

    def forward(chunk: bytes) -> None:
        commands.publish(chunk)

    node.create_subscription(JointTrajectory, "~/joint_trajectory", forward, QoSProfile(depth=10), raw=True)
    executor = EventsExecutor()
    executor.add_node(node)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        while True:
            executor.spin_once(timeout_sec=0.1)


if __name__ == "__main__":
    main()
