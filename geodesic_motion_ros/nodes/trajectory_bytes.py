"""Joint trajectories as they go over the wire, without a Python object for each knot.

A reference has hundreds of knots. To make their messages, and to have rclpy read them out again, takes longer than to
plan it: 7 ms of a control period of 10. In plain CDR (OMG DDS-XTypes 1.3, 7.4.1) numbers lie at multiples of their
size from where the message begins, so all points but the first look alike: they are the rows of one numpy array.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from geodesic_motion_ros.nodes.plain_cdr import ENCAPSULATION

_GAP = bytes(4)


def joint_trajectory_bytes(
    joint_names: Sequence[str],
    times: np.ndarray,
    positions: np.ndarray,
    velocities: np.ndarray,
    accelerations: np.ndarray,
    stamp: int,
) -> bytes:
    """Return a serialised JointTrajectory, which a publisher takes in the place of the message.

    Parameters
    ----------
    times : (n,) of the knots [s], 0 or more, after the stamp.
    positions, velocities, accelerations : (n, eta) [rad], [rad/s], [rad/s^2].
    stamp : when the motion begins, by the ROS clock [ns].
    """
    header = struct.pack("=iI", *divmod(stamp, 10**9)) + _string("")
    names = struct.pack("=I", len(joint_names)) + b"".join(map(_string, joint_names))
    head = header + names + struct.pack("=I", len(times))
    points = _points(times, positions, velocities, accelerations).tobytes()
    # The first point's numbers come after a length too.
    gap = _GAP if len(head) % 8 == 0 else b""
    return ENCAPSULATION + head + points[:4] + gap + points[4:]


def _string(text: str) -> bytes:
    """Its length, its characters and a zero, filled up to a multiple of 4 bytes."""
    characters = text.encode() + b"\0"
    return struct.pack("=I", len(characters)) + characters + bytes(-len(characters) % 4)


def _points(times: np.ndarray, positions: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
    """Points (n,) that begin 4 bytes after a multiple of 8, and so end there too.

    A sequence is its length, what is missing to a multiple of 8, and its numbers; that of efforts is empty.
    """
    joints = positions.shape[1]
    row = np.dtype([
        ("positions_length", "u4"), ("positions", "f8", (joints,)),
        ("velocities_length", "u4"), ("velocities_gap", "u4"), ("velocities", "f8", (joints,)),
        ("accelerations_length", "u4"), ("accelerations_gap", "u4"), ("accelerations", "f8", (joints,)),
        ("effort_length", "u4"), ("seconds", "i4"), ("nanoseconds", "u4"),
    ])  # fmt: skip
    points = np.zeros(len(times), dtype=row)
    # A knot goes along its motion to the whole nanosecond that is sent: between knots a millisecond apart, half a
    # nanosecond off would ask for a thousandth more of the acceleration.
    off = (np.round(1e9 * times) * 1e-9 - times)[:, None]
    positions, velocities = positions + off * velocities, velocities + off * accelerations
    values = {"positions": positions, "velocities": velocities, "accelerations": accelerations}
    for name, rows in values.items():
        points[name], points[f"{name}_length"] = rows, joints
    points["seconds"], points["nanoseconds"] = np.divmod(np.round(1e9 * times).astype(np.int64), 10**9)
    return points
