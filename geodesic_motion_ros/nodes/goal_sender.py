"""A sender of one goal to a planner that runs or starts, who says what becomes of it."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from geodesic_motion_ros.contract.mode import Mode
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.nodes.messages import pose_message, seconds
from geodesic_motion_ros.nodes.newest_goal import PREPARING
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError

#: How long [s] by default a planner is waited for that is not there, and an arm that stands.
PATIENCE = 30.0
#: A planner that runs sends its status many times a second: it has fallen silent after this time [s].
_SILENCE = 10.0
# What the arm does is said once it has done it for so long [s], and while it goes on every so often [s].
_LASTING, _SAID_EVERY = 0.5, 5.0


class NoPlannerError(GeodesicMotionError):
    """No planner listens, or it does not answer."""


class GoalRefusedError(GeodesicMotionError):
    """The planner refuses the goal, and keeps to the one before if there is one."""


class GoalNotReachedError(GeodesicMotionError):
    """The planner has dropped the goal, or has another one, or the arm stands elsewhere for long."""


class Goal(ABC):
    """A goal as an arm takes it: the topic, the message, and the command of the `ros2` command line that sends it."""

    topic: str
    kind: type

    @abstractmethod
    def message(self, stamp: Time) -> Any:
        """Return the message that requests it."""

    @abstractmethod
    def by_hand(self, topic: str) -> str:
        """Return the command that sends it on a topic."""


@dataclass(frozen=True)
class PoseGoal(Goal):
    """A pose (7,) of the tool in a frame: position [m], quaternion (w, x, y, z)."""

    pose: np.ndarray
    frame: str
    topic = "goal_pose"
    kind = PoseStamped

    def message(self, stamp: Time) -> PoseStamped:
        """Return the PoseStamped that requests it."""
        return pose_message(self.pose[:3], self.pose[3:], self.frame, stamp)

    def by_hand(self, topic: str = "/goal_pose") -> str:
        """Return the command that sends it on a topic."""
        x, y, z, qw, qx, qy, qz = (round(float(value), 4) for value in self.pose)
        message = (
            f"{{header: {{frame_id: {self.frame}}}, pose: {{position: {{x: {x}, y: {y}, z: {z}}}, "
            f"orientation: {{w: {qw}, x: {qx}, y: {qy}, z: {qz}}}}}}}"
        )
        return f'ros2 topic pub --once {topic} geometry_msgs/msg/PoseStamped "{message}"'


@dataclass(frozen=True)
class JointGoal(Goal):
    """Positions (eta,) [rad] of an arm's joints, by their names."""

    names: Sequence[str]
    positions: np.ndarray
    topic = "goal_joints"
    kind = JointState

    def message(self, stamp: Time) -> JointState:
        """Return the JointState that requests it."""
        return JointState(header=Header(stamp=stamp), name=list(self.names), position=self.positions.tolist())

    def by_hand(self, topic: str = "/goal_joints") -> str:
        # Names in quotes: those of some arms are numbers.
        """Return the command that sends it on a topic."""
        names = ", ".join(f"'{name}'" for name in self.names)
        positions = ", ".join(f"{value:.4f}" for value in self.positions)
        message = f"{{name: [{names}], position: [{positions}]}}"
        return f'ros2 topic pub --once {topic} sensor_msgs/msg/JointState "{message}"'


def goal_of_skill(
    skill: Skill, prefix: str = "", move: Sequence[float] = (0.0, 0.0, 0.0), end: Literal["start", "goal"] = "goal"
) -> Goal:
    """Return an end of a skill as its arm takes goals: a pose, or for arms of fewer than six joints a configuration.

    prefix : the parameter joint_prefix of the planner. move : (3,) [m], how far from that end.

    Raises
    ------
    ParameterError : a configuration is to be moved.
    """
    robot = Robot.named(skill.robot)
    if skill.space == "task" or robot.takes_poses:
        pose = (skill.goal_pose if end == "goal" else skill.start_pose).copy()
        pose[:3] += move
        return PoseGoal(pose, prefix + skill.base_frame)
    if any(move):
        raise ParameterError(
            f"--move is of a pose, and an arm of {len(robot.joint_names)} joints takes configurations: leave it out"
        )
    return JointGoal([prefix + name for name in robot.joint_names], skill.mean_configuration(end))


