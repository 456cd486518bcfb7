"""MoveIt's planning scene as markers: its boxes, spheres and cylinders become obstacles and held objects, by the code
that takes markers. Marker `ID/n` is the n-th shape of the object ID.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Pose
from shape_msgs.msg import SolidPrimitive
from visualization_msgs.msg import Marker

from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.marker_bytes import Place, SeenMarker, Tint, Turn, Vector
from geodesic_motion_ros.nodes.messages import (
    FrameLookup,
    MessageRefused,
    check_number,
    checked_point,
    checked_quaternion,
    frame_of,
)
from geodesic_motion_ros.nodes.plain_cdr import Stamp, StampedFrame

#: Operations on objects, as moveit_msgs/CollisionObject numbers them: a field of one byte is one of these here.
ADD, REMOVE, APPEND, MOVE = (bytes([number]) for number in range(4))
_NAMES = {SolidPrimitive.CONE: "a cone", SolidPrimitive.PRISM: "a prism"}
_NO_POINTS = np.zeros((0, 3))
_UNSEEN = Tint(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Shape:
    """A shape of an object: the type of its marker, that marker's scale [m], and its place in the object."""

    kind: int
    scale: tuple[float, float, float]
    place: TaskFrame


@dataclass(frozen=True)
class SceneObject:
    """An object: where it stands in a frame, and its shapes."""

    name: str
    place: TaskFrame
    shapes: tuple[Shape, ...]

    def within(self, frame: TaskFrame) -> SceneObject:
        """Return the same object as the frame sees it that the given one stands in."""
        return replace(self, place=TaskFrame(*frame.to_base(self.place.origin, self.place.quaternion)))

    def seen_from(self, frame: TaskFrame) -> SceneObject:
        """Return the same object as a frame sees it that stands in the same one as the object."""
        return replace(self, place=TaskFrame(*frame.to_task(self.place.origin, self.place.quaternion)))

    def markers(self, frame: str, stamp: Stamp) -> list[SeenMarker]:
        """Return the markers that show it in a frame, by its name."""
        return [
            _marker(self.name, number, Marker.ADD, frame, stamp, shape, self.place)
            for number, shape in enumerate(self.shapes)
        ]


def removal(name: str, stamp: Stamp) -> SeenMarker:
    """Return the marker that removes an object, or all where the name is empty."""
    return _marker(name, 0, Marker.DELETEALL, "", stamp, Shape(0, (0.0, 0.0, 0.0), _IDENTITY), _IDENTITY)


_IDENTITY = TaskFrame.identity()


def _marker(
    name: str, number: int, action: int, frame: str, stamp: Stamp, shape: Shape, place: TaskFrame
) -> SeenMarker:
    (x, y, z), (w, *turn) = (
        part.tolist() for part in place.to_base(shape.place.origin, shape.place.quaternion)
    )  # fmt: skip
    pose = Place(Vector(x, y, z), Turn(*turn, w))
    return SeenMarker(
        StampedFrame(stamp, frame), name, number, shape.kind, action, pose, Vector(*shape.scale), _UNSEEN, Stamp(0, 0),
        _NO_POINTS,
    )  # fmt: skip


def read_object(message: Any, base_frame: str, lookup: FrameLookup, before: SceneObject | None) -> SceneObject:
    """Return the object that a CollisionObject puts somewhere (ADD, APPEND, MOVE), as the base frame sees it.

    before : what the scene has of its name. Refused are meshes, planes, cones and prisms, and a MOVE of what is not
    there.
    """
    subject = f"object '{message.id}'"
    frame = frame_of(message.header, base_frame, lookup)
    place = TaskFrame(*frame.to_base(*_pose(message.pose, subject)))
    shapes = _shapes(message, subject)
    if message.operation == MOVE:
        if before is None:
            raise MessageRefused(f"{subject}: MOVE of what is not in the scene")
        if shapes:
            raise MessageRefused(f"{subject}: MOVE with shapes; it is for the pose alone")
        return replace(before, place=place)
    if message.operation == APPEND and before is not None:
        # Its new shapes stand where the object does.
        there = (
            replace(shape, place=TaskFrame(*before.place.to_task(*_placed(shape, place)))) for shape in shapes
        )
        return replace(before, shapes=(*before.shapes, *there))
    if message.operation not in (ADD, APPEND):
        asked = message.operation[0]
        raise MessageRefused(f"{subject}: operation {asked}, expected ADD, REMOVE, APPEND or MOVE (0 to 3)")
    if not shapes:
        raise MessageRefused(f"{subject}: it has no shapes")
    return SceneObject(message.id, place, shapes)


def _placed(shape: Shape, place: TaskFrame) -> tuple[np.ndarray, np.ndarray]:
    return place.to_base(shape.place.origin, shape.place.quaternion)


def _shapes(message: Any, subject: str) -> tuple[Shape, ...]:
    for field in ("meshes", "planes"):
        if getattr(message, field):
            raise MessageRefused(f"{subject}: {field} are not taken; expected boxes, spheres and cylinders")
    primitives, poses = message.primitives, message.primitive_poses
    if len(poses) not in (0, len(primitives)):
        raise MessageRefused(f"{subject}: {len(primitives)} primitives and {len(poses)} poses: one each, or no poses")
    placed = poses or [None] * len(primitives)
    return tuple(_shape(one, pose, subject) for one, pose in zip(primitives, placed, strict=True))


