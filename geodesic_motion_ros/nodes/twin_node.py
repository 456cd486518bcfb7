"""Node `twin`: a simulated arm that stands in for the hardware behind the same topics.

Physics runs in real time, or as a simulated clock goes on, in a thread of its own. Only that thread touches PyBullet:
callbacks leave what they want in a mailbox, services wait until it was done.
"""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as NotDoneInTime
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.action.server import ServerGoalHandle
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import Image, JointState, PointCloud2
from std_msgs.msg import Float64, String, UInt32
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from geodesic_motion_ros.nodes.clock_offset import ClockOffset
from geodesic_motion_ros.nodes.drive_watch import DRIVE_TOPIC
from geodesic_motion_ros.nodes.extras import extra
from geodesic_motion_ros.nodes.joint_bytes import SeenTrajectory, parse_joint_trajectory
from geodesic_motion_ros.nodes.marker_messages import MarkerScene, sphere_marker
from geodesic_motion_ros.nodes.messages import (
    MessageRefused,
    cloud_message,
    image_message,
    joint_state_message,
    point_message,
    pose_message,
    read_joint_positions,
    read_joint_trajectory,
    read_pose,
    seconds,
)
from geodesic_motion_ros.nodes.node_time import NodeTime
from geodesic_motion_ros.nodes.parameter_tables import TWIN
from geodesic_motion_ros.nodes.parameters import NodeParameters
from geodesic_motion_ros.nodes.publishers import LATCHED, publishers_of
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.running import STEADY, LoopingNode, run_node
from geodesic_motion_ros.nodes.steady_loop import SteadyLoop
from geodesic_motion_ros.nodes.trajectory_action import KIND, TrajectoryServer
from geodesic_motion_ros.nodes.twin_parameters import (
    base_frame,
    camera_settings,
    check_twin,
    initial_joints,
    robot_of,
    scene_around,
    scripted_spheres,
    steps_per_message,
)
from geodesic_motion_ros.nodes.usage import PROGRAMS
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.robot_file import published_urdf
from geodesic_motion_ros.simulation.camera_process import CameraProcess
from geodesic_motion_ros.simulation.loading import simulated_urdf
from geodesic_motion_ros.simulation.scripted_spheres import ScriptedSpheres
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_ros.utils.errors import GeodesicMotionError, RobotError

# After a stall physics makes up for what was lost, for half as long [s] of real time at most, in the next tick half as
# long as that, and so on until nothing is owed: where steps take longer than what they stand for, the world is late.
_MAKING_UP = 1.0
# A service waits this long [s] for the physics thread.
_PATIENCE = 2.0
# After a reset, commands from before it may still be in transit: none counts for this long [s].
_DEAF = 0.3
# Changes of the topic that commands are logged at most once in this time [s]: two streams at once would fill the log.
_QUIET = 0.2
_POSES, _TRAJECTORIES, _POSTURES = "target_pose", "joint_trajectory", "target_posture"
_HAND = "~/hand_pose"
# A posture belongs to the poses with stamps that are no farther from its own [s].
_SAME_TIME = 0.1
_OBSTACLE_COLOUR = (0.85, 0.30, 0.20, 0.9)
_IMAGE_SIZE = (320, 240)
#: The frame of clouds.
_CAMERA = "twin_camera"

@dataclass(frozen=True)
class _Command:
    """What a message on a topic asks of the world."""

    topic: str
    apply: Callable[[], None]
    #: The goal of an action that asks for it, and until when that lasts [s] by the node's clock.
    goal: ServerGoalHandle | None = None
    until: float = 0.0


