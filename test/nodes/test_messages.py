"""The border: what is accepted, what is refused with which reason, and that nothing unchecked gets into a field."""

from __future__ import annotations

import array
import math
import struct

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

from geodesic_motion_ros.nodes import messages as m
from geodesic_motion_ros.nodes.trajectory_bytes import joint_trajectory_bytes
from geodesic_motion_ros.robot.kinematics import Robot

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

    @pytest.mark.parametrize("frame", ["", "world", "/world"])
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


PANDA = Robot.named("panda")


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
        # Whole nanoseconds: at other times the knots that are sent lie a little further along the motion.
        times = np.round(1e9 * np.cumsum(generator.uniform(1e-3, 0.1, 20))) * 1e-9
        rows = [PANDA.sample(20, generator), *generator.normal(size=(2, 20, 7))]
        rows[1][-1] = 0.0
        names = [PANDA.joint_names[joint] for joint in order]
        begin = 1_700_000_000_123_456_789
        wire = joint_trajectory_bytes(names, times, *(values[:, order] for values in rows), begin)
        received = deserialize_message(wire, JointTrajectory)
        waypoints = m.read_joint_trajectory(received, PANDA)
        assert (received.header.stamp.sec, received.header.stamp.nanosec) == divmod(begin, 10**9)
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

    @pytest.mark.parametrize(("sent", "expected"), [("left_", ""), ("", "left_"), ("right_", "left_")])
    def test_joints_with_another_prefix_are_named_with_the_remedy(self, sent, expected):
        message = trajectory()
        message.joint_names = list(PANDA.prefixed(sent).joint_names)
        with pytest.raises(m.MessageRefused) as refusal:
            m.read_joint_trajectory(message, PANDA.prefixed(expected), expected)
        assert f"names {sent}panda_joint1, {sent}panda_joint2, " in str(refusal.value)
        assert str(refusal.value).endswith(f"{expected}panda_joint7: set the parameter joint_prefix to '{sent}'")

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


@settings(deadline=None, max_examples=300)
@given(st.tuples(*[_ANY] * 7), _ANY)
def test_fuzzed_messages_are_read_or_refused(numbers, point):
    """Whatever the fields hold, a reader returns finite values or raises MessageRefused, nothing else."""
    x, y, z, qw, qx, qy, qz = numbers
    state = JointState(name=list(NAMES), position=array.array("d", [x, y, z]))
    stamped = PointStamped(header=Header(frame_id=BASE))
    stamped.point.x, stamped.point.y = point, x
    for read in (
        lambda: m.read_pose(pose(x, y, z, (qw, qx, qy, qz)), BASE),
        lambda: m.read_joint_positions(state, NAMES),
        lambda: m.read_point(stamped, BASE),
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
