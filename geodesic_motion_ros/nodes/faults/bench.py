"""The bench: planner and twin as two processes over DDS, relays between them, and everything recorded that they say."""

from __future__ import annotations

import gc
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np
import rclpy
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped, PoseStamped
from nav_msgs.msg import Path
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, UInt32
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from geodesic_motion_ros.errors import GeodesicMotionError
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.nodes.demo_run import Processes, isolated_environment
from geodesic_motion_ros.nodes.faults.bench_clock import BenchClock
from geodesic_motion_ros.nodes.faults.command_ear import Command, CommandEar, steady_time
from geodesic_motion_ros.nodes.faults.fault import GOAL, MOTION, START, Findings
from geodesic_motion_ros.nodes.faults.judge import Target, TargetJudge, Trajectory, TrajectoryJudge
from geodesic_motion_ros.nodes.faults.relay import Relay
from geodesic_motion_ros.nodes.messages import (
    MarkerScene,
    MessageRefused,
    pose_message,
    read_joint_trajectory,
    read_pose,
    seconds,
    sphere_marker,
)
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.running import go_first
from geodesic_motion_ros.nodes.twin_node import start_joints
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill

#: Longest time [s] to wait for nodes that start, and for an arm that moves.
START_PATIENCE, PATIENCE = 60.0, 25.0
#: Topics between twin and planner that a relay stands in.
RELAYED = {"joint_states": JointState, "obstacles": MarkerArray, "obstacle_point": PointStamped}
#: What the planner says when commands begin anew at where the arm is.
_LOST = "nothing is commanded until"
#: A status that explains a command is heard this long [s] after it at most.
_TOLD_AFTER = 0.1
#: An arm whose joints stay within this [rad] for this long [s] rests.
_REST, _REST_TIME = 1e-3, 0.15
_DEFAULTS = {parameter.name: parameter.default for parameter in PLANNER}
_PLANNER = {"latent_view_rate": 0.0}
#: Times a second that the planner alone is told of spheres; centre [m] and radius [m] of one.
OBSTACLES_HZ = 30.0
Sphere = tuple[np.ndarray, float]
_GREY = (0.5, 0.5, 0.5, 1.0)


class NotSeenError(GeodesicMotionError):
    """What was waited for has not happened."""


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

    def number(self, key: str) -> float:
        return float(self.values[key])


