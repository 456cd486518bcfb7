"""Subscriptions that receive every publisher of an obstacle topic: reliable or best effort, latched or not."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo

# What rclpy calls a node that it has not heard of, though it has of its publisher.
_NOT_YET_KNOWN = "_NODE_NAME_UNKNOWN_"
# A second copy of a message, on another subscription of its topic, arrives within so long [s].
_COPY_WITHIN = 1.0


class ObstacleSubscription:
    """A subscription that receives a topic whatever quality of service its publishers offer, and each message once.

    DDS connects no best-effort publisher with a reliable subscription, and hands what a latched publisher sent
    earlier to transient-local subscriptions only. So there is one subscription from the beginning on, and as soon as a
    publisher appears that needs it another one beside it; what arrives on both is taken once. What arrives on a
    transient-local one was latched; by which publisher DDS does not tell.
    """

    def __init__(
        self,
        node: Node,
        kind: type,
        topic: str,
        take: Callable[[Any], None],
        depth: int,
        reliability: ReliabilityPolicy,
        raw: bool = False,
        take_latched: Callable[[Any, frozenset[str]], None] = lambda *_: None,
        take_end: Callable[[str], None] = lambda _: None,
    ) -> None:
        """depth, reliability : of the first subscription. raw : `take` receives the message's bytes.

        take_latched : receives what `take` has returned for a message that was latched, and the living publishers that
        latch what they send, one of which sent it. take_end : receives such a publisher when it has ended.
        """
        self._take_latched, self._take_end = take_latched, take_end
        self._latching: frozenset[str] = frozenset()
        self._node, self._kind, self._topic, self._take, self._depth, self._raw = node, kind, topic, take, depth, raw
        self._subscriptions: dict[tuple[ReliabilityPolicy, DurabilityPolicy], Any] = {}
        self._copies = _Copies()
        self._subscribe(reliability, DurabilityPolicy.VOLATILE)

    def other_types(self) -> list[str]:
        """Return sentences about the publishers whose messages never arrive: they are of another type than the topic's.
        """
        expected = f"{self._kind.__module__.split('.')[0]}/msg/{self._kind.__name__}"
        return [
            f"{found.node_namespace.rstrip('/')}/{found.node_name} publishes {found.topic_type}, expected is {expected}"
            for found in self._publishers()
            if found.topic_type != expected and found.node_name != _NOT_YET_KNOWN
        ]

    @property
    def publishers(self) -> tuple[str, ...]:
        """Full names of the nodes that publish, each once, sorted."""
        return tuple(sorted({f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in self._publishers()}))

    def look_for_latching(self) -> None:
        """Look which publishers latch what they send, and hand over those that have ended."""
        latching = [one for one in self._publishers() if one.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL]
        if latching:
            self._subscribe(ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)
        before, self._latching = self._latching, frozenset(bytes(one.endpoint_gid).hex() for one in latching)
        for publisher in before - self._latching:
            self._take_end(publisher)

    def _subscribe(self, reliability: ReliabilityPolicy, durability: DurabilityPolicy) -> None:
        offered = reliability, durability
        if offered in self._subscriptions:
            return
        self._subscriptions[offered] = None  # a publisher that appears meanwhile must not make a second one
        profile = QoSProfile(depth=self._depth, reliability=reliability, durability=durability)
        # Not rclpy's own callback: its warning says that no message will come, which the other subscription belies.
        events = SubscriptionEventCallbacks(
            matched=lambda _: self.look_for_latching(),
            incompatible_qos=lambda _: self._subscribe(ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
            use_default_callbacks=False,
        )

        def receive(message: bytes) -> None:
            received = self._copies.take(message, offered, time.monotonic())
            if received.is_new or len(self._subscriptions) == 1:
                received.result = self._take(message if self._raw else deserialize_message(message, self._kind))
            if durability == DurabilityPolicy.TRANSIENT_LOCAL:
                self.look_for_latching()
                self._take_latched(received.result, self._latching)

        self._subscriptions[offered] = self._node.create_subscription(
            self._kind, self._topic, receive, profile, raw=True, event_callbacks=events
        )

    def _publishers(self) -> list[TopicEndpointInfo]:
        return self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(self._topic))


@dataclass
class _Received:
    content: int
    at: float
    by: set[object]
    result: Any = None

    @property
    def is_new(self) -> bool:
        """Whether one subscription alone has received it."""
        return len(self.by) == 1


class _Copies:
    """Tells the copies of a message on several subscriptions from messages that are sent again.

    Each subscription receives what a publisher sends in its order: the first message with this content that one has
    not received yet is the one that another has.
    """

    def __init__(self) -> None:
        self._received: deque[_Received] = deque()

    def take(self, message: bytes, subscription: object, now: float) -> _Received:
        """Take a message that a subscription has received at a time [s] of a steady clock."""
        while self._received and now - self._received[0].at > _COPY_WITHIN:
            self._received.popleft()
        content = hash(message)
        for received in self._received:
            if received.content == content and subscription not in received.by:
                received.by.add(subscription)
                return received
        self._received.append(_Received(content, now, {subscription}))
        return self._received[-1]
