"""The places of other frames in the base frame, from `/tf` and `/tf_static` where `tf2_msgs` is installed.

It is no dependency: the ROS packages of PyPI lack it, and with all messages in the base frame nothing is asked for.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from time import monotonic
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.nodes.extras import extra
from geodesic_motion_ros.nodes.messages import FrameLookup, FramePose, TransformAwaited
from geodesic_motion_ros.nodes.refusals import RefusalLog
from geodesic_motion_ros.nodes.running import STEADY
from geodesic_motion_ros.nodes.transform_bytes import parse_transforms
from geodesic_motion_ros.nodes.transform_table import NotYetKnown, TransformTable

#: A message waits so long [s] for a transform that it needs.
PATIENCE = 0.1
#: So often [s] it is looked at whether that is over.
_LOOK = 0.02
#: Messages that wait on a topic, at most; more of them and the oldest is refused at once.
_MOST_WAITING = 50
_MOVING = QoSProfile(depth=100)
_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class FixedFrame:
    """One frame that stands where a parameter says, and the others as somebody else knows, as `FrameLookup`."""

    def __init__(self, name: str, pose: FramePose, others: FrameLookup) -> None:
        """pose : position (3,) [m] and unit quaternion (4,), scalar first, in the base frame."""
        self._name, self._pose, self._others = name, pose, others

    def __call__(self, target: str, source: str, stamp: Time) -> FramePose | Refusal:
        return self._pose if source == self._name else self._others(target, source, stamp)


class HeardFrames:
    """The frames that a node hears of on `/tf` and `/tf_static`, as `FrameLookup`."""

    def __init__(self, node: Node, kind: type, refusals: RefusalLog, changed: Callable[[], None]) -> None:
        """kind : TFMessage. changed : called when something was heard."""
        self._table = TransformTable()
        self._refusals, self._changed = refusals, changed
        for topic, qos, static in (("/tf", _MOVING, False), ("/tf_static", _STATIC, True)):
            node.create_subscription(kind, topic, partial(self._hear, topic, static), qos, raw=True)
        # After the clock was set back, stamps of before are of the future.
        threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True)
        self._jumps = node.get_clock().create_jump_callback(
            threshold, post_callback=lambda jump: self._table.forget_motion()
        )

    def _hear(self, topic: str, static: bool, message: bytes) -> None:
        with self._refusals.guard(topic):
            for frame, parent, stamp, place in parse_transforms(message):
                self._table.add(frame, parent, stamp, place, static)
        self._changed()

    def __call__(self, target: str, source: str, stamp: Time) -> FramePose | Refusal:
        if stamp.sec < 0:
            return Refusal(VerdictCode.BAD_INPUT, f"its stamp, {stamp.sec} s, is negative")
        found = self._table.place(target, source, stamp.sec * 10**9 + stamp.nanosec)
        return found if isinstance(found, Refusal) else (found.origin, found.quaternion)


def frames_of(node: Node, refusals: RefusalLog, changed: Callable[[], None]) -> FrameLookup:
    """Return the frames that a node hears of; where `tf2_msgs` is not installed, none. changed : as of `HeardFrames`.
    """
    kind = extra("tf2_msgs/msg/TFMessage")
    return no_tf if kind is None else HeardFrames(node, kind, refusals, changed)


def no_tf(target: str, source: str, stamp: Time) -> Refusal:
    """Refuse every lookup, on a machine without `tf2_msgs`."""
    return Refusal(VerdictCode.BAD_INPUT, "tf2_msgs, for tf, is not installed: make ros-extras")


class LateTransforms:
    """Messages that wait a moment for transforms, each topic in its order; others are taken at once.

    Only the thread that spins the node calls it.
    """

    def __init__(self, node: Node, base_frame: str) -> None:
        self._base_frame = base_frame
        self.frames: FrameLookup = no_tf
        #: By topic: what takes a message, and since when it waits [s].
        self._waiting: dict[str, deque[tuple[Callable[[], Any], float]]] = {}
        self._arrived = 0.0
        self._timer = node.create_timer(_LOOK, self.look, clock=STEADY)
        self._timer.cancel()

    def take(self, topic: str, work: Callable[[], Any]) -> Any:
        """Have a message of a topic taken, once those before it are; returns what that returns, None where it waits."""
        waiting = self._waiting.setdefault(topic, deque())
        if waiting:
            self._wait(waiting, work, monotonic())
            return None
        self._arrived = monotonic()
        try:
            return work()
        except TransformAwaited:
            self._wait(waiting, work, self._arrived)
            return None

    def need(self, headers: Iterable[Header]) -> None:
        """Have the message that is being taken wait where the frame of one of its headers may be known in a moment."""
        if monotonic() - self._arrived > PATIENCE:
            return
        if any(map(self.may_come, headers)):
            raise TransformAwaited

    def may_come(self, header: Header) -> bool:
        """Tell whether where the frame of a message stood is not known, but may be in a moment; any thread may ask."""
        name = header.frame_id.removeprefix("/")
        return name != self._base_frame and isinstance(self.frames(self._base_frame, name, header.stamp), NotYetKnown)

    def look(self) -> None:
        """Take the messages whose transforms have come, or that have waited long enough to be refused."""
        for waiting in self._waiting.values():
            while waiting:
                work, self._arrived = waiting[0]
                try:
                    work()
                except TransformAwaited:
                    break
                waiting.popleft()
        if not any(self._waiting.values()):
            self._timer.cancel()

    def _wait(self, waiting: deque, work: Callable[[], Any], since: float) -> None:
        waiting.append((work, since))
        if len(waiting) > _MOST_WAITING:
            waiting[0] = waiting[0][0], -math.inf
            self.look()
        self._timer.reset()
