"""Record: what planner and twin have said in a run, and what follows from it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Path
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, UInt32

from geodesic_motion_ros.nodes.messages import seconds
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.faults.bench_clock import BenchClock
from geodesic_motion_studies.faults.command_ear import steady_time

#: What the planner says while an arm that is not where it was sent has not rested.
_LOST = "nothing is commanded until"
#: An arm whose joints stay within this [rad] for this long [s] rests.
_REST, _REST_TIME = 1e-3, 0.15


class Status(NamedTuple):
    """What the planner said, and when that was sent, or arrived where the clock is simulated [s, steady clock]."""

    sent: float
    values: dict[str, str]

    @property
    def code(self) -> str:
        return self.values["code"]

    @property
    def reason(self) -> str:
        return self.values["reason"]

    @property
    def without_goal(self) -> bool:
        """Whether the planner has no goal: then what it says is why, of the newest one asked for. A filter says NO_GOAL
        also where it has refused the newest.
        """
        return self.code == "NO_GOAL" or (self.code != "OK" and self.code == self.values["goal_code"])

    @property
    def lost(self) -> bool:
        """Whether the arm was found elsewhere than commanded: commands will begin anew at where it is."""
        return _LOST in self.reason

    def number(self, key: str) -> float:
        return float(self.values[key])


class ArmState(NamedTuple):
    """A joint state: when it arrived [s, steady clock], its stamp [s], and the configuration (eta,) [rad]."""

    arrived: float
    stamp: float
    configuration: np.ndarray


class Record:
    """Everything that the two nodes say.

    Attributes
    ----------
    statuses, health : of the planner, since the run began. states : of the arm, likewise.
    path : positions (n, 3) [m] of the tool on its newest path.
    least_clearance [m], contacts : the twin's, since the run began.
    """

    def __init__(self, node: Node, robot: Robot, clock: BenchClock) -> None:
        self._robot, self._clock = robot, clock
        self.forget()
        for kind, topic, take in (
            (DiagnosticArray, "planner/status", self._on_status),
            (DiagnosticArray, "/diagnostics", self._on_health),
            (JointState, "joint_states", self._on_joints),
            (Path, "path", self._on_path),
            (Float64, "twin/clearance", self._on_clearance),
            (UInt32, "twin/contacts", self._on_contacts),
        ):
            _listen(node, kind, topic, take)

    def forget(self) -> None:
        """The nodes are others from now on."""
        self.statuses: list[Status] = []
        self.states: list[ArmState] = []
        self._last_contacts = 0
        self.begin()

    def begin(self) -> None:
        """Another run begins, with what was said last."""
        self.statuses, self.states = self.statuses[-1:], self.states[-1:]
        self.health: list[str] = []
        self.path = np.zeros((0, 3))
        self.least_clearance, self.contacts = math.inf, 0

    @property
    def status(self) -> Status | None:
        """The planner's newest."""
        return self.statuses[-1] if self.statuses else None

    @property
    def configuration(self) -> np.ndarray:
        """Where the arm is, (eta,) [rad]."""
        return self.states[-1].configuration

    @property
    def tool(self) -> np.ndarray:
        """Where the tool is, (3,) [m]."""
        return self._robot.forward(self.configuration)[0]

    @property
    def rests(self) -> bool:
        """Whether the arm has not moved for a moment."""
        newest = self.states[-1]
        for state in reversed(self.states):
            if np.max(np.abs(state.configuration - newest.configuration)) > _REST:
                return False
            if newest.arrived - state.arrived >= _REST_TIME:
                return True
        return False

    def ahead(self, distance: float) -> np.ndarray:
        """The place (3,) [m] on the tool's path so far [m] ahead of it, or where the path ends."""
        return ahead(self.path, self.tool, distance)

    def since(self, moment: float) -> list[Status]:
        """The statuses sent after a moment [s, steady clock], oldest first."""
        first = len(self.statuses)
        while first and self.statuses[first - 1].sent > moment:
            first -= 1
        return self.statuses[first:]

    def _on_status(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        # Its stamp is of the clock that the nodes run by.
        sent = now if self._clock.simulated else min(now, steady_time(seconds(message.header.stamp)))
        self.statuses.append(Status(sent, {pair.key: pair.value for pair in message.status[0].values}))

    def _on_health(self, message: DiagnosticArray) -> None:
        self.health.append(message.status[0].message)

    def _on_joints(self, message: JointState) -> None:
        self.states.append(ArmState(time.monotonic(), seconds(message.header.stamp), np.array(message.position)))

    def _on_path(self, message: Path) -> None:
        points = [pose.pose.position for pose in message.poses]
        self.path = np.array([(point.x, point.y, point.z) for point in points]).reshape(-1, 3)

    def _on_clearance(self, message: Float64) -> None:
        self.least_clearance = min(self.least_clearance, message.data)

    def _on_contacts(self, message: UInt32) -> None:
        # They count from zero again when a scene begins.
        self.contacts += message.data - (self._last_contacts if message.data >= self._last_contacts else 0)
        self._last_contacts = message.data


def ahead(path: np.ndarray, place: np.ndarray, distance: float) -> np.ndarray:
    """The point (3,) of a path (n, 3) so far [m] ahead of that nearest to a place (3,), or its end."""
    passed = int(np.argmin(np.linalg.norm(path - place, axis=1)))
    lengths = np.cumsum(np.linalg.norm(np.diff(path[passed:], axis=0), axis=1))
    return path[passed + min(int(np.searchsorted(lengths, distance)), len(lengths))]


def _listen(node: Node, kind: type, topic: str, take: Callable[[Any], None]) -> None:
    node.create_subscription(kind, topic, take, QoSProfile(depth=100))
