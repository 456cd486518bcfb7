"""Markers are read or refused with the reason, and what is written can be read."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.shapes import solid_distances
from geodesic_motion_ros.nodes import marker_messages as m
from geodesic_motion_ros.nodes.messages import MessageRefused
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.robot.kinematics import Robot

BASE = "panda_link0"
STAMP = Time(sec=12, nanosec=500_000_000)
NOT_THERE = Refusal(VerdictCode.BAD_INPUT, "not there")
BAD = (math.nan, math.inf, -math.inf, 1e300)
_ANY = st.floats(allow_nan=True, allow_infinity=True)


def sphere(namespace="n", number=1, diameter=0.1, frame=BASE, **fields) -> Marker:
    marker = Marker(header=Header(frame_id=frame, stamp=STAMP), ns=namespace, id=number, type=Marker.SPHERE)
    marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = 0.1, 0.2, 0.3
    marker.scale.x = marker.scale.y = marker.scale.z = diameter
    for name, value in fields.items():
        setattr(marker, name, value)
    return marker


def shape(kind: int, scale: Sequence[float]) -> Marker:
    """A marker at (0.1, 0.2, 0.3), turned by a quarter about z."""
    marker = sphere(type=kind)
    marker.pose.orientation.w = marker.pose.orientation.z = math.sqrt(0.5)
    marker.scale.x, marker.scale.y, marker.scale.z = scale
    return marker


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
        with pytest.raises(MessageRefused, match=r"marker n/1: scale"):
            m.read_marker(sphere(diameter=diameter), BASE)

    @pytest.mark.parametrize("value", BAD)
    def test_centres_must_be_finite(self, value):
        marker = sphere()
        marker.pose.position.z = value
        with pytest.raises(MessageRefused, match=r"marker n/1: centre"):
            m.read_marker(marker, BASE)

    def test_other_shapes_actions_and_frames_are_refused(self):
        with pytest.raises(MessageRefused, match="action 7"):
            m.read_marker(sphere(action=7), BASE)
        with pytest.raises(MessageRefused, match="frame 'camera'"):
            m.read_marker(sphere(frame="camera"), BASE)

    @pytest.mark.parametrize(
        ("kind", "what"),
        [
            (Marker.ARROW, "type 0, an arrow, or no type was set, expected SPHERE"),
            (Marker.LINE_STRIP, "type 4, a line, which is not taken"),
            (Marker.LINE_LIST, "type 5, lines, which are not taken"),
            (Marker.CUBE_LIST, "type 6, a list of cubes, which is not taken: publish its centres as a cloud"),
            (Marker.SPHERE_LIST, "type 7, a list of spheres, which is not taken: publish its centres as a cloud"),
            (Marker.POINTS, "type 8, a list of points, which is not taken: publish its centres as a cloud"),
            (Marker.MESH_RESOURCE, "type 10, a mesh, which is not taken"),
            (Marker.TRIANGLE_LIST, "type 11, triangles, which are not taken"),
            (12, "type 12, expected SPHERE"),
        ],
    )
    def test_what_shows_a_body_and_is_not_taken_is_named(self, kind, what):
        with pytest.raises(MessageRefused, match=what):
            m.read_marker(sphere(type=kind), BASE)

    def test_a_text_is_no_body(self):
        text = sphere(type=Marker.TEXT_VIEW_FACING)
        text.scale.x = text.scale.y = 0.0
        assert m.read_marker(text, BASE).action == "nothing"

    def test_a_leading_slash_is_as_of_ros_1(self):
        assert m.read_marker(sphere(frame=f"/{BASE}"), BASE).action == "put"
        asked = []
        lookup = lambda target, source, stamp: asked.append(source) or NOT_THERE  # noqa: E731
        for frame in ("/camera", ""):
            with pytest.raises(MessageRefused, match=f"frame '{frame}' is unknown here: send it in '{BASE}'"):
                m.read_marker(sphere(frame=frame), BASE, lookup)
        assert asked == ["camera", ""]

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
            with pytest.raises(MessageRefused, match=f"marker n/1: orientation is the {said}"):
                m.read_marker(marker, BASE)
            marker.pose.orientation.w = math.nan
            with pytest.raises(MessageRefused, match="marker n/1: orientation holds nan"):
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
            with pytest.raises(MessageRefused, match=r"marker n/1: scale"):
                m.read_marker(shape(kind, scale), BASE)

    def test_lifetime_must_not_be_negative(self):
        with pytest.raises(MessageRefused, match="lifetime"):
            m.read_marker(sphere(lifetime=Duration(sec=-1)), BASE)


@settings(deadline=None, max_examples=100)
@given(st.tuples(*[_ANY] * 10), st.integers(-5, 20), st.integers(-5, 20), st.text(max_size=8))
def test_fuzzed_markers_are_read_or_refused(numbers, kind, action, frame):
    """Whatever the fields hold, finite values are returned or MessageRefused is raised, nothing else."""
    x, y, z, qw, qx, qy, qz, sx, sy, sz = numbers
    marker = sphere(type=kind, action=action, frame=frame if kind % 2 else BASE)
    marker.pose.position.x, marker.pose.position.y, marker.pose.position.z = x, y, z
    marker.scale.x, marker.scale.y, marker.scale.z = sx, sy, sz
    turned = marker.pose.orientation
    turned.w, turned.x, turned.y, turned.z = qw, qx, qy, qz
    try:
        update = m.read_marker(marker, BASE)
    except MessageRefused:
        return
    solid = 0.0 if update.solid is None else update.solid
    assert all(np.all(np.isfinite(part)) for part in (update.centre, update.radius, update.lifetime, solid))


class TestWriters:
    """Numpy scalars go in, plain numbers come out: serialised and read back they are the same."""

    def test_single_precision_input_is_not_garbage(self):
        marker = m.sphere_marker("n", np.int64(3), np.float32([0.5, 0, 0]), np.float32(0.25), (1, 0, 0, 1), BASE, STAMP)
        back = deserialize_message(serialize_message(marker), Marker)
        assert (back.id, back.pose.position.x, back.scale.z, back.color.a) == (3, 0.5, 0.5, 1.0)

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


class TestHeld:
    """What the hand holds, by markers in the tool frame."""

    TOOL = "panda_grasptarget"
    BOTTLE = HeldObject("n/1", "cylinder", (0.03, 0.2), (0.1, 0.2, 0.3))

    def marker(self, number: int = 1, kind: int = Marker.CYLINDER, **fields) -> Marker:
        marker = sphere(number=number, frame=self.TOOL, type=kind, **fields)
        marker.scale.x, marker.scale.y, marker.scale.z = 0.06, 0.06, 0.2
        return marker

    def after(self, *markers: Marker, held: Sequence[HeldObject] = ()) -> tuple[HeldObject, ...]:
        return m.held_objects_after(markers, held, Robot.named("panda"))

    def test_attach_replace_detach(self):
        assert self.after(self.marker()) == (self.BOTTLE,)
        assert self.after(self.marker(), held=[self.BOTTLE]) == (self.BOTTLE,)
        box = HeldObject("n/1", "box", (0.06, 0.06, 0.2), self.BOTTLE.position)
        assert self.after(self.marker(kind=Marker.CUBE), held=[self.BOTTLE]) == (box,)
        ball = self.after(self.marker(2, Marker.SPHERE), held=[self.BOTTLE])[1]
        assert (ball.name, ball.shape, ball.dimensions) == ("n/2", "sphere", (0.1,))
        assert self.after(self.marker(action=Marker.DELETE), held=[self.BOTTLE, ball]) == (ball,)
        assert self.after(self.marker(action=Marker.DELETEALL), held=[self.BOTTLE, ball]) == ()
        other = sphere("m", action=Marker.DELETEALL)
        assert self.after(other, held=[self.BOTTLE, ball]) == (self.BOTTLE, ball)
        assert self.after(sphere("", action=Marker.DELETEALL), self.marker(), held=[ball]) == (self.BOTTLE,)

    @pytest.mark.parametrize(
        ("changes", "reason"),
        [
            ({"type": Marker.MESH_RESOURCE}, "marker n/1: type 10, a mesh, which is not taken, expected SPHERE"),
            ({"type": Marker.ARROW}, "marker n/1: type 0, an arrow, or no type was set, expected SPHERE"),
            ({"header": Header(frame_id=BASE)}, "marker n/1: frame 'panda_link0'.*send it in 'panda_grasptarget'"),
            ({"lifetime": Duration(sec=2)}, "lifetime 2 s, expected 0"),
            ({"action": 7}, "action 7"),
            ({"action": Marker.DELETE}, "marker n/1: nothing of this name is held; held: n/2"),
        ],
    )
    def test_what_cannot_be_used_is_refused_by_name(self, changes, reason):
        marker = self.marker()
        for name, value in changes.items():
            setattr(marker, name, value)
        with pytest.raises(MessageRefused, match=reason):
            self.after(marker, held=[HeldObject("n/2", "sphere", (0.02,))])

    @pytest.mark.parametrize("value", [*BAD, 0.0, -0.1])
    def test_no_size(self, value):
        marker = self.marker()
        marker.scale.z = value
        with pytest.raises(MessageRefused, match="marker n/1: scale"):
            self.after(marker)

    def test_two_of_one_name_and_what_is_larger_than_the_arm(self):
        with pytest.raises(MessageRefused, match="marker n/1: two held objects have this ns and id"):
            self.after(self.marker(), self.marker())
        large = self.marker()
        large.scale.z = 3.0
        with pytest.raises(MessageRefused, match=r"'n/1' reaches 1\.87 m from 'panda_grasptarget'"):
            self.after(large)

    def test_what_is_shown_is_read_again(self):
        place = np.array(self.BOTTLE.position), np.array(self.BOTTLE.quaternion)
        shown = m.held_marker(0, self.BOTTLE, *place, (0.0,) * 4, self.TOOL, STAMP)
        assert self.after(shown)[0] == HeldObject("held/0", "cylinder", (0.03, 0.2), (0.1, 0.2, 0.3))
