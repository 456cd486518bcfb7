"""Everything the planner node hears: callbacks check and store, the control cycle takes a snapshot."""

from __future__ import annotations

import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import Header, String
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.filtering.offer import OfferRequest
from geodesic_motion_ros.geometry.point_clouds import MOMENT
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.shapes import no_solids
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.arm_state import ArmState
from geodesic_motion_ros.nodes.arming import Arming
from geodesic_motion_ros.nodes.cloud_thread import CloudFigures, CloudThread
from geodesic_motion_ros.nodes.cycle import CycleInputs
from geodesic_motion_ros.nodes.delivery import TransitWatch, stamp_of
from geodesic_motion_ros.nodes.described_arm import DescribedArm
from geodesic_motion_ros.nodes.drive_watch import DRIVE_TOPIC
from geodesic_motion_ros.nodes.extras import extra
from geodesic_motion_ros.nodes.frames import PATIENCE, FixedFrame, LateTransforms, frames_of
from geodesic_motion_ros.nodes.marker_bytes import SeenMarker, parse_marker, parse_markers
from geodesic_motion_ros.nodes.marker_messages import (
    MarkerUpdate,
    held_objects_after,
    read_marker,
    unknown_objects_after,
)
from geodesic_motion_ros.nodes.messages import (
    MessageRefused,
    frame_of,
    read_cloud,
    read_joint_positions,
    read_point,
    read_pose,
    seconds,
)
from geodesic_motion_ros.nodes.node_time import NodeTime
from geodesic_motion_ros.nodes.obstacle_load import Load, ObstacleLoad
from geodesic_motion_ros.nodes.obstacle_subscription import ObstacleSubscription
from geodesic_motion_ros.nodes.parameters import NodeParameters
from geodesic_motion_ros.nodes.plain_cdr import Stamp
from geodesic_motion_ros.nodes.planning_scene import REMOVE, PlanningSceneReader, removal
from geodesic_motion_ros.nodes.publishers import LATCHED
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.seen_cloud import CloudSettings, SeenCloud, see_cloud
from geodesic_motion_ros.obstacles.tracker import Key, ObstacleTracker
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.planning.streaming_planner import StreamingPlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import SelfFilter
from geodesic_motion_ros.utils.errors import RobotError

# A joint state that was lost is replaced by the next one. The queue is short, but a message to be refused must not push
# out the good one before it.
RECENT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
GOALS = QoSProfile(depth=10)


#: How often a cloud that waits for a joint state, or for a transform, looks for one [s].
_LOOK = 0.005
#: Goals wait in one queue for transforms: the newest counts, whichever topic it came on.
_GOAL = "goal"
#: The topic of what the hand holds.
HELD = "~/held_objects"
#: The topic of MoveIt's planning scene.
SCENE = "planning_scene"
#: Goals with this frame id are relative to the task frame, and move with it.
TASK_FRAME = "task_frame"