class TwinNode(LoopingNode):
    """The digital twin as a ROS 2 node.

    The arm follows `target_pose`, a stream that must not pause, in the posture of `target_posture` with the same stamp,
    if there is one, or `joint_trajectory`, whichever spoke last. Stamps of
    trajectories are of the node's clock; their rules are those of joint_trajectory_controller
    (`trajectory/trajectory_player.py`). When the clock is set the arm brakes and holds.

    In free drive (`~/free_drive`) it follows none of them: gravity is compensated, and a hand pulls the tool towards
    the stream `~/hand_pose` by springs (`simulation/free_drive.py`).

    `~/contacts` counts the physics steps with contact between the arm and obstacles or the declared scene since the
    last reset, so that no contact is lost between messages; a warning names what is touched. `~/clearance` is the
    smallest distance [m] from obstacles since the message before, inf without any.

    Raises
    ------
    ParameterError : a parameter does not exist or does not fit.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("twin", **node_options)

    def _build(self) -> None:
        self._options = NodeParameters(self, TWIN, check_twin)
        values = self._options
        self._robot, self._frame = robot_of(values.values), base_frame(values.values)
        scene = scene_around(values["scene"], values["skill"])
        self.world = ArmWorld(values["gui"], values["physics_rate"], scene, self._robot)
        self.world.reset(initial_joints(values.values, self.world.robot))
        # The same arm, by the names of messages.
        self._arm = self.world.robot.prefixed(values["joint_prefix"])
        self._camera = None
        if values["cloud_rate"]:
            view = camera_settings(values.values)
            self._camera = CameraProcess(self._robot, view, scene)
            place = ", ".join(f"{number:.4f}" for number in np.concatenate(view.pose))
            self.get_logger().info(
                f"a depth camera sees the arm: -p camera_frame:={_CAMERA} -p camera_pose:='[{place}]' tells a planner "
                "where it stands"
            )
        self._unpublished: deque[tuple[tuple[float, Time], np.ndarray]] = deque()
        self._spheres, self._spheres_start = ScriptedSpheres({}), 0.0
        self._steps = self._contacts = self._discontinuities = 0
        self._touched: set[str] = set()
        self._least_clearance = np.inf
        self.refusals = RefusalLog(self.get_logger().warning)
        self._mailbox: queue.SimpleQueue[tuple[Callable[[], str], Future[str]]] = queue.SimpleQueue()
        self._command: _Command | None = None
        # The newest target posture, and its stamp [s].
        self._posture: tuple[np.ndarray | None, float] = None, 0.0
        self._command_lock = threading.Lock()
        self._commander = ""
        self._commanded_at = self._deaf_until = self._quiet_until = -np.inf
        self._clock_offset = ClockOffset()
        self._time = NodeTime(self.get_clock())
        self._moment, self._patience = self._time.read(), _MAKING_UP
        self._set_by, self._stepped_until = 0.0, self._moment.running
        self._goals: TrajectoryServer | None = None
        self._loop = SteadyLoop(self._tick, values["physics_rate"], self._died, name="physics")
        self._make_interface()
        if values["spawn_at_start"]:
            self._spawn()

    def _introduction(self) -> str:
        topics = ", ".join(self.resolve_topic_name(name) for name in ("joint_trajectory", "target_pose"))
        return f"ready: a simulated {self._robot} on {self._joint_states.topic_name}; waits for commands on {topics}"

    def _make_interface(self) -> None:
        # Reliable publishers serve subscribers of either kind; best effort ones would leave reliable
        # subscribers out.
        qos = QoSProfile(depth=1)
        self._joint_states = self.create_publisher(JointState, "joint_states", qos)
        self._commanded = self.create_publisher(JointState, DRIVE_TOPIC, qos)
        self._ee_pose = self.create_publisher(PoseStamped, "ee_pose", qos)
        self._obstacles = self.create_publisher(MarkerArray, "obstacles", qos)
        self._obstacle_point = self.create_publisher(PointStamped, "obstacle_point", qos)
        self._clearance = self.create_publisher(Float64, "~/clearance", qos)
        self._contact_count = self.create_publisher(UInt32, "~/contacts", qos)
        self._discontinuity_count = self.create_publisher(UInt32, "~/discontinuities", qos)
        self._image = self.create_publisher(Image, "~/image", qos)
        if self._camera is not None:
            # Where it is off, nobody is to think that this node publishes clouds.
            self._cloud = self.create_publisher(PointCloud2, "obstacle_cloud", qos)
        self._description = self.create_publisher(String, "robot_description", LATCHED)
        shown = simulated_urdf(RobotDescription.named(self._robot))
        self._description.publish(String(data=published_urdf(shown, self._options["joint_prefix"])))
        self._markers = MarkerScene(self._frame)
        values = self._options
        every = steps_per_message(values.values)
        self._schedule = [
            (every["state_rate"], self._publish_state),
            (every["obstacle_rate"], self._publish_obstacles),
            (every["image_rate"], self._publish_image),
            (every["cloud_rate"], self._look),
        ]
        self.create_subscription(PoseStamped, _HAND, self._on_hand, qos)
        self._commands = (
            self.create_subscription(PoseStamped, _POSES, self._on_target, qos),
            self.create_subscription(JointTrajectory, _TRAJECTORIES, self._on_trajectory, qos, raw=True),
        )
        self.create_subscription(JointState, _POSTURES, self._on_posture, qos)
        if (kind := extra(KIND)) is not None:
            self._goals = TrajectoryServer(
                self, kind, "follow_joint_trajectory", self._accepts, self._on_trajectory_goal
            )
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(Trigger, "~/spawn_obstacles", self._on_spawn)
        self.create_service(SetBool, "~/free_drive", self._on_free_drive)
        self.create_timer(1.0, self._look_for_rivals, clock=STEADY)

    def start(self) -> None:
        """Begin physics."""
        self._stepped_until = self._time.running()
        self._loop.start()

    def stop(self) -> None:
        """End physics and close the world; harmless when done before."""
        if self._loop.stop():
            if self._goals is not None:
                self._goals.play(None)
            self.world.close()
            if self._camera is not None:
                self._camera.stop()

    # ------------------------------------------------------------ physics thread

    def _tick(self, _: int) -> None:
        self._serve_mailbox()
        moment = self._moment = self._time.read()
        steps = self._take_steps(moment.running)
        was_set = moment.set_by != self._set_by
        if was_set:
            self._set_by, self._clock_offset = moment.set_by, ClockOffset()
            self.world.hold()
        # what the steps arrive at is the state of now
        arrival = self.world.time + steps * self.world.dt
        self.world.clock_offset = self._clock_offset.update(1e-9 * moment.ros_time, arrival)
        # What a late tick makes up for was before its command came: until then the old one is followed.
        made = self._make_up(steps - 1)
        self._take_command()
        if self._goals is not None and self._goals.look(1e-9 * moment.ros_time):
            self.world.hold()
        if steps:
            self._step()
            made += 1
        for every, publish in self._schedule:
            # A late tick makes several steps at once; what fell due among them is published once. By a clock that was
            # set, all that was published is of another time.
            if every and (was_set or self._steps // every != (self._steps - made) // every):
                publish()
        self._publish_clouds()

    def _take_steps(self, running: float) -> int:
        """Take the steps of physics that are due: for the time that has passed, of a simulation or of the world.

        running : now [s].
        """
        due = max(0, round((running - self._stepped_until) / self.world.dt))
        self._stepped_until += due * self.world.dt
        return due

    def _make_up(self, steps: int) -> int:
        """So many steps, or as many as there is time for; returns how many."""
        # A simulated clock that goes on by several steps at once owes nothing.
        is_late = steps > 1 and not self._moment.simulated
        self._patience = 0.5 * self._patience if is_late else _MAKING_UP
        made, until = 0, time.monotonic() + self._patience
        while made < steps and time.monotonic() < until:
            self._step()
            made += 1
        return made

    def _step(self) -> None:
        self.world.set_obstacles(self._spheres.obstacles(self.world.time - self._spheres_start))
        if (timeout := self._options["cmd_timeout"]) > 0.0 and self.world.hold_if_overdue(timeout):
            self.get_logger().warning(
                f"no new {_TRAJECTORIES} for {timeout:g} s after the end of the last one (cmd_timeout): "
                "the arm holds where it is"
            )
        self.world.step()
        self._steps += 1
        if contacts := self.world.contacts():
            self._contacts += 1
            for name in contacts.keys() - self._touched:
                self.get_logger().warning(f"{contacts[name]} touches '{name}'")
            self._touched |= contacts.keys()
        if self._spheres.items:
            self._least_clearance = min(self._least_clearance, self.world.clearance()[0])

    def _take_command(self) -> None:
        with self._command_lock:
            command, self._command = self._command, None
        now = self._time.running()
        if command is not None:
            self._obey(command, now)
        # a trajectory ends by itself
        elif now - self._commanded_at > self._options["command_timeout"]:
            if self._commander == _POSES:
                self.world.hold()
            elif self._commander == _HAND:
                self.world.let_go()

    def _obey(self, command: _Command, now: float) -> None:
        if now < self._deaf_until:
            reason = f"the arm was reset, nothing is followed for {_DEAF:g} s"
            self.refusals.add(command.topic, reason)
            self._drop(command, reason)
            return
        with self.refusals.guard(command.topic) as guard:
            try:
                command.apply()
            except RobotError as error:
                raise MessageRefused(str(error)) from error
        if guard.reason:
            self._drop(command, guard.reason)
            return
        if self._goals is not None:
            self._goals.play(command.goal, command.until)
        if command.topic != self._commander and now >= self._quiet_until:
            self._quiet_until = now + _QUIET
            self.get_logger().info(
                f"{command.topic} commands the arm from now on{self._commander and f', no longer {self._commander}'}"
            )
        self._commander, self._commanded_at = command.topic, now

    def _drop(self, command: _Command, reason: str) -> None:
        """Take note that a command is not followed."""
        if self._goals is not None and command.goal is not None:
            self._goals.refuse(command.goal, reason)

    def _serve_mailbox(self) -> None:
        while not self._mailbox.empty():
            work, done = self._mailbox.get()
            if not done.set_running_or_notify_cancel():
                continue
            try:
                done.set_result(work())
            except Exception as error:  # the caller gets it, and physics goes on
                done.set_exception(error)

    def _stamp(self) -> Time:
        """When the world is as it is: as the tick began, however long its steps took."""
        return Time(nanoseconds=self._moment.ros_time).to_msg()

    def _publish_state(self) -> None:
        stamp = self._stamp()
        world = self.world
        names = self._arm.joint_names
        self._joint_states.publish(joint_state_message(names, world.joint_positions, world.joint_velocities, stamp))
        if world.is_driven:
            drive = world.commanded_positions, world.commanded_velocities
            self._commanded.publish(joint_state_message(names, *drive, stamp))
        self._ee_pose.publish(pose_message(*world.tool_pose(), self._frame, stamp))

    def _publish_obstacles(self) -> None:
        stamp = self._stamp()
        spheres = list(self._spheres.obstacles(self.world.time - self._spheres_start).values())
        shown = [
            sphere_marker("twin", number, *sphere, _OBSTACLE_COLOUR, self._frame, stamp)
            for number, sphere in enumerate(spheres)
        ]
        update = self._markers.update(shown, stamp)
        # Without spheres only the deletions that end those before are sent: silence afterwards means
        # no obstacle.
        if update.markers:
            self._obstacles.publish(update)
        if spheres:
            self._obstacle_point.publish(point_message(spheres[0][0], self._frame, stamp))
        self._clearance.publish(Float64(data=float(self._least_clearance)))
        self._contact_count.publish(UInt32(data=int(self._contacts)))
        self._discontinuity_count.publish(UInt32(data=self._discontinuities))
        self._least_clearance = np.inf

    def _publish_image(self) -> None:
        self._image.publish(image_message(self.world.render(*_IMAGE_SIZE), self._stamp()))

    def _look(self) -> None:
        """Ask the camera for a picture of now; one that is not ready yet is not waited for."""
        if self._camera is not None:
            spheres = self._spheres.obstacles(self.world.time - self._spheres_start)
            self._camera.look((self._moment.running, self._stamp()), self.world.joint_positions, spheres)

    def _publish_clouds(self) -> None:
        """Publish what the camera has seen once it is due."""
        if self._camera is None:
            return
        try:
            seen = self._camera.take()
        except EOFError:
            self._camera = None
            self.get_logger().error("the process of the camera has ended: no more clouds are published")
            return
        if seen is not None:
            self._unpublished.append(seen)
        while self._unpublished:
            (taken, stamp), points = self._unpublished[0]
            if 0.0 <= self._moment.running - taken < self._options["cloud_delay"]:
                return
            self._unpublished.popleft()
            self._cloud.publish(cloud_message(points, _CAMERA, stamp))

    # ---------------------------------------------------------------- callbacks

    def _on_target(self, message: PoseStamped) -> None:
        with self.refusals.guard(_POSES):
            position, quaternion = read_pose(message, self._frame)
            posture, stamp = self._posture
            known = posture is not None and abs(seconds(message.header.stamp) - stamp) <= _SAME_TIME
            followed = posture if known and self._options["follow_posture"] else None
            self._ask(_Command(_POSES, partial(self.world.set_target_pose, position, quaternion, followed)))

    def _on_posture(self, message: JointState) -> None:
        with self.refusals.guard(_POSTURES):
            posture = read_joint_positions(message, self._arm.joint_names)
            try:
                self._posture = self._arm.checked(posture), seconds(message.header.stamp)
            except RobotError as error:
                raise MessageRefused(str(error)) from error

    def _on_hand(self, message: PoseStamped) -> None:
        with self.refusals.guard(_HAND):
            self._ask(_Command(_HAND, partial(self.world.pull, *read_pose(message, self._frame))))

    def _on_trajectory(self, wire: bytes) -> None:
        with self.refusals.guard(_TRAJECTORIES):
            self._take_trajectory(parse_joint_trajectory(wire))

    def _on_trajectory_goal(self, message: JointTrajectory, goal: ServerGoalHandle) -> None:
        with self.refusals.guard(_TRAJECTORIES):
            self._take_trajectory(message, goal)

    def _take_trajectory(
        self, message: JointTrajectory | SeenTrajectory, goal: ServerGoalHandle | None = None
    ) -> None:
        waypoints = read_joint_trajectory(message, self._arm, self._options["joint_prefix"])
        begin = seconds(message.header.stamp) or None
        until = (begin or 1e-9 * self.get_clock().now().nanoseconds) + float(waypoints.times[-1])
        self._ask(_Command(_TRAJECTORIES, partial(self._follow, waypoints, begin), goal, until))

    def _accepts(self, message: JointTrajectory) -> bool:
        """Whether the arm can play a trajectory; the log says why not."""
        with self.refusals.guard(_TRAJECTORIES) as guard:
            read_joint_trajectory(message, self._arm, self._options["joint_prefix"])
        return not guard.reason

    def _follow(self, waypoints: JointWaypoints, begin: float | None) -> None:
        step = self.world.set_joint_trajectory(waypoints, begin)
        if step is None:
            return
        self._discontinuities += 1
        self.get_logger().warning(
            f"{_TRAJECTORIES}: what is desired of '{self._arm.joint_names[step.joint]}' steps by "
            f"{1000 * step.position:.2f} mrad and {step.velocity:.3f} rad/s as a trajectory takes over that came "
            f"{1000 * step.late:.0f} ms after its begin: an arm whose own controller judges its commands stops here",
            throttle_duration_sec=1.0,
        )

    def _ask(self, command: _Command) -> None:
        with self._command_lock:
            before, self._command = self._command, command
        if before is not None:
            self._drop(before, "another command has taken its place")

    def _look_for_rivals(self) -> None:
        with self.refusals.guard("the search for other commanders"):
            rivals = [
                f"{topic} is published by {' and '.join(names)}"
                for topic, subscription in zip((_POSES, _TRAJECTORIES), self._commands, strict=True)
                if len(names := publishers_of(self, subscription.topic_name)) > 1
            ]
            if rivals:
                warning = f"{'; '.join(rivals)}: only one may command the arm"
                self.get_logger().warning(warning, throttle_duration_sec=5.0)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self.refusals.answer("~/reset", response, partial(self._in_physics_thread, self._reset))

    def _on_spawn(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self.refusals.answer("~/spawn_obstacles", response, partial(self._in_physics_thread, self._spawn))

    def _on_free_drive(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        work = self._begin_free_drive if request.data else self._end_free_drive
        return self.refusals.answer("~/free_drive", response, partial(self._in_physics_thread, work))

    def _in_physics_thread(self, work: Callable[[], str]) -> str:
        done: Future[str] = Future()
        self._mailbox.put((work, done))
        try:
            return done.result(_PATIENCE)
        except GeodesicMotionError as error:
            raise MessageRefused(str(error)) from error
        except NotDoneInTime as error:
            done.cancel()
            raise MessageRefused(f"physics did not answer within {_PATIENCE:g} s") from error

    def _reset(self) -> str:
        self.world.reset(initial_joints(self._options.values, self.world.robot))
        self._begin_anew()
        with self._command_lock:
            before, self._command = self._command, None
        if before is not None:
            self._drop(before, "the arm was reset")
        if self._goals is not None:
            self._goals.play(None)
        self._commander, self._deaf_until = "", self._time.running() + _DEAF
        return "the arm is where it started, the spheres begin again, contacts count from zero"

    def _begin_free_drive(self) -> str:
        self.world.begin_free_drive()
        return "the arm is in free drive: gravity is compensated, it goes where it is pulled and follows no command"

    def _end_free_drive(self) -> str:
        self.world.end_free_drive()
        return "the motors hold the arm where it is"

    def _spawn(self) -> str:
        self._spheres = scripted_spheres(self._options["spheres"])
        self._begin_anew()
        return f"{len(self._spheres.items)} obstacles: {', '.join(self._spheres.items) or 'none'}"

    def _begin_anew(self) -> None:
        """What is still to be made up for was before."""
        self._spheres_start, self._stepped_until = self.world.time, self._time.running()
        self._contacts, self._discontinuities, self._least_clearance = 0, 0, np.inf
        self._touched.clear()


def main(args: list[str] | None = None) -> int:
    """Run the twin until SIGINT or SIGTERM; returns the exit code."""
    return run_node(PROGRAMS["twin"], TwinNode, args)


if __name__ == "__main__":
    sys.exit(main())
