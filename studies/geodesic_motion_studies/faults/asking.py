"""Asking: goals, obstacles, parameters and services, as a user's own nodes would use them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import yaml
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool, Trigger

from geodesic_motion_ros.nodes.marker_messages import MarkerScene, sphere_marker
from geodesic_motion_ros.nodes.messages import pose_message
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.faults.fault import NotSeenError
from geodesic_motion_studies.faults.relay import Relay

#: Times a second that the planner alone receives spheres; centre [m] and radius [m] of one.
OBSTACLES_HZ = 10.0
Sphere = tuple[np.ndarray, float]
#: A service answers within this [s].
_ANSWER = 5.0
_GREY = (0.5, 0.5, 0.5, 1.0)


class Wait(Protocol):
    """Waits until a condition is true, and raises NotSeenError after too long."""

    def __call__(self, condition: Callable[[], Any], what: str, patience: float = ...) -> float: ...


class Asking:
    """Talks to planner and twin."""

    def __init__(self, node: Node, skill: Skill, obstacles: Relay, wait: Wait) -> None:
        """obstacles : between the twin and the planner, for what the planner alone receives."""
        self._node, self._skill, self._wait, self._relay = node, skill, wait, obstacles
        self._goals = node.create_publisher(PoseStamped, "goal_pose", QoSProfile(depth=10))
        self._publishers: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        self.forget()
        node.create_timer(1.0 / OBSTACLES_HZ, self._tell_spheres)

    def forget(self) -> None:
        """The nodes are others from now on, and know of no obstacle."""
        self._scene_shown = False
        self._spheres: list[Sphere] = []
        self._shown_spheres = MarkerScene(self._skill.base_frame)

    @property
    def is_heard(self) -> bool:
        """Whether a planner listens to goals."""
        return bool(self._goals.get_subscription_count())

    def send_goal(self, pose: np.ndarray | None = None, frame: str | None = None) -> None:
        """Ask for a goal; as of `goal_message`."""
        self._goals.publish(self.goal_message(pose, frame))

    def goal_message(self, pose: np.ndarray | None = None, frame: str | None = None) -> PoseStamped:
        """A tool pose (7,) in a frame: position [m], quaternion (w, x, y, z); the skill's goal and frame without."""
        pose = self._skill.goal_pose if pose is None else pose
        stamp = self._node.get_clock().now().to_msg()
        return pose_message(pose[:3], pose[3:], frame or self._skill.base_frame, stamp)

    def plan(self, start: np.ndarray | None = None) -> list[Any]:
        """The poses of a plan from a pose (7,), or the skill's start, to its goal, as messages; none where there is no
        plan.
        """
        start = self._skill.start_pose if start is None else start
        request = GetPlan.Request(start=self.goal_message(start), goal=self.goal_message())
        return [pose.pose for pose in self.call(GetPlan, "plan", request).plan.poses]

    def publish(self, topic: str, message: Any) -> None:
        """Say something on a topic of the planner, as soon as it listens."""
        if topic not in self._publishers:
            self._publishers[topic] = self._node.create_publisher(type(message), topic, QoSProfile(depth=10))
        publisher = self._publishers[topic]
        self._wait(publisher.get_subscription_count, f"a subscriber of {topic}")
        publisher.publish(message)

    def call(self, kind: type, name: str, request: Any) -> Any:
        """Call a service and return its response."""
        if name not in self._clients:
            self._clients[name] = self._node.create_client(kind, name)
        client = self._clients[name]
        self._wait(client.service_is_ready, f"the service {name}")
        future = client.call_async(request)
        self._wait(future.done, f"an answer of {name}", _ANSWER)
        return future.result()

    def trigger(self, name: str) -> str:
        """Call a service without arguments; NotSeenError where it refuses."""
        response = self.call(Trigger, name, Trigger.Request())
        if not response.success:
            raise NotSeenError(f"{name}: {response.message}")
        return response.message

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
        """Put obstacles into the twin's world, in the place of those before; as of `simulation/scripted_spheres.py`."""
        if not scene and not self._scene_shown:
            return
        result = self.set_parameters("twin", spheres=yaml.safe_dump(dict(scene)) if scene else "")
        if not result.successful:
            raise NotSeenError(f"the twin refuses spheres: {result.reason}")
        self.trigger("twin/spawn_obstacles")
        self._scene_shown = bool(scene)

    def tell_spheres(self, spheres: Sequence[Sphere]) -> float:
        """Tell the planner, and not the twin, of spheres from now on, in the place of those before; when that was [s].
        """
        self._spheres = list(spheres)
        return self._tell_spheres()

    def _tell_spheres(self) -> float:
        stamp, frame = self._node.get_clock().now().to_msg(), self._skill.base_frame
        markers = [
            sphere_marker("bench", number, *sphere, _GREY, frame, stamp) for number, sphere in enumerate(self._spheres)
        ]
        update = self._shown_spheres.update(markers, stamp)
        # To make a hundred markers takes a while, in which nobody has received them.
        now = time.monotonic()
        if update.markers:
            self._relay.send(update)
        return now
