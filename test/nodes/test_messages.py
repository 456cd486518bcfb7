"""The border: what is accepted, what is refused with which reason, and that nothing unchecked gets into a field."""

from __future__ import annotations

import array
import math
import struct
from collections.abc import Sequence

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, PoseStamped
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, JointState, PointCloud2, PointField
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker

from geodesic_motion_ros.nodes import messages as m
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.solids import solid_distances

BASE = "panda_link0"
NAMES = ("j1", "j2", "j3")
STAMP = Time(sec=12, nanosec=500_000_000)
BAD = (math.nan, math.inf, -math.inf, 1e300)


def pose(x=0.1, y=0.2, z=0.3, quaternion=(1.0, 0.0, 0.0, 0.0), frame=BASE) -> PoseStamped:
    message = PoseStamped(header=Header(frame_id=frame))
    message.pose.position.x, message.pose.position.y, message.pose.position.z = x, y, z
    orientation = message.pose.orientation
    orientation.w, orientation.x, orientation.y, orientation.z = quaternion
    return message


def sphere(namespace="n", number=1, diameter=0.1, frame=BASE, **fields) -> Marker:
    marker = Marker(header=Header(frame_id=frame, stamp=STAMP), ns=namespace, id=number, type=Marker.SPHERE)
    marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = 0.1, 0.2, 0.3
    marker.scale.x = marker.scale.y = marker.scale.z = diameter
    for name, value in fields.items():
        setattr(marker, name, value)
    return marker


class TestPose:
    def test_order_of_the_quaternion_is_turned_round(self):
        message = pose(quaternion=(0.1, 0.2, 0.3, math.sqrt(1 - 0.14)))
        position, quaternion = m.read_pose(message, BASE)
        np.testing.assert_array_equal(position, [0.1, 0.2, 0.3])
        np.testing.assert_allclose(quaternion, [0.1, 0.2, 0.3, math.sqrt(0.86)])
        assert message.pose.orientation.x == 0.2

    def test_norm_is_repaired_zero_is_refused(self):
        assert m.read_pose(pose(quaternion=(2.0, 0.0, 0.0, 0.0)), BASE)[1].tolist() == [1.0, 0.0, 0.0, 0.0]
        with pytest.raises(m.MessageRefused, match="zero quaternion"):
            m.read_pose(pose(quaternion=(0.0, 0.0, 0.0, 0.0)), BASE)

    @pytest.mark.parametrize("value", BAD)
    def test_numbers_must_be_finite_and_plausible(self, value):
        with pytest.raises(m.MessageRefused, match="position"):
            m.read_pose(pose(y=value), BASE)
        with pytest.raises(m.MessageRefused, match="orientation"):
            m.read_pose(pose(quaternion=(1.0, value, 0.0, 0.0)), BASE)

    @pytest.mark.parametrize("frame", ["", "world", "/panda_link0"])
    def test_other_frames_are_refused_by_name(self, frame):
        with pytest.raises(m.MessageRefused, match=f"frame '{frame}' .*'{BASE}'"):
            m.read_pose(pose(frame=frame), BASE)

    def test_there_and_back(self):
        position, quaternion = np.array([0.3, -0.2, 0.1]), np.array([0.5, -0.5, 0.5, 0.5])
        back = m.read_pose(m.pose_message(position, quaternion, BASE, STAMP), BASE)
        np.testing.assert_array_equal(back[0], position)
        np.testing.assert_array_equal(back[1], quaternion)


