"""A planner that moves a twin, both processes of their own, seen from outside: goals and spheres in, status out."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from geodesic_motion_ros.demo.demo_run import DemoError, Processes, isolated_environment
from geodesic_motion_ros.nodes.marker_messages import MarkerScene, sphere_marker
from geodesic_motion_ros.nodes.messages import cloud_message, pose_message
from geodesic_motion_ros.skill.skill import Skill

#: Times a second that spheres are published, and that a cloud is; seconds to wait for the nodes.
OBSTACLES_HZ, CLOUDS_HZ, PATIENCE = 30.0, 10.0, 60.0
_SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
_GREY = (0.5, 0.5, 0.5, 1.0)
_NOTHING: Mapping[str, Any] = MappingProxyType({})

#: Centres (o, 3) and radii (o,) [m] of spheres at a time [s].
Spheres = Callable[[float], tuple[np.ndarray, np.ndarray]]
#: Points (n, 3) [m] at a time [s].
Cloud = Callable[[float], np.ndarray]


def no_spheres(_: float) -> tuple[np.ndarray, np.ndarray]:
    """No spheres at any time."""
    return np.empty((0, 3)), np.empty(0)


@dataclass(frozen=True)
class Tick:
    """A status as received: when it came [s], the tick's number, the duration of the one before [ms], all misses, the
    verdict's code, by how much of its cost the path may be dearer than the cheapest, and the verdict's reason.
    """

    time: float
    number: int
    duration: float
    misses: int
    code: str
    cost_gap: float
    reason: str


class PlannerStream:
    """Starts a planner at a rate [Hz] and a twin, and talks to them until it is left.

    Attributes
    ----------
    spheres : the obstacles, published `OBSTACLES_HZ` times a second; each is known by its number from
        `first_number` on. None: nothing is published, nor waited for.
    cloud : points (n, 3) [m] at a time [s], published `CLOUDS_HZ` times a second; None: no cloud is published.
    ticks : the planner's, since they were last cleared. code, time_to_goal, goal_number, speed : of its newest status:
        the verdict, the time that it still needs [s], nan where it follows no path to the goal, how many goals it has
        heard, and how fast it moves the tool [m/s].

    Raises
    ------
    DemoError : a node has ended, or what is waited for does not happen.
    """

    def __init__(
        self, skill: str, folder: Path, rate: float, domain: int, module: str = "nodes.planner_node",
        beside: Mapping[str, Sequence[str]] = _NOTHING, environment: Mapping[str, str] = _NOTHING, **parameters: object,
    ) -> None:  # fmt: skip
        """module : of the planner. beside : commands of other processes, by their names. environment : of all
        processes, besides what keeps them on this machine. parameters : of the planner, besides skill and rate.
        """
        self._module, self._beside = module, beside
        self.skill = Skill.load(skill)
        self.spheres: Spheres | None = no_spheres
        self.first_number = 0
        self.cloud: Cloud | None = None
        self.ticks: list[Tick] = []
        self.code, self.time_to_goal = "", math.nan
        self.goal_number, self.speed = 0, math.nan
        # Whether the planner knows where the arm is, and that somebody receives its commands.
        self._followed = False
        self._name = skill
        self._parameters = {"skill": skill, "rate": rate, "latent_view_rate": 0.0} | parameters
        self._processes = Processes(folder, isolated_environment(domain) | dict(environment))
        self._scene = MarkerScene(self.skill.base_frame)
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("planner_stream", context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._goals = self.node.create_publisher(PoseStamped, "goal_pose", QoSProfile(depth=1))
        self._obstacles = self.node.create_publisher(MarkerArray, "obstacles", QoSProfile(depth=5))
        self.node.create_subscription(DiagnosticArray, "planner/status", self._on_status, QoSProfile(depth=50))
        self._clouds = self.node.create_publisher(PointCloud2, "obstacle_cloud", _SENSOR)
        self.node.create_timer(1.0 / OBSTACLES_HZ, self.tell_spheres)
        self.node.create_timer(1.0 / CLOUDS_HZ, self._tell_cloud)

    def __enter__(self) -> PlannerStream:
        try:
            self._processes.start("twin", {"skill": self._name})
            self._processes.start("planner", self._parameters, module=self._module)
            for name, command in self._beside.items():
                self._processes.run(name, command)
            self.wait(lambda: self._followed and self._goals.get_subscription_count(), PATIENCE)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._processes.__exit__()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def wait(self, condition: Callable[[], object], patience: float) -> None:
        """Wait until a condition is true, at most so long [s]."""
        deadline = self.now() + patience
        while not condition():
            self._executor.spin_once(timeout_sec=0.05)
            self._processes.check()
            if self.now() > deadline:
                raise DemoError(f"timed out after {patience:g} s; the planner says: {self.code or 'nothing'}")

    def spend(self, seconds: float) -> None:
        """Go on for so long [s]."""
        begin = self.now()
        self.wait(lambda: self.now() - begin >= seconds, seconds + PATIENCE)

    def send_goal(self, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Ask for a pose of the tool, (3,) [m] and (4,) in the skill's base frame."""
        stamp = self.node.get_clock().now().to_msg()
        self._goals.publish(pose_message(position, quaternion, self.skill.base_frame, stamp))

    def tell_spheres(self) -> None:
        """Tell where the spheres are now."""
        if self.spheres is None:
            return
        stamp, frame = self.node.get_clock().now().to_msg(), self.skill.base_frame
        markers = [
            sphere_marker("stream", number, centre, radius, _GREY, frame, stamp)
            for number, (centre, radius) in enumerate(zip(*self.spheres(self.now()), strict=True), self.first_number)
        ]
        self._obstacles.publish(self._scene.update(markers, stamp))

    def _tell_cloud(self) -> None:
        if self.cloud is not None:
            stamp = self.node.get_clock().now().to_msg()
            self._clouds.publish(cloud_message(self.cloud(self.now()), self.skill.base_frame, stamp))

    def processor_time(self, name: str) -> float:
        """The processor time [s] that a process and those that it started have taken since they began, by its name."""
        session, ticks = self._processes.number(name), 0
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with suppress(OSError):  # it has ended
                # man 5 proc: after the name in brackets session is the fourth field, utime the twelfth, then stime.
                fields = stat.read_text().rpartition(")")[2].split()
                ticks += (int(fields[11]) + int(fields[12])) * (int(fields[3]) == session)
        return ticks / os.sysconf("SC_CLK_TCK")

    def now(self) -> float:
        """The time [s] by the ROS clock."""
        return 1e-9 * self.node.get_clock().now().nanoseconds

    def _on_status(self, message: DiagnosticArray) -> None:
        values = {pair.key: pair.value for pair in message.status[0].values}
        self.code, self.time_to_goal = values["code"], float(values["time_to_goal"])
        self.goal_number, self.speed = int(values["goal_number"]), float(values["speed"])
        self._followed = self.code == "NO_GOAL" and values["commands_received_by"] != ""
        duration, misses = float(values["last_tick_ms"]), int(values["deadline_misses"])
        gap = float(values["cost_gap"])
        self.ticks.append(Tick(self.now(), int(values["tick"]), duration, misses, self.code, gap, values["reason"]))
