"""Everything the planner node says.

`~/status` carries one DiagnosticStatus a cycle: its message is `CODE: reason`, its values hold the figures
of the verdict. `/diagnostics` carries the loop's health once a second. Both are DiagnosticArrays, for
their stamp.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.time import Time
from sensor_msgs.msg import Image, JointState
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.cloud_thread import CloudFigures
from geodesic_motion_ros.nodes.cycle import CycleOutput, PoseArrays
from geodesic_motion_ros.nodes.marker_messages import (
    MarkerScene,
    cubes_marker,
    held_marker,
    line_marker,
    solid_marker,
    sphere_marker,
)
from geodesic_motion_ros.nodes.messages import (
    diagnostic_array,
    diagnostic_status,
    fill_pose,
    image_message,
    path_message,
)
from geodesic_motion_ros.nodes.node_time import NodeTime
from geodesic_motion_ros.nodes.obstacle_load import Load, advice
from geodesic_motion_ros.nodes.publishers import LATCHED, publishers_of, subscribers_of
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.steady_loop import LoopStatistics, SteadyLoop
from geodesic_motion_ros.nodes.trajectory_action import TrajectoryGoals
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.obstacles.tracker import ObstacleSet
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.trajectory.trajectory import JointReference

_LEVELS = {
    VerdictCode.OK: DiagnosticStatus.OK,
    VerdictCode.HOLD_REQUESTED: DiagnosticStatus.WARN,
    VerdictCode.NO_GOAL: DiagnosticStatus.WARN,
    VerdictCode.NO_FEASIBLE_PATH: DiagnosticStatus.WARN,
    VerdictCode.GOAL_OUT_OF_SUPPORT: DiagnosticStatus.WARN,
    VerdictCode.DEADLINE_MISSED: DiagnosticStatus.WARN,
}
#: What the verdict says of start and goal: lengths [m] and angles [rad].
_END_FIGURES = (
    "start_offset", "goal_offset", "start_offset_angle", "goal_offset_angle",
    "start_beyond", "goal_beyond", "start_beyond_angle", "goal_beyond_angle", "end_correction",
)  # fmt: skip
_PATH_COLOUR, _DETOUR_COLOUR = (0.95, 0.85, 0.25, 1.0), (0.95, 0.45, 0.15, 1.0)
_SCENE_COLOUR, _SEEN_COLOUR = (0.55, 0.58, 0.62, 0.35), (0.40, 0.75, 0.45, 0.08)
_OBSTACLE_COLOUR = (0.88, 0.28, 0.24, 0.55)
#: Cubes of a cloud that are shown.
_MOST_CUBES = 1000
_TOOL_COLOUR, _HELD_COLOUR = (0.25, 0.55, 0.85, 0.45), (0.30, 0.70, 0.40, 0.85)


class PlannerOutputs:
    """The publishers of the planner.

    Commands and verdicts are stamped with the time that their cycle began with: a simulated clock may go on while a
    cycle lasts. All else is stamped when it leaves.
    """

    def __init__(
        self,
        node: Node,
        frame: str,
        hardware: str,
        command_topic: str,
        guarded: str,
        joint_names: Sequence[str],
        time: NodeTime,
        noun: str = "goal",
        trajectory_goals: TrajectoryGoals | None = None,
    ) -> None:
        """command_topic : "target_pose" or "joint_trajectory"; nothing is published on the other. trajectory_goals :
        what sends trajectories in the place of the topic.

        guarded : what is kept away from obstacles, as the status says it. time : that trajectories are timed by.
        noun : what a person calls that which the node is asked for.
        """
        self._guarded, self._joint_names, self._time, self._noun = guarded, tuple(joint_names), time, noun
        self._node, self._frame, self._hardware = node, frame, hardware
        kind = PoseStamped if command_topic == "target_pose" else JointTrajectory
        self._goals = trajectory_goals
        self._commands = trajectory_goals or node.create_publisher(kind, command_topic, QoSProfile(depth=1))
        if kind is PoseStamped:
            self._postures = node.create_publisher(JointState, "target_posture", QoSProfile(depth=1))
            self._posture_message = JointState(name=list(joint_names))
            self._posture_message.header.frame_id = frame
        self._path = node.create_publisher(Path, "path", QoSProfile(depth=1))
        self._status = node.create_publisher(DiagnosticArray, "~/status", QoSProfile(depth=10))
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        self._markers = node.create_publisher(MarkerArray, "~/markers", QoSProfile(depth=2))
        self._view = node.create_publisher(Image, "~/latent_view", LATCHED)
        self._scene = MarkerScene(frame)
        self._target_message = PoseStamped()
        self._target_message.header.frame_id = frame
        self._facing = np.zeros(4)
        self._received_by: tuple[str, ...] = ()
        self._cycle = self._now()

    def begin_cycle(self, now: float | None = None) -> None:
        """Stamp commands and verdicts from now on with a time as of `Moment.now` [s].

        None: with that of the clock, until it is known what the cycle goes by.
        """
        self._cycle = self._now() if now is None else Time(nanoseconds=self._time.ros_time(now)).to_msg()

    @property
    def command_topic(self) -> str:
        """The full name of the topic, or of the action, of the commands."""
        return self._commands.topic_name

    def publish_target(self, position: np.ndarray, quaternion: np.ndarray, posture: np.ndarray | None = None) -> None:
        """Publish the pose to be at now, and the configuration (eta,) [rad] that holds it; only the control loop calls
        this.
        """
        stamp = self._target_message.header.stamp = self._cycle
        # Both signs are one orientation, between which a controller may turn along the longer arc.
        self._facing = -quaternion if quaternion @ self._facing < 0.0 else quaternion
        fill_pose(self._target_message.pose, position, self._facing)
        if posture is not None:
            # First the posture: with the pose both are known.
            self._posture_message.header.stamp = stamp
            self._posture_message.position = posture.tolist()
            self._postures.publish(self._posture_message)
        self._commands.publish(self._target_message)

    def publish_trajectory(self, reference: JointReference, begin: float) -> None:
        """Publish what to play from `begin` on, a time as of `Moment.now` [s]; only the control loop calls this."""
        knots = reference.positions, reference.velocities, reference.accelerations
        stamp = self._time.ros_time(begin)
        self._commands.publish(joint_trajectory_bytes(self._joint_names, reference.times, *knots, stamp))

    def look_for_nodes_on_commands(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Look for nodes on the topic of the commands: names of those that publish on it, this one among them, and of
        those that receive it.
        """
        if self._goals is not None:
            self._received_by = self._goals.subscribers()
            return self._goals.publishers(), self._received_by
        self._received_by = subscribers_of(self._node, self.command_topic)
        return publishers_of(self._node, self.command_topic), self._received_by

    def publish_status(
        self,
        output: CycleOutput,
        goal_number: int,
        refusals: RefusalLog,
        loop: SteadyLoop,
        plan: str,
        figures: Mapping[str, float | str],
        held: Sequence[HeldObject],
    ) -> None:
        """Publish the verdict of a cycle, sent from within its tick: ticks and durations are of those before it.

        goal_number : of the newest goal, whether it was accepted or not.
        figures : what the certificate counts, and ages of inputs, by name.
        plan : the newest answer of the service `plan`, `CODE: reason`; empty before the first.
        held : the objects in the hand that are counted.
        """
        verdict, path, newest = output.verdict, output.verdict.figures, refusals.newest(within=1.0)
        level, message = _LEVELS.get(verdict.code, DiagnosticStatus.ERROR), verdict.sentence
        if output.is_goal_refused and output.goal_verdict.sentence != message:
            message += f"; newest {self._noun} refused: {output.goal_verdict.sentence}"
        if newest or output.is_goal_refused:
            level = max(level, DiagnosticStatus.WARN)
        values = {
            "code": verdict.code.name,
            "reason": verdict.reason,
            "mode": output.mode,
            "guarded": self._guarded,
            "holding": ", ".join(one.name for one in held),
            "clearance": path.clearance,
            **figures,
            "energy_per_edge": path.energy_per_edge,
            "cost_gap": path.cost_gap,
            "in_support": path.in_support,
            "detour_mm": 1e3 * path.displacement,
            "swivel_rad": path.swivel,
            "deviation": path.deviation,
            "goal_covered": path.goal_covered,
            "goal_distance": path.goal_distance,
            **{name: getattr(path, name) for name in _END_FIGURES},
            "goal_number": goal_number,
            "goal_code": output.goal_verdict.code.name,
            "goal_reason": output.goal_verdict.reason,
            "plan": plan,
            "refused_input": newest,
            **{f"refused_{topic}": count for topic, count in sorted(refusals.counts.items())},
            "speed": output.speed,
            "time_to_goal": output.time_to_goal,
            "tick": loop.ticks,
            "last_tick_ms": 1e3 * loop.last_duration,
            "last_tick_work_ms": 1e3 * loop.last_work,
            "deadline_misses": loop.misses,
            "commands_received_by": " ".join(self._received_by),
        }
        self._publish_status(self._status, level, "verdict", message, values, self._cycle)

    def publish_diagnostics(
        self,
        loop: LoopStatistics,
        rate: float,
        ages: Mapping[str, float],
        dropped: Mapping[str, int],
        remark: str,
        cloud: CloudFigures,
        obstacles: int,
        load: Load,
    ) -> None:
        """Publish the health of the loop: rate [Hz], tick [ms], misses, ages of inputs [s], refused messages by topic,
        what is odd about inputs, the newest point cloud, how many obstacles there are, and the load of their messages.
        """
        values: dict[str, object] = {
            "rate_hz": loop.rate,
            "tick_ms_p50": 1e3 * loop.tick_p50,
            "tick_ms_p99": 1e3 * loop.tick_p99,
            "ticks": loop.ticks,
            "deadline_misses": loop.misses,
        }
        values |= {f"age_{topic}": age for topic, age in sorted(ages.items())}
        values |= {f"refused_{topic}": count for topic, count in sorted(dropped.items())}
        values |= {
            "clouds": cloud.number,
            "cloud_points": cloud.points,
            "cloud_points_not_finite": cloud.not_finite,
            "cloud_points_out_of_reach": cloud.out_of_reach,
            "cloud_points_of_arm": cloud.of_arm,
            "cloud_points_of_scene": cloud.of_scene,
            "cloud_cubes_remembered": cloud.remembered,
            "cloud_clusters": cloud.clusters,
            "cloud_ms": 1e3 * cloud.duration,
            "obstacles": obstacles,
            "obstacle_share": load.share,
        }
        slow = loop.rate < 0.95 * rate
        level = DiagnosticStatus.WARN if slow or remark else DiagnosticStatus.OK
        message = remark or "running"
        if slow:
            why = advice(obstacles, load, rate, loop.tick_p50)
            message = f"DEGRADED: {loop.rate:.1f} of {rate:g} Hz: {why}"
        self._publish_status(self._diagnostics, level, "loop", message, values, self._now())

    @property
    def is_path_watched(self) -> bool:
        return bool(self._path.get_subscription_count())

    @property
    def are_markers_watched(self) -> bool:
        return bool(self._markers.get_subscription_count())

    @property
    def is_view_watched(self) -> bool:
        return bool(self._view.get_subscription_count())

    def publish_path(self, poses: PoseArrays | None) -> None:
        """Publish tool positions (n, 3) and quaternions (n, 4) of the present path; an empty path when there is none.
        """
        positions, quaternions = (np.zeros((0, 3)), np.zeros((0, 4))) if poses is None else poses
        self._path.publish(path_message(positions, quaternions, self._frame, self._now()))

    def publish_markers(
        self,
        path: np.ndarray,
        is_detour: bool,
        obstacles: ObstacleSet,
        scene: DeclaredScene,
        body: np.ndarray,
        held: Sequence[HeldObject],
        tool: TaskFrame,
    ) -> None:
        """Publish the path (n, 3), in another colour where it is a detour, obstacles as the planner sees them (of a
        cloud some occupied cubes), the declared scene, faint what it lists as seen, and the body's spheres (K, 4):
        centre and radius [m], base frame; and the objects in the hand, with the tool where it is commanded to be.
        """
        stamp = self._now()
        shown: list[Marker] = []
        if len(path):
            colour = _DETOUR_COLOUR if is_detour else _PATH_COLOUR
            shown.append(line_marker("path", path, 0.006, colour, self._frame, stamp))
        for number, solid in enumerate(scene.solids):
            shown.append(solid_marker("scene", number, solid, _SCENE_COLOUR, self._frame, stamp))
        for number, box in enumerate(scene.seen):
            shown.append(solid_marker("seen", number, box, _SEEN_COLOUR, self._frame, stamp))
        # Once, however many velocities it may move on at.
        spheres = dict.fromkeys(zip(map(tuple, obstacles.centres.tolist()), obstacles.radii.tolist(), strict=True))
        for number, (centre, radius) in enumerate(spheres):
            shown.append(sphere_marker("obstacles", number, centre, radius, _OBSTACLE_COLOUR, self._frame, stamp))
        for number, solid in enumerate(obstacles.solids):
            shown.append(solid_marker("solids", number, solid, _OBSTACLE_COLOUR, self._frame, stamp))
        cubes = obstacles.cloud.occupied
        if len(cubes):
            some = cubes[:: math.ceil(len(cubes) / _MOST_CUBES)]
            shown.append(cubes_marker("cloud", some, obstacles.cloud.edge, _OBSTACLE_COLOUR, self._frame, stamp))
        for number, sphere in enumerate(body):
            shown.append(sphere_marker("tool", number, sphere[:3], sphere[3], _TOOL_COLOUR, self._frame, stamp))
        for number, one in enumerate(held):
            place = tool.to_base(np.array(one.position), np.array(one.quaternion))
            shown.append(held_marker(number, one, *place, _HELD_COLOUR, self._frame, stamp))
        self._markers.publish(self._scene.update(shown, stamp))

    def publish_view(self, pixels: np.ndarray) -> None:
        """Publish a picture (h, w, 3) uint8 of the latent space."""
        self._view.publish(image_message(pixels, self._now()))

    def _publish_status(
        self, publisher: object, level: bytes, part: str, message: str, values: dict[str, object], stamp: object
    ) -> None:
        name = f"{self._node.get_fully_qualified_name().lstrip('/')}: {part}"
        status = diagnostic_status(level, name, message, self._hardware, values)
        publisher.publish(diagnostic_array([status], stamp))

    def _now(self) -> object:
        return self._node.get_clock().now().to_msg()

