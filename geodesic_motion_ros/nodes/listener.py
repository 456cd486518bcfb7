"""Hear messages: by a clock, in a frame, noting those that are refused, and in turn where some wait for a transform."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile

from geodesic_motion_ros.nodes.frames import FixedFrame, LateTransforms, frames_of
from geodesic_motion_ros.nodes.node_time import NodeTime
from geodesic_motion_ros.nodes.parameters import NodeParameters
from geodesic_motion_ros.nodes.refusals import RefusalLog


class Listener:
    """Subscribe for all inputs of a node, which share clock, frames and refusals.

    Attributes
    ----------
    base_frame : what is heard is taken into this frame. frames : tells where other frames stand.
    late : has messages wait for transforms. refusals : counts what is refused. time : tells the time.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self.node, self.parameters = node, parameters
        self.base_frame: str = parameters["base_frame"]
        self.refusals = RefusalLog(node.get_logger().warning)
        self.late = LateTransforms(node, self.base_frame)
        self.frames = frames_of(node, self.refusals, self.late.look)
        if parameters["camera_frame"]:
            place = np.array(parameters["camera_pose"])
            self.frames = FixedFrame(parameters["camera_frame"], (place[:3], place[3:]), self.frames)
        self.late.frames = self.frames
        self.time = NodeTime(node.get_clock())

    def subscribe(
        self, kind: type, topic: str, take: Callable[[Any], None], qos: QoSProfile, queue: str = "", raw: bool = False
    ) -> None:
        """Subscribe to a topic. queue : of messages that wait for transforms; "": that of the topic. raw : `take` gets
        bytes.
        """

        def receive(message: Any) -> None:
            with self.refusals.guard(topic):
                take(message)

        receive_in_turn = lambda message: self.late.take(queue or topic, partial(receive, message))  # noqa: E731
        self.node.create_subscription(kind, topic, receive_in_turn, qos, raw=raw)
