"""Markers to obstacles and what is to be seen to markers; reads and writes as `messages` does."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from scipy.spatial.transform import Rotation
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from geodesic_motion_ros.geometry.quaternions import from_rotation, to_rotation
from geodesic_motion_ros.geometry.shapes import solid_rows
from geodesic_motion_ros.nodes.marker_bytes import SeenMarker
from geodesic_motion_ros.nodes.messages import (
    FrameLookup,
    MessageRefused,
    base_only,
    check_number,
    checked_point,
    checked_quaternion,
    fill_pose,
    frame_of,
    seconds,
)
from geodesic_motion_ros.obstacles.tracker import Key
from geodesic_motion_ros.robot.held_objects import HeldObject, check_held
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import RobotError

_CLOUD = "which is not taken: publish its centres as a cloud on obstacle_cloud, as octomap does"
#: Types that show bodies but are not taken.
_OTHERS = {
    Marker.ARROW: "an arrow, or no type was set",
    Marker.MESH_RESOURCE: "a mesh, which is not taken",
    Marker.TRIANGLE_LIST: "triangles, which are not taken",
    Marker.LINE_STRIP: "a line, which is not taken",
    Marker.LINE_LIST: "lines, which are not taken",
    Marker.CUBE_LIST: f"a list of cubes, {_CLOUD}",
    Marker.SPHERE_LIST: f"a list of spheres, {_CLOUD}",
    Marker.POINTS: f"a list of points, {_CLOUD}",
}


@dataclass(frozen=True)
class MarkerUpdate:
    """The change that one marker asks for: `put`, `delete` or `delete_all`; `nothing` where it shows no body.

    To `put` belong a centre (3,) [m], the radius of a sphere [m], or the row (16,) of a solid (`geometry/shapes.py`),
    and a lifetime [s].
    """

    action: str
    key: Key
    stamp: float = 0.0
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    radius: float = 0.0
    lifetime: float = 0.0
    solid: np.ndarray | None = None


def read_marker(message: Marker | SeenMarker, base_frame: str, lookup: FrameLookup = base_only) -> MarkerUpdate:
    """Return an obstacle by (ns, id), as the base frame sees it, or its deletion.

    SPHERE has its diameter for scale [m], of an ellipsoid the largest. CUBE is a box with its sides for scale, turned
    by its orientation. CYLINDER has its diameter and its height along z for scale; it becomes a solid that holds it: a
    capsule as thick, whose axis is as long, so that it is longer by half a diameter at both ends, or the box around
    it, whichever has less volume.

    TEXT_VIEW_FACING is no body, and is passed over.

    DELETEALL empties one namespace, or the whole topic when `ns` is empty. A lifetime of zero means until
    deleted.
    """
    key, stamp = (message.ns, int(message.id)), seconds(message.header.stamp)
    if message.action == Marker.DELETEALL:
        return MarkerUpdate("delete_all", key, stamp)
    if message.action == Marker.DELETE:
        return MarkerUpdate("delete", key, stamp)
    name = f"marker {message.ns}/{message.id}"
    if message.action != Marker.ADD:  # MODIFY has the same number
        raise MessageRefused(f"{name}: action {message.action}, expected ADD (0), DELETE (2) or DELETEALL (3)")
    if message.type == Marker.TEXT_VIEW_FACING:
        return MarkerUpdate("nothing", key, stamp)
    _check_type(message, name)
    frame = frame_of(message.header, base_frame, lookup)
    centre, scale = checked_point(message.pose.position, f"{name}: centre"), _checked_scale(message, name)
    lifetime = message.lifetime.sec + 1e-9 * message.lifetime.nanosec
    if lifetime < 0.0:
        raise MessageRefused(f"{name}: lifetime {lifetime} s, expected 0 (for ever) or more")
    if message.type == Marker.SPHERE:
        return MarkerUpdate("put", key, stamp, frame.points_to_base(centre), 0.5 * max(scale), lifetime)
    half_extents, radius = _box_or_capsule(message.type, 0.5 * np.array(scale))
    centre, quaternion = frame.to_base(centre, checked_quaternion(message.pose, f"{name}: orientation"))
    rotation = to_rotation(quaternion).as_matrix()
    solid = solid_rows(centre[None], rotation[None], half_extents[None], np.array([radius]))[0]
    return MarkerUpdate("put", key, stamp, centre, lifetime=lifetime, solid=solid)


def _check_type(message: Marker | SeenMarker, name: str) -> None:
    if message.type not in (Marker.SPHERE, Marker.CUBE, Marker.CYLINDER):
        other = f", {_OTHERS[message.type]}" if message.type in _OTHERS else ""
        raise MessageRefused(
            f"{name}: type {message.type}{other}, expected SPHERE ({Marker.SPHERE}), CUBE ({Marker.CUBE}) or "
            f"CYLINDER ({Marker.CYLINDER})"
        )


def _checked_scale(message: Marker | SeenMarker, name: str) -> tuple[float, float, float]:
    """Diameters or sides [m]."""
    scale = (message.scale.x, message.scale.y, message.scale.z)
    for value in scale:
        check_number(value, f"{name}: scale", "m")
    if min(scale) <= 0.0:
        raise MessageRefused(f"{name}: scale {scale} m holds diameters or sides, which must be positive")
    return scale


def held_name(message: Marker | SeenMarker) -> str:
    """Return what the object of a marker is called."""
    return f"{message.ns}/{message.id}"


def unknown_objects_after(
    unknown: Mapping[str, str], messages: Sequence[Marker | SeenMarker] | None, refusal: str
) -> dict[str, str]:
    """Return objects of which it is not known whether and how they are held, by name, each with the reason.

    A refused message makes those unknown that it was to attach, one that cannot be read (None) whatever it was about,
    which is called ""; one that was taken makes those known that it names: attached, or detached by DELETE or
    DELETEALL.
    """
    if messages is None:
        return {**unknown, "": refusal}
    detaching = Marker.DELETE, Marker.DELETEALL
    if refusal:
        return {**unknown, **{held_name(one): refusal for one in messages if one.action not in detaching}}
    named = {held_name(one) for one in messages if one.action != Marker.DELETEALL}
    cleared = {one.ns for one in messages if one.action == Marker.DELETEALL}
    return {
        name: reason for name, reason in unknown.items()
        if "" not in cleared and name not in named and name.rpartition("/")[0] not in cleared
    }  # fmt: skip


def held_objects_after(
    messages: Sequence[Marker | SeenMarker],
    held: Sequence[HeldObject],
    robot: Robot,
    unknown: Collection[str] = (),
) -> tuple[HeldObject, ...]:
    """Return what a robot's hand holds after markers, where it held something before; objects are called `ns/id`.

    unknown : names of which it is not known whether they are held: they may be detached.

    ADD attaches an object, or replaces the one of its name; DELETE detaches it, DELETEALL those of a namespace, or all
    where `ns` is empty. Shapes as of `read_marker`, but a CYLINDER is one; the frame must be the tool's.

    All of them are refused where one cannot be used: no shape, a mesh, another frame, a lifetime, two objects of one
    name, an object that is larger than the arm, a DELETE of what is not held.
    """
    objects = {one.name: one for one in held}
    attached: set[str] = set()
    for message in messages:
        name = held_name(message)
        if message.action == Marker.DELETEALL:
            objects = {key: one for key, one in objects.items() if message.ns and key.rpartition("/")[0] != message.ns}
        elif message.action == Marker.DELETE:
            if name not in objects and name not in unknown:
                raise MessageRefused(f"marker {name}: nothing of this name is held; held: {', '.join(objects) or '-'}")
            objects.pop(name, None)
        elif name in attached:
            raise MessageRefused(f"marker {name}: two held objects have this ns and id; each needs its own")
        else:
            objects[name] = _read_held(message, name, robot.tool_link)
            attached.add(name)
    try:
        check_held(list(objects.values()), robot)
    except RobotError as error:
        raise MessageRefused(str(error)) from error
    return tuple(objects.values())


def _read_held(message: Marker | SeenMarker, name: str, tool_frame: str) -> HeldObject:
    """The object that a marker attaches."""
    subject = f"marker {name}"
    if message.action != Marker.ADD:
        raise MessageRefused(f"{subject}: action {message.action}, expected ADD (0), DELETE (2) or DELETEALL (3)")
    _check_type(message, subject)
    if message.header.frame_id.removeprefix("/") != tool_frame:
        raise MessageRefused(
            f"{subject}: frame '{message.header.frame_id}': what is held stands in the tool frame: send it in "
            f"'{tool_frame}'"
        )
    lifetime = seconds(message.lifetime)
    if lifetime != 0.0:
        raise MessageRefused(f"{subject}: lifetime {lifetime:g} s, expected 0: it is held until DELETE")
    centre, scale = checked_point(message.pose.position, f"{subject}: centre"), _checked_scale(message, subject)
    quaternion = checked_quaternion(message.pose, f"{subject}: orientation")
    shape, dimensions = {
        Marker.SPHERE: ("sphere", (0.5 * max(scale),)),
        Marker.CUBE: ("box", scale),
        Marker.CYLINDER: ("cylinder", (0.5 * max(scale[:2]), scale[2])),
    }[message.type]
    return HeldObject(name, shape, dimensions, tuple(centre.tolist()), tuple(quaternion.tolist()))


def _box_or_capsule(kind: int, half_sides: np.ndarray) -> tuple[np.ndarray, float]:
    """Half extents (3,) and radius [m] of the solid that holds a CUBE or CYLINDER with half sides (3,) [m]."""
    thick, half_height = float(max(half_sides[:2])), half_sides[2]
    box = 8.0 * float(np.prod(half_sides))
    capsule = math.pi * thick**2 * (2.0 * half_height + 4.0 / 3.0 * thick)
    if kind == Marker.CYLINDER and capsule < box:
        return np.array([0.0, 0.0, half_height]), thick
    return half_sides, 0.0


Colour = tuple[float, float, float, float]


def sphere_marker(
    namespace: str, number: int, centre: np.ndarray, radius: float, colour: Colour, frame: str, stamp: Time
) -> Marker:
    """Return a SPHERE of a radius [m]."""
    marker = _marker(namespace, number, Marker.SPHERE, colour, frame, stamp)
    marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = (float(value) for value in centre)
    marker.scale.x = marker.scale.y = marker.scale.z = 2.0 * float(radius)
    return marker


def solid_marker(namespace: str, number: int, solid: np.ndarray, colour: Colour, frame: str, stamp: Time) -> Marker:
    """Return a solid (16,) (`geometry/shapes.py`): a capsule as the CYLINDER around it, others as the CUBE."""
    half_extents, radius = solid[3:6], solid[6]
    kind = Marker.CUBE if np.any(half_extents[:2]) else Marker.CYLINDER
    marker = _marker(namespace, number, kind, colour, frame, stamp)
    fill_pose(marker.pose, solid[:3], from_rotation(Rotation.from_matrix(solid[7:].reshape(3, 3))))
    marker.scale.x, marker.scale.y, marker.scale.z = (2.0 * float(half + radius) for half in half_extents)
    return marker


def held_marker(
    number: int, held: HeldObject, position: np.ndarray, quaternion: np.ndarray, colour: Colour, frame: str, stamp: Time
) -> Marker:
    """Return a held object whose centre and axes are at a pose (3,) [m], (4,)."""
    kind = {"sphere": Marker.SPHERE, "box": Marker.CUBE, "cylinder": Marker.CYLINDER}[held.shape]
    marker = _marker("held", number, kind, colour, frame, stamp)
    fill_pose(marker.pose, position, quaternion)
    marker.scale.x, marker.scale.y, marker.scale.z = (float(side) for side in held.sides)
    return marker


def cubes_marker(namespace: str, centres: np.ndarray, edge: float, colour: Colour, frame: str, stamp: Time) -> Marker:
    """Return a CUBE_LIST of cubes of one edge [m] at centres (n, 3) [m]."""
    marker = _marker(namespace, 0, Marker.CUBE_LIST, colour, frame, stamp)
    marker.scale.x = marker.scale.y = marker.scale.z = float(edge)
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in centres.tolist()]
    return marker


def line_marker(namespace: str, points: np.ndarray, width: float, colour: Colour, frame: str, stamp: Time) -> Marker:
    """Return a LINE_STRIP through points (n, 3) [m]."""
    marker = _marker(namespace, 0, Marker.LINE_STRIP, colour, frame, stamp)
    marker.scale.x = float(width)
    marker.points = [Point(x=x, y=y, z=z) for x, y, z in points.tolist()]
    return marker


def deletion_marker(namespace: str, number: int, frame: str, stamp: Time) -> Marker:
    """Return the marker that deletes another one."""
    header = Header(frame_id=frame, stamp=stamp)
    return Marker(header=header, ns=namespace, id=int(number), action=Marker.DELETE)


def _marker(namespace: str, number: int, kind: int, colour: Colour, frame: str, stamp: Time) -> Marker:
    marker = Marker(header=Header(frame_id=frame, stamp=stamp), ns=namespace, id=int(number), type=int(kind))
    marker.pose.orientation.w = 1.0
    red, green, blue, alpha = (float(part) for part in colour)
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    return marker


class MarkerScene:
    """The markers to be seen, as updates: everything seen before and no more is deleted by (ns, id)."""

    def __init__(self, frame: str) -> None:
        self._frame = frame
        self._shown: set[Key] = set()

    def update(self, markers: Sequence[Marker], stamp: Time) -> MarkerArray:
        """Return the update that shows markers, and deletes those that are not among them."""
        wanted = {(marker.ns, marker.id) for marker in markers}
        deletions = [deletion_marker(*key, self._frame, stamp) for key in sorted(self._shown - wanted)]
        self._shown = wanted
        return MarkerArray(markers=[*markers, *deletions])