class TestJointPositions:
    def state(self, names=NAMES, positions=(1.0, 2.0, 3.0)) -> JointState:
        return JointState(name=list(names), position=array.array("d", positions))

    def test_any_order_and_further_joints(self):
        message = self.state(("finger", "j3", "j1", "j2"), (0.04, 3.0, 1.0, 2.0))
        np.testing.assert_array_equal(m.read_joint_positions(message, NAMES), [1.0, 2.0, 3.0])

    def test_missing_joints_are_named(self):
        with pytest.raises(m.MessageRefused, match="lacks j1, j3; it has j2"):
            m.read_joint_positions(self.state(("j2",), (1.0,)), NAMES)

    def test_one_position_for_each_name(self):
        with pytest.raises(m.MessageRefused, match="3 names and 2 positions"):
            m.read_joint_positions(self.state(positions=(1.0, 2.0)), NAMES)

    def test_a_name_may_not_come_twice(self):
        with pytest.raises(m.MessageRefused, match="twice"):
            m.read_joint_positions(self.state(("j1", "j2", "j2"), (1.0, 2.0, 3.0)), NAMES)

    @pytest.mark.parametrize("value", BAD)
    def test_bad_positions_are_refused_with_the_joint(self, value):
        with pytest.raises(m.MessageRefused, match="joint j2"):
            m.read_joint_positions(self.state(positions=(1.0, value, 3.0)), NAMES)

    def test_bad_values_of_joints_that_are_not_ours_do_not_matter(self):
        message = self.state((*NAMES, "finger"), (1.0, 2.0, 3.0, math.nan))
        np.testing.assert_array_equal(m.read_joint_positions(message, NAMES), [1.0, 2.0, 3.0])


PANDA = Robot.panda()


def trajectory(**fields) -> JointTrajectory:
    """Two points of a Panda at ready, a second apart, with fields of the last one exchanged."""
    points = [
        JointTrajectoryPoint(
            positions=PANDA.ready.tolist(),
            velocities=[0.0] * 7,
            accelerations=[0.0] * 7,
            time_from_start=Duration(sec=sec),
        )
        for sec in (1, 2)
    ]
    for name, value in fields.items():
        setattr(points[-1], name, value)
    return JointTrajectory(header=Header(stamp=STAMP), joint_names=list(PANDA.joint_names), points=points)


def without(message: JointTrajectory, *names: str) -> JointTrajectory:
    """The same with fields emptied at all points."""
    for point in message.points:
        for name in names:
            setattr(point, name, [])
    return message


