"""Messages in other frames: carried into the base frame at their stamp, or refused with the reason.

SciPy is the oracle; transforms come as bytes that `rosbags` writes.
"""

from __future__ import annotations

import array
import math
import sys
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.clock import ROSClock
from rclpy.qos import QoSProfile
from rclpy.time import Time as RosTime
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.nodes import messages as m
from geodesic_motion_ros.nodes.frames import HeardFrames, frames_of, no_tf
from geodesic_motion_ros.nodes.marker_messages import read_marker
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.transform_bytes import parse_transforms

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
BASE, CAMERA = "panda_link0", "camera"
EARLY, LATE = Time(sec=10), Time(sec=11, nanosec=500_000_000)
#: Where the camera stands at these times: origin [m] and rotation.
PLACES = {
    10.0: (np.array([1.0, -0.5, 0.8]), Rotation.from_euler("xyz", [2.0, 0.4, -1.1])),
    11.5: (np.array([0.9, -0.3, 0.7]), Rotation.from_euler("xyz", [1.8, 0.5, -0.9])),
}


def wire(*transforms: tuple[str, str, float, np.ndarray, Rotation]) -> bytes:
    """A serialised TFMessage of transforms (frame, parent, stamp [s], origin [m], rotation)."""
    made = [
        TYPES["geometry_msgs/msg/TransformStamped"](
            TYPES["std_msgs/msg/Header"](
                TYPES["builtin_interfaces/msg/Time"](math.floor(stamp), round(1e9 * (stamp % 1.0))), parent
            ),
            frame,
            TYPES["geometry_msgs/msg/Transform"](
                TYPES["geometry_msgs/msg/Vector3"](*origin), TYPES["geometry_msgs/msg/Quaternion"](*rotation.as_quat())
            ),
        )
        for frame, parent, stamp, origin, rotation in transforms
    ]
    return bytes(STORE.serialize_cdr(TYPES["tf2_msgs/msg/TFMessage"](made), "tf2_msgs/msg/TFMessage"))


class Heard:
    """What a node would hear of, and the frames that come of it."""

    def __init__(self) -> None:
        self.clock, self.hear, self.changes = ROSClock(), {}, 0
        self.warnings: list[str] = []
        self.frames = HeardFrames(self, object, RefusalLog(self.warnings.append), self._changed)

    def create_subscription(self, kind: type, topic: str, take: Callable, qos: QoSProfile, raw: bool) -> None:
        assert raw
        self.hear[topic] = take

    def get_clock(self) -> ROSClock:
        return self.clock

    def _changed(self) -> None:
        self.changes += 1

    def __call__(self, target: str, source: str, stamp: Time) -> m.FramePose | Refusal:
        return self.frames(target, source, stamp)


@pytest.fixture
def lookup() -> Heard:
    heard = Heard()
    for time, place in PLACES.items():
        heard.hear["/tf"](wire((CAMERA, BASE, time, *place)))
    return heard


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
        ("map", EARLY, "frame 'map' .*'panda_link0' .*tf tells nothing of map"),
        (CAMERA, Time(sec=12), "frame 'camera' .*tf has camera in panda_link0 up to 0.500 s before its stamp"),
        (CAMERA, Time(sec=9), "frame 'camera' .*tf has camera in panda_link0 from 1.000 s after its stamp on"),
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


def test_without_tf2_msgs_it_is_said_that_they_would_be_needed(monkeypatch) -> None:
    for module in ("tf2_msgs", "tf2_msgs.msg"):
        monkeypatch.setitem(sys.modules, module, None)
    lookup = frames_of(SimpleNamespace(), RefusalLog(print), print)
    assert lookup is no_tf
    with pytest.raises(m.MessageRefused, match=r"frame 'camera' .*'panda_link0' .*tf2_msgs, .*not installed"):
        m.read_point(PointStamped(header=Header(frame_id=CAMERA)), BASE, lookup)


def test_what_moves_is_forgotten_when_the_clock_is_set_back(lookup) -> None:
    lookup.hear["/tf_static"](wire(("lens", CAMERA, 0.0, POINT, TURN)))
    lookup.clock._set_ros_time_is_active(True)
    lookup.clock.set_ros_time_override(RosTime(seconds=20, clock_type=lookup.clock.clock_type))
    for time, place in PLACES.items():
        lookup.hear["/tf"](wire((CAMERA, BASE, time, *place)))
    np.testing.assert_allclose(lookup(BASE, CAMERA, EARLY)[0], PLACES[10.0][0])
    lookup.clock.set_ros_time_override(RosTime(seconds=15, clock_type=lookup.clock.clock_type))
    assert "tf tells nothing of panda_link0" in lookup(BASE, CAMERA, EARLY).reason
    np.testing.assert_allclose(lookup(CAMERA, "lens", EARLY)[0], POINT)


@pytest.mark.parametrize("bad", [np.array([math.nan, 0.0, 0.0]), np.array([0.0, math.inf, 0.0])])
def test_a_transform_of_no_place_is_refused_and_counted(lookup, bad) -> None:
    before = lookup.changes
    lookup.hear["/tf"](wire((CAMERA, BASE, 11.0, bad, TURN)))
    assert "'camera' stands at" in lookup.warnings[-1]
    assert lookup.changes == before + 1
    np.testing.assert_allclose(lookup(BASE, CAMERA, EARLY)[0], PLACES[10.0][0])


def test_what_is_cut_off_is_refused(lookup) -> None:
    whole = wire((CAMERA, BASE, 11.0, POINT, TURN))
    for length in range(4, len(whole) - 1, 7):
        with pytest.raises(m.MessageRefused, match="end before they should"):
            parse_transforms(whole[:length])
