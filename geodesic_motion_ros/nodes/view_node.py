"""Node `view`: a page in the browser that shows a planner and its arm; with `control` it commands both.

It is no part of what plans: it runs beside it, reads the newest messages twenty times a second, and no others.
"""

from __future__ import annotations

import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image, JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.nodes.goal_sender import Goal, PoseGoal, goal_of_skill
from geodesic_motion_ros.nodes.marker_bytes import SeenMarker, parse_markers
from geodesic_motion_ros.nodes.marker_messages import deletion_marker, sphere_marker
from geodesic_motion_ros.nodes.messages import seconds
from geodesic_motion_ros.nodes.parameter_tables import VIEW
from geodesic_motion_ros.nodes.parameters import NodeParameters, Value
from geodesic_motion_ros.nodes.publishers import LATCHED
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.running import STEADY, LoopingNode, run_node
from geodesic_motion_ros.nodes.usage import PROGRAMS
from geodesic_motion_ros.nodes.view_thread import ViewThread
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.view.shape import Shape
from geodesic_motion_ros.view.words import SILENT, StatusReader

#: Pictures a second; a status is read so often [s], and is of the past after so long [s].
_FRAMES, _READ, _SILENCE = 20.0, 0.2, 2.0
#: Which of `~/markers` are shown, and as what.
_KINDS = {
    Marker.SPHERE: "sphere", Marker.CUBE: "box", Marker.CYLINDER: "cylinder", Marker.LINE_STRIP: "line",
    Marker.CUBE_LIST: "boxes",
}  # fmt: skip
_NAMESPACE, _COLOUR = "view", (0.87, 0.26, 0.21, 0.9)
#: Until a motion is repeated [s]: at the goal, and after a goal was sent.
_AT_GOAL, _SENT = 1.5, 2.0
_NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class ViewNode(LoopingNode):
    """A node that shows, and where its parameter `control` says so, commands.

    Attributes
    ----------
    page : what is in the browser.

    Raises
    ------
    ParameterError, SkillError : a parameter, or the skill, cannot be used. GeodesicMotionError : viser is not
        installed.
    """

    # What is dragged is published again and again, on a machine whose browser may keep all cores busy; but the planner
    # and the arm go first.
    niceness = -5

    def __init__(self, **node_options: Any) -> None:
        super().__init__("view", **node_options)

    def _build(self) -> None:
        # Its library is an extra.
        from geodesic_motion_ros.view.page import Page

        values = self._options = NodeParameters(self, VIEW, _check_view)
        self._planner = values["planner"]
        self._goal: Goal | None = None
        if values["control"] and values["skill"]:
            self._goal = goal_of_skill(Skill.load(values["skill"]), values["joint_prefix"])
        place = Pose(self._goal.pose[:3], self._goal.pose[3:]) if isinstance(self._goal, PoseGoal) else None
        self._repeats = values["repeat"]
        self.page = Page(
            values["host"], values["port"], self.get_namespace().strip("/") or "geodesic motion", values["control"],
            place, self._repeats,
        )  # fmt: skip
        self._commanding, self._ended = threading.Lock(), False
        self._frame, self._status, self._reader = "", SILENT, StatusReader()
        self._urdf = ""
        self._heard = self._read = self._arrived = self._sent = -np.inf
        self._refusals = RefusalLog(self.get_logger().warning)
        self._inbox: dict[type, deque[bytes]] = {}
        # As bytes: of most messages no object is ever made.
        for kind, topic, qos, kept in (
            (String, "robot_description", LATCHED, 1),
            (JointState, "joint_states", _NEWEST, 10),  # joints may come in several messages
            (MarkerArray, f"{self._planner}/markers", QoSProfile(depth=10), 50),  # each changes what was shown before
            (DiagnosticArray, f"{self._planner}/status", _NEWEST, 1),
            (Image, f"{self._planner}/latent_view", LATCHED, 1),
        ):
            self._inbox[kind] = deque(maxlen=kept)
            self.create_subscription(kind, topic, self._keeping(kind), qos, raw=True)
        if values["control"]:
            self._make_commands()
        self._thread = ViewThread(self._draw, lambda: True, 1.0 / _FRAMES, self._died, "page")

    def _keeping(self, kind: type) -> Callable[[bytes], None]:
        def keep(message: bytes) -> None:
            self._inbox[kind].append(message)

        return keep

    def _make_commands(self) -> None:
        self._obstacles = self.create_publisher(MarkerArray, "obstacles", QoSProfile(depth=1))
        if self._goal is not None:
            self._goals = self.create_publisher(self._goal.kind, self._goal.topic, QoSProfile(depth=1))
        self._hold = self.create_client(SetBool, f"{self._planner}/hold")
        self._parameters = self.create_client(SetParameters, f"{self._planner}/set_parameters")
        self._reset = self.create_client(Trigger, "twin/reset")
        # Beside the page's thread, which takes seconds to draw an arm anew: obstacles must not fall silent.
        self.create_timer(1.0 / _FRAMES, self._command, clock=STEADY)

    def _introduction(self) -> str:
        does = "shows and commands" if self._options["control"] else "shows"
        return f"ready: open {self.page.address} in a browser; it {does} {self.resolve_topic_name(self._planner)}"

    def start(self) -> None:
        """Begin to show."""
        self._thread.start()

    def stop(self) -> None:
        """End the page; what was dragged is an obstacle no longer. Harmless when done before."""
        self._thread.stop()
        # The executor may still run: nothing that it publishes comes after the deletion.
        with self._commanding:
            if self._options["control"] and self._frame and not self._ended:
                self._publish_spheres([], [number for number, *_ in self.page.spheres])
            self._ended = True
        self.page.stop()

    # ------------------------------------------------------------------ the page's thread

    def _draw(self) -> None:
        with self._refusals.guard("the page"):
            now = time.monotonic()
            with self.page.updating():
                self._show(now)

    def _show(self, now: float) -> None:
        if now - self._read >= _READ:
            self._read = now
            self._show_status(now)
        inbox = self._inbox[MarkerArray]
        while inbox:
            self._show_markers(parse_markers(inbox.popleft()))
        for message in self._taken(String):
            self._urdf = message.data
            self._draw_arm()
        positions: dict[str, float] = {}
        for message in self._taken(JointState):
            positions.update(zip(message.name, message.position, strict=False))
        self.page.place_arm(positions)
        for message in self._taken(Image):
            self.page.show_latent(np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, 3))

    def _taken(self, kind: type) -> Iterable[Any]:
        """The messages of a kind that have come since the last picture."""
        inbox = self._inbox[kind]
        while inbox:
            yield deserialize_message(inbox.popleft(), kind)

    def _show_status(self, now: float) -> None:
        for message in self._taken(DiagnosticArray):
            values = {pair.key: pair.value for pair in message.status[0].values}
            self._heard = now
            self._status = self._reader.read(seconds(message.header.stamp), message.status[0].message, values)
        if now - self._heard > _SILENCE:
            self._status = SILENT
        self.page.show_status(self._status)

    def _show_markers(self, markers: Sequence[SeenMarker]) -> None:
        if markers and markers[0].header.frame_id != self._frame:
            self._frame = markers[0].header.frame_id
            self._draw_arm()
        self.page.shapes.remove((marker.ns, marker.id) for marker in markers if marker.action == Marker.DELETE)
        self.page.shapes.put(shapes_of(markers))

    def _draw_arm(self) -> None:
        """Draw the arm once its URDF and the frame of all that is shown are known."""
        if self._urdf and self._frame:
            for missing in self.page.draw_arm(self._urdf, self._frame):
                self.get_logger().warning(f"not drawn: {missing}")

    # ------------------------------------------------------------------ the executor's thread, with control

    def _command(self) -> None:
        with self._commanding:
            if not self._ended:
                self._serve()

    def _serve(self) -> None:
        now = time.monotonic()
        if self._frame:
            self._publish_spheres(self.page.spheres, self.page.take_removed())
        serve: Mapping[str, Callable[[Any], None]] = {
            "go": lambda _: self._send_goal(now),
            "reset": lambda _: self._call(self._reset, Trigger.Request()),
            "hold": lambda hold: self._call(self._hold, SetBool.Request(data=hold)),
            "speed": lambda share: self._call(self._parameters, speed_request(share)),
            "repeat": lambda repeats: setattr(self, "_repeats", repeats),
        }
        for name, value in self.page.take_requests().items():
            serve[name](value)
        if self._repeats:
            self._repeat(now)

    def _publish_spheres(self, spheres: Iterable[tuple[int, np.ndarray, float]], removed: Iterable[int]) -> None:
        stamp = self.get_clock().now().to_msg()
        markers = [
            *(sphere_marker(_NAMESPACE, *sphere, _COLOUR, self._frame, stamp) for sphere in spheres),
            *(deletion_marker(_NAMESPACE, number, self._frame, stamp) for number in removed),
        ]
        if markers:
            self._obstacles.publish(MarkerArray(markers=markers))

    def _send_goal(self, now: float) -> None:
        goal, place = self._goal, self.page.goal
        if goal is None:
            self.page.show_answer("no goal: start the page with the skill of the planner")
            return
        if place is not None:
            goal = PoseGoal(np.concatenate([place.position, place.quaternion]), self._frame)
        self._goals.publish(goal.message(self.get_clock().now().to_msg()))
        self._sent = now

    def _call(self, client: Any, request: Any) -> None:
        """Call a service, and show what it answers."""
        if not client.service_is_ready():
            self.page.show_answer(f"nobody offers {client.srv_name}")
            return
        client.call_async(request).add_done_callback(lambda done: self.page.show_answer(answer_of(done.result())))

    def _repeat(self, now: float) -> None:
        """Send the goal where there is none; have the twin begin again once the arm has been there for a while."""
        if not self._status.has_arrived:
            self._arrived = now
        if self._status.code == "NO_GOAL" and now - self._sent > _SENT:
            self._send_goal(now)
        elif now - self._arrived > _AT_GOAL and now - self._sent > _SENT:
            self._sent = now
            self._call(self._reset, Trigger.Request())


