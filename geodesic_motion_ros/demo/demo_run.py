"""One run of the demo: planner and twin as processes of their own, a probe that starts the motion and records it."""

from __future__ import annotations

import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.client import Client
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, UInt32
from std_srvs.srv import Trigger

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.nodes.messages import pose_message, read_point, read_pose, seconds
from geodesic_motion_ros.nodes.stolen_time import StolenTime
from geodesic_motion_ros.utils.errors import GeodesicMotionError

# The arm has arrived when it has been this close to the goal for this long.
ARRIVAL_DISTANCE, ARRIVAL_ANGLE, ARRIVAL_TIME = 0.003, math.radians(0.5), 0.5
# An arm that stands elsewhere than at the goal is waited for so long [s] of the nodes' time; it has moved when its tool
# is so far [m] from where it stood. Processes that start, and a planner that has not planned yet, are waited for while
# they live.
STANDING_PATIENCE, MOVED = 25.0, 0.002
_LOG_PREFIX = re.compile(r"^(\[[^]]*\] )*\[[^]]*\]: ")
# What is waited for is said every so often [s].
_SAID_EVERY = 10.0


class DemoError(GeodesicMotionError):
    """A process of the demo has ended or does not answer; says which one and where its log is."""


class Tick(NamedTuple):
    """A status of the planner, sent from within a tick: when [s], the tick's number, the duration and the processor
    time of the tick before [ms], the deadlines that were missed until then, and the code.
    """

    stamp: float
    number: int
    duration: float
    work: float
    misses: int
    code: str


@dataclass
class Recording:
    """A recording of one run. Times are seconds since the goal was sent; poses are the twin's measured tool poses.

    Attributes
    ----------
    pose_times (n,), positions (n, 3) [m], quaternions (n, 4) ; joint_times (m,), joints (m, 7) [rad].
    obstacle_times (k,), obstacles (k, 3) [m] : centres of the moving sphere.
    ticks : one per status of the planner.
    newest : what the planner said last, `CODE: reason`.
    min_clearance : smallest distance [m] from the arm's real geometry to the obstacle, inf without one.
    contacts : physics steps in which arm and obstacle touched. touched : seconds from goal to the first, or inf.
    arrived : seconds from goal to arrival, nan if it never did.
    stolen_percent : of the machine's time meanwhile, as of `StolenTime`.
    """

    pose_times: list[float] = field(default_factory=list)
    positions: list[np.ndarray] = field(default_factory=list)
    quaternions: list[np.ndarray] = field(default_factory=list)
    joint_times: list[float] = field(default_factory=list)
    joints: list[np.ndarray] = field(default_factory=list)
    obstacle_times: list[float] = field(default_factory=list)
    obstacles: list[np.ndarray] = field(default_factory=list)
    ticks: list[Tick] = field(default_factory=list)
    newest: str = ""
    min_clearance: float = math.inf
    contacts: int = 0
    touched: float = math.inf
    arrived: float = math.nan
    stolen_percent: float = math.nan


