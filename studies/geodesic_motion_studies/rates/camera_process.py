"""A depth camera as a process of its own: it hears where the arm is, and publishes what it sees of it, late as cameras
are.

A cloud shows the arm where it was at the cloud's stamp, by the joint states around that.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.time import Time
from sensor_msgs.msg import JointState, PointCloud2

from geodesic_motion_ros.nodes.messages import cloud_message, diagnostic_array, diagnostic_status, seconds
from geodesic_motion_ros.nodes.running import go_first
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.rates.depth_picture import DepthPicture

#: Clouds a second, their frame, and how late they are [s].
RATE, FRAME, DELAY = 30.0, "camera", 0.06
#: What its diagnostics are called.
NAME = "camera: clouds"
#: Joint states that are kept.
_KEPT = 100
_CLOUDS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


def command(robot: str, points: int, ball: np.ndarray | None) -> list[str]:
    """What starts it: `points` as of `depth_picture.camera`, `ball` (3,) [m] where one is seen."""
    there = [] if ball is None else ["--ball", *(repr(float(number)) for number in ball)]
    return [sys.executable, "-m", __name__, robot, str(points), *there]


class Camera:
    """The publisher of clouds, and of diagnostics: how many it has sent, and what the newest one shows."""

    def __init__(self, robot: str, points: int, ball: np.ndarray | None) -> None:
        """ball : its centre (3,) [m], where one is seen."""
        self._picture = DepthPicture(Robot.named(robot), CollisionModel.named(robot), points, ball)
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._joints: deque[np.ndarray] = deque(maxlen=_KEPT)
        self._sent, self._values = itertools.count(1), {"clouds_sent": 0}
        node = self.node = rclpy.create_node("camera")
        node.create_subscription(JointState, "joint_states", self._hear, QoSProfile(depth=10))
        self._clouds = node.create_publisher(PointCloud2, "obstacle_cloud", _CLOUDS)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        node.create_timer(1.0 / RATE, self._look)
        node.create_timer(1.0, self._say)

    def _hear(self, message: JointState) -> None:
        self._times.append(seconds(message.header.stamp))
        self._joints.append(np.array(message.position))

    def _look(self) -> None:
        taken = 1e-9 * self.node.get_clock().now().nanoseconds - DELAY
        if not self._times or not self._times[0] <= taken <= self._times[-1]:
            return
        began = time.thread_time()
        joints = np.array([np.interp(taken, self._times, column) for column in np.transpose(self._joints)])
        seen = self._picture.take(joints)
        self._clouds.publish(cloud_message(seen.points, FRAME, Time(seconds=taken).to_msg()))
        self._values = {
            "clouds_sent": next(self._sent), "points": len(seen.points), "points_of_arm": seen.of_arm,
            "points_of_ball": seen.of_ball, "work_ms": 1e3 * (time.thread_time() - began),
        }  # fmt: skip

    def _say(self) -> None:
        status = diagnostic_status(DiagnosticStatus.OK, NAME, "", "", dict(self._values))
        self._diagnostics.publish(diagnostic_array([status], self.node.get_clock().now().to_msg()))


def main(arguments: Sequence[str] | None = None) -> None:
    """Publish clouds until interrupted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot")
    parser.add_argument("points", type=int)
    parser.add_argument("--ball", type=float, nargs=3, metavar=("X", "Y", "Z"))
    given = parser.parse_args(arguments)
    # Python's own handler stays: an interrupt ends the loop.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    seen = Camera(given.robot, given.points, None if given.ball is None else np.array(given.ball))
    executor = EventsExecutor()
    executor.add_node(seen.node)
    # A camera does not wait for a core.
    go_first()
    with suppress(KeyboardInterrupt):
        while True:
            executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    seen.node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
