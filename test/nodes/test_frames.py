"""Messages in other frames: carried into the base frame at their stamp, or refused with the reason.

SciPy is the oracle; tf2 is played by a buffer that answers from a table.
"""

from __future__ import annotations

import array
import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped, PoseStamped, TransformStamped
from rclpy.clock import ROSClock
from rclpy.time import Time as RosTime
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.nodes import messages as m
from geodesic_motion_ros.nodes.frames import BufferedFrames, frames_of, no_tf2
from geodesic_motion_ros.nodes.marker_messages import read_marker

BASE, CAMERA = "panda_link0", "camera"
EARLY, LATE = Time(sec=10), Time(sec=11, nanosec=500_000_000)
#: Where the camera stands at these times: origin [m] and rotation.
PLACES = {
    10.0: (np.array([1.0, -0.5, 0.8]), Rotation.from_euler("xyz", [2.0, 0.4, -1.1])),
    11.5: (np.array([0.9, -0.3, 0.7]), Rotation.from_euler("xyz", [1.8, 0.5, -0.9])),
}


class NoTransform(Exception):
    """What the table's buffer raises."""


class TableBuffer:
    """A tf2 buffer that knows the camera at some times; at time 0 it tells of the last of them."""

    def __init__(self, places: dict[float, tuple[np.ndarray, Rotation]]) -> None:
        self.places = places

    def lookup_transform(self, target_frame: str, source_frame: str, time: RosTime) -> TransformStamped:
        asked = 1e-9 * time.nanoseconds or max(self.places, default=0.0)
        if (target_frame, source_frame) != (BASE, CAMERA) or asked not in self.places:
            raise NoTransform(f"no {source_frame} at {asked:g}")
        origin, rotation = self.places[asked]
        found = TransformStamped()
        place, turn = found.transform.translation, found.transform.rotation
        place.x, place.y, place.z = origin.tolist()
        turn.x, turn.y, turn.z, turn.w = rotation.as_quat().tolist()
        return found

    def clear(self) -> None:
        self.places.clear()


@pytest.fixture
def lookup() -> BufferedFrames:
    return BufferedFrames(TableBuffer(dict(PLACES)), NoTransform)


@pytest.fixture(params=[(EARLY, 10.0), (LATE, 11.5), (Time(), 11.5)], ids=["early", "late", "no stamp"])
def seen(request) -> tuple[Header, np.ndarray, Rotation]:
    """A header of the camera's, and where the camera stood then."""
    stamp, time = request.param
    return Header(frame_id=CAMERA, stamp=stamp), *PLACES[time]


TURN = Rotation.from_euler("zyx", [0.3, -0.8, 2.2])
POINT = np.array([0.1, -0.2, 0.9])


def fill(pose, position: np.ndarray, rotation: Rotation) -> None:
    m.fill_pose(pose, position, np.roll(rotation.as_quat(), 1))


def test_a_pose_is_carried_with_its_orientation(seen, lookup) -> None:
    header, origin, rotation = seen
    message = PoseStamped(header=header)
    fill(message.pose, POINT, TURN)
    position, quaternion = m.read_pose(message, BASE, lookup)
    np.testing.assert_allclose(position, origin + rotation.apply(POINT), atol=1e-12)
    np.testing.assert_allclose((to_rotation(quaternion).inv() * (rotation * TURN)).magnitude(), 0.0, atol=1e-9)


def test_a_point_and_a_sphere_are_carried(seen, lookup) -> None:
    header, origin, rotation = seen
    expected = origin + rotation.apply(POINT)
    point = PointStamped(header=header)
    point.point.x, point.point.y, point.point.z = POINT.tolist()
    np.testing.assert_allclose(m.read_point(point, BASE, lookup), expected, atol=1e-12)
    sphere = marker(header, Marker.SPHERE)
    update = read_marker(sphere, BASE, lookup)
    np.testing.assert_allclose(update.centre, expected, atol=1e-12)
    assert update.radius == 0.4


@pytest.mark.parametrize("kind", [Marker.CUBE, Marker.CYLINDER])
def test_a_solid_is_carried_with_its_axes(seen, lookup, kind) -> None:
    header, origin, rotation = seen
    there = read_marker(marker(header, kind), BASE, lookup)
    here = read_marker(marker(Header(frame_id=BASE), kind), BASE)
    np.testing.assert_allclose(there.centre, origin + rotation.apply(POINT), atol=1e-12)
    np.testing.assert_array_equal(there.solid[:3], there.centre)
    np.testing.assert_array_equal(there.solid[3:7], here.solid[3:7])
    np.testing.assert_allclose(there.solid[7:].reshape(3, 3), (rotation * TURN).as_matrix(), atol=1e-12)