def shapes_of(markers: Iterable[SeenMarker]) -> list[Shape]:
    """Return the shapes of markers that are added."""
    shapes = []
    for marker in markers:
        if marker.action == Marker.ADD and marker.type in _KINDS:
            turn = marker.pose.orientation
            pose = tuple(marker.pose.position), (turn.w, turn.x, turn.y, turn.z)
            look = tuple(marker.scale), tuple(marker.color), marker.points
            shapes.append(Shape(marker.ns, marker.id, _KINDS[marker.type], *pose, *look))
    return shapes


def speed_request(share: float) -> SetParameters.Request:
    """Return the request to move at a share of the speed, 0 to 1."""
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(share))
    return SetParameters.Request(parameters=[ParameterMessage(name="speed_override", value=value)])


def answer_of(response: Any) -> str:
    """Return what a service answered, in words; of parameters only what was refused."""
    if isinstance(response, SetParameters.Response):
        return "; ".join(result.reason for result in response.results if not result.successful)
    return response.message if response.success else f"refused: {response.message}"


def _check_view(values: Mapping[str, Value]) -> None:
    try:
        with socket.socket(socket.AF_INET6 if ":" in str(values["host"]) else socket.AF_INET) as probe:
            probe.bind((values["host"], 0))
    except OSError as error:
        reason = f"this machine has no such address ({error.strerror})"
        raise ParameterError(f"parameter host = {values['host']!r}: {reason}") from error


def main(args: list[str] | None = None) -> int:
    """Show until SIGINT or SIGTERM; returns the exit code."""
    return run_node(PROGRAMS["view"], ViewNode, args)


if __name__ == "__main__":
    sys.exit(main())
