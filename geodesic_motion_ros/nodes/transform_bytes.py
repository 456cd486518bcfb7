"""Transforms as they come over the wire, read as `marker_bytes` reads markers: a driver sends thousands a second."""

from __future__ import annotations

import math
import struct

from geodesic_motion_ros.nodes.messages import MessageRefused
from geodesic_motion_ros.nodes.plain_cdr import LENGTH, checked_plain, multiple, refusing_short, stamp, text
from geodesic_motion_ros.nodes.transform_table import Numbers

_NUMBERS = struct.Struct("=7d")


def parse_transforms(wire: bytes) -> list[tuple[str, str, int, Numbers]]:
    """Parse a serialised TFMessage: frame, its parent, the stamp [ns], and where it is; refused as a whole where
    numbers are not finite or a quaternion is no unit quaternion.
    """
    data, at, found = checked_plain(wire, "transforms"), 4, []
    with refusing_short(data, "transforms"):
        (count,) = LENGTH.unpack_from(data)
        for _ in range(count):
            at = multiple(at, 4)
            seconds, nanoseconds = stamp(data, at)
            parent, at = text(data, at + 8)
            frame, at = text(data, at)
            at = multiple(at, 8)
            *origin, x, y, z, w = _NUMBERS.unpack_from(data, at)
            at += _NUMBERS.size
            norm = math.hypot(x, y, z, w)
            if not (all(map(math.isfinite, origin)) and 0.9 < norm < 1.1):
                raise MessageRefused(
                    f"'{frame}' stands at {origin} m, {[x, y, z, w]} in '{parent}': expected finite numbers and a unit "
                    "quaternion"
                )
            turn = w / norm, x / norm, y / norm, z / norm
            moment = seconds * 10**9 + nanoseconds
            # A leading / is of ROS 1.
            found.append((frame.removeprefix("/"), parent.removeprefix("/"), moment, (tuple(origin), turn)))
    return found
