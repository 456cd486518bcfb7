"""Node `franka`: drives a Franka Research 3 over its own protocol, by Franka's own library.

    planner --joint_trajectory--> franka --> a process of its own, every millisecond --> the arm

The process is `hardware/fci_process.py`; here messages are read, judged and handed on, and what the arm says is
published.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.hardware.command_stream import load_kernels
from geodesic_motion_ros.hardware.drive_state import JOINTS, DriveMode, DriveState
from geodesic_motion_ros.hardware.drive_talk import Notice
from geodesic_motion_ros.hardware.fci_link import FciLink
from geodesic_motion_ros.hardware.judged_commands import check_motion
from geodesic_motion_ros.nodes.joint_bytes import parse_joint_trajectory
from geodesic_motion_ros.nodes.messages import (
    MessageRefused,
    diagnostic_array,
    diagnostic_status,
    joint_state_message,
    read_joint_trajectory,
)
from geodesic_motion_ros.nodes.parameter_tables import FRANKA
from geodesic_motion_ros.nodes.parameters import NodeParameters
from geodesic_motion_ros.nodes.publishers import publishers_of
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.running import STEADY, LoopingNode, run_node
from geodesic_motion_ros.nodes.steady_loop import SteadyLoop
from geodesic_motion_ros.nodes.usage import PROGRAMS
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.utils.errors import ParameterError, RobotError

_TRAJECTORIES = "joint_trajectory"
#: Trajectories that wait to be read, at most: those of a fifth of a second of a planner at 100 Hz.
_WAITING = 20
#: The status is published so often [Hz], and at once where the mode has changed.
_STATUS_RATE = 10.0
#: Stamps that are older than this [s] are those of an arm whose milliseconds last longer than the machine's.
_OLD = 0.1
_MESSAGES = {
    DriveMode.CONNECTING: "no connection to the arm",
    DriveMode.DISARMED: "the arm stands and follows nothing: ~/arm with data: true",
    DriveMode.FOLLOWING: f"the arm follows {_TRAJECTORIES}",
    DriveMode.RESTING: "the arm goes on to rest, and follows nothing then",
    DriveMode.REFLEX: "the arm has stopped itself",
    DriveMode.USER_STOPPED: "the arm is stopped by its user",
    DriveMode.NOT_READY: "the arm is not set to execution",
    DriveMode.ENDED: "the process that commands the arm has ended",
}
_SLOW = (
    "; its stamps are {:.2f} s old: the arm's milliseconds last longer than this machine's, as those of a slow "
    "simulation, which is for clock_from_robot"
)
_LEVELS = {DriveMode.FOLLOWING: DiagnosticStatus.OK, DriveMode.DISARMED: DiagnosticStatus.WARN}


class FrankaNode(LoopingNode):
    """The driver of a Franka Research 3 as a ROS 2 node.

    The arm follows `joint_trajectory` after `~/arm`, until it is disarmed or stops itself; a trajectory that does not
    continue what is commanded is refused, and the arm goes on to the rest at the end of the one before, as it does
    where nothing more comes. After a reflex it waits for `~/recover`, and for `~/arm` then. A connection that is lost
    is looked for again by itself; the arm follows nothing after it before `~/arm`.

    Raises
    ------
    ParameterError : a parameter does not exist or does not fit. RobotError : no such robot; pylibfranka is not
        installed.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("franka", **node_options)

    def _build(self) -> None:
        values = NodeParameters(self, FRANKA)
        if not values["address"]:
            raise ParameterError("parameter address is empty: give the address of the arm, as 172.16.0.2")
        if self.get_parameter("use_sim_time").value:
            raise ParameterError("use_sim_time does not fit an arm, whose time is real; a simulated one that is slower "
                                 "shows its own with clock_from_robot")  # fmt: skip
        plain = Robot.named(values["robot"])
        if (count := len(plain.joint_names)) != JOINTS:
            raise ParameterError(f"parameter robot = {values['robot']!r} has {count} joints: a Franka has {JOINTS}")
        self._prefix = values["joint_prefix"]
        self._robot, self._limits = plain.prefixed(self._prefix), JointLimits.of(plain)
        self._by_robot, self._address, rate = values["clock_from_robot"], values["address"], values["state_rate"]
        self._epoch = time.time_ns()
        load_kernels(self._limits)
        self.refusals = RefusalLog(self.get_logger().warning)
        self.link = FciLink(self._address, values["robot"], self._by_robot, self._epoch, self._hear, self._died)
        self._loop = SteadyLoop(self._tick, rate, self._died, name="states")
        self._published, self._age = 0, 0.0
        self._mode: DriveMode | None = None
        self._every = max(1, round(rate / _STATUS_RATE))
        # What the arm said last, and what it said last of each mode.
        self._newest = ""
        self._explained: dict[DriveMode, str] = {}
        qos = QoSProfile(depth=1)
        self._states = self.create_publisher(JointState, "joint_states", qos)
        self._commanded = self.create_publisher(JointState, "commanded_joint_states", qos)
        self._status = self.create_publisher(DiagnosticArray, "~/status", QoSProfile(depth=10))
        self._clock_publisher = self.create_publisher(Clock, "/clock", qos) if self._by_robot else None
        # Each continues the one before: none may be passed over.
        each = QoSProfile(depth=_WAITING)
        self._trajectories = self.create_subscription(
            JointTrajectory, _TRAJECTORIES, self._on_trajectory, each, raw=True
        )
        self.create_service(SetBool, "~/arm", self._on_arm)
        self.create_service(Trigger, "~/recover", self._on_recover)
        self.create_timer(1.0, self._look_for_rivals, clock=STEADY)

    def _introduction(self) -> str:
        return (
            f"ready: connects to the arm at {self._address}, publishes {self._states.topic_name}; the arm follows "
            f"{self._trajectories.topic_name} after ~/arm"
        )

    def start(self) -> None:
        """Connect to the arm."""
        self.link.start()
        self._loop.start()

    def stop(self) -> None:
        """Let the arm go on to rest, and end; harmless when done before."""
        self.link.stop()
        self._loop.stop()

    # ---------------------------------------------------------------- what the arm says

    def _tick(self, _: int) -> None:
        state = self.link.state()
        if state.count != self._published:  # silence of the arm is silence here: who plans must know
            self._published = state.count
            self._publish(state)
        if state.mode is not self._mode or self._loop.ticks % self._every == 0:
            self._mode = state.mode
            self._publish_status(state)

    def _publish(self, state: DriveState) -> None:
        stamp = Time(nanoseconds=self._epoch + round(1e9 * state.time)).to_msg()
        if not self._by_robot:
            self._age = 1e-9 * (time.time_ns() - self._epoch) - state.time
        if self._clock_publisher is not None:
            self._clock_publisher.publish(Clock(clock=stamp))
        names = self._robot.joint_names
        self._states.publish(joint_state_message(names, state.positions, state.velocities, stamp))
        self._commanded.publish(joint_state_message(names, state.commanded, state.commanded_velocities, stamp))

    def _publish_status(self, state: DriveState) -> None:
        message = self._explained.get(state.mode) or _MESSAGES[state.mode]
        level = _LEVELS.get(state.mode, DiagnosticStatus.ERROR)
        if self._age > _OLD:
            message += _SLOW.format(self._age)
            level = max(level, DiagnosticStatus.WARN)
        error = float(np.max(np.abs(state.positions - state.commanded)))
        values = {
            "mode": state.mode.name,
            "newest": self._newest,
            "success_rate": state.success,
            "lost_cycles": state.lost,
            "tracking_error_mrad": 1000.0 * error,
            "commanded_speed_mrad_s": 1000.0 * float(np.max(np.abs(state.commanded_velocities))),
            "stamp_age_ms": 1000.0 * self._age,
            "refused_input": self.refusals.newest(within=1.0),
            **{f"refused_{topic}": count for topic, count in sorted(self.refusals.counts.items())},
        }
        name = f"{self.get_fully_qualified_name().lstrip('/')}: arm"
        status = diagnostic_status(level, name, f"{state.mode.name}: {message}", self._address, values)
        self._status.publish(diagnostic_array([status], self.get_clock().now().to_msg()))

    def _hear(self, notice: Notice) -> None:
        if notice.kind == "refused":
            self.refusals.add(_TRAJECTORIES, notice.text)
            return
        self._newest = notice.text
        if notice.mode is not None:
            self._explained[notice.mode] = notice.text
            self._mode = None  # the status is published anew
        log = self.get_logger()
        # each from a line of its own: rclpy keeps the level of a line
        if notice.kind == "info":
            log.info(notice.text)
        elif notice.kind == "warning":
            log.warning(notice.text)
        else:
            log.error(notice.text)

    # ---------------------------------------------------------------- what it is asked for

    def _on_trajectory(self, wire: bytes) -> None:
        with self.refusals.guard(_TRAJECTORIES):
            message = parse_joint_trajectory(wire)
            waypoints = read_joint_trajectory(message, self._robot, self._prefix)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            try:
                check_motion(waypoints, self._limits, self._robot.joint_names)
                self.link.send(waypoints, 1e-9 * (stamp - self._epoch) if stamp else None)
            except RobotError as error:
                raise MessageRefused(str(error)) from error

    def _on_arm(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        return self._serve("~/arm", response, "arm" if request.data else "disarm")

    def _on_recover(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._serve("~/recover", response, "recover")

    def _serve(self, service: str, response: Any, kind: str) -> Any:
        def ask() -> str:
            try:
                return self.link.ask(kind)
            except RobotError as error:
                raise MessageRefused(str(error)) from error

        self.refusals.answer(service, response, ask)
        if response.success:
            self.get_logger().info(f"{service}: {response.message}")
        return response

    def _look_for_rivals(self) -> None:
        names = publishers_of(self, self._trajectories.topic_name)
        if len(names) > 1:
            self.get_logger().warning(
                f"{_TRAJECTORIES} is published by {' and '.join(names)}: only one may command the arm",
                throttle_duration_sec=5.0,
            )


def main(args: list[str] | None = None) -> int:
    """Drive the arm until SIGINT or SIGTERM; returns the exit code."""
    return run_node(PROGRAMS["franka"], FrankaNode, args)


if __name__ == "__main__":
    sys.exit(main())