class Processes:
    """The nodes of one run, each in a process of its own with a parameter file and a log; ended on leaving."""

    def __init__(self, folder: Path, environment: Mapping[str, str]) -> None:
        self._folder, self._environment = folder, dict(environment)
        self._running: dict[str, tuple[subprocess.Popen[bytes], Path]] = {}

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *_: object) -> None:
        for process, _ in self._running.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.send_signal(signal.SIGCONT)  # one that was stopped would not hear it
        for process, _ in self._running.values():
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._running.clear()

    def start(
        self,
        name: str,
        parameters: Mapping[str, Any],
        remapped: Mapping[str, str] = MappingProxyType({}),
        before: Sequence[str] = (),
        module: str = "",
    ) -> None:
        """Start node `name` of this package as `python -m`, with its parameters in a file that can be used again.

        remapped : names of topics and services, each to another one. before : a command that runs what follows it.
        module : another one of that name, within the package.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        file = self._folder / f"{name}.yaml"
        file.write_text(yaml.safe_dump({f"/**/{name}": {"ros__parameters": dict(parameters)}}, sort_keys=False))
        module = f"geodesic_motion_ros.{module or f'nodes.{name}_node'}"
        command = [*before, sys.executable, "-m", module, "--ros-args", "--params-file", str(file)]
        command += [word for names in remapped.items() for word in ("-r", ":=".join(names))]
        self.run(name, command)

    def run(self, name: str, command: Sequence[str]) -> None:
        """Start a process that is known by a name from now on."""
        self._folder.mkdir(parents=True, exist_ok=True)
        log = self._folder / f"{name}.log"
        with log.open("wb") as output, _interrupts_deferred():
            # In a session of its own: Ctrl-C reaches the demo alone, which then ends its nodes in order.
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=self._environment,
                start_new_session=True,
            )  # fmt: skip
            self._running[name] = (process, log)

    def send(self, name: str, number: int) -> None:
        """Send a signal to a node."""
        self._running[name][0].send_signal(number)

    def end(self, name: str, number: int = signal.SIGINT) -> int:
        """End a node by a signal, which ends it within seconds or is followed by SIGKILL; its exit code."""
        process, _ = self._running.pop(name)
        process.send_signal(number)
        try:
            return process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            return process.wait()

    def number(self, name: str) -> int:
        """The process id of a node."""
        return self._running[name][0].pid

    def exit_code(self, name: str) -> int | None:
        """Of a node that has ended; None while it runs."""
        return self._running[name][0].poll()

    def log(self, name: str) -> str:
        """What a node has printed so far."""
        return self._running[name][1].read_text(errors="replace")

    def newest(self) -> str:
        """Say in one line what each node has printed last, without the level, time and name of a line of the log."""
        last = {name: (self.log(name).strip().splitlines() or ["nothing yet"])[-1] for name in self._running}
        return "; ".join(f"the {name} says: {_LOG_PREFIX.sub('', line)}" for name, line in last.items())

    def check(self) -> None:
        """Raise DemoError, with the end of its log, when a process has ended."""
        for name, (process, log) in self._running.items():
            if process.poll() is not None:
                tail = "\n".join(log.read_text(errors="replace").splitlines()[-15:])
                raise DemoError(f"the {name} has ended with exit code {process.returncode}; {log} ends with:\n{tail}")


class Probe:
    """Talks to planner and twin over ROS and records what they say. All of it happens in the caller's thread."""

    def __init__(
        self,
        processes: Processes,
        domain: int,
        frame: str,
        goal: np.ndarray,
        say: Callable[[str], None],
        simulated: bool = False,
    ) -> None:
        """say : called with what is waited for, where that takes long. simulated : whether a node publishes `/clock`.
        """
        self._processes, self._frame, self._goal, self._say = processes, frame, goal, say
        self._stood_at, self._stood_since = np.full(3, math.inf), math.inf
        self.recording = Recording()
        self._began = math.inf
        self._near_since = math.nan
        self._code = ""
        self._context = rclpy.Context()
        # Python's own handlers stay in place: Ctrl-C raises KeyboardInterrupt here, and the demo cleans up.
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        time_of_nodes = [Parameter("use_sim_time", value=simulated)]
        self._node = rclpy.create_node("demo", context=self._context, parameter_overrides=time_of_nodes)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._goals = self._node.create_publisher(PoseStamped, "goal_pose", QoSProfile(depth=1))
        for kind, topic, take in (
            (JointState, "joint_states", self._on_joints),
            (PointStamped, "obstacle_point", self._on_obstacle),
            (DiagnosticArray, "planner/status", self._on_status),
        ):
            self._node.create_subscription(kind, topic, take, QoSProfile(depth=50))
        self._meet_the_arm()

    def _meet_the_arm(self) -> None:
        """Make what talks to the twin alone."""
        self._spawn = self._node.create_client(Trigger, "twin/spawn_obstacles")
        for kind, topic, take in (
            (PoseStamped, "ee_pose", self._on_pose),
            (Float64, "twin/clearance", self._on_clearance),
            (UInt32, "twin/contacts", self._on_contacts),
        ):
            self._node.create_subscription(kind, topic, take, QoSProfile(depth=50))

    def __enter__(self) -> Probe:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def run(self, after_contact: float = math.inf) -> Recording:
        """Wait for both nodes, let the obstacle loose, send the goal, record until the arm has arrived.

        The recording ends `after_contact` seconds after arm and obstacle have touched for the first time.
        """
        self._make_ready()
        self._send_goal()
        record, stolen = self.recording, StolenTime()
        self._spin(lambda: self._is_over(after_contact))
        record.stolen_percent = stolen.percent()
        return record

    def _send_goal(self) -> None:
        self._began = self._now()
        stamp = self._node.get_clock().now().to_msg()
        self._goals.publish(pose_message(self._goal[:3], self._goal[3:], self._frame, stamp))

    def _is_over(self, after_contact: float) -> bool:
        record = self.recording
        return (
            not math.isnan(record.arrived)
            or self._now() - self._began > record.touched + after_contact
            or self._now() - self._stood_since > STANDING_PATIENCE
        )

    def _make_ready(self) -> None:
        # NO_GOAL: the planner runs, and hears the arm
        self._wait(
            lambda: self._code == "NO_GOAL" and self._spawn.service_is_ready() and self._goals.get_subscription_count(),
            "planner and twin to start",
        )  # fmt: skip
        self._ask(self._spawn, Trigger.Request(), "the twin to spawn the obstacle")

    def _ask(self, client: Client, request: Any, what: str) -> str:
        """Call a service of std_srvs; returns what it answers, DemoError where it refuses."""
        asked = client.call_async(request)
        self._wait(asked.done, what)
        if not asked.result().success:
            raise DemoError(f"waited for {what}, and was refused: {asked.result().message}")
        return asked.result().message

    def _wait(self, condition: Callable[[], Any], what: str) -> None:
        """Wait as long as the processes live, and say now and then what they are at."""
        while not condition():
            until = time.monotonic() + _SAID_EVERY
            self._spin(lambda until=until: condition() or time.monotonic() > until)
            if not condition():
                self._say(f"  waiting for {what}; {self._processes.newest()}")

    def _spin(self, until: Callable[[], Any]) -> None:
        while not until():
            self._executor.spin_once(timeout_sec=0.05)
            self._processes.check()

    def _now(self) -> float:
        return 1e-9 * self._node.get_clock().now().nanoseconds

    def _since(self, stamp: Any) -> float:
        """Seconds from the goal to a stamp; negative before the goal."""
        return seconds(stamp) - self._began

    def _on_pose(self, message: PoseStamped) -> None:
        at = self._since(message.header.stamp)
        if at < 0.0:
            return
        position, quaternion = read_pose(message, self._frame)
        record = self.recording
        # It stands from the first plan on: before, a planner on a busy machine may take long to answer.
        if not record.ticks or np.linalg.norm(position - self._stood_at) > MOVED:
            self._stood_at, self._stood_since = position, self._now()
        record.pose_times.append(at)
        record.positions.append(position)
        record.quaternions.append(quaternion)
        distance = np.linalg.norm(position - self._goal[:3])
        if distance > ARRIVAL_DISTANCE or angle_between(quaternion, self._goal[3:]) > ARRIVAL_ANGLE:
            self._near_since = math.nan
        elif math.isnan(self._near_since):
            self._near_since = at
        elif at - self._near_since >= ARRIVAL_TIME and math.isnan(record.arrived):
            record.arrived = self._near_since

    def _on_joints(self, message: JointState) -> None:
        at = self._since(message.header.stamp)
        if at >= 0.0:
            self.recording.joint_times.append(at)
            self.recording.joints.append(np.array(message.position))

    def _on_obstacle(self, message: PointStamped) -> None:
        at = self._since(message.header.stamp)
        if at >= 0.0:
            self.recording.obstacle_times.append(at)
            self.recording.obstacles.append(read_point(message, self._frame))

    def _on_status(self, message: DiagnosticArray) -> None:
        values = {pair.key: pair.value for pair in message.status[0].values}
        self._code, self.recording.newest = values["code"], message.status[0].message
        at = self._since(message.header.stamp)
        # The motion begins with the first plan: before, a tick has nothing to do, and would flatter the figures.
        if at >= 0.0 and (self.recording.ticks or self._code != "NO_GOAL"):
            last = float(values["last_tick_ms"]), float(values["last_tick_work_ms"])
            misses = int(values["deadline_misses"])
            self.recording.ticks.append(Tick(at, int(values["tick"]), *last, misses, self._code))

    def _on_clearance(self, message: Float64) -> None:
        if self._began < math.inf:
            self.recording.min_clearance = min(self.recording.min_clearance, message.data)

    def _on_contacts(self, message: UInt32) -> None:
        if self._began < math.inf:
            self.recording.contacts = message.data
            if message.data:
                self.recording.touched = min(self.recording.touched, self._now() - self._began)


@contextmanager
def _interrupts_deferred() -> Iterator[None]:
    """Let signals that end the demo wait: a process that has begun must be known to those who will end it."""
    heard: list[int] = []
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, lambda number, frame: heard.append(number)) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
        for number in heard:
            signal.raise_signal(number)


@contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """SIGTERM and SIGHUP end a program as Ctrl-C does, with its processes."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    numbers = (signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, interrupt) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


def isolated_environment(domain: int) -> dict[str, str]:
    """Environment in which nodes of one ROS domain hear each other on this machine and nobody else."""
    return os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
