"""Messages to arrays and arrays to messages; those of markers stand in `marker_messages`.

Readers check everything a message claims (finite, sizes, frame, names) and raise `MessageRefused` with the
reason; what they return may be trusted. Quaternions are reordered here, from (x, y, z, w) to the library's
(w, x, y, z) and back. Writers convert every scalar by `float()` and every array by `tolist()` or
`array.array`: rclpy does not check field types by default, and a numpy scalar in a field is published as
garbage, silently.
"""

from __future__ import annotations

import array
import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PointStamped, Pose, PoseStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import Image, JointState, PointCloud2, PointField
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.point_clouds import carry_finite
from geodesic_motion_ros.geometry.quaternions import normalise, to_rotation
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.trajectory.trajectory_player import JointWaypoints
from geodesic_motion_ros.utils.checked_numbers import LARGEST_NUMBER
from geodesic_motion_ros.utils.errors import GeodesicMotionError, RobotError

if TYPE_CHECKING:
    from geodesic_motion_ros.nodes.joint_bytes import SeenJointState, SeenPoint, SeenTrajectory

# Points of a cloud beyond which it is refused.
MOST_POINTS = 1_000_000

# Encoders and a controller's overshoot may show a joint this much [rad] beyond its limit.
LIMIT_TOLERANCE = 0.02

_ALL = slice(None)
#: Where the base frame stands in itself.
_BASE = TaskFrame.identity()
_FLOATS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}


class MessageRefused(GeodesicMotionError):
    """The error of a message that cannot be used; it says what is wrong with it and what would be right."""


class TransformAwaited(Exception):
    """What is raised where a message is to wait for a transform: it is taken later, as if it came then."""


# ---------------------------------------------------------------- frames

#: Origin (3,) [m] and unit quaternion (w, x, y, z) of a frame in another one.
FramePose = tuple[np.ndarray, np.ndarray]


class FrameLookup(Protocol):
    """A lookup of where a source frame stands in a target frame at a time, of stamp 0 the newest; or why it cannot."""

    def __call__(self, target: str, source: str, stamp: Time) -> FramePose | Refusal: ...


def base_only(target: str, source: str, stamp: Time) -> Refusal:
    """Refuse every lookup, for who takes messages in the base frame only."""
    return Refusal(VerdictCode.BAD_INPUT, "nothing is transformed here")


def frame_of(header: Header, base_frame: str, lookup: FrameLookup) -> TaskFrame:
    """Return where the frame of a message stands in the base frame at its stamp; refused where nobody knows, naming
    both.
    """
    name = header.frame_id.removeprefix("/")  # as of ROS 1; tf2 refuses it
    if name == base_frame:
        return _BASE
    found = lookup(base_frame, name, header.stamp)
    if isinstance(found, Refusal):
        raise MessageRefused(f"frame '{header.frame_id}' is unknown here: send it in '{base_frame}' ({found.reason})")
    origin, quaternion = found
    norm = float(np.linalg.norm(quaternion))
    if not (np.all(np.isfinite(origin)) and 0.9 < norm < 1.1):
        raise MessageRefused(
            f"frame '{header.frame_id}' stands at {origin.tolist()} m, {quaternion.tolist()} in '{base_frame}': "
            "expected finite numbers and a unit quaternion"
        )
    return TaskFrame(origin, normalise(quaternion))


# ---------------------------------------------------------------- messages to arrays


def read_pose(message: PoseStamped, base_frame: str, lookup: FrameLookup = base_only) -> tuple[np.ndarray, np.ndarray]:
    """Return the position (3,) [m] and unit quaternion (w, x, y, z) of a pose, as the base frame sees it; the norm may
    be any but zero.
    """
    frame = frame_of(message.header, base_frame, lookup)
    return frame.to_base(checked_point(message.pose.position, "position"), checked_quaternion(message.pose))


def read_point(message: PointStamped, base_frame: str, lookup: FrameLookup = base_only) -> np.ndarray:
    """Return the point (3,) [m], as the base frame sees it."""
    return frame_of(message.header, base_frame, lookup).points_to_base(checked_point(message.point, "point"))


def read_joint_positions(message: JointState | SeenJointState, joint_names: Sequence[str]) -> np.ndarray:
    """Return joint positions (n,) [rad] in the robot's order; the message may use any order and name further joints."""
    places, positions = read_some_joints(message, joint_names)
    missing = [name for place, name in enumerate(joint_names) if place not in places]
    if missing:
        there = ", ".join(message.name) or "no joints"
        without = "" if len(message.position) else ", and no positions"
        raise MessageRefused(f"joint state lacks {', '.join(missing)}; it has {there}{without}")
    return positions