class TestJointTrajectory:
    @pytest.mark.parametrize("seed", range(3))
    def test_what_is_written_is_read_through_the_wire_in_any_order_of_joints(self, seed):
        generator = np.random.default_rng(seed)
        order = generator.permutation(7)
        times = np.cumsum(generator.uniform(1e-3, 0.1, 20))
        rows = [PANDA.sample(20, generator), *generator.normal(size=(2, 20, 7))]
        rows[1][-1] = 0.0
        names = [PANDA.joint_names[joint] for joint in order]
        begin = 1.7e9 + 0.123456
        wire = joint_trajectory_bytes(names, times, *(values[:, order] for values in rows), begin)
        received = deserialize_message(wire, JointTrajectory)
        waypoints = m.read_joint_trajectory(received, PANDA)
        assert m.seconds(received.header.stamp) == pytest.approx(begin, abs=1e-6)
        np.testing.assert_allclose(waypoints.times, times, atol=1e-9)
        for values, written in zip(
            (waypoints.positions, waypoints.velocities, waypoints.accelerations), rows, strict=True
        ):
            np.testing.assert_array_equal(values, written)

    def test_velocities_and_accelerations_are_optional(self):
        bare = m.read_joint_trajectory(without(trajectory(), "velocities", "accelerations"), PANDA)
        assert bare.velocities is None
        assert bare.accelerations is None
        assert m.read_joint_trajectory(without(trajectory(), "accelerations"), PANDA).velocities.shape == (2, 7)

    def test_joints_must_be_those_of_the_robot_and_are_named(self):
        message = trajectory()
        message.joint_names = [*PANDA.joint_names[:6], "elbow"]
        with pytest.raises(m.MessageRefused, match="lacks joints panda_joint7; expected panda_joint1, panda_joint2"):
            m.read_joint_trajectory(message, PANDA)
        message.joint_names = [*PANDA.joint_names, "elbow"]
        with pytest.raises(m.MessageRefused, match="has unknown joints elbow; expected panda_joint1"):
            m.read_joint_trajectory(message, PANDA)
        message.joint_names = [*PANDA.joint_names, "panda_joint7"]
        with pytest.raises(m.MessageRefused, match="names a joint twice"):
            m.read_joint_trajectory(message, PANDA)

    @pytest.mark.parametrize(
        ("message", "reason"),
        [
            (JointTrajectory(joint_names=list(PANDA.joint_names)), "no points"),
            (trajectory(time_from_start=Duration(sec=1)), "must increase strictly: waypoint 0 is at 1.0000 s"),
            (trajectory(positions=[0.0] * 6), "has 6 positions at point 1: expected one of each joint"),
            (trajectory(velocities=[]), "has 0 velocities at point 1"),
            (trajectory(accelerations=[0.0] * 8), "has 8 accelerations at point 1"),
            (without(trajectory(), "positions"), "no positions"),
            (without(trajectory(), "velocities"), "accelerations but no velocities"),
            (trajectory(velocities=[0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]), "the last ones must be zero"),
            (trajectory(positions=[math.nan] * 7), "positions of a trajectory hold nan"),
            (trajectory(accelerations=[math.inf] * 7), "accelerations of a trajectory hold inf"),
            (trajectory(positions=[*PANDA.ready[:6], -4.0]), r"panda_joint7 at -4.000 \(limits -2.897 to 2.897\)"),
            (trajectory(positions=[4.0, *PANDA.ready[1:]]), "panda_joint1 at 4.000"),
        ],
    )
    def test_what_cannot_be_played_is_refused_with_the_reason(self, message, reason):
        with pytest.raises(m.MessageRefused, match=reason):
            m.read_joint_trajectory(message, PANDA)

    def test_efforts_are_refused_as_by_a_controller_of_positions(self):
        message = trajectory()
        for point in message.points:
            point.effort = [1.0] * 7
        with pytest.raises(m.MessageRefused, match="efforts"):
            m.read_joint_trajectory(message, PANDA)


