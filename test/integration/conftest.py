"""Fixtures of the integration tests: a small skill on disk, a bench that spins the real nodes in its own context."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import Log
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes import marker_messages, messages
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.robot.inverse_kinematics import solve
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill

#: How long a condition may take to come true [s]: far more than it needs, so that a busy machine fails no test.
PATIENCE = 60.0
BASE = "panda_link0"


@pytest.fixture(scope="session")
def skill_folder(fan_skill: Skill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small skill, on disk."""
    return fan_skill.save(tmp_path_factory.mktemp("skills") / "fan")


@pytest.fixture(scope="session")
def table_skill_folder(fan_skill: Skill, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same skill, which says that it was recorded on the shipped table."""
    recorded = replace(fan_skill, scene=DeclaredScene.named("table").described)
    return recorded.save(tmp_path_factory.mktemp("skills") / "fan_on_a_table")


@pytest.fixture(scope="session")
def skill(skill_folder: Path) -> Skill:
    return Skill.load(skill_folder)


@pytest.fixture(scope="session")
def start_joints(skill: Skill) -> np.ndarray:
    """Joint positions (7,) [rad] at the skill's start."""
    return solve(Robot.named("panda"), skill.start_pose[:3], skill.start_pose[3:])


class Bench:
    """A ROS context, an executor in a thread, a probe node that talks and listens, and the nodes under test.

    Everything heard is kept in `heard[topic]`, newest last. `wait` waits for a condition, never for a time.
    """

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.probe = rclpy.create_node("probe", context=self.context)
        self.executor.add_node(self.probe)
        self.heard: dict[str, list[Any]] = {}
        self._changed = threading.Condition()
        self._error: Exception | None = None
        self._nodes: list[Any] = []
        self._processes: list[subprocess.Popen] = []
        self._publishers: dict[str, Any] = {}
        #: Where the arm is (7,) [rad], once its joint states are sent.
        self.arm: np.ndarray | None = None
        self._thread = threading.Thread(target=self._spin, name="bench")
        self._thread.start()

    def _spin(self) -> None:
        try:
            self.executor.spin()
        except ExternalShutdownException:
            return
        except Exception as error:  # raised in a callback: the waiting test gets it
            self._error = error
            self._notify()

    def add(self, kind: type, namespace: str = "", **parameters: Any) -> Any:
        """Create a node of this package with parameters, start it and spin it."""
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        node = kind(context=self.context, namespace=namespace, parameter_overrides=overrides)
        self._nodes.append(node)
        self.executor.add_node(node)
        node.start()
        return node

    def launch(self, module: str, *arguments: str, **parameters: Any) -> subprocess.Popen:
        """Run a node of this package as a process."""
        command = [sys.executable, "-m", f"geodesic_motion_ros.nodes.{module}", *arguments, "--ros-args"]
        for name, value in parameters.items():
            command += ["-p", f"{name}:={value}"]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self._processes.append(process)
        return process

    def listen(self, kind: type, topic: str, qos: QoSProfile | int = 10) -> None:
        self.heard[topic] = []
        self.probe.create_subscription(kind, topic, lambda message: self._hear(topic, message), qos)

    def _hear(self, topic: str, message: Any) -> None:
        with self._changed:
            self.heard[topic].append(message)
            self._changed.notify_all()

    def listen_to_log(self) -> None:
        """Hear what the nodes log, and what they have logged."""
        self.listen(Log, "/rosout", QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL))

    def logged(self, text: str) -> list[str]:
        """What was logged that holds a text."""
        return [entry.msg for entry in self.heard["/rosout"] if text in entry.msg]

    def wait(self, condition: Callable[[], Any], what: str) -> Any:
        """Wait until a condition on what was heard is true; returns its value."""
        with self._changed:
            value = self._changed.wait_for(lambda: self._error or condition(), PATIENCE)
        if self._error is not None:
            raise self._error
        assert value, f"waited {PATIENCE:g} s without success for: {what}; status: {self.status()}"
        return value

    def publisher(self, kind: type, topic: str) -> Any:
        """A publisher that has found at least one subscriber."""
        if topic not in self._publishers:
            self._publishers[topic] = self.probe.create_publisher(kind, topic, 10)
        publisher = self._publishers[topic]
        self.poll(lambda: publisher.get_subscription_count() > 0, f"a subscriber of {topic}")
        return publisher

    def call(self, kind: type, name: str, request: Any) -> Any:
        """Call a service and return the response."""
        client = self.probe.create_client(kind, name)
        assert client.wait_for_service(PATIENCE), f"no service {name}"
        future = client.call_async(request)
        future.add_done_callback(lambda _: self._notify())
        self.wait(future.done, f"an answer of {name}")
        self.probe.destroy_client(client)
        return future.result()

    def repeat(self, every: float, work: Callable[[], None]) -> Any:
        """Do something periodically in the executor; returns the timer."""
        return self.probe.create_timer(every, work)

    def _notify(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def poll(self, condition: Callable[[], bool], what: str) -> None:
        """`wait` for what nobody tells of, as the ROS graph and the time: it is looked at again and again."""
        timer = self.probe.create_timer(0.02, self._notify)
        self.wait(condition, what)
        self.probe.destroy_timer(timer)

    # ------------------------------------------------------------------ the planner

    def watch_planner(self) -> None:
        self.listen(DiagnosticArray, "planner/status")
        self.listen(PoseStamped, "target_pose", 100)

    def status(self) -> dict[str, str]:
        """The newest status of the planner, by key."""
        heard = self.heard.get("planner/status")
        return {pair.key: pair.value for pair in heard[-1].status[0].values} if heard else {}

    def wait_for_code(self, code: str, reason: str = "") -> dict[str, str]:
        """Wait until the planner's verdict is this one and its reason holds a text."""

        def found() -> bool:
            status = self.status()
            return status.get("code") == code and reason in status["reason"]

        self.wait(found, f"verdict {code} {reason}")
        return self.status()

    def at_rest(self) -> bool:
        return float(self.status()["speed"]) == 0.0

    def at_goal(self) -> bool:
        return self.at_rest() and float(self.status()["time_to_goal"]) < 0.01

    def health(self) -> dict[str, str]:
        """The newest figures among the diagnostics, by key; they are to be listened to."""
        heard = self.heard["/diagnostics"]
        return {pair.key: pair.value for pair in heard[-1].status[0].values} if heard else {}

    def send_goal(self, pose: np.ndarray, frame: str = BASE) -> None:
        """Publish a goal (7,): position [m], quaternion (w, x, y, z)."""
        self.publisher(PoseStamped, "goal_pose").publish(pose_of(pose, frame))

    def send_joint_states(
        self, positions: np.ndarray, names: Sequence[str] | None = None, follows: bool = True
    ) -> Any:
        """Publish an arm fifty times a second, which is at once where `target_posture` says; returns the timer.

        names : of joints of an arm that rests, whatever is commanded; so too where it does not follow.
        """
        publisher = self.publisher(JointState, "joint_states")
        self.arm = arm = np.array(positions)

        def send() -> None:
            stamp = self.probe.get_clock().now().to_msg()
            shown = names or Robot.named("panda").joint_names
            publisher.publish(messages.joint_state_message(shown, arm, np.zeros(len(arm)), stamp))

        def follow(message: JointState) -> None:
            arm[:] = message.position

        if follows and names is None:
            self.probe.create_subscription(JointState, "target_posture", follow, 10)
        return self.repeat(0.02, send)

    def send_spheres(self, *spheres: tuple[Sequence[float], float], frame: str = BASE, late: float = 0.0) -> None:
        """Publish obstacles (centre [m], radius [m]) once, as one MarkerArray, by its stamp so late [s]."""
        stamp = (self.probe.get_clock().now() - Duration(seconds=late)).to_msg()
        markers = [
            marker_messages.sphere_marker("test", number, np.array(centre), radius, (1.0, 0.0, 0.0, 1.0), frame, stamp)
            for number, (centre, radius) in enumerate(spheres)
        ]
        self.publisher(MarkerArray, "obstacles").publish(MarkerArray(markers=markers))

    def delete_spheres(self) -> None:
        marker = Marker(header=Header(frame_id=BASE), action=Marker.DELETEALL)
        self.publisher(MarkerArray, "obstacles").publish(MarkerArray(markers=[marker]))

    def close(self) -> None:
        for process in self._processes:
            if process.poll() is None:
                process.kill()
            process.communicate()
        for node in self._nodes:
            node.stop()
        self.executor.shutdown()
        self._thread.join()
        for node in (*self._nodes, self.probe):
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)


