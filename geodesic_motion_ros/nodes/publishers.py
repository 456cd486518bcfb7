"""Who else talks on a topic that only one node may talk on."""

from __future__ import annotations

from rclpy.node import Node


def publishers_of(node: Node, topic: str) -> tuple[str, ...]:
    """Full names of the nodes that publish on a topic, one for each publisher, sorted."""
    found = node.get_publishers_info_by_topic(topic)
    return tuple(sorted(f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in found))