class TestMarker:
    def test_scale_is_the_diameter(self):
        update = m.read_marker(sphere(lifetime=Duration(sec=1, nanosec=500_000_000)), BASE)
        assert (update.action, update.key, update.radius) == ("put", ("n", 1), 0.05)
        assert update.lifetime == 1.5
        assert update.stamp == 12.5
        np.testing.assert_array_equal(update.centre, [0.1, 0.2, 0.3])

    def test_an_ellipsoid_is_covered(self):
        marker = sphere()
        marker.scale.y = 0.3
        assert m.read_marker(marker, BASE).radius == 0.15

    def test_deletions_need_neither_frame_nor_size(self):
        marker = sphere(frame="", diameter=0.0, action=Marker.DELETE)
        assert m.read_marker(marker, BASE).action == "delete"
        assert m.read_marker(sphere(action=Marker.DELETEALL, diameter=0.0), BASE).action == "delete_all"

    @pytest.mark.parametrize("diameter", [0.0, -0.1, *BAD])
    def test_diameters_must_be_positive(self, diameter):
        with pytest.raises(m.MessageRefused, match=r"marker n/1: scale"):
            m.read_marker(sphere(diameter=diameter), BASE)

    @pytest.mark.parametrize("value", BAD)
    def test_centres_must_be_finite(self, value):
        marker = sphere()
        marker.pose.position.z = value
        with pytest.raises(m.MessageRefused, match=r"marker n/1: centre"):
            m.read_marker(marker, BASE)

    def test_other_shapes_actions_and_frames_are_refused(self):
        with pytest.raises(m.MessageRefused, match="type 0, expected SPHERE"):
            m.read_marker(sphere(type=Marker.ARROW), BASE)
        with pytest.raises(m.MessageRefused, match="action 7"):
            m.read_marker(sphere(action=7), BASE)
        with pytest.raises(m.MessageRefused, match="frame 'camera'"):
            m.read_marker(sphere(frame="camera"), BASE)

    def test_a_cube_is_a_turned_box(self):
        update = m.read_marker(shape(Marker.CUBE, (0.2, 0.1, 0.4)), BASE)
        assert (update.action, update.key) == ("put", ("n", 1))
        np.testing.assert_array_equal(update.centre, [0.1, 0.2, 0.3])
        # Turned by a quarter about z: its long side along x is along y.
        points = update.centre + np.array([[0.0, 0.15, 0.0], [0.15, 0.0, 0.0], [0.0, 0.0, 0.3]])
        np.testing.assert_allclose(solid_distances(points, update.solid[None]), [0.05, 0.1, 0.1], atol=1e-6)

    @pytest.mark.parametrize("scale", [(0.1, 0.1, 0.8), (0.1, 0.09, 0.8), (0.3, 0.3, 0.1), (0.1, 0.1, 0.12)])
    def test_a_cylinder_is_held_by_its_solid(self, scale):
        update = m.read_marker(shape(Marker.CYLINDER, scale), BASE)
        random = np.random.default_rng(0)
        angles, heights = random.uniform(0.0, 2.0 * np.pi, 500), random.uniform(-0.5, 0.5, 500)
        # In the marker's frame, which is turned by a quarter about z.
        surface = np.stack([0.5 * scale[0] * np.cos(angles), 0.5 * scale[1] * np.sin(angles), scale[2] * heights])
        turned = np.stack([-surface[1], surface[0], surface[2]], axis=1) + update.centre
        distances = solid_distances(turned, update.solid[None])
        assert np.max(distances) <= 1e-9
        slender = scale[2] > 0.5
        assert (update.solid[6] > 0.0) == slender
        # A solid that holds it and is no larger than it must be: half a diameter, or the corners of the box.
        above = update.centre + np.array([0.0, 0.0, 0.5 * scale[2] + 1.0])
        over = 1.0 - solid_distances(above[None], update.solid[None])[0]
        assert over == pytest.approx(0.5 * max(scale[:2]) if slender else 0.0, abs=1e-9)

    def test_solids_need_a_rotation_and_spheres_do_not(self):
        for kind, said in ((Marker.CUBE, "zero quaternion"), (Marker.CYLINDER, "zero quaternion")):
            marker = shape(kind, (0.1, 0.1, 0.1))
            marker.pose.orientation.w = marker.pose.orientation.z = 0.0
            with pytest.raises(m.MessageRefused, match=f"marker n/1: orientation is the {said}"):
                m.read_marker(marker, BASE)
            marker.pose.orientation.w = math.nan
            with pytest.raises(m.MessageRefused, match="marker n/1: orientation holds nan"):
                m.read_marker(marker, BASE)
        marker = sphere()
        marker.pose.orientation.w = 0.0
        assert m.read_marker(marker, BASE).solid is None

    @pytest.mark.parametrize("kind", [Marker.CUBE, Marker.CYLINDER])
    @pytest.mark.parametrize("side", [0.0, -0.1, *BAD])
    def test_every_side_of_a_solid_must_be_positive(self, kind, side):
        for axis in range(3):
            scale = [0.1, 0.1, 0.1]
            scale[axis] = side
            with pytest.raises(m.MessageRefused, match=r"marker n/1: scale"):
                m.read_marker(shape(kind, scale), BASE)

    def test_lifetime_must_not_be_negative(self):
        with pytest.raises(m.MessageRefused, match="lifetime"):
            m.read_marker(sphere(lifetime=Duration(sec=-1)), BASE)


