"""Who else is on a topic: one that only one node may publish on, or that some node is to receive; latched topics."""

from __future__ import annotations

from collections.abc import Iterable

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo

#: Of what is published once: who subscribes later receives it too.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def publishers_of(node: Node, topic: str) -> tuple[str, ...]:
    """Return full names of the nodes that publish on a topic, one for each publisher, sorted."""
    return _names(node.get_publishers_info_by_topic(topic))


def subscribers_of(node: Node, topic: str) -> tuple[str, ...]:
    """Return full names of the nodes that receive a topic, one for each subscription, sorted."""
    return _names(node.get_subscriptions_info_by_topic(topic))


def _names(found: Iterable[TopicEndpointInfo]) -> tuple[str, ...]:
    return tuple(sorted(f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in found))