def cloud_of(points: np.ndarray) -> PointCloud2:
    fields = [PointField(name=name, offset=8 * i, datatype=PointField.FLOAT64, count=1) for i, name in enumerate("xyz")]
    return PointCloud2(
        header=Header(frame_id=BASE), height=1, width=len(points), point_step=24, row_step=24 * len(points),
        fields=fields, data=points.tobytes(),
    )  # fmt: skip


def pose_of(pose: np.ndarray, frame: str = BASE) -> PoseStamped:
    """A PoseStamped of (7,): position [m], quaternion (w, x, y, z)."""
    message = messages.pose_message(pose[:3], pose[3:], frame, Header().stamp)
    return message


@pytest.fixture
def make_cloud() -> Callable[[np.ndarray], PointCloud2]:
    """Makes a cloud of points (n, 3) [m] in the base frame."""
    return cloud_of


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def make_pose() -> Callable[..., PoseStamped]:
    return pose_of


@pytest.fixture
def planner_options(skill_folder: Path) -> dict[str, Any]:
    """Parameters for a planner of postures, on a machine that may be busy."""
    return {
        "skill": str(skill_folder),
        "output": "target_pose",
        # a small tool, which stands free where a whole hand would touch the scenes' obstacles
        "avoid": "tool",
        "tool_spheres": [0.0, 0.0, 0.0, 0.04],
        # The bench's arm is where it was sent a moment ago, which on a busy machine is far from where it is sent now;
        # tests of these tolerances set their own.
        "tracking_tolerance": 0.2,
        "tracking_tolerance_angle": 1.0,
        "tracking_tolerance_joint": 1.0,
        "latency": 0.1,
        "state_timeout": 2.0,
        "resume_timeout": 60.0,
        "obstacle_timeout": 3600.0,
        "latent_view_rate": 0.0,
    }


@pytest.fixture
def ready(bench: Bench, planner_options: dict[str, Any], start_joints: np.ndarray) -> Bench:
    """A bench with a planner that has joint states and no goal."""
    bench.watch_planner()
    bench.planner = bench.add(PlannerNode, **planner_options)
    bench.joint_states = bench.send_joint_states(start_joints)
    bench.wait_for_code("NO_GOAL")
    return bench


@pytest.fixture
def moving(ready: Bench, skill: Skill) -> Bench:
    """The same, moving to the skill's goal."""
    ready.send_goal(skill.goal_pose)
    ready.wait_for_code("OK")
    return ready


@pytest.fixture
def wall() -> tuple[list[float], float]:
    """The middle of every demonstration, and a radius [m] that blocks them all without touching the ends."""
    return [0.465, -0.01, 0.34], 0.2