def shape(kind: int, scale: Sequence[float]) -> Marker:
    """A marker at (0.1, 0.2, 0.3), turned by a quarter about z."""
    marker = sphere(type=kind)
    marker.pose.orientation.w = marker.pose.orientation.z = math.sqrt(0.5)
    marker.scale.x, marker.scale.y, marker.scale.z = scale
    return marker


def test_a_cloud_that_is_written_is_read_again():
    points = np.random.default_rng(0).normal(size=(50, 3))
    read, not_finite = m.read_cloud(m.cloud_message(points, BASE, Time(sec=3)), BASE)
    np.testing.assert_allclose(read, points, rtol=1e-6)
    assert not_finite == 0


def cloud(points: np.ndarray, kind=PointField.FLOAT32, big=False, padding=4, row_padding=0, height=1) -> PointCloud2:
    """A cloud with the fields in an unusual order, padding after every point and every row."""
    code = {PointField.FLOAT32: "f", PointField.FLOAT64: "d"}[kind]
    size = struct.calcsize(code)
    step, width = 3 * size + padding, len(points) // height
    pack = struct.Struct((">" if big else "<") + 3 * code)
    rows = []
    for row in points.reshape(height, width, 3):
        packed = b"".join(pack.pack(z, x, y) + bytes(padding) for x, y, z in row)
        rows.append(packed + bytes(row_padding))
    fields = [
        PointField(name=name, offset=offset * size, datatype=kind, count=1)
        for name, offset in zip("xyz", (1, 2, 0), strict=True)
    ]
    return PointCloud2(
        header=Header(frame_id=BASE), height=height, width=width, fields=fields, is_bigendian=big,
        point_step=step, row_step=width * step + row_padding, data=array.array("B", b"".join(rows)),
    )  # fmt: skip


class TestCloud:
    POINTS = np.array([[0.11, 0.21, 0.31], [0.52, -0.12, 0.42], [0.51, -0.11, 0.41], [-0.33, 0.03, 0.73]])

    @pytest.mark.parametrize("kind", [PointField.FLOAT32, PointField.FLOAT64])
    @pytest.mark.parametrize("big", [False, True])
    def test_layouts(self, kind, big):
        points, not_finite = m.read_cloud(cloud(self.POINTS, kind, big, row_padding=5, height=2), BASE)
        np.testing.assert_allclose(points, self.POINTS, atol=1e-7)
        assert not_finite == 0

    def test_points_without_return_are_left_out(self):
        points = np.array([[math.nan, 0.0, 0.0], [0.1, 0.1, 0.1], [math.inf, 0.0, 0.0]])
        kept, not_finite = m.read_cloud(cloud(points), BASE)
        np.testing.assert_allclose(kept, points[[1]], atol=1e-7)
        assert not_finite == 2

    def test_an_empty_cloud_is_no_obstacle(self):
        points, not_finite = m.read_cloud(cloud(np.zeros((0, 3))), BASE)
        assert (points.shape, not_finite) == ((0, 3), 0)

    def test_a_million_points_are_read_and_more_refused_unread(self):
        message = cloud(np.zeros((1, 3)), padding=0)
        message.width, message.row_step = 1_000_000, 12_000_000
        message.data = array.array("B", bytes(12_000_000))
        assert m.read_cloud(message, BASE)[0].shape == (1_000_000, 3)
        message.width += 1
        with pytest.raises(m.MessageRefused, match="1000001 points, at most 1000000"):
            m.read_cloud(message, BASE)

    def test_implausible_points_are_refused(self):
        with pytest.raises(m.MessageRefused, match="metres"):
            m.read_cloud(cloud(np.array([[0.0, 2e5, 0.0]])), BASE)

    def test_broken_layouts_are_refused(self):
        lacking, wrong_type, truncated, beyond, narrow = (cloud(self.POINTS) for _ in range(5))
        lacking.fields = lacking.fields[:2]
        wrong_type.fields[0].datatype = PointField.UINT8
        truncated.data = truncated.data[:-1]
        beyond.fields[1].offset = 40
        narrow.row_step = 3
        for message, reason in (
            (lacking, "no field z"), (wrong_type, "datatype 2"), (truncated, "63 bytes"),
            (beyond, "point_step"), (narrow, "row_step"),
        ):  # fmt: skip
            with pytest.raises(m.MessageRefused, match=reason):
                m.read_cloud(message, BASE)


