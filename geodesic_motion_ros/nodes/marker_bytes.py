"""Markers as they come over the wire, without a Python object for each of their fields.

rclpy makes 25 objects of each marker, and holds the interpreter until it has made all of a message: 5 ms and more for
a hundred, in which the control loop stands still. An obstacle, or a picture of one, needs a few of their numbers: they
are read here. In
plain CDR (OMG DDS-XTypes 1.3, 7.4.1) numbers lie at multiples of their size from where the message begins, and what has
no fixed length begins with its length.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from geodesic_motion_ros.nodes.plain_cdr import (
    LENGTH,
    Stamp,
    StampedFrame,
    checked_plain,
    multiple,
    refusing_short,
    stamp,
    text,
)

_WHICH = struct.Struct("=iii")
_NUMBERS = struct.Struct("=10d")
_TINT = struct.Struct("=4f")
_NO_POINTS = np.zeros((0, 3))
_POINT, _COLOUR, _TEXTURE_COORDINATES = (3, 8), (4, 4), (2, 4)


class Vector(NamedTuple):
    """A geometry_msgs/Point or Vector3."""

    x: float
    y: float
    z: float


class Turn(NamedTuple):
    """A geometry_msgs/Quaternion."""

    x: float
    y: float
    z: float
    w: float


class Place(NamedTuple):
    """A geometry_msgs/Pose."""

    position: Vector
    orientation: Turn


class Tint(NamedTuple):
    """A std_msgs/ColorRGBA."""

    r: float
    g: float
    b: float
    a: float


class SeenMarker(NamedTuple):
    """The fields of a visualization_msgs/Marker that tell of a body and how it looks, under the names that it has
    there; points as an array (n, 3) [m].
    """

    header: StampedFrame
    ns: str
    id: int
    type: int
    action: int
    pose: Place
    scale: Vector
    color: Tint
    lifetime: Stamp
    points: np.ndarray


def parse_marker(wire: bytes) -> SeenMarker:
    """Parse a serialised Marker."""
    return _markers(wire, 1)[0]


def parse_markers(wire: bytes) -> list[SeenMarker]:
    """Parse a serialised MarkerArray."""
    return _markers(wire)


def _markers(wire: bytes, count: int | None = None) -> list[SeenMarker]:
    data, at, found = checked_plain(wire, "markers"), 0, []
    with refusing_short(data, "markers"):
        if count is None:
            (count,), at = LENGTH.unpack_from(data), 4
        for _ in range(count):
            marker, at = _marker(data, multiple(at, 4))
            found.append(marker)
        if at > len(data):
            raise struct.error
    return found


def _marker(data: bytes, at: int) -> tuple[SeenMarker, int]:
    """The marker that begins at a byte, and where it ends."""
    moment = stamp(data, at)
    frame, at = text(data, at + 8)
    namespace, at = text(data, at)
    number, kind, action = _WHICH.unpack_from(data, at)
    at = multiple(at + 12, 8)
    x, y, z, *orientation, length, width, height = _NUMBERS.unpack_from(data, at)
    tint = Tint._make(_TINT.unpack_from(data, at + 80))
    at += 96
    lifetime = stamp(data, at)
    # Whether it is locked to its frame, one byte, is of no interest.
    at = multiple(at + 9, 4)
    points, end = _points(data, at), _after_looks(data, at)
    place = Place(Vector(x, y, z), Turn._make(orientation))
    header, scale = StampedFrame(moment, frame), Vector(length, width, height)
    return SeenMarker(header, namespace, number, kind, action, place, scale, tint, lifetime, points), end


def _points(data: bytes, at: int) -> np.ndarray:
    """The points (n, 3) of a marker that begin at a byte."""
    (count,) = LENGTH.unpack_from(data, at)
    if not count:
        return _NO_POINTS
    begin = multiple(at + 4, 8)
    if begin + 24 * count > len(data):
        raise struct.error
    return np.frombuffer(data, dtype="=f8", count=3 * count, offset=begin).reshape(-1, 3)


def _after_looks(data: bytes, at: int) -> int:
    """Where a marker ends whose points begin at a byte: there follow colours, a texture, texts and a mesh."""
    at = _after_numbers(data, at, *_POINT)
    at = _after_numbers(data, at, *_COLOUR)
    at = _after_bytes(data, at)  # texture_resource
    at = _after_bytes(data, at + 8)  # stamp and frame of the texture
    at = _after_bytes(data, at)  # its format
    at = _after_bytes(data, at)
    at = _after_numbers(data, at, *_TEXTURE_COORDINATES)
    at = _after_bytes(data, at)  # text
    at = _after_bytes(data, at)  # mesh_resource
    at = _after_bytes(data, at)  # the mesh's name
    (size,) = LENGTH.unpack_from(data, at)
    # The last field is one byte, which need not lie at a multiple of anything.
    return at + 4 + size + 1


def _after_bytes(data: bytes, at: int) -> int:
    (length,) = LENGTH.unpack_from(data, at)
    return (at + 7 + length) & ~3


def _after_numbers(data: bytes, at: int, each: int, size: int) -> int:
    """Behind a sequence of so many numbers each, of a size [bytes]."""
    (length,) = LENGTH.unpack_from(data, at)
    return multiple(at + 4, size) + length * each * size if length else at + 4