@dataclass(frozen=True)
class _Status:
    """What the planner says in a cycle, as of `~/status`: when [s], and of which goal, counted from 1."""

    stamp: float
    text: str
    ok: bool
    mode: str
    goal_number: int
    goal_code: str
    goal_reason: str
    time_to_goal: float
    speed: float

    @classmethod
    def of(cls, message: DiagnosticArray) -> _Status:
        status = message.status[0]
        values = {pair.key: pair.value for pair in status.values}
        return cls(
            seconds(message.header.stamp), status.message, values["code"] == VerdictCode.OK.name, values["mode"],
            int(values["goal_number"]), values["goal_code"], values["goal_reason"], float(values["time_to_goal"]),
            float(values["speed"]),
        )  # fmt: skip

    @property
    def has_arrived(self) -> bool:
        return self.ok and self.time_to_goal == 0.0 and self.speed == 0.0

    @property
    def stands(self) -> bool:
        return self.speed == 0.0 and not self.time_to_goal > 0.0

    @property
    def doing(self) -> tuple[str, str]:
        """What the arm does: in which it goes on though the figures change, and in words."""
        if self.ok and self.time_to_goal > 0.0:
            return "moving", f"moving, {self.time_to_goal:.1f} s to go"
        return self.text.partition(":")[0] + self.mode, f"{self.mode or Mode.HOLDING.value}: {self.text}"


class ProgressReport:
    """A report that decides when a user reads what the arm does: once that has lasted for half a second, and every five
    seconds.

    So a user reads something also where what the arm does changes faster than that. begin : when the goal was accepted
    [s].
    """

    def __init__(self, begin: float) -> None:
        self._kind, self._since, self._said, self._known = "", begin, begin, True

    def take(self, kind: str, time: float) -> bool:
        """Take note of the kind of what the arm does at a time [s]; returns whether the user is to read it now."""
        if kind != self._kind:
            self._kind, self._since, self._known = kind, time, False
        lasts = not self._known and time - self._since >= _LASTING
        if not lasts and time - self._said < _SAID_EVERY:
            return False
        self._said, self._known = time, True
        return True


