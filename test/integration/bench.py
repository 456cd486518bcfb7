"""A bench that spins the real nodes in a context of its own, and the clock that they live by.

The clock goes on a step at a time, and only while a test waits for something: the arm is where the test takes it to be,
however busy the machine is. A test that is marked `realtime` is of time itself: its nodes live by the machine's clock.
"""

from __future__ import annotations

import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import Log
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from rclpy.timer import Timer
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.nodes import marker_messages, messages
from geodesic_motion_ros.nodes.cycle_clock import LONGEST_ADVANCE
from geodesic_motion_ros.nodes.filter_node import FilterNode
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.running import STEADY, destroy_actions
from geodesic_motion_ros.nodes.twin_node import TwinNode
from geodesic_motion_ros.paper.paper_node import PaperNode
from geodesic_motion_ros.robot.kinematics import Robot

#: How long a condition may take to come true [s], by the machine's clock and by the nodes': far more than it needs, so
#: that a busy machine fails no test.
PATIENCE = 200.0
#: The nodes' clock goes on by so much at once [s]: as far as a command moves on in a cycle at most, for tests to last
#: half as long as the motions in them.
STEP = LONGEST_ADVANCE
#: By which message of a node it is seen up to when it has lived: one with a header, sent at least every STEP.
_STATUS = DiagnosticArray, "planner/status"
ANSWERS = {
    PlannerNode: _STATUS, PaperNode: _STATUS, TwinNode: (JointState, "joint_states"),
    FilterNode: (DiagnosticArray, "filter/status"),
}  # fmt: skip
BASE = "panda_link0"


class SteppedClock:
    """`/clock` of a simulation that goes on a step at a time, each after the nodes have lived up to the one before."""

    def __init__(self, probe: Node, changed: Callable[[], None]) -> None:
        """changed : called when a node has lived on."""
        # A time of today: what is rounded by large times is rounded here, too.
        self.nanoseconds = int(time.time()) * 10**9
        self.length = STEP
        self._probe, self._changed = probe, changed
        self._publisher = probe.create_publisher(Clock, "/clock", 10)
        # Up to when each node has lived [ns], by the topic on which it answers; and the bench, whose timers have run.
        self._lived = {"": self.nanoseconds}
        self._timer = self._timer_of_the_bench()

    def _timer_of_the_bench(self) -> Timer:
        """A timer that is called once a step. Of a busy executor it may be called several times at one time, and waits
        for as many of its periods: all of them together are far less than a step.
        """
        return self._probe.create_timer(1e-3 * STEP, self._live)

    def _live(self) -> None:
        self._lived[""] = self._probe.get_clock().now().nanoseconds
        self._changed()

    def show(self) -> None:
        self._publisher.publish(Clock(clock=Time(nanoseconds=self.nanoseconds).to_msg()))

    def step(self) -> None:
        self.nanoseconds += round(1e9 * self.length)
        self.show()

    def begin_anew(self) -> None:
        """See from now on up to when the bench has lived: a clock was set, and its timer waits for a time of before."""
        self._probe.destroy_timer(self._timer)
        self._timer = self._timer_of_the_bench()

    def follow(self, kind: type, topic: str) -> None:
        """Wait from now on for a node: by the stamps of these messages it is seen up to when it has lived."""
        self._lived[topic] = self.nanoseconds

        def hear(message: bytes) -> None:
            seconds, nanoseconds = struct.unpack_from("<iI", message, 4)
            if topic in self._lived:
                self._lived[topic] = seconds * 10**9 + nanoseconds
            self._changed()

        self._probe.create_subscription(kind, topic, hear, 10, raw=True)

    def leave(self, topic: str) -> None:
        """Wait no more for a node."""
        del self._lived[topic]

    def __str__(self) -> str:
        behind = {topic or "the bench": 1e-9 * (self.nanoseconds - until) for topic, until in self._lived.items()}
        return f"{1e-9 * self.nanoseconds:.2f} s, of which they lack {behind} s"

    @property
    def is_lived(self) -> bool:
        """Whether all nodes have lived up to now; their stamps may be off by a microsecond."""
        return all(abs(until - self.nanoseconds) < 1000 for until in tuple(self._lived.values()))