class Bench:
    """Runs the two nodes of a skill, talks to them and records them; all of it in the caller's thread.

    Attributes
    ----------
    relays : by topic. clock : that the nodes run by where a fault wants one.
    statuses, health : of the planner, since the present run began. joints : (steady time [s], configuration) likewise.
    least_clearance [m], contacts : the twin's, likewise.
    """

    def __init__(self, skill: str, folder: FilePath, domain: int, planner_on: Sequence[str] = ()) -> None:
        """skill : a folder, or the name of a shipped skill. folder : for parameter files and logs of the nodes.
        planner_on : a command that runs the planner on another host; none: it runs on this one.
        """
        self.skill_name, self.skill = skill, Skill.load(skill)
        self.robot = Robot.named(self.skill.robot)
        self.goal = self.skill.goal_pose
        self.domain = domain
        self.environment = isolated_environment(domain)
        if planner_on:
            self.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SUBNET"
        self.folder = folder
        self.processes = Processes(folder, self.environment)
        self._planner_on = planner_on
        self._given: dict[str, dict[str, Any]] = {}
        self._context = rclpy.Context()
        # Read when the context begins, of this process too.
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = self.environment["ROS_AUTOMATIC_DISCOVERY_RANGE"]
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("bench", context=self._context)
        self._executor = EventsExecutor(context=self._context)
        # Messages that it passes on must not wait for whatever else keeps the cores busy.
        go_first()
        self._executor.add_node(self.node)
        self.clock = BenchClock(self.node)
        self.relays = {topic: Relay(self.node, kind, topic, f"relayed/{topic}") for topic, kind in RELAYED.items()}
        self._goals = self.node.create_publisher(PoseStamped, "goal_pose", QoSProfile(depth=10))
        self._publishers: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        self.command_topic = "joint_trajectory" if self.skill.space == "joint" else "target_pose"
        self.command_kind = JointTrajectory if self.skill.space == "joint" else PoseStamped
        self._ear = CommandEar(self._context, self.command_kind, self.command_topic)
        self._judge = self._make_judge()
        self._scene_shown = False
        self._last_contacts = 0
        self.spheres: list[Sphere] = []
        self._shown_spheres = MarkerScene(self.skill.base_frame)
        self.node.create_timer(1.0 / OBSTACLES_HZ, self._tell_spheres)
        self.path = np.zeros((0, 3))
        self.statuses: list[Status] = []
        self.joints: list[tuple[float, np.ndarray]] = []
        self._forget_run()
        self._listen(DiagnosticArray, "planner/status", self._on_status)
        self._listen(DiagnosticArray, "/diagnostics", self._on_health)
        self._listen(JointState, "joint_states", self._on_joints)
        self._listen(Path, "path", self._on_path)
        self._listen(Float64, "twin/clearance", self._on_clearance)
        self._listen(UInt32, "twin/contacts", self._on_contacts)
        # Nor for a collection of all libraries' objects.
        gc.collect()
        gc.freeze()

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *_: object) -> None:
        self.processes.__exit__()
        self._ear.close()
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _make_judge(self) -> TrajectoryJudge | TargetJudge:
        if self.skill.space != "joint":
            return TargetJudge()
        scales = _DEFAULTS["speed_scale"], _DEFAULTS["acceleration_scale"]
        return TrajectoryJudge(JointLimits.of(self.robot, *scales))

    def _listen(self, kind: type, topic: str, take: Callable[[Any], None]) -> None:
        self.node.create_subscription(kind, topic, take, QoSProfile(depth=100))

    # ------------------------------------------------------------------ nodes

    def start(self, name: str, parameters: Mapping[str, Any]) -> None:
        """Start `planner` or `twin`; its parameters are those of the bench and these."""
        given = {"skill": self.skill_name, **parameters}
        if name == "planner":
            remapped = {topic: f"relayed/{topic}" for topic in RELAYED}
            self.processes.start(name, _PLANNER | given, remapped, self._planner_on)
        else:
            self.processes.start(name, given)
        self._given[name] = dict(parameters)

    def prepare(self, planner: Mapping[str, Any], twin: Mapping[str, Any], fresh: bool = False) -> None:
        """Bring both nodes to where the arm stands at its start without a goal, nothing disturbed."""
        sim = bool(planner.get("use_sim_time"))
        wanted = {"planner": dict(planner), "twin": dict(twin) | ({"use_sim_time": True} if sim else {})}
        if fresh or self._given != wanted or not self._renewed():
            self.stop_nodes()
            self.clock.run(sim)
            self.statuses, self.joints = [], []
            for name in ("twin", "planner"):
                self.start(name, wanted[name])
            self._wait_for_nodes()
        self._forget_run()
        self._judge = self._make_judge()
        self.spend(0.05)

    def stop_nodes(self) -> None:
        """End what runs, in order; relays pass everything on again."""
        self.processes.__exit__()
        self._given.clear()
        self._scene_shown = False
        self._last_contacts = 0
        self.spheres = []
        self._shown_spheres = MarkerScene(self.skill.base_frame)
        for relay in self.relays.values():
            relay.release()

    def restart(self, name: str) -> None:
        """Start a node again as it was started last."""
        self.start(name, self._given[name])

    def attempt(self, parameters: Mapping[str, Any]) -> tuple[int, str]:
        """Start another planner, which is to refuse its parameters: its exit code and what it says."""
        with Processes(self.folder / "refused", self.environment) as processes:
            processes.start("planner", _PLANNER | {"skill": self.skill_name, **parameters})
            began = time.monotonic()
            self.wait(
                lambda: processes.exit_code("planner") is not None or time.monotonic() > began + START_PATIENCE,
                "a refusal", 2.0 * START_PATIENCE,
            )  # fmt: skip
            code = processes.exit_code("planner")
            return (0 if code is None else code), processes.log("planner")

    def _wait_for_nodes(self) -> None:
        def ready() -> bool:
            listened = self._goals.get_subscription_count() and all(relay.listeners for relay in self.relays.values())
            return bool(listened) and self.status is not None and self.status.code == "NO_GOAL"

        self.wait(ready, "planner and twin to start", START_PATIENCE)

    def _renewed(self) -> bool:
        """Bring nodes that run back to the beginning; False where they do not follow."""
        for relay in self.relays.values():
            relay.release()
        try:
            self.tell_spheres([])
            self.hold(False)
            self.show_scene({})
            self.trigger("planner/clear_obstacles")
            self.trigger("twin/reset")
            since = time.monotonic()
            self.verdict("NO_GOAL", since=since + 0.3, patience=5.0)
        except GeodesicMotionError:
            return False
        return bool(np.max(np.abs(self.configuration - start_joints(self.skill_name))) < 0.02)

    # ------------------------------------------------------------------ phases

    def reach(self, phase: str, random: np.random.Generator) -> None:
        """Let the arm reach a phase; when exactly is up to chance."""
        if phase == START:
            return
        self.send_goal()
        whole = self.verdict("OK").number("time_to_goal")
        left = {MOTION: random.uniform(0.4, 0.7) * whole, GOAL: random.uniform(0.3, 0.8)}[phase]
        self.wait(lambda: self.status.code == "OK" and self.status.number("time_to_goal") < left, f"the phase {phase}")

    def finish(self, findings: Findings) -> None:
        """Motion resumes after a fault has cleared: the arm reaches its goal, which is sent again where it was
        dropped or never given."""
        since = time.monotonic()
        self.wait(lambda: self.status.sent > since + 0.7, "the planner to settle")
        if self.status.code == "NO_GOAL":
            self.send_goal()
        began = time.monotonic()
        try:
            self.arrive()
        except NotSeenError:
            findings.require(False, f"the goal is not reached afterwards: {self.status.code}: {self.status.reason}")
            return
        findings.note(f"goal reached {time.monotonic() - began:.1f} s after")

    def arrive(self, patience: float = PATIENCE) -> None:
        """Wait until the arm rests at its goal."""
        self.wait(
            lambda: self.status.code == "OK" and self.status.number("time_to_goal") == 0.0 and self.rests,
            "arrival at the goal", patience,
        )  # fmt: skip

    # ------------------------------------------------------------------ talking

    def send_goal(self, pose: np.ndarray | None = None, frame: str | None = None) -> None:
        """Ask for a goal; as of `goal_message`."""
        self._goals.publish(self.goal_message(pose, frame))

    def goal_message(self, pose: np.ndarray | None = None, frame: str | None = None) -> PoseStamped:
        """A tool pose (7,) in a frame: position [m], quaternion (w, x, y, z); the skill's goal and frame without."""
        pose = self.goal if pose is None else pose
        stamp = self.node.get_clock().now().to_msg()
        return pose_message(pose[:3], pose[3:], frame or self.skill.base_frame, stamp)

    def publish(self, topic: str, message: Any) -> None:
        """Say something on a topic of the planner, as soon as it listens."""
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(type(message), topic, QoSProfile(depth=10))
        publisher = self._publishers[topic]
        self.wait(publisher.get_subscription_count, f"a subscriber of {topic}")
        publisher.publish(message)

    def call(self, kind: type, name: str, request: Any) -> Any:
        """Call a service and return its response."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, name)
        client = self._clients[name]
        self.wait(client.service_is_ready, f"the service {name}")
        future = client.call_async(request)
        self.wait(future.done, f"an answer of {name}", 5.0)
        return future.result()

    def trigger(self, name: str) -> str:
        """Call a service without arguments; NotSeenError where it refuses."""
        response = self.call(Trigger, name, Trigger.Request())
        if not response.success:
            raise NotSeenError(f"{name}: {response.message}")
        return response.message

    def memory(self, name: str) -> float:
        """What a node occupies in memory, MB."""
        status = FilePath(f"/proc/{self.processes.number(name)}/status").read_text()
        return int(next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]) / 1024.0

    def hold(self, hold: bool) -> None:
        """Ask the planner to hold, or release it."""
        self.call(SetBool, "planner/hold", SetBool.Request(data=hold))

    def set_parameters(self, name: str, **values: Any) -> SetParametersResult:
        """Change parameters of a node, all or nothing."""
        request = SetParametersAtomically.Request()
        request.parameters = [Parameter(key, value=value).to_parameter_msg() for key, value in values.items()]
        return self.call(SetParametersAtomically, f"{name}/set_parameters_atomically", request).result

    def parameter(self, name: str, key: str) -> Any:
        """The present value of a node's parameter."""
        response = self.call(GetParameters, f"{name}/get_parameters", GetParameters.Request(names=[key]))
        return parameter_value_to_python(response.values[0])

    def show_scene(self, scene: Mapping[str, Mapping[str, Any]]) -> None:
        """Put obstacles into the twin's world, in the place of those before; as of `simulation/scenes.py`."""
        if not scene and not self._scene_shown:
            return
        result = self.set_parameters("twin", scene=yaml.safe_dump(dict(scene)) if scene else "")
        if not result.successful:
            raise NotSeenError(f"the twin refuses a scene: {result.reason}")
        self.trigger("twin/spawn_obstacles")
        self._scene_shown = bool(scene)

    def tell_spheres(self, spheres: Sequence[Sphere]) -> float:
        """Tell the planner, and not the twin, of spheres from now on, in the place of those before; the time [s]."""
        self.spheres = list(spheres)
        now = time.monotonic()
        self._tell_spheres()
        return now

    def _tell_spheres(self) -> None:
        stamp, frame = self.node.get_clock().now().to_msg(), self.skill.base_frame
        markers = [
            sphere_marker("bench", number, *sphere, _GREY, frame, stamp) for number, sphere in enumerate(self.spheres)
        ]
        update = self._shown_spheres.update(markers, stamp)
        if update.markers:
            self.relays["obstacles"].send(update)

    # ------------------------------------------------------------------ waiting

    def wait(self, condition: Callable[[], Any], what: str, patience: float = PATIENCE) -> float:
        """Wait until a condition is true; the time that took [s]. NotSeenError after too long."""
        began = time.monotonic()
        while not condition():
            self._executor.spin_once(timeout_sec=0.02)
            self.processes.check()
            if time.monotonic() - began > patience:
                said = "nothing" if self.status is None else f"{self.status.code}: {self.status.reason}"
                raise NotSeenError(f"waited {patience:g} s in vain for {what}; the planner says {said}")
        return time.monotonic() - began

    def spend(self, duration: float) -> None:
        """Go on for so long [s]."""
        end = time.monotonic() + duration
        self.wait(lambda: time.monotonic() >= end, "time to pass", duration + PATIENCE)

    def verdict(
        self, code: str, text: str = "", since: float | None = None, patience: float = PATIENCE, of: str = ""
    ) -> Status:
        """The first status after `since` [s, steady clock] with a code, and a text in its reason; of "goal_": what is
        said of the newest goal.
        """
        since = time.monotonic() if since is None else since
        found: list[Status] = []

        def seen() -> bool:
            for status in reversed(self.statuses):
                if status.sent <= since:
                    break
                if status.values[f"{of}code"] == code and text in status.values[f"{of}reason"]:
                    found[:] = [status]
            return bool(found)

        self.wait(seen, f"{code} {text}".strip(), patience)
        return found[0]

    @property
    def status(self) -> Status | None:
        """The planner's newest."""
        return self.statuses[-1] if self.statuses else None

    @property
    def configuration(self) -> np.ndarray:
        """Where the arm is, (eta,) [rad]."""
        return self.joints[-1][1]

    @property
    def tool(self) -> np.ndarray:
        """Where the tool is, (3,) [m]."""
        return self.robot.forward(self.configuration)[0]

    def ahead(self, distance: float) -> np.ndarray:
        """The place (3,) [m] on the tool's way so far [m] ahead of it, or where the way ends."""
        passed = int(np.argmin(np.linalg.norm(self.path - self.tool, axis=1)))
        gone = np.cumsum(np.linalg.norm(np.diff(self.path[passed:], axis=0), axis=1))
        return self.path[passed + min(int(np.searchsorted(gone, distance)), len(gone))]

    def ticks_until(self, since: float, condition: Callable[[Status], object], what: str) -> tuple[int, Status]:
        """Ticks of the planner from `since` [s, steady clock] to the first status that fulfils a condition."""
        before = [status for status in self.statuses if status.sent <= since][-1]
        found: list[Status] = []

        def seen() -> bool:
            found[:] = [status for status in self.statuses if status.sent > since and condition(status)][:1]
            return bool(found)

        self.wait(seen, what)
        return int(found[0].number("tick") - before.number("tick")), found[0]

    @property
    def rests(self) -> bool:
        """Whether the arm has not moved for a moment."""
        newest, last = self.joints[-1]
        for arrived, configuration in reversed(self.joints):
            if np.max(np.abs(configuration - last)) > _REST:
                return False
            if newest - arrived >= _REST_TIME:
                return True
        return False

    # ------------------------------------------------------------------ judging

    def judge(self, findings: Findings) -> None:
        """Judge every command of the run so far; what is judged is forgotten."""
        wrong: list[str] = []
        before = -math.inf
        for command in self._ear.take():
            restarted = self._begins_anew(before, command.sent)
            for sentence in self._judged(command, restarted):
                wrong.append(f"command {self._judge.count} at {command.sent - self._began:.2f} s {sentence}")
            before = command.sent
        for sentence in wrong[:3]:
            findings.require(False, sentence)
        findings.require(len(wrong) <= 3, f"and {len(wrong) - 3} more")
        findings.note(f"{self._judge.count} commands, largest step {self._judge.largest_step:.2g} rad")

    def begin_anew(self) -> None:
        """The next command is the first of a planner that has just begun."""
        self._anew.append(time.monotonic())

    def _begins_anew(self, before: float, sent: float) -> bool:
        if before == -math.inf or any(before < moment <= sent for moment in self._anew):
            return True
        return any(
            before - _TOLD_AFTER < status.sent < sent + _TOLD_AFTER and _LOST in status.reason
            for status in self.statuses
        )

    def _judged(self, command: Command, restarted: bool) -> list[str]:
        measured = self._measured_at(command.sent) if restarted else None
        message = deserialize_message(command.message, self.command_kind)
        sent = self.clock.at(command.sent)
        try:
            if isinstance(self._judge, TrajectoryJudge):
                waypoints = read_joint_trajectory(message, self.robot)
                return self._judge.hear(Trajectory(sent, seconds(message.header.stamp), waypoints), measured)
            pose = read_pose(message, self.skill.base_frame)
        except MessageRefused as error:
            return [str(error)]
        place = None if measured is None else self.robot.forward(measured)
        return self._judge.hear(Target(sent, seconds(message.header.stamp), *pose), place)

    def _measured_at(self, moment: float) -> np.ndarray | None:
        before = [configuration for arrived, configuration in self.joints if arrived <= moment]
        return before[-1] if before else None

    # ------------------------------------------------------------------ recording

    def _forget_run(self) -> None:
        self.statuses, self.joints = self.statuses[-1:], self.joints[-1:]
        self._ear.take()
        self.health: list[str] = []
        self._anew: list[float] = []
        self._began = time.monotonic()
        self.least_clearance, self.contacts = math.inf, 0

    def _on_status(self, message: DiagnosticArray) -> None:
        now = time.monotonic()
        # Its stamp is of the clock that the nodes run by.
        sent = now if self.clock.simulated else min(now, steady_time(seconds(message.header.stamp)))
        self.statuses.append(Status(sent, {pair.key: pair.value for pair in message.status[0].values}))

    def _on_health(self, message: DiagnosticArray) -> None:
        self.health.append(message.status[0].message)

    def _on_joints(self, message: JointState) -> None:
        self.joints.append((time.monotonic(), np.array(message.position)))

    def _on_path(self, message: Path) -> None:
        points = [pose.pose.position for pose in message.poses]
        self.path = np.array([(point.x, point.y, point.z) for point in points]).reshape(-1, 3)

    def _on_clearance(self, message: Float64) -> None:
        self.least_clearance = min(self.least_clearance, message.data)

    def _on_contacts(self, message: UInt32) -> None:
        # They count from zero again when a scene begins.
        self.contacts += message.data - (self._last_contacts if message.data >= self._last_contacts else 0)
        self._last_contacts = message.data