def send_goal(
    goal: Goal,
    ros_arguments: Sequence[str] = (),
    patience: float = PATIENCE,
    said: Callable[[str], None] = lambda line: None,
) -> float:
    """Publish a goal once, as soon as a planner listens, and wait for the arm to arrive; returns after how long [s].

    Parameters
    ----------
    ros_arguments : what follows --ros-args on a command line, such as ("-r", "__ns:=/left").
    patience : for so long [s] a planner is waited for that is not there, and an arm that stands before it has arrived.
        A planner that is there and starts is waited for as long as that takes.
    said : called with each line that a person should read; the first is the command that does the same.

    Raises
    ------
    NoPlannerError : nobody listens to the topic, or the planner falls silent.
    GoalRefusedError, GoalNotReachedError : with the planner's reason.
    ParameterError : ROS arguments that cannot be read.
    """
    context = rclpy.Context()
    try:
        rclpy.init(args=["goal", "--ros-args", *ros_arguments], context=context)
    except RuntimeError as error:  # what rcl makes of an argument that it cannot read
        raise ParameterError(str(error)) from error
    node = rclpy.create_node("goal", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        return _Sender(node, executor, goal, patience, said).run()
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


class _Sender:
    """Sends a goal and follows what comes of it."""

    def __init__(
        self, node: Node, executor: SingleThreadedExecutor, goal: Goal, patience: float, said: Callable[[str], None]
    ) -> None:
        self._node, self._executor, self._goal, self._patience, self._said = node, executor, goal, patience, said
        self._goals = node.create_publisher(goal.kind, goal.topic, QoSProfile(depth=1))
        self._newest: _Status | None = None
        self._heard = time.monotonic()
        node.create_subscription(DiagnosticArray, "planner/status", self._hear, 10)

    def _hear(self, message: DiagnosticArray) -> None:
        self._newest, self._heard = _Status.of(message), time.monotonic()

    def run(self) -> float:
        """Send it, and return the time [s] from the planner's acceptance to the arrival."""
        self._said(self._goal.by_hand(self._goals.topic_name))
        before = self._await_planner().goal_number
        self._goals.publish(self._goal.message(self._node.get_clock().now().to_msg()))
        # The planner prepares a goal for a while. It may have had others meanwhile: the next one is ours.
        accepted = self._await(lambda status: status.goal_number > before and status.goal_reason != PREPARING)
        if accepted.goal_code != VerdictCode.OK.name:
            raise GoalRefusedError(f"the planner refuses the goal: {accepted.goal_code}: {accepted.goal_reason}")
        self._said(f"accepted: {accepted.goal_reason}")
        return self._follow(accepted)

    def _await_planner(self) -> _Status:
        """The first status of a planner that listens; says what is waited for."""
        topic, seen, line = self._goals.topic_name, time.monotonic(), ""
        while not (self._goals.get_subscription_count() and self._newest is not None):
            now = time.monotonic()
            starts = self._planner_is_there()
            seen = now if starts else seen
            if now - seen > self._patience:
                raise NoPlannerError(
                    f"nobody listens to {topic}: start the planner first (waited {self._patience:g} s; the same "
                    "ROS_DOMAIN_ID?)"
                )
            waits = "the planner starts: waiting for it" if starts else f"waiting for a planner that listens to {topic}"
            # Discovery takes a moment.
            if now - self._heard > 1.0 and line != waits:
                line = waits
                self._said(f"{waits}; Ctrl-C leaves")
            self._executor.spin_once(timeout_sec=0.05)
        return self._newest

    def _planner_is_there(self) -> bool:
        """Whether there is a planner in this namespace, though it may not listen yet."""
        return ("planner", self._node.get_namespace()) in self._node.get_node_names_and_namespaces()

    def _await(self, until: Callable[[_Status], bool]) -> _Status:
        """The first status of which something is true; NoPlannerError where none comes any more."""
        newest = self._newest
        while newest is None or not until(newest):
            if time.monotonic() - self._heard > _SILENCE:
                raise NoPlannerError(f"the planner has fallen silent for {_SILENCE:g} s")
            self._executor.spin_once(timeout_sec=0.05)
            newest = self._newest
        return newest

    def _follow(self, accepted: _Status) -> float:
        """Say what the arm does until it has arrived; the time [s] of the planner's clock that this took."""
        report, moved, status = ProgressReport(accepted.stamp), time.monotonic(), accepted
        while not status.has_arrived:
            self._check(status, accepted.goal_number)
            kind, words = status.doing
            if report.take(kind, status.stamp):
                self._said(words)
            if not status.stands:
                moved = time.monotonic()
            elif time.monotonic() - moved > self._patience:
                raise GoalNotReachedError(
                    f"the arm has stood for {self._patience:g} s: {status.text}; the planner keeps the goal"
                )
            last = status
            status = self._await(lambda newest, last=last: newest is not last)
        self._check(status, accepted.goal_number)
        return status.stamp - accepted.stamp

    @staticmethod
    def _check(status: _Status, number: int) -> None:
        if status.goal_number > number:
            raise GoalNotReachedError("another goal has been sent to the planner, which takes the place of this one")
        if status.goal_number < number:
            raise GoalNotReachedError("the planner was started anew, and has no goal: send the goal again")
        if status.goal_code != VerdictCode.OK.name:
            raise GoalNotReachedError(f"{status.goal_code}: {status.goal_reason}")