_ANY = st.floats(allow_nan=True, allow_infinity=True)


def _numbers(update: m.MarkerUpdate) -> tuple[object, ...]:
    return update.centre, update.radius, update.lifetime, 0.0 if update.solid is None else update.solid


@settings(deadline=None, max_examples=300)
@given(st.tuples(*[_ANY] * 10), st.integers(-5, 20), st.integers(-5, 20), st.text(max_size=8), _ANY)
def test_fuzzed_messages_are_read_or_refused(numbers, kind, action, frame, point):
    """Whatever the fields hold, a reader returns finite values or raises MessageRefused, nothing else."""
    x, y, z, qw, qx, qy, qz, sx, sy, sz = numbers
    marker = sphere(type=kind, action=action, frame=frame if kind % 2 else BASE)
    marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = x, y, z
    marker.scale.x, marker.scale.y, marker.scale.z = sx, sy, sz
    turned = marker.pose.orientation
    turned.w, turned.x, turned.y, turned.z = qw, qx, qy, qz
    state = JointState(name=list(NAMES), position=array.array("d", [x, y, z]))
    stamped = PointStamped(header=Header(frame_id=BASE))
    stamped.point.x, stamped.point.y = point, x
    for read in (
        lambda: m.read_pose(pose(x, y, z, (qw, qx, qy, qz)), BASE),
        lambda: m.read_joint_positions(state, NAMES),
        lambda: m.read_point(stamped, BASE),
        lambda: _numbers(m.read_marker(marker, BASE)),
    ):
        try:
            parts = read()
        except m.MessageRefused:
            continue
        assert all(np.all(np.isfinite(part)) for part in (parts if isinstance(parts, tuple) else (parts,)))


@settings(deadline=None, max_examples=200)
@given(
    st.integers(0, 5),
    st.integers(0, 5),
    st.integers(0, 40),
    st.integers(0, 200),
    st.integers(0, 300),
    st.data(),
)
def test_fuzzed_clouds_are_read_or_refused(height, width, step, row, size, data):
    fields = [
        PointField(name=name, offset=data.draw(st.integers(0, 50)), datatype=data.draw(st.integers(0, 9)), count=1)
        for name in data.draw(st.lists(st.sampled_from("xyzi"), max_size=5))
    ]
    message = PointCloud2(
        header=Header(frame_id=BASE), height=height, width=width, fields=fields, point_step=step, row_step=row,
        data=array.array("B", data.draw(st.binary(min_size=size, max_size=size))),
    )  # fmt: skip
    try:
        points, _ = m.read_cloud(message, BASE)
    except m.MessageRefused:
        return
    assert np.all(np.isfinite(points))