def _shape(primitive: SolidPrimitive, pose: Pose | None, subject: str) -> Shape:
    place = _IDENTITY if pose is None else TaskFrame(*_pose(pose, subject))
    lengths, kind = list(primitive.dimensions), primitive.type
    wanted = {SolidPrimitive.BOX: 3, SolidPrimitive.SPHERE: 1, SolidPrimitive.CYLINDER: 2}
    if kind not in wanted:
        raise MessageRefused(
            f"{subject}: {_NAMES.get(kind, f'a primitive of type {kind}')} is not taken; expected boxes, spheres and "
            "cylinders"
        )
    if len(lengths) < wanted[kind]:
        raise MessageRefused(f"{subject}: a primitive has {len(lengths)} dimensions, expected {wanted[kind]}")
    for length in lengths[: wanted[kind]]:
        check_number(length, f"{subject}: a dimension", "m")
    if kind == SolidPrimitive.BOX:
        return Shape(Marker.CUBE, (lengths[0], lengths[1], lengths[2]), place)
    if kind == SolidPrimitive.SPHERE:
        return Shape(Marker.SPHERE, (2.0 * lengths[0],) * 3, place)
    height, radius = lengths[SolidPrimitive.CYLINDER_HEIGHT], lengths[SolidPrimitive.CYLINDER_RADIUS]
    return Shape(Marker.CYLINDER, (2.0 * radius, 2.0 * radius, height), place)


def _pose(pose: Pose, subject: str) -> tuple[np.ndarray, np.ndarray]:
    """Position and unit quaternion; one that was not filled in, all zero, is no rotation, as MoveIt takes it."""
    position, turn = checked_point(pose.position, f"{subject}: position"), pose.orientation
    if (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 0.0):
        return position, _IDENTITY.quaternion
    return position, checked_quaternion(pose, f"{subject}: orientation")


class Attachment(NamedTuple):
    """What an AttachedCollisionObject asks for: markers of held objects and of obstacles, and the objects of the scene
    and of the hand after that.
    """

    held: list[SeenMarker]
    obstacles: list[SeenMarker]
    objects_after: dict[str, SceneObject]
    held_after: dict[str, SceneObject]


class PlanningSceneReader:
    """The objects of a scene, and what its messages change in them.

    `changes` and `attachment` return what the code of markers is to take; they raise MessageRefused, and change nothing
    then.
    """

    def __init__(self, base_frame: str, tool_frame: str, lookup: FrameLookup) -> None:
        self._base_frame, self._tool_frame, self._lookup = base_frame, tool_frame, lookup
        self._objects: dict[str, SceneObject] = {}
        self._held: dict[str, SceneObject] = {}

    def forget_objects(self) -> None:
        """Have no objects, as before a whole scene."""
        self._objects.clear()

    def changes(self, message: Any) -> list[SeenMarker]:
        """Return the markers that a CollisionObject of the world stands for."""
        stamp = Stamp(message.header.stamp.sec, message.header.stamp.nanosec)
        if message.operation == REMOVE:
            if not message.id:
                self.forget_objects()
            self._objects.pop(message.id, None)
            return [removal(message.id, stamp)]
        before = self._objects.get(message.id)
        made = self._objects[message.id] = read_object(message, self._base_frame, self._lookup, before)
        surplus = [] if before is None else before.markers(self._base_frame, stamp)[len(made.shapes) :]
        return [*made.markers(self._base_frame, stamp), *(one._replace(action=Marker.DELETE) for one in surplus)]

    def attachment(self, message: Any, tool: TaskFrame | None) -> Attachment:
        """Return what an AttachedCollisionObject asks for, which `attach` then does.

        tool : where the tool is in the base frame; None: that is not known. Without shapes the object of the scene is
        attached where it stands; what is detached stays where it is then.
        """
        wanted, objects, hand = message.object, dict(self._objects), dict(self._held)
        stamp = Stamp(wanted.header.stamp.sec, wanted.header.stamp.nanosec)
        if wanted.operation == REMOVE:
            left = [hand.pop(name).within(_known(tool, name)) for name in self._held if wanted.id in ("", name)]
            objects |= {one.name: one for one in left}
            around = [marker for one in left for marker in one.markers(self._base_frame, stamp)]
            return Attachment([removal(wanted.id, stamp)], around, objects, hand)
        if message.link_name.removeprefix("/") != self._tool_frame:
            raise MessageRefused(
                f"object '{wanted.id}': attached to '{message.link_name}': what is held is attached to "
                f"'{self._tool_frame}'"
            )
        made = hand[wanted.id] = self._to_attach(wanted, tool)
        around = [] if objects.pop(wanted.id, None) is None else [removal(wanted.id, stamp)]
        held = [removal(wanted.id, stamp), *made.markers(self._tool_frame, Stamp(0, 0))]
        return Attachment(held, around, objects, hand)

    def attach(self, attachment: Attachment) -> None:
        """Have the objects as they are after an attachment."""
        self._objects, self._held = attachment.objects_after, attachment.held_after

    def _to_attach(self, wanted: Any, tool: TaskFrame | None) -> SceneObject:
        """An object as the tool sees it."""
        in_tool_frame = wanted.header.frame_id.removeprefix("/") == self._tool_frame
        if wanted.primitives and in_tool_frame:
            return read_object(wanted, self._tool_frame, self._lookup, None)
        there = self._objects.get(wanted.id)
        if wanted.primitives or wanted.meshes or wanted.planes:
            there = read_object(wanted, self._base_frame, self._lookup, None)
        if there is None:
            raise MessageRefused(f"object '{wanted.id}': it has no shapes, and is not in the scene")
        return there.seen_from(_known(tool, wanted.id))


def _known(tool: TaskFrame | None, name: str) -> TaskFrame:
    if tool is None:
        raise MessageRefused(f"object '{name}': where the tool is is not known yet")
    return tool
