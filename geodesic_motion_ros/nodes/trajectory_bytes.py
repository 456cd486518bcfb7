"""Joint trajectories as they go over the wire, without a Python object for each knot.

A reference has hundreds of knots. To make their messages, and to have rclpy read them out again, takes longer than to
plan it: 6 to 10 ms of a control period of 10. In CDR (OMG DDS-XTypes 1.3, 7.4.1) all points but the first lie at the
same alignment: they are the rows of one numpy array.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory

from geodesic_motion_ros.nodes.messages import joint_trajectory_message, whole_nanoseconds

#: Bytes of a sequence's length.
_LENGTH = 4


def joint_trajectory_bytes(
    joint_names: Sequence[str],
    times: np.ndarray,
    positions: np.ndarray,
    velocities: np.ndarray,
    accelerations: np.ndarray,
    begin: float,
) -> bytes:
    """`messages.joint_trajectory_message`, serialised; a publisher takes either."""
    values = positions, velocities, accelerations
    message = joint_trajectory_message(joint_names, times[:1], *(rows[:1] for rows in values), begin)
    result = bytearray(serialize_message(message))
    # Without points a message ends with their number.
    none = serialize_message(JointTrajectory(header=message.header, joint_names=message.joint_names))
    at = len(none) - _LENGTH
    result[at : at + _LENGTH] = np.uint32(len(times)).tobytes()
    return bytes(result + _points(times[1:], values).tobytes())


def _points(times: np.ndarray, values: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Points (n,) that follow another one; it ends with 4 bytes over a multiple of 8, and so do they.

    A sequence is its length, what is missing to a multiple of 8, and its numbers; that of efforts is empty.
    """
    joints = values[0].shape[1]
    row = np.dtype([
        ("positions_length", "u4"), ("positions", "f8", (joints,)),
        ("velocities_length", "u4"), ("velocities_gap", "u4"), ("velocities", "f8", (joints,)),
        ("accelerations_length", "u4"), ("accelerations_gap", "u4"), ("accelerations", "f8", (joints,)),
        ("effort_length", "u4"), ("seconds", "i4"), ("nanoseconds", "u4"),
    ])  # fmt: skip
    points = np.zeros(len(times), dtype=row)
    for name, rows in zip(("positions", "velocities", "accelerations"), values, strict=True):
        points[name], points[f"{name}_length"] = rows[1:], joints
    points["seconds"], points["nanoseconds"] = whole_nanoseconds(times)
    return points
