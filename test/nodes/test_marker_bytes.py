"""Markers that are read from bytes are those that were sent; what is cut off or spoiled is refused."""

from __future__ import annotations

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray, MeshFile, UVCoordinate

from geodesic_motion_ros.nodes.marker_bytes import SeenMarker, parse_marker, parse_markers
from geodesic_motion_ros.nodes.marker_messages import sphere_marker
from geodesic_motion_ros.nodes.messages import MessageRefused

STAMP = Time(sec=1_700_000_000, nanosec=999_999_999)


def full(random: np.random.Generator) -> Marker:
    """A marker whose fields of any length have lengths by chance, zero among them."""

    def some(make) -> list:
        return [make() for _ in range(random.integers(4))]

    def text() -> str:
        return "".join(some(lambda: "äb"[random.integers(2)]))

    def data() -> list[int]:
        return some(lambda: int(random.integers(256)))

    marker = Marker(
        header=Header(stamp=STAMP, frame_id=text()), ns=text(), id=int(random.integers(-9, 9)),
        type=int(random.integers(12)), action=int(random.integers(4)), color=ColorRGBA(r=1.0, a=0.5),
        lifetime=Duration(sec=-3, nanosec=7), frame_locked=True, points=some(lambda: Point(x=random.normal())),
        colors=some(ColorRGBA), texture_resource=text(), uv_coordinates=some(UVCoordinate), text=text(),
        texture=CompressedImage(header=Header(frame_id=text()), format=text(), data=data()),
        mesh_resource=text(), mesh_file=MeshFile(filename=text(), data=data()),
    )  # fmt: skip
    position, turn, scale = marker.pose.position, marker.pose.orientation, marker.scale
    position.x, position.y, position.z, scale.x, scale.y, scale.z = random.normal(size=6).tolist()
    turn.x, turn.y, turn.z, turn.w = random.normal(size=4).tolist()
    return marker


def assert_the_same(seen: SeenMarker, sent: Marker) -> None:
    assert seen[1:5] == (sent.ns, sent.id, sent.type, sent.action)
    assert seen.header.frame_id == sent.header.frame_id
    for name in ("header.stamp", "lifetime", "pose.position", "pose.orientation", "scale", "color"):
        got, given = seen, sent
        for part in name.split("."):
            got, given = getattr(got, part), getattr(given, part)
        assert got._asdict() == {field: getattr(given, field) for field in got._fields}
    assert seen.points.tolist() == [[point.x, point.y, point.z] for point in sent.points]


@pytest.mark.parametrize("seed", range(30))
def test_they_are_those_that_were_sent(seed: int) -> None:
    random = np.random.default_rng(seed)
    sent = [full(random) for _ in range(seed % 4)]
    seen = parse_markers(serialize_message(MarkerArray(markers=sent)))
    assert len(seen) == len(sent)
    for got, given in zip(seen, sent, strict=True):
        assert_the_same(got, given)
        assert_the_same(parse_marker(serialize_message(given)), given)


def test_whatever_is_cut_off_is_refused() -> None:
    wire = serialize_message(MarkerArray(markers=[full(np.random.default_rng(5)) for _ in range(2)]))
    # Behind the end up to three bytes mean nothing.
    for length in range(len(wire) - 3):
        with pytest.raises(MessageRefused):
            parse_markers(wire[:length])


def test_spoiled_bytes_are_refused_or_read() -> None:
    random, refused = np.random.default_rng(0), 0
    wire = np.frombuffer(serialize_message(MarkerArray(markers=[full(random) for _ in range(3)])), np.uint8)
    for _ in range(2000):
        spoiled = wire.copy()
        spoiled[random.integers(len(wire), size=4)] = random.integers(256, size=4)
        try:
            parse_markers(spoiled.tobytes())
        except MessageRefused:
            refused += 1
    assert 0 < refused < 2000


def test_another_order_of_bytes_is_refused() -> None:
    wire = serialize_message(sphere_marker("n", 1, np.zeros(3), 0.1, (1.0, 0.0, 0.0, 1.0), "base", STAMP))
    with pytest.raises(MessageRefused, match="written as 0000, expected plain CDR, 0001"):
        parse_marker(bytes(2) + wire[2:])