class TestWriters:
    """Numpy scalars go in, plain numbers come out: serialised and read back they are the same."""

    def test_path(self):
        positions, quaternions = np.arange(6.0).reshape(2, 3), np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0]])
        message = m.path_message(positions, quaternions, BASE, STAMP)
        back = deserialize_message(serialize_message(message), type(message))
        assert [p.pose.position.z for p in back.poses] == [2.0, 5.0]
        assert back.poses[1].pose.orientation.x == 1.0
        assert back.poses[1].header.frame_id == BASE

    def test_image(self):
        pixels = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
        message = m.image_message(pixels, STAMP)
        back = deserialize_message(serialize_message(message), Image)
        assert (back.height, back.width, back.encoding, back.step) == (5, 7, "rgb8", 21)
        np.testing.assert_array_equal(np.frombuffer(back.data, np.uint8).reshape(5, 7, 3), pixels)

    def test_single_precision_input_is_not_garbage(self):
        message = m.pose_message(np.float32([0.5, 0.25, 2.0]), np.float32([1, 0, 0, 0]), BASE, STAMP)
        back = deserialize_message(serialize_message(message), PoseStamped)
        assert (back.pose.position.x, back.pose.position.y, back.pose.position.z) == (0.5, 0.25, 2.0)
        marker = m.sphere_marker("n", np.int64(3), np.float32([0.5, 0, 0]), np.float32(0.25), (1, 0, 0, 1), BASE, STAMP)
        back = deserialize_message(serialize_message(marker), Marker)
        assert (back.id, back.pose.position.x, back.scale.z, back.color.a) == (3, 0.5, 0.5, 1.0)

    def test_joint_states(self):
        message = m.joint_state_message(NAMES, np.float32([1, 2, 3]), np.zeros(3), STAMP)
        back = deserialize_message(serialize_message(message), JointState)
        np.testing.assert_array_equal(m.read_joint_positions(back, NAMES), [1.0, 2.0, 3.0])

    def test_diagnostics(self):
        status = m.diagnostic_status(
            DiagnosticStatus.WARN, "node", "text", "panda", {"a": np.float64(0.5), "b": 3, "c": math.nan}
        )
        array_message = m.diagnostic_array([status], STAMP)
        back = deserialize_message(serialize_message(array_message), type(array_message)).status[0]
        assert back.level == DiagnosticStatus.WARN
        assert {pair.key: pair.value for pair in back.values} == {"a": "0.5", "b": "3", "c": "nan"}

    def test_what_is_no_longer_shown_is_deleted_once(self):
        scene = m.MarkerScene(BASE)
        scene.update([sphere("a", 0), sphere("a", 1)], STAMP)
        second = scene.update([sphere("a", 1)], STAMP).markers
        assert [(x.ns, x.id, x.action) for x in second] == [("a", 1, Marker.ADD), ("a", 0, Marker.DELETE)]
        assert len(scene.update([sphere("a", 1)], STAMP).markers) == 1

    def test_written_spheres_can_be_read(self):
        marker = m.sphere_marker("n", 4, np.array([0.1, 0.2, 0.3]), 0.07, (1.0, 0.0, 0.0, 1.0), BASE, STAMP)
        update = m.read_marker(marker, BASE)
        assert (update.key, update.radius) == (("n", 4), 0.07)

    @pytest.mark.parametrize("kind", [Marker.CUBE, Marker.CYLINDER])
    def test_written_solids_can_be_read(self, kind):
        solid = m.read_marker(shape(kind, (0.1, 0.1, 0.9)), BASE).solid
        marker = m.solid_marker("n", 4, solid, (1.0, 0.0, 0.0, 1.0), BASE, STAMP)
        back = deserialize_message(serialize_message(marker), Marker)
        assert back.type == kind
        points = np.random.default_rng(0).uniform(-0.5, 0.8, (200, 3))
        again = m.read_marker(back, BASE).solid
        away = solid_distances(points, again[None]) - solid_distances(points, solid[None])
        # Of a capsule the cylinder around it is shown.
        assert np.all(np.abs(away) < 1e-9) if kind == Marker.CUBE else np.all(away <= 1e-9)

    def test_cubes(self):
        centres = np.arange(6.0).reshape(2, 3)
        marker = m.cubes_marker("n", centres, np.float32(0.25), (1.0, 0.0, 0.0, 1.0), BASE, STAMP)
        back = deserialize_message(serialize_message(marker), Marker)
        assert (back.type, back.scale.y) == (Marker.CUBE_LIST, 0.25)
        assert [(p.x, p.y, p.z) for p in back.points] == [(0.0, 1.0, 2.0), (3.0, 4.0, 5.0)]