class PlannerInputs:
    """The subscriptions of the planner and what they have brought.

    Callbacks run in the executor and hold the lock for microseconds; `snapshot` is called by the control
    loop, which reads the joint states that have come. What a point cloud shows is worked out in a thread of its own,
    from `start` to `stop`; the arm is taken out of it where it was measured at the cloud's stamp.

    Attributes
    ----------
    frames : tells where frames other than the base frame stand.
    arming : whether the arm may be commanded.
    arm : what the joint states say. drive : what the arm's drive says that it commands.
    tracking_error : how far the arm may be from where it is taken to be [m]; declared : (b, 16) solids of the declared
        scene, which are taken out of clouds; who knows them sets them.
    noun : what a person calls that which the node is asked for.
    """

    noun = StreamingPlanner.noun

    def __init__(
        self,
        node: Node,
        parameters: NodeParameters,
        robot: Robot,
        skill_robot: str,
        changed: Callable[[], None],
        armed: bool = True,
    ) -> None:
        """robot : its names are those of messages; skill_robot : what the arm is called.
        changed : called when something new is known of obstacles, or is offered, from the thread that heard it.
        armed : as of `Arming`.
        """
        self._node, self._parameters, self._robot = node, parameters, robot
        self._changed = changed
        self._frame: str = parameters["base_frame"]
        self.refusals = RefusalLog(node.get_logger().warning)
        self._late = LateTransforms(node, self._frame)
        self.frames = frames_of(node, self.refusals, self._late.look)
        if parameters["camera_frame"]:
            place = np.array(parameters["camera_pose"])
            self.frames = FixedFrame(parameters["camera_frame"], (place[:3], place[3:]), self.frames)
        self._late.frames = self.frames
        self.time = NodeTime(node.get_clock())
        self._lock = threading.Lock()
        self.arming = Arming(armed, parameters["required_obstacle_topics"], self.noun)
        self._tracker = ObstacleTracker(self.arming.required)
        self._described = DescribedArm(robot, skill_robot, node.resolve_topic_name("robot_description"))
        self.arm = ArmState(robot, self.refusals, parameters["joint_prefix"])
        self._transit = TransitWatch()
        self.drive = ArmState(robot, self.refusals, parameters["joint_prefix"], DRIVE_TOPIC)
        self._goal: GoalRequest | OfferRequest | Refusal | None = None
        self._goal_number = 0
        self._withdrawn = 0, ""
        self._task_frame: tuple[np.ndarray, np.ndarray] | None = None
        self._task_frame_taken: float | None = None
        self._hold = False
        self._held: tuple[HeldObject, ...] = ()
        self._unknown_held: dict[str, str] = {}
        self._publishers: tuple[str, ...] = ()
        self._subscribers: tuple[str, ...] | None = None
        self._load = ObstacleLoad()
        self._cloud_figures = CloudFigures()
        self.tracking_error = 0.0
        self._self_filter = SelfFilter(robot, CollisionModel.named(skill_robot))
        self.declared = no_solids()
        self._seen: SeenCloud | None = None
        self._stopped = threading.Event()
        self._cloud_thread = CloudThread(self._see_cloud, self._take_cloud, self._cloud_failed)
        for topic, receive in (("joint_states", self.on_joint_states), (DRIVE_TOPIC, self.on_drive)):
            node.create_subscription(JointState, topic, receive, RECENT, raw=True)
        self._subscribe(String, "robot_description", lambda message: self._described.receive(message.data), LATCHED)
        self._subscribe_goals()
        # Markers are edits of a set: each of them is needed. Of points and clouds the next one replaces what was lost;
        # clouds are large, and only the newest counts.
        self._obstacle_topics: dict[str, ObstacleSubscription] = {}
        edits = {"depth": 50, "reliability": ReliabilityPolicy.RELIABLE, "raw": True}
        self._subscribe_obstacles(MarkerArray, "obstacles", self.on_obstacles, **edits)
        self._subscribe_obstacles(Marker, "obstacle_marker", self.on_marker, **edits)
        self._held_topic = ObstacleSubscription(node, MarkerArray, HELD, self.receive_held, **edits)
        self._scene = PlanningSceneReader(self._frame, robot.tool_link, self.frames)
        if (kind := extra("moveit_msgs/msg/PlanningScene")) is not None:
            scene = {"depth": 50, "reliability": ReliabilityPolicy.RELIABLE}
            self._subscribe_obstacles(kind, SCENE, self.on_planning_scene, **scene)
        best_effort = ReliabilityPolicy.BEST_EFFORT
        self._subscribe_obstacles(PointStamped, "obstacle_point", self.on_point, depth=10, reliability=best_effort)
        self._subscribe_obstacles(PointCloud2, "obstacle_cloud", self.on_cloud, depth=1, reliability=best_effort)

    def start(self) -> None:
        """Begin to look at point clouds."""
        self._cloud_thread.start()

    def stop(self) -> None:
        """End the thread that does so; harmless when it has ended or never began."""
        self._stopped.set()
        self._cloud_thread.stop()

    def snapshot(self) -> CycleInputs:
        """Return what is known now."""
        self.arm.update()
        self.drive.update()
        moment = self.time.read()
        now = moment.running
        joints, age = self.arm.joints, now - self.arm.taken
        with self._lock:
            goal, number, hold, withdrawn = self._goal, self._goal_number, self._hold, self._withdrawn
            transit = self._transit.longest(now)
            task_frame = self._task_frame
            publishers, subscribers = self._publishers, self._subscribers
            obstacles = self._tracker.current(now)
            timeout = self._parameters["obstacle_timeout"]
            silent, late = self._tracker.silent(now, timeout), self._tracker.late(now, timeout)
            unusable = self._tracker.unusable()
            held, held_refused = self._held, next(iter(self._unknown_held.values()), "")
        if self._parameters["obstacle_silence_policy"] == "keep":
            # a topic of which nothing is known leaves nothing to keep to
            silent, late = {}, {}
        return CycleInputs(
            measured=joints,
            state_age=age,
            goal=goal,
            goal_number=number,
            obstacles=obstacles,
            silent_sources=silent,
            late_sources=late,
            unusable_sources=unusable,
            hold=hold,
            task_frame=task_frame,
            publishers=publishers,
            subscribers=subscribers,
            now=moment.now,
            has_clock=moment.has_clock,
            clock_stood=moment.stood,
            heard=now,
            simulated=moment.simulated,
            set_by=moment.set_by,
            held=held,
            held_refused=held_refused,
            state_fault=self.arm.fault(now),
            drive=self.drive.joints,
            drive_age=now - self.drive.taken,
            transit=transit,
            unarmed=self.arming.unarmed,
            withdrawn=withdrawn,
            other_arm=self._described.fault,
        )

    def ages(self) -> dict[str, float]:
        """Return the seconds since the newest data of each input was taken."""
        now = self.time.running()
        with self._lock:
            ages = self._tracker.ages(now)
            if self.arm.joints is not None:
                ages["joint_states"] = now - self.arm.taken
            if self.drive.joints is not None:
                ages[DRIVE_TOPIC] = now - self.drive.taken
            if self._task_frame_taken is not None:
                ages["task_frame"] = now - self._task_frame_taken
        return ages

    def remarks(self) -> dict[str, str]:
        """Return what a person should know of inputs that are taken, by kind; to be asked once a second."""
        now = self.time.running()
        remarks = self.arm.remarks(now, self._parameters["state_timeout"])
        with self._lock:
            late = self._transit.remark(now)
        remarks |= {"late": late} if late else {}
        return remarks | ({"description": self._described.remark} if self._described.remark else {})

    def take_obstacle_load(self) -> tuple[int, Load]:
        """Return how many obstacles there are, and take the load of their messages since the last call."""
        with self._lock:
            count = len(self._tracker.current(self.time.running()))
        return count, self._load.take()

    def cloud_figures(self) -> CloudFigures:
        """Return the figures of the newest point cloud."""
        with self._lock:
            return self._cloud_figures

    def look_at_publishers(self) -> None:
        """Look who publishes obstacles: refuse topics on which somebody publishes messages of a type that never
        arrives, note what was latched by a publisher that has ended, and report two publishers that use one name.
        """
        for topic, subscription in self._obstacle_topics.items():
            for reason in subscription.other_types():
                with self._obstacle_guard(topic):
                    raise MessageRefused(reason)
            subscription.look_for_latching()
            self._set_publishers(topic)
        with self._lock:
            alternating = self._tracker.alternating(self.time.running())
        for label, places in alternating.items():
            at = " and ".join(str(np.round(place, 2).tolist()) for place in np.unique(places, axis=0)[:2])
            reason = f"{label}: two places alternate, {at} m: two publishers? Each needs a namespace of its own"
            self.refusals.add(label.split("/")[0], reason, prefix="a doubtful obstacle on")
        for reason in self._held_topic.other_types():
            with self.refusals.guard(HELD):
                raise MessageRefused(reason)

    def request_hold(self, hold: bool) -> None:
        """Take the request of a hold, or of its end."""
        with self._lock:
            self._hold = hold

    def set_nodes_on_commands(self, publishers: tuple[str, ...], subscribers: tuple[str, ...]) -> None:
        """Say which nodes publish the commands, and which receive them."""
        with self._lock:
            self._publishers, self._subscribers = publishers, subscribers

    def clear_obstacles(self) -> int:
        """Forget all obstacles and what was expected of their topics; returns how many there were."""
        self._cloud_thread.forget()
        self._scene.forget_objects()
        with self._lock:
            count = len(self._tracker.current(self.time.running()))
            self._tracker.clear()
            self._seen = None
        return count

    def _subscribe_goals(self) -> None:
        """Hear where the arm is to go."""
        origin = np.array(self._parameters["task_frame"])
        self._task_frame = origin[:3], origin[3:]
        self._subscribe(PoseStamped, "goal_pose", self._on_goal, GOALS, _GOAL)
        self._subscribe(JointState, "goal_joints", self._on_goal_joints, GOALS, _GOAL)
        self._subscribe(PoseStamped, "task_frame", self.on_task_frame, GOALS)

    def _subscribe(
        self, kind: type, topic: str, take: Callable[[Any], None], qos: QoSProfile, queue: str = "", raw: bool = False
    ) -> None:
        """queue : of messages that wait for transforms; "": that of the topic. raw : take gets bytes."""

        def receive(message: Any) -> None:
            with self.refusals.guard(topic):
                take(message)

        receive_in_turn = lambda message: self._late.take(queue or topic, partial(receive, message))  # noqa: E731
        self._node.create_subscription(kind, topic, receive_in_turn, qos, raw=raw)

    def _subscribe_obstacles(
        self, kind: type, topic: str, take: Callable[[Any], list[Key] | None], **offered: Any
    ) -> None:
        """take : returns the keys of the obstacles that a message puts. offered : depth, reliability and raw as of
        `ObstacleSubscription`.
        """

        def receive(message: Any) -> list[Key]:
            with self._load.count_time(), self._obstacle_guard(topic):
                return take(message) or []
            return []

        def receive_in_turn(message: Any) -> list[Key]:
            # Of a message that waits nobody answers for what it puts: it stays when its publisher ends.
            return self._late.take(topic, partial(receive, message)) or []

        def receive_latched(keys: list[Key], publishers: frozenset[str]) -> None:
            with self._lock:
                self._tracker.answer_for(topic, keys, publishers)

        def receive_end(publisher: str) -> None:
            with self._lock:
                self._tracker.end(topic, publisher, self.time.running())

        self._obstacle_topics[topic] = ObstacleSubscription(
            self._node, kind, topic, receive_in_turn, take_latched=receive_latched, take_end=receive_end, **offered
        )

    def _set_publishers(self, topic: str) -> None:
        nodes = self._obstacle_topics[topic].publishers
        with self._lock:
            self._tracker.set_publishers(topic, nodes)

    @contextmanager
    def _obstacle_guard(self, topic: str) -> Iterator[None]:
        """As `RefusalLog.guard`; what is refused here may be in the arm's path all the same."""
        with self.refusals.guard(topic) as guard:
            yield
        if guard.reason:
            with self._lock:
                self._tracker.refuse(topic, guard.reason)
            self._changed()

    def on_joint_states(self, message: bytes) -> None:
        """Take a serialised JointState."""
        moment = self.time.read()
        self.arm.receive(message, moment)
        with self._lock:
            self._transit.take(stamp_of(message), moment)

    def on_drive(self, message: bytes) -> None:
        """Take a serialised JointState of what the drive commands."""
        self.drive.receive(message, self.time.read())

    def request_goal(self, topic: str, message: PoseStamped | JointState, numbered: Callable[[int], None]) -> None:
        """Take a goal as if it came on a topic; only the thread that spins the node calls this. numbered : called with
        its number, whether it is refused or not.
        """
        take = {"goal_pose": self._on_goal, "goal_joints": self._on_goal_joints}[topic]

        def receive() -> None:
            with self.refusals.guard(topic):
                take(message, numbered)

        self._late.take(_GOAL, receive)

    def withdraw_goal(self, number: int, why: str) -> None:
        """Have a goal dropped, by its number, where it is still what the planner goes to."""
        with self._lock:
            self._withdrawn = number, why

    def _on_goal(self, message: PoseStamped, numbered: Callable[[int], None] = lambda _: None) -> None:
        in_task_frame = message.header.frame_id == TASK_FRAME
        if not in_task_frame:
            self._late.need([message.header])
        try:
            pose = Pose(*read_pose(message, TASK_FRAME if in_task_frame else self._frame, self.frames))
        except MessageRefused as error:
            numbered(self._set_goal(Refusal(VerdictCode.BAD_INPUT, f"goal_pose: {error}")))
            raise
        numbered(self._set_goal(GoalRequest(pose, in_task_frame)))

    def _on_goal_joints(self, message: JointState, numbered: Callable[[int], None] = lambda _: None) -> None:
        try:
            goal = GoalRequest(configuration=read_joint_positions(message, self._robot.joint_names))
        except MessageRefused as error:
            numbered(self._set_goal(Refusal(VerdictCode.BAD_INPUT, f"goal_joints: {error}")))
            raise
        numbered(self._set_goal(goal))

    def _set_goal(self, goal: GoalRequest | OfferRequest | Refusal) -> int:
        """Take a goal, and return its number."""
        with self._lock:
            self._goal = goal
            self._goal_number += 1
            return self._goal_number

    def on_task_frame(self, message: PoseStamped) -> None:
        """Take the pose of the task frame."""
        self._late.need([message.header])
        frame = read_pose(message, self._frame, self.frames)
        moment = self.time.read()
        with self._lock:
            self._task_frame = frame
            self._task_frame_taken = moment.running - max(0.0, moment.transit(seconds(message.header.stamp)))

    def on_obstacles(self, message: bytes) -> list[Key]:
        """Take obstacles, and return the keys of those that the message puts somewhere."""
        markers, updates, refused = parse_markers(message), [], ""
        self._late.need(marker.header for marker in markers if marker.action == Marker.ADD)
        self._load.count(len(markers))
        for marker in markers:
            # one bad marker must not hide the good ones beside it
            with self.refusals.guard("obstacles") as guard:
                updates.append(read_marker(marker, self._frame, self.frames))
            refused = guard.reason or refused
        self._take_updates("obstacles", updates, refused, is_whole=len(updates) == len(markers))
        return [update.key for update in updates if update.action == "put"]

    def _take_updates(self, source: str, updates: Sequence[MarkerUpdate], refused: str, is_whole: bool) -> None:
        """Take what a message asks of obstacles. refused : why not all of it; is_whole : whether it is all."""
        moment = self.time.read()
        # A marker without a stamp is as old as the newest one beside it: the DELETEALL that begins a message has none.
        newest = max((update.stamp for update in updates), default=0.0)
        with self._lock:
            if is_whole:
                # A scene that says nothing of objects, as of the robot's state, promises no further one.
                empty = source != SCENE and all(update.action == "nothing" for update in updates)
                self._tracker.hear(source, moment.running, moment.transit(newest), empty=empty)
            taken = [
                self._apply(source, update, moment.running, moment.transit(update.stamp or newest))
                for update in updates
            ]
            if refused:
                self._tracker.refuse(source, refused)
        self._count_overtaken(source, all(taken))
        self._changed()

    def receive_held(self, message: bytes) -> None:
        """Take all of a message, or nothing; the arm stands as long as anything that was to be attached is unknown."""
        markers = None
        with self.refusals.guard(HELD) as guard:
            markers = parse_markers(message)
            self._hold_objects(markers)
        self._note_unknown(markers, guard.reason)

    def _hold_objects(self, markers: Sequence[SeenMarker]) -> None:
        held = held_objects_after(markers, self._held, self._robot, self._unknown_held)
        with self._lock:
            self._held = held

    def _note_unknown(self, markers: Sequence[SeenMarker] | None, reason: str) -> None:
        with self._lock:
            self._unknown_held = unknown_objects_after(self._unknown_held, markers, reason)

    def on_planning_scene(self, message: Any) -> list[Key]:
        """Take a PlanningScene, and return the keys of the obstacles that it puts somewhere."""
        world, attached = message.world.collision_objects, message.robot_state.attached_collision_objects
        placing = [one for one in (*world, *(one.object for one in attached)) if one.operation != REMOVE]
        own = {self._frame, self._robot.tool_link}
        self._late.need(one.header for one in placing if one.header.frame_id.removeprefix("/") not in own)
        markers: list[SeenMarker] = []
        refused = ""
        if not message.is_diff:
            self._scene.forget_objects()
            markers.append(removal("", Stamp(0, 0)))
        for one in world:
            with self.refusals.guard(SCENE) as guard:
                markers += self._scene.changes(one)
            refused = guard.reason or refused
        for one in attached:
            markers += self._attach(one)
        self._load.count(len(markers))
        updates = []
        for marker in markers:
            with self.refusals.guard(SCENE) as guard:
                updates.append(read_marker(marker, self._frame))
            refused = guard.reason or refused
        self._take_updates(SCENE, updates, refused, is_whole=not refused)
        return [update.key for update in updates if update.action == "put"]

    def _attach(self, message: Any) -> list[SeenMarker]:
        """Take an AttachedCollisionObject, and return the markers of what that changes in the world."""
        joints, asked = self.arm.joints, None
        with self.refusals.guard(SCENE) as guard:
            tool = None if joints is None else TaskFrame(*self._robot.forward(joints))
            asked = self._scene.attachment(message, tool)
            self._hold_objects(asked.held)
            self._scene.attach(asked)
        # What could not be read is known by its name alone.
        unread = removal(message.object.id, Stamp(0, 0))._replace(action=Marker.ADD)
        self._note_unknown([unread] if asked is None else asked.held, guard.reason)
        return [] if asked is None or guard.reason else asked.obstacles

    def on_marker(self, message: bytes) -> list[Key]:
        """Take an obstacle, as `on_obstacles`, of one marker."""
        marker = parse_marker(message)
        self._late.need([marker.header])
        self._load.count(1)
        update = read_marker(marker, self._frame, self.frames)
        moment = self.time.read()
        with self._lock:
            taken = self._apply("obstacle_marker", update, moment.running, moment.transit(update.stamp))
        self._count_overtaken("obstacle_marker", taken)
        self._changed()
        return [update.key] if update.action == "put" else []

    def _apply(self, source: str, update: MarkerUpdate, now: float, transit: float) -> bool:
        """False where what was to be put was overtaken."""
        if update.action == "nothing":
            return True
        if update.action == "put":
            return self._tracker.put(
                source, update.key, update.centre, update.radius, now, update.lifetime, update.solid, transit
            )
        if update.action == "delete":
            self._tracker.delete(source, update.key, now, transit)
        else:
            self._tracker.delete_all(source, now, update.key[0], transit)
        return True

    def _count_overtaken(self, source: str, taken: bool) -> None:
        if not taken:
            self.refusals.add(source, "overtaken: its stamp is older than that of what was heard before")

    def on_point(self, message: PointStamped) -> None:
        """Take a point as an obstacle."""
        self._late.need([message.header])
        centre = read_point(message, self._frame, self.frames)
        radius, lifetime = self._parameters["obstacle_point_radius"], self._parameters["obstacle_lifetime"]
        moment = self.time.read()
        transit = moment.transit(seconds(message.header.stamp))
        with self._lock:
            taken = self._tracker.put(
                "obstacle_point", ("", 0), centre, radius, moment.running, transit=transit, forget_after=lifetime
            )
        self._count_overtaken("obstacle_point", taken)
        self._changed()

    def on_cloud(self, message: PointCloud2) -> None:
        """Take a point cloud."""
        # One that is of no use must not take the place of one that waits.
        if not self._late.may_come(message.header):
            frame_of(message.header, self._frame, self.frames)
        moment = self.time.read()
        heard = moment.running, moment.transit(seconds(message.header.stamp))
        self._cloud_thread.put((message, heard[0] - max(0.0, heard[1])), heard)

    def _see_cloud(self, heard: tuple[PointCloud2, float]) -> tuple[SeenCloud, CloudFigures] | None:
        """Read a cloud that was taken at a time [s, running]; None where it is refused, or the node ends."""
        message, taken = heard
        filters = self._parameters["self_filter"]
        if not self._wait_for_frame(message.header) or (filters and not self._wait_for_joints(taken)):
            return None
        with self._obstacle_guard("obstacle_cloud"):
            joints = self._joints_at(taken) if filters else None
            began = time.monotonic()
            points, not_finite = read_cloud(message, self._frame, self.frames)
            # A camera stands in the origin of its frame; of a cloud that somebody has carried nothing is known.
            frame = frame_of(message.header, self._frame, self.frames)
            viewpoint = frame.origin if np.any(frame.origin) else None
            edge = self._parameters["obstacle_cloud_voxel"]
            settings = CloudSettings(
                edge, self._parameters["obstacle_cloud_radius"], self._parameters["obstacle_cloud_thickness"],
                self._parameters["self_filter_padding"] + self.tracking_error,
            )  # fmt: skip
            with self._lock:
                held, before = self._held, self._seen
            seen = see_cloud(
                points, self._self_filter, joints, held, self.declared, settings, taken, before, viewpoint
            )
            figures = CloudFigures(
                seen.points, not_finite, seen.out_of_reach, seen.of_arm, seen.of_scene, seen.remembered,
                len(seen.clusters), time.monotonic() - began,
            )  # fmt: skip
            if seen.field.edge > edge:
                self._node.get_logger().warning(
                    f"obstacle_cloud: its points are so far apart that cubes of {seen.field.edge:.3f} m must do, not "
                    f"{edge:g} m: filter the cloud",
                    throttle_duration_sec=5.0,
                )
            return seen, figures
        return None

    def _wait_for_frame(self, header: Header) -> bool:
        """Wait a moment for where a frame stood; False where the node ends meanwhile."""
        begun = time.monotonic()
        while self._late.may_come(header) and time.monotonic() - begun < PATIENCE:
            if self._stopped.wait(_LOOK):
                return False
        return True

    def _wait_for_joints(self, taken: float) -> bool:
        """Wait for a joint state of a time [s, running] or later, as long as the arm moves on without one; False where
        the node ends meanwhile.
        """
        while not self.arm.history.reaches(taken):
            if self.time.running() - taken > self._parameters["state_timeout"]:
                break
            if self._stopped.wait(_LOOK):
                return False
        return True

    def _joints_at(self, taken: float) -> np.ndarray:
        """Interpolate the arm's joints (n,) [rad] at a time [s, running]; refused where they are not known."""
        try:
            return self.arm.history.at(taken, self._parameters["state_timeout"])
        except RobotError as error:
            raise MessageRefused(
                f"where the arm was at its stamp is unknown, and the arm cannot be taken out of it: {error}; stamp "
                "clouds and joint states by one clock, or set self_filter to false where no cloud shows the arm"
            ) from error

    def _take_cloud(self, made: tuple[SeenCloud, CloudFigures], heard: tuple[float, float]) -> None:
        """heard : when the cloud arrived, and its transit [s]."""
        seen, figures = made
        lifetime = self._parameters["obstacle_lifetime"]
        with self._lock:
            # What was an obstacle may be in the hand.
            moment = MOMENT if self._seen is None or seen.held == self._seen.held else 0.0
            taken = self._tracker.replace_cloud(
                "obstacle_cloud", seen.field, *heard, lifetime, seen.clusters, seen.around, moment, seen.memory.sight
            )
            if taken:
                self._cloud_figures, self._seen = replace(figures, number=self._cloud_figures.number + 1), seen
        self._count_overtaken("obstacle_cloud", taken)
        self._changed()

    def _cloud_failed(self, error: BaseException) -> None:
        reason = f"internal error, see the log: {error!r}"
        self.refusals.add("obstacle_cloud", reason)
        with self._lock:
            self._tracker.refuse("obstacle_cloud", reason)
        self._node.get_logger().error("".join(traceback.format_exception(error)), throttle_duration_sec=1.0)