class Bench:
    """A ROS context, an executor in a thread, a probe node that talks and listens, and the nodes under test.

    Everything heard is kept in `heard[topic]`, newest last. `wait` waits for a condition, never for a time: the nodes'
    clock goes on while it does, and stands otherwise.

    realtime : the nodes live by the machine's clock, and `clock` is None.
    """

    def __init__(self, realtime: bool = False) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        # As the nodes run: callbacks in the order in which their messages came.
        self.executor = EventsExecutor(context=self.context)
        self._by_the_clock = {} if realtime else {"use_sim_time": True}
        self.probe = rclpy.create_node("probe", context=self.context, parameter_overrides=options(self._by_the_clock))
        self.executor.add_node(self.probe)
        self.heard: dict[str, list[Any]] = {}
        self._changed = threading.Condition()
        self.clock = None if realtime else SteppedClock(self.probe, self._notify)
        self._error: Exception | None = None
        self._nodes: list[Any] = []
        self._processes: list[subprocess.Popen] = []
        self._publishers: dict[str, Any] = {}
        #: Where the arm is (7,) [rad], once its joint states are sent.
        self.arm: np.ndarray | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin, name="bench")
        self._thread.start()

    def _spin(self) -> None:
        try:
            while not self._closing.is_set():
                self.executor.spin_once(timeout_sec=0.1)
        except ExternalShutdownException:
            return
        except Exception as error:  # raised in a callback: the waiting test gets it
            self._error = error
            self._notify()

    def add(self, kind: type, namespace: str = "", remapped: Mapping[str, str] | None = None, **parameters: Any) -> Any:
        """Create a node of this package with parameters, start it and spin it. remapped : names, and what they become.
        """
        overrides = options(self._by_the_clock | parameters)
        arguments = ["--ros-args"]
        for name, other in (remapped or {}).items():
            arguments += ["-r", f"{name}:={other}"]
        node = kind(context=self.context, namespace=namespace, parameter_overrides=overrides, cli_args=arguments)
        self._nodes.append(node)
        self.executor.add_node(node)
        if self.clock is not None:
            self._show(lambda: node.get_clock().now().nanoseconds == self.clock.nanoseconds)
            if kind in ANSWERS:
                message, topic = ANSWERS[kind]
                self.clock.follow(message, f"{node.get_namespace().rstrip('/')}/{topic}")
        node.start()
        return node

    def end(self, node: Any) -> None:
        """End a node and take it off; the clock waits for it no more."""
        if self.clock is not None:
            self.clock.leave(f"{node.get_namespace().rstrip('/')}/{ANSWERS[type(node)][1]}")
        node.stop()
        self._nodes.remove(node)
        self.executor.remove_node(node)
        node.destroy_node()

    def launch(self, module: str, *arguments: str, where: str = "nodes", **parameters: Any) -> subprocess.Popen:
        """Run a node of this package as a process."""
        command = [sys.executable, "-m", f"geodesic_motion_ros.{where}.{module}", *arguments, "--ros-args"]
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
        """Wait until a condition on what was heard is true, while the nodes' clock goes on; returns its value."""
        if self.clock is None:
            return self._stand(condition, what)
        begun, began = time.monotonic(), self.clock.nanoseconds
        while True:
            with self._changed:
                self._check()
                value = condition()
            if value:
                return value
            lived = 1e-9 * (self.clock.nanoseconds - began)
            passed = min(lived, time.monotonic() - begun)
            assert passed < PATIENCE, f"waited {lived:.0f} s without success for: {what}; status: {self.status()}"
            self.clock.step()
            self._live_up_to_now()

    def _live_up_to_now(self) -> None:
        """Wait until the nodes have lived up to now, which is shown again where that takes long: it may be lost."""
        began = time.monotonic()
        while time.monotonic() - began < PATIENCE:
            with self._changed:
                lived = self._changed.wait_for(lambda: self._error or self.clock.is_lived, 1.0)
            self._check()
            if lived:
                return
            self.clock.show()
        raise AssertionError(f"waited {PATIENCE:g} s without success for nodes to live up to now: {self.clock}")

    def _show(self, seen: Callable[[], bool]) -> None:
        """Show the nodes' clock until it is seen."""
        timer = self.probe.create_timer(0.02, self.clock.show, clock=STEADY)
        self.poll(seen, "a node that knows the time")
        self.probe.destroy_timer(timer)

    def set_clock(self, seconds: float) -> None:
        """Set the nodes' clock [s], as a simulator does. Timers of before go on when their time comes again."""
        self.clock.nanoseconds = set_to = round(1e9 * seconds)
        self._show(lambda: self.probe.get_clock().now().nanoseconds == set_to)
        self.clock.begin_anew()

    def now(self) -> float:
        """The time [s] of the nodes' clock."""
        return 1e-9 * self.probe.get_clock().now().nanoseconds

    def live(self, duration: float) -> None:
        """Have the nodes live for so long [s], by their clock."""
        until = self.now() + duration
        self.wait(lambda: self.now() >= until, f"{duration:g} s to pass")

    def _stand(self, condition: Callable[[], Any], what: str) -> Any:
        """Wait while the nodes' clock stands."""
        with self._changed:
            value = self._changed.wait_for(lambda: self._error or condition(), PATIENCE)
        self._check()
        assert value, f"waited {PATIENCE:g} s without success for: {what}; status: {self.status()}"
        return value

    def _check(self) -> None:
        if self._error is not None:
            raise self._error

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
        self._stand(future.done, f"an answer of {name}")
        self.probe.destroy_client(client)
        return future.result()

    def during(self, work: Callable[[], Any]) -> Any:
        """Do what waits for the nodes by itself, while their clock goes on; returns its result."""
        future: Future[Any] = Future()

        def run() -> None:
            try:
                future.set_result(work())
            except BaseException as error:
                future.set_exception(error)

        future.add_done_callback(lambda _: self._notify())
        # A daemon: work that never ends fails its test, and holds up no other.
        threading.Thread(target=run, name="work", daemon=True).start()
        self.wait(future.done, "the end of what waits for the nodes")
        return future.result()

    def repeat(self, every: float, work: Callable[[], None]) -> Any:
        """Do something periodically in the executor; returns the timer."""
        return self.probe.create_timer(every, work)

    def _notify(self) -> None:
        with self._changed:
            self._changed.notify_all()

    def poll(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for what nobody tells of, as the ROS graph and the machine's time, while the nodes' clock stands."""
        timer = self.probe.create_timer(0.02, self._notify, clock=STEADY)
        self._stand(condition, what)
        self.probe.destroy_timer(timer)

    # ------------------------------------------------------------------ the planner

    def watch_planner(self) -> None:
        self.listen(DiagnosticArray, "planner/status")
        self.listen(PoseStamped, "target_pose", 100)

    def status(self) -> dict[str, str]:
        """The newest status of the planner, by key."""
        heard = self.heard.get("planner/status")
        return {pair.key: pair.value for pair in heard[-1].status[0].values} if heard else {}

    def commanded(self) -> PoseStamped:
        """The pose that was commanded in the cycle of the newest status."""
        stamp = self.heard["planner/status"][-1].header.stamp
        found = lambda: [pose for pose in self.heard["target_pose"] if pose.header.stamp == stamp]  # noqa: E731
        return self._stand(found, "the target pose of the newest status")[-1]

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
        self._closing.set()
        self._thread.join()
        self.executor.shutdown()
        destroy_actions(self.probe)
        for node in (*self._nodes, self.probe):
            node.destroy_node()
        rclpy.try_shutdown(context=self.context)


def options(values: Mapping[str, Any]) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


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