def marker(header: Header, kind: int) -> Marker:
    made = Marker(header=header, type=kind)
    fill(made.pose, POINT, TURN)
    made.scale.x, made.scale.y, made.scale.z = 0.1, 0.1, 0.8
    return made


def test_the_points_of_a_cloud_are_carried(seen, lookup) -> None:
    header, origin, rotation = seen
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3))
    points[7, 1] = math.nan
    carried, not_finite = m.read_cloud(cloud(header, points), BASE, lookup)
    np.testing.assert_allclose(carried, origin + rotation.apply(np.delete(points, 7, axis=0)), atol=1e-12)
    assert not_finite == 1


def cloud(header: Header, points: np.ndarray) -> PointCloud2:
    fields = [PointField(name=n, offset=8 * i, datatype=PointField.FLOAT64, count=1) for i, n in enumerate("xyz")]
    return PointCloud2(
        header=header, height=1, width=len(points), fields=fields, point_step=24, row_step=24 * len(points),
        data=array.array("B", points.tobytes()),
    )  # fmt: skip


def test_what_is_in_the_base_frame_is_not_asked_for() -> None:
    def never(target: str, source: str, stamp: Time) -> str:
        raise AssertionError("asked")

    message = PoseStamped(header=Header(frame_id=BASE))
    fill(message.pose, POINT, TURN)
    position, quaternion = m.read_pose(message, BASE, never)
    np.testing.assert_array_equal(position, POINT)
    np.testing.assert_allclose(quaternion, np.roll(TURN.as_quat(), 1), atol=1e-15)


@pytest.mark.parametrize(
    ("frame", "stamp", "reason"),
    [
        ("map", EARLY, "frame 'map' .*'panda_link0' .*no map at 10"),
        (CAMERA, Time(sec=12), "frame 'camera' .*no transform of it at its stamp: no camera at 12"),
        (CAMERA, Time(sec=-1), "stamp, -1 s, is negative"),
    ],
)
def test_a_missing_transform_is_named(lookup, frame, stamp, reason) -> None:
    message = PointStamped(header=Header(frame_id=frame, stamp=stamp))
    with pytest.raises(m.MessageRefused, match=reason):
        m.read_point(message, BASE, lookup)


@pytest.mark.parametrize(
    "found",
    [(np.full(3, np.nan), np.array([1.0, 0.0, 0.0, 0.0])), (np.zeros(3), np.zeros(4)), (np.zeros(3), np.full(4, 9.0))],
    ids=["NaN", "zero quaternion", "no unit quaternion"],
)
def test_a_transform_that_is_none_is_refused(found) -> None:
    with pytest.raises(m.MessageRefused, match="frame 'camera' stands at"):
        m.read_point(PointStamped(header=Header(frame_id=CAMERA)), BASE, lambda target, source, stamp: found)


def test_without_tf2_it_is_said_that_it_would_be_needed(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "tf2_ros", None)
    lookup = frames_of(SimpleNamespace())
    assert lookup is no_tf2
    with pytest.raises(m.MessageRefused, match=r"frame 'camera' .*'panda_link0' .*tf2_ros, which .*not installed"):
        m.read_point(PointStamped(header=Header(frame_id=CAMERA)), BASE, lookup)


def test_with_tf2_its_buffer_is_asked_and_emptied_when_the_clock_is_set_back(monkeypatch) -> None:
    buffer, listeners = TableBuffer(dict(PLACES)), []
    tf2 = SimpleNamespace(
        Buffer=lambda: buffer,
        TransformListener=lambda *of: listeners.append(of),
        TransformException=NoTransform,
    )
    monkeypatch.setitem(sys.modules, "tf2_ros", tf2)
    clock = ROSClock()
    node = SimpleNamespace(get_clock=lambda: clock)
    lookup = frames_of(node)
    assert listeners == [(buffer, node)]
    clock._set_ros_time_is_active(True)
    clock.set_ros_time_override(RosTime(seconds=20, clock_type=clock.clock_type))
    buffer.places = dict(PLACES)
    np.testing.assert_array_equal(lookup(BASE, CAMERA, EARLY)[0], PLACES[10.0][0])
    clock.set_ros_time_override(RosTime(seconds=15, clock_type=clock.clock_type))
    assert "no camera" in lookup(BASE, CAMERA, EARLY).reason
