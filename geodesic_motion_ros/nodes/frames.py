"""The places of other frames in the base frame: tf2's answer where tf2 is installed.

tf2 is no dependency: the ROS packages of PyPI have none, and with all messages in the base frame nothing asks for it.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.clock import ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time as RosTime

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.nodes.messages import FrameLookup, FramePose


class TransformBuffer(Protocol):
    """The part of a tf2_ros.Buffer that is used."""

    def lookup_transform(self, target_frame: str, source_frame: str, time: RosTime) -> Any:
        """Return the TransformStamped of the source frame in the target frame, at time 0 the newest; does not wait."""

    def clear(self) -> None:
        """Forget the transforms that change."""


class BufferedFrames:
    """The frames of a buffer that somebody fills, as `FrameLookup`."""

    def __init__(self, buffer: TransformBuffer, unknown: type[Exception], *filled_by: object) -> None:
        """unknown : what the buffer raises where it has no transform. filled_by : who must live as long."""
        self._buffer, self._unknown, self._filled_by = buffer, unknown, filled_by

    def __call__(self, target: str, source: str, stamp: Time) -> FramePose | Refusal:
        if stamp.sec < 0:
            return Refusal(VerdictCode.BAD_INPUT, f"its stamp, {stamp.sec} s, is negative")
        try:
            at = RosTime(seconds=stamp.sec, nanoseconds=stamp.nanosec, clock_type=ClockType.ROS_TIME)
            found = self._buffer.lookup_transform(target, source, at).transform
        except self._unknown as error:
            return Refusal(VerdictCode.BAD_INPUT, f"tf2 has no transform of it at its stamp: {error}")
        position, rotation = found.translation, found.rotation
        return (
            np.array([position.x, position.y, position.z]),
            np.array([rotation.w, rotation.x, rotation.y, rotation.z]),
        )


class FixedFrame:
    """One frame that stands where a parameter says, and the others as somebody else knows, as `FrameLookup`."""

    def __init__(self, name: str, pose: FramePose, others: FrameLookup) -> None:
        """pose : position (3,) [m] and unit quaternion (4,), scalar first, in the base frame."""
        self._name, self._pose, self._others = name, pose, others

    def __call__(self, target: str, source: str, stamp: Time) -> FramePose | Refusal:
        return self._pose if source == self._name else self._others(target, source, stamp)


def frames_of(node: Node) -> FrameLookup:
    """Return the frames that a node hears of on `/tf` and `/tf_static`; where tf2 is not installed, none."""
    try:
        import tf2_ros
    except ImportError:
        return no_tf2
    buffer = tf2_ros.Buffer()
    listener = tf2_ros.TransformListener(buffer, node)
    # A buffer takes no transform that is much older than those it has: after the clock was set back it would be deaf.
    threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True)
    jumps = node.get_clock().create_jump_callback(threshold, post_callback=lambda jump: buffer.clear())
    return BufferedFrames(buffer, tf2_ros.TransformException, listener, jumps)


def no_tf2(target: str, source: str, stamp: Time) -> Refusal:
    """Refuse every lookup, on a machine without tf2."""
    return Refusal(VerdictCode.BAD_INPUT, "tf2_ros, which would transform it, is not installed")