def read_some_joints(
    message: JointState | SeenJointState, joint_names: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return those of the robot's joints that a message has positions of: their places among the names (k,), in order,
    and the positions (k,) [rad]; none where it is about other joints, or about velocities and efforts alone.
    """
    place_of = {name: place for place, name in enumerate(joint_names)}
    found = [(place_of[name], i) for i, name in enumerate(message.name) if name in place_of]
    if not found or not len(message.position):
        return np.zeros(0, dtype=int), np.zeros(0)
    if len(message.name) != len(message.position):
        raise MessageRefused(
            f"joint state has {len(message.name)} names and {len(message.position)} positions: one each"
        )
    found.sort()
    places, at = (np.array(column) for column in zip(*found, strict=True))
    if np.any(np.diff(places) == 0):
        raise MessageRefused(f"joint state names a joint twice: {', '.join(message.name)}")
    positions = np.asarray(message.position)[at]
    for place, value in zip(places, positions, strict=True):
        check_number(float(value), f"joint {joint_names[place]}", "rad")
    return places, positions


def check_limits(joints: np.ndarray, robot: Robot, places: np.ndarray | slice = _ALL) -> None:
    """Refuse joint positions (k,) [rad] that the robot cannot have, naming the joints and their limits.

    places : (k,) of these joints among the robot's; by default they are all of them.
    """
    names, lower, upper = np.array(robot.joint_names)[places], robot.lower[places], robot.upper[places]
    outside = ~((joints >= lower - LIMIT_TOLERANCE) & (joints <= upper + LIMIT_TOLERANCE))
    if np.any(outside):
        beyond = ", ".join(
            f"{names[i]} at {joints[i]:.3f} (limits {lower[i]:.3f} to {upper[i]:.3f})" for i in np.flatnonzero(outside)
        )
        raise MessageRefused(f"joints beyond their limits [rad]: {beyond}; is this another robot, or degrees?")


def other_prefix(there: Collection[str], names: Sequence[str], prefix: str) -> str | None:
    """Return what names of a message begin with where they are joints of this robot with another prefix than `names`
    have.
    """
    own = [name.removeprefix(prefix) for name in names]
    for name in there:
        other = name.removesuffix(own[0])
        if other != name and other != prefix and all(other + one in there for one in own):
            return other
    return None


class TrajectoryPoints(NamedTuple):
    """The points of a joint trajectory as its message has them: times (m,) [s] from its start, positions (m, eta)
    [rad], velocities and accelerations where it has any.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray | None
    accelerations: np.ndarray | None


def read_joint_trajectory(message: JointTrajectory | SeenTrajectory, robot: Robot, prefix: str = "") -> JointWaypoints:
    """Return the waypoints of a trajectory in the robot's order of joints; the message may use any.

    Accepted is what joint_trajectory_controller accepts of all its joints for a position interface, as it is configured
    by default: at least one point, strictly increasing times, last velocities of zero, no efforts. Refused in addition
    is what it would play but no arm should: numbers that are not finite, positions beyond the limits, velocities or
    accelerations that only some points have, accelerations without velocities.

    prefix : that of the robot's names, to say which one the message has.
    """
    read = read_trajectory_points(message, robot, prefix)
    try:
        waypoints = JointWaypoints(*read)
    except RobotError as error:
        raise MessageRefused(str(error)) from error
    check_limits(read.positions.min(axis=0), robot)
    check_limits(read.positions.max(axis=0), robot)
    return waypoints


def read_trajectory_points(
    message: JointTrajectory | SeenTrajectory, robot: Robot, prefix: str = ""
) -> TrajectoryPoints:
    """Return the points of a trajectory in the robot's order of joints, whatever their numbers are; the message may use
    any order. prefix : as of `read_joint_trajectory`.
    """
    names, points = message.joint_names, message.points
    missing = [name for name in robot.joint_names if name not in names]
    unknown = [name for name in names if name not in robot.joint_names]
    if missing and (other := other_prefix(names, robot.joint_names, prefix)) is not None:
        raise MessageRefused(
            f"joint trajectory names {', '.join(names)}; expected {', '.join(robot.joint_names)}: set the parameter "
            f"joint_prefix to '{other}'"
        )
    for fault, which in (("lacks", missing), ("has unknown", unknown)):
        if which:
            raise MessageRefused(
                f"joint trajectory {fault} joints {', '.join(which)}; expected {', '.join(robot.joint_names)}"
            )
    if len(names) != len(robot.joint_names):
        raise MessageRefused(f"joint trajectory names a joint twice: {', '.join(names)}")
    if not points:
        raise MessageRefused("joint trajectory has no points: what is played goes on (to stop, send where to rest)")
    order = [names.index(name) for name in robot.joint_names]
    times = np.array([seconds(point.time_from_start) for point in points])
    positions, velocities, accelerations, efforts = (
        _values_of_points(points, name, order) for name in ("positions", "velocities", "accelerations", "effort")
    )
    if positions is None:
        raise MessageRefused("joint trajectory has no positions: they are needed at each point")
    if efforts is not None:
        raise MessageRefused("joint trajectory has efforts: joints are moved by positions here")
    return TrajectoryPoints(times, positions, velocities, accelerations)


def _values_of_points(
    points: Sequence[JointTrajectoryPoint | SeenPoint], name: str, order: Sequence[int]
) -> np.ndarray | None:
    """Field (n, joints) of n points with its columns in an order; None where it is empty at all of them."""
    rows = [getattr(point, name) for point in points]
    sizes = np.array([len(row) for row in rows])
    if not sizes.any():
        return None
    if np.any(sizes != len(order)):
        i = int(np.flatnonzero(sizes != len(order))[0])
        raise MessageRefused(f"joint trajectory has {sizes[i]} {name} at point {i}: expected one of each joint")
    # The rows are array.array of doubles: joining their bytes is ten times faster than converting numbers.
    return np.frombuffer(b"".join(rows)).reshape(-1, len(order))[:, order]


def cloud_message(points: np.ndarray, frame: str, stamp: Time) -> PointCloud2:
    """Return points (n, 3) [m] as a cloud of single precision."""
    fields = [
        PointField(name=name, offset=4 * axis, datatype=PointField.FLOAT32, count=1) for axis, name in enumerate("xyz")
    ]
    return PointCloud2(
        header=Header(frame_id=frame, stamp=stamp), height=1, width=len(points), fields=fields, point_step=12,
        row_step=12 * len(points), data=np.asarray(points, dtype="<f4").tobytes(), is_dense=True,
    )  # fmt: skip


def read_cloud(message: PointCloud2, base_frame: str, lookup: FrameLookup = base_only) -> tuple[np.ndarray, int]:
    """Return points (n, 3) [m] of a cloud, as the base frame sees them, and how many were left out because they are not
    finite (no return).

    Clouds of more than a million points are refused.
    """
    frame = frame_of(message.header, base_frame, lookup)
    count = message.width * message.height
    if count > MOST_POINTS:
        raise MessageRefused(f"cloud: {count} points, at most {MOST_POINTS} are taken: filter the cloud first")
    sent = _cloud_points(message)
    points, largest = carry_finite(sent, to_rotation(frame.quaternion).as_matrix(), frame.origin)
    if largest > LARGEST_NUMBER:
        raise MessageRefused(f"cloud: a coordinate exceeds {LARGEST_NUMBER:g} m; metres are expected")
    return points, len(sent) - len(points)


def _cloud_points(message: PointCloud2) -> np.ndarray:
    fields = {item.name: item for item in message.fields}
    missing = [name for name in "xyz" if name not in fields]
    if missing:
        raise MessageRefused(f"cloud: no field {', '.join(missing)}; it has {', '.join(fields) or 'none'}")
    order = ">" if message.is_bigendian else "<"
    formats, offsets = [], []
    for name in "xyz":
        datatype, offset = fields[name].datatype, fields[name].offset
        if datatype not in _FLOATS:
            raise MessageRefused(f"cloud: field {name} has datatype {datatype}, expected FLOAT32 (7) or FLOAT64 (8)")
        if offset + int(_FLOATS[datatype][1]) > message.point_step:
            raise MessageRefused(f"cloud: field {name} ends beyond point_step {message.point_step}")
        formats.append(order + _FLOATS[datatype])
        offsets.append(offset)
    if message.row_step < message.width * message.point_step:
        raise MessageRefused(
            f"cloud: row_step {message.row_step} is less than width {message.width} x point_step {message.point_step}"
        )
    if len(message.data) != message.height * message.row_step:
        raise MessageRefused(
            f"cloud: {len(message.data)} bytes, expected height {message.height} x row_step {message.row_step}"
        )
    if not len(message.data):
        return np.zeros((0, 3))
    layout = np.dtype(
        {"names": ["x", "y", "z"], "formats": formats, "offsets": offsets, "itemsize": message.point_step}
    )
    rows = np.frombuffer(message.data, dtype=np.uint8).reshape(message.height, message.row_step)
    packed = np.ascontiguousarray(rows[:, : message.width * message.point_step]).view(layout).reshape(-1)
    return np.stack([packed[name].astype(float) for name in "xyz"], axis=1)


def seconds(stamp: Time | Duration) -> float:
    """Return a stamp or a duration in seconds; a stamp is 0 when the sender set none."""
    return stamp.sec + 1e-9 * stamp.nanosec


def checked_point(point: Point, name: str) -> np.ndarray:
    """Return a point (3,) [m], refused by its name where a coordinate is not finite, or too far away for an arm."""
    values = (point.x, point.y, point.z)
    for value in values:
        check_number(value, name, "m")
    return np.array(values)


def checked_quaternion(pose: Pose, name: str = "orientation") -> np.ndarray:
    """Return the unit quaternion (w, x, y, z) of a pose; the norm in the message may be any but zero."""
    orientation = pose.orientation
    quaternion = np.array([orientation.w, orientation.x, orientation.y, orientation.z])
    for value in quaternion:
        check_number(float(value), name, "")
    norm = float(np.linalg.norm(quaternion))
    if norm < 1e-6:
        raise MessageRefused(f"{name} is the zero quaternion; a rotation has norm 1 (no rotation: w = 1)")
    return quaternion / norm


def check_number(value: float, name: str, unit: str) -> None:
    """Refuse what is not finite, or larger than a number of a unit may be here, by its name."""
    if not math.isfinite(value):
        raise MessageRefused(f"{name} holds {value}; finite numbers are needed")
    if abs(value) > LARGEST_NUMBER:
        raise MessageRefused(f"{name} holds {value:g} {unit}; at most {LARGEST_NUMBER:g} is plausible")


# ---------------------------------------------------------------- arrays to messages


def fill_pose(pose: Pose, position: np.ndarray, quaternion: np.ndarray) -> Pose:
    """Write a position (3,) [m] and a quaternion (w, x, y, z) into a pose."""
    pose.position.x, pose.position.y, pose.position.z = (float(value) for value in position)
    w, x, y, z = (float(value) for value in quaternion)
    pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z = w, x, y, z
    return pose


def pose_message(position: np.ndarray, quaternion: np.ndarray, frame: str, stamp: Time) -> PoseStamped:
    """Return a PoseStamped of a position (3,) [m] and a quaternion (w, x, y, z)."""
    message = PoseStamped(header=Header(frame_id=frame, stamp=stamp))
    fill_pose(message.pose, position, quaternion)
    return message


def point_message(point: np.ndarray, frame: str, stamp: Time) -> PointStamped:
    """Return a PointStamped of a point (3,) [m]."""
    x, y, z = (float(value) for value in point)
    return PointStamped(header=Header(frame_id=frame, stamp=stamp), point=Point(x=x, y=y, z=z))


def path_message(positions: np.ndarray, quaternions: np.ndarray, frame: str, stamp: Time) -> Path:
    """Return a Path of positions (n, 3) [m] and quaternions (n, 4)."""
    header = Header(frame_id=frame, stamp=stamp)
    poses = [
        PoseStamped(header=header, pose=fill_pose(Pose(), position, quaternion))
        for position, quaternion in zip(positions.tolist(), quaternions.tolist(), strict=True)
    ]
    return Path(header=header, poses=poses)


def image_message(pixels: np.ndarray, stamp: Time) -> Image:
    """Return an rgb8 Image of pixels (h, w, 3) uint8."""
    height, width, _ = pixels.shape
    return Image(
        header=Header(stamp=stamp),
        height=height,
        width=width,
        encoding="rgb8",
        step=3 * width,
        data=array.array("B", np.ascontiguousarray(pixels, dtype=np.uint8).tobytes()),
    )


def joint_state_message(names: Sequence[str], positions: np.ndarray, velocities: np.ndarray, stamp: Time) -> JointState:
    """Return a JointState of positions (n,) [rad] and velocities (n,) [rad/s]."""
    return JointState(
        header=Header(stamp=stamp),
        name=list(names),
        position=array.array("d", positions.tolist()),
        velocity=array.array("d", velocities.tolist()),
    )


def diagnostic_status(
    level: bytes, name: str, message: str, hardware: str, values: dict[str, object]
) -> DiagnosticStatus:
    """Return a DiagnosticStatus; floats among the values are written with six digits."""
    pairs = [KeyValue(key=key, value=_text(value)) for key, value in values.items()]
    return DiagnosticStatus(level=level, name=name, message=message, hardware_id=hardware, values=pairs)


def diagnostic_array(statuses: Sequence[DiagnosticStatus], stamp: Time) -> DiagnosticArray:
    """Return a DiagnosticArray of statuses."""
    return DiagnosticArray(header=Header(stamp=stamp), status=list(statuses))


def _text(value: object) -> str:
    return f"{float(value):.6g}" if isinstance(value, float | np.floating) else str(value)
