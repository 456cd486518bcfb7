"""Hear of obstacles, and of what the hand holds, on every topic: messages are checked, and put together."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import PointStamped
from rclpy.qos import ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.arm_state import ArmState
from geodesic_motion_ros.nodes.cloud_input import CloudInput
from geodesic_motion_ros.nodes.extras import extra
from geodesic_motion_ros.nodes.listener import Listener
from geodesic_motion_ros.nodes.marker_bytes import SeenMarker, parse_marker, parse_markers
from geodesic_motion_ros.nodes.marker_messages import (
    MarkerUpdate,
    held_objects_after,
    read_marker,
    unknown_objects_after,
)
from geodesic_motion_ros.nodes.messages import MessageRefused, read_point, seconds
from geodesic_motion_ros.nodes.obstacle_load import Load, ObstacleLoad
from geodesic_motion_ros.nodes.obstacle_subscription import ObstacleSubscription
from geodesic_motion_ros.nodes.plain_cdr import Stamp
from geodesic_motion_ros.nodes.planning_scene import REMOVE, PlanningSceneReader, removal
from geodesic_motion_ros.nodes.seen_cloud import SeenCloud
from geodesic_motion_ros.obstacles.tracker import Key, ObstacleSet, ObstacleTracker
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.self_filter import SelfFilter

#: The topic of what the hand holds.
HELD = "~/held_objects"
#: The topic of MoveIt's planning scene.
SCENE = "planning_scene"


class KnownObstacles(NamedTuple):
    """Obstacles and held objects that are known at a time, as `CycleInputs` has them."""

    obstacles: ObstacleSet
    silent_sources: dict[str, float]
    late_sources: dict[str, float]
    unusable_sources: dict[str, str]
    held: tuple[HeldObject, ...]
    held_refused: str


class ObstacleInputs:
    """The topics of obstacles and of what the hand holds, and what they have brought.

    Attributes
    ----------
    clouds : what point clouds show.
    """

    def __init__(
        self,
        listener: Listener,
        robot: Robot,
        arm: ArmState,
        self_filter: SelfFilter,
        required: Sequence[str],
        changed: Callable[[], None],
    ) -> None:
        """arm : tells where the arm is. self_filter : takes the arm out of clouds. required : topics that must be
        heard. changed : called when something new is known, from the thread that heard it.
        """
        self._listener, self._robot, self._arm, self._changed = listener, robot, arm, changed
        self._parameters, self._refusals, self._late = listener.parameters, listener.refusals, listener.late
        self._frame, self._frames = listener.base_frame, listener.frames
        self._lock = threading.Lock()
        self._tracker = ObstacleTracker(required)
        self._held: tuple[HeldObject, ...] = ()
        self._unknown_held: dict[str, str] = {}
        self._load = ObstacleLoad()
        guard = partial(self._guard, "obstacle_cloud")
        self.clouds = CloudInput(listener, arm, self_filter, lambda: self._held, guard, self._take_cloud, changed)
        # Markers are edits of a set: each of them is needed. Of points and clouds the next one replaces what was lost;
        # clouds are large, and only the newest counts.
        self._topics: dict[str, ObstacleSubscription] = {}
        edits = {"depth": 50, "reliability": ReliabilityPolicy.RELIABLE, "raw": True}
        self._subscribe(MarkerArray, "obstacles", self.on_obstacles, **edits)
        self._subscribe(Marker, "obstacle_marker", self.on_marker, **edits)
        self._held_topic = ObstacleSubscription(listener.node, MarkerArray, HELD, self.receive_held, **edits)
        self._scene = PlanningSceneReader(self._frame, robot.tool_link, listener.frames)
        if (kind := extra("moveit_msgs/msg/PlanningScene")) is not None:
            scene = {"depth": 50, "reliability": ReliabilityPolicy.RELIABLE}
            self._subscribe(kind, SCENE, self.on_planning_scene, **scene)
        best_effort = ReliabilityPolicy.BEST_EFFORT
        self._subscribe(PointStamped, "obstacle_point", self.on_point, depth=10, reliability=best_effort)
        self._subscribe(PointCloud2, "obstacle_cloud", self.clouds.on_cloud, depth=1, reliability=best_effort)

    def known(self, now: float) -> KnownObstacles:
        """Return what is known at a time [s, running]."""
        timeout = self._parameters["obstacle_timeout"]
        with self._lock:
            tracker, unknown = self._tracker, next(iter(self._unknown_held.values()), "")
            silent, late = tracker.silent(now, timeout), tracker.late(now, timeout)
            if self._parameters["obstacle_silence_policy"] == "keep":
                # a topic of which nothing is known leaves nothing to keep to
                silent, late = {}, {}
            return KnownObstacles(tracker.current(now), silent, late, tracker.unusable(), self._held, unknown)

    def ages(self, now: float) -> dict[str, float]:
        """Return the seconds since the newest data of each topic was taken, at a time [s, running]."""
        with self._lock:
            return self._tracker.ages(now)

    def take_load(self) -> tuple[int, Load]:
        """Return how many obstacles there are, and take the load of their messages since the last call."""
        with self._lock:
            count = len(self._tracker.current(self._listener.time.running()))
        return count, self._load.take()

    def look_at_publishers(self) -> None:
        """Look who publishes obstacles: refuse topics on which somebody publishes messages of a type that never
        arrives, note what was latched by a publisher that has ended, and report two publishers that use one name.
        """
        for topic, subscription in self._topics.items():
            for reason in subscription.other_types():
                with self._guard(topic):
                    raise MessageRefused(reason)
            subscription.look_for_latching()
            nodes = subscription.publishers
            with self._lock:
                self._tracker.set_publishers(topic, nodes)
        with self._lock:
            alternating = self._tracker.alternating(self._listener.time.running())
        for label, places in alternating.items():
            at = " and ".join(str(np.round(place, 2).tolist()) for place in np.unique(places, axis=0)[:2])
            reason = f"{label}: two places alternate, {at} m: two publishers? Each needs a namespace of its own"
            self._refusals.add(label.split("/")[0], reason, prefix="a doubtful obstacle on")
        for reason in self._held_topic.other_types():
            with self._refusals.guard(HELD):
                raise MessageRefused(reason)

    def clear(self) -> int:
        """Forget all obstacles and what was expected of their topics; returns how many there were."""
        self.clouds.forget()
        self._scene.forget_objects()
        with self._lock:
            count = len(self._tracker.current(self._listener.time.running()))
            self._tracker.clear()
        return count

    def _subscribe(self, kind: type, topic: str, take: Callable[[Any], list[Key] | None], **offered: Any) -> None:
        """take : returns the keys of the obstacles that a message puts. offered : depth, reliability and raw as of
        `ObstacleSubscription`.
        """

        def receive(message: Any) -> list[Key]:
            with self._load.count_time(), self._guard(topic):
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
                self._tracker.end(topic, publisher, self._listener.time.running())

        self._topics[topic] = ObstacleSubscription(
            self._listener.node, kind, topic, receive_in_turn, take_latched=receive_latched, take_end=receive_end,
            **offered,
        )  # fmt: skip

    @contextmanager
    def _guard(self, topic: str) -> Iterator[None]:
        """As `RefusalLog.guard`; what is refused here may be in the arm's path all the same."""
        with self._refusals.guard(topic) as guard:
            yield
        if guard.reason:
            with self._lock:
                self._tracker.refuse(topic, guard.reason)
            self._changed()

    def on_obstacles(self, message: bytes) -> list[Key]:
        """Take obstacles, and return the keys of those that the message puts somewhere."""
        markers, updates, refused = parse_markers(message), [], ""
        self._late.need(marker.header for marker in markers if marker.action == Marker.ADD)
        self._load.count(len(markers))
        for marker in markers:
            # one bad marker must not hide the good ones beside it
            with self._refusals.guard("obstacles") as guard:
                updates.append(read_marker(marker, self._frame, self._frames))
            refused = guard.reason or refused
        self._take_updates("obstacles", updates, refused, is_whole=len(updates) == len(markers))
        return [update.key for update in updates if update.action == "put"]

    def _take_updates(self, source: str, updates: Sequence[MarkerUpdate], refused: str, is_whole: bool) -> None:
        """Take what a message asks of obstacles. refused : why not all of it; is_whole : whether it is all."""
        moment = self._listener.time.read()
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
        with self._refusals.guard(HELD) as guard:
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
            with self._refusals.guard(SCENE) as guard:
                markers += self._scene.changes(one)
            refused = guard.reason or refused
        for one in attached:
            markers += self._attach(one)
        self._load.count(len(markers))
        updates = []
        for marker in markers:
            with self._refusals.guard(SCENE) as guard:
                updates.append(read_marker(marker, self._frame))
            refused = guard.reason or refused
        self._take_updates(SCENE, updates, refused, is_whole=not refused)
        return [update.key for update in updates if update.action == "put"]

    def _attach(self, message: Any) -> list[SeenMarker]:
        """Take an AttachedCollisionObject, and return the markers of what that changes in the world."""
        joints, asked = self._arm.joints, None
        with self._refusals.guard(SCENE) as guard:
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
        update = read_marker(marker, self._frame, self._frames)
        moment = self._listener.time.read()
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
            self._refusals.add(source, "overtaken: its stamp is older than that of what was heard before")

    def on_point(self, message: PointStamped) -> None:
        """Take a point as an obstacle."""
        self._late.need([message.header])
        centre = read_point(message, self._frame, self._frames)
        radius, lifetime = self._parameters["obstacle_point_radius"], self._parameters["obstacle_lifetime"]
        moment = self._listener.time.read()
        transit = moment.transit(seconds(message.header.stamp))
        with self._lock:
            taken = self._tracker.put(
                "obstacle_point", ("", 0), centre, radius, moment.running, transit=transit, forget_after=lifetime
            )
        self._count_overtaken("obstacle_point", taken)
        self._changed()

    def _take_cloud(self, seen: SeenCloud, heard: tuple[float, float], moment: float) -> bool:
        """As of `CloudInput`."""
        lifetime = self._parameters["obstacle_lifetime"]
        with self._lock:
            taken = self._tracker.replace_cloud(
                "obstacle_cloud", seen.field, *heard, lifetime, seen.clusters, seen.around, moment, seen.memory.sight
            )
        self._count_overtaken("obstacle_cloud", taken)
        return taken
