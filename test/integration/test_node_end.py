"""A node that has ended leaves the ROS graph, whatever it had: who waits for it must not find it."""

from __future__ import annotations

from typing import Any

import pytest
from bench import Bench

from geodesic_motion_ros.nodes.filter_node import FilterNode
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.twin_node import TwinNode


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        (PlannerNode, {}),
        (PlannerNode, {"trajectory_action": "arm/follow_joint_trajectory"}),
        (FilterNode, {"robot": "panda", "scene": "none"}),
        (TwinNode, {}),
    ],
    ids=["planner", "planner that sends to an action", "filter", "twin"],
)  # fmt: skip
def test_a_node_that_has_ended_is_no_longer_seen(bench: Bench, kind: type, parameters: dict[str, Any]) -> None:
    if "trajectory_action" in parameters:
        pytest.importorskip("control_msgs.action", reason="make ros-extras builds it")
    node = bench.add(kind, **parameters)
    name = node.get_name()
    bench.poll(lambda: name in bench.probe.get_node_names(), "the node")
    bench.end(node)
    bench.poll(lambda: name not in bench.probe.get_node_names(), "a graph without it")
