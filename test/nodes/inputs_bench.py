"""Inputs of a planner, at times of the test's own."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes.node_time import NodeTime
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.planner_inputs import PlannerInputs
from geodesic_motion_ros.robot.kinematics import Robot

#: [m/s], [s].
SPEED, PATIENCE = 0.5, 10.0
BASE = "panda_link0"
PARAMETERS = {parameter.name: parameter.default for parameter in PLANNER}


class Bench:
    """Inputs of a planner, and the clocks they look at: `go` lets time pass, `jump` sets the ROS clock [s]."""

    def __init__(self, node: Any, **parameters: Any) -> None:
        self.ros, self.steady = 1_000_000_000_000, 5_000_000_000
        self.ros_time_is_active = False
        self.changed = threading.Event()
        self.parameters = PARAMETERS | parameters
        robot = Robot.named("panda")
        self.inputs = PlannerInputs(node, self.parameters, robot, "panda", self.changed.set)
        self.inputs.listener.time = NodeTime(self, lambda: self.steady)

    def now(self) -> Any:
        return SimpleNamespace(nanoseconds=self.ros)

    def go(self, seconds: float) -> None:
        self.ros += round(1e9 * seconds)
        self.steady += round(1e9 * seconds)

    def jump(self, seconds: float) -> None:
        self.ros += round(1e9 * seconds)

    def header(self, late: float | None = 0.0) -> Header:
        """late : how long ago its stamp is [s]; None: stamp 0."""
        at = 0 if late is None else self.ros - round(1e9 * late)
        return Header(frame_id=BASE, stamp=Time(sec=at // 10**9, nanosec=at % 10**9))

    def sphere(self, x: float = 0.5, late: float | None = 0.0, **fields: Any) -> Marker:
        marker = Marker(header=self.header(late), type=Marker.SPHERE, **fields)
        marker.pose.position.x = x
        marker.scale.x = marker.scale.y = marker.scale.z = 0.1
        return marker

    def tell(self, *markers: Marker) -> None:
        self.inputs.obstacles.on_obstacles(serialize_message(MarkerArray(markers=list(markers))))

    def move(self, late: float | None, duration: float = 1.0, delay: float | None = None) -> None:
        """Tell of a sphere along x, where it was `delay` ago, sixty times a second.

        late : as of `header`.
        """
        for _ in range(round(60 * duration)):
            self.go(1.0 / 60.0)
            self.tell(self.sphere(SPEED * (self.true_time - ((late or 0.0) if delay is None else delay)), late))

    @property
    def true_time(self) -> float:
        return 1e-9 * self.steady

    def place_now(self) -> float:
        """Where along x the first sphere is expected now [m]."""
        snapshot = self.inputs.snapshot()
        return float(snapshot.obstacles.moved_on(snapshot.heard, 1.6, 0.0).centres[0, 0])
