"""The page's tables of topics and services are those of the nodes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from bench import Bench
from rclpy.node import Node

from geodesic_motion_ros.nodes.extras import extra
from geodesic_motion_ros.nodes.franka_node import FrankaNode
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.record_node import RecordNode
from geodesic_motion_ros.nodes.twin_node import TwinNode

PAGE = (Path(__file__).resolve().parents[2] / "doc" / "ros_interface.md").read_text()
#: Rows of actions, which are neither topics nor services, and of topics that need a package, by its message.
ACTIONS = {"move_to_goal", "trajectory_action", "follow_joint_trajectory"}
NEEDS = {
    "planning_scene": "moveit_msgs/msg/PlanningScene", "tf": "tf2_msgs/msg/TFMessage",
    "tf_static": "tf2_msgs/msg/TFMessage",
}  # fmt: skip
#: What every node of rclpy has.
EVERY = {"rcl_interfaces", "type_description_interfaces", "rosgraph_msgs"}


def documented(node: str) -> set[str]:
    """Names in the first column of the table of a node, of topics and services that are there on this machine."""
    table = PAGE.split(f"opics and services of the {node} ")[1].split("\n\n")[1]
    names = {name for row in table.splitlines() for name in re.findall("`/?(.+?)`", row.split("|")[1])}
    return names - ACTIONS - {name for name in names if name in NEEDS and extra(NEEDS[name]) is None}


def interface(node: Node, namespace: str = "") -> set[str]:
    """Topics and services of a node in a namespace, its own with `~/`, the others without a leading slash."""
    ends = [(end.topic_name, end.msg_type) for end in (*node.publishers, *node.subscriptions)]
    ends += [(end.srv_name, end.srv_type) for end in node.services]
    names = {name for name, kind in ends if kind.__module__.partition(".")[0] not in EVERY}
    names = {name.removeprefix(f"/{namespace}").removeprefix("/") for name in names}
    own = f"{node.get_name()}/"
    return {f"~/{name.removeprefix(own)}" if name.startswith(own) else name for name in names}


def test_those_of_the_twin(bench):
    # With all that it may publish.
    assert interface(bench.add(TwinNode, cloud_rate=1.0)) == documented("twin")


def test_those_of_the_recorder(bench, tmp_path):
    assert interface(bench.add(RecordNode, folder=str(tmp_path))) == documented("recorder")


def test_those_of_the_driver():
    pytest.importorskip("pylibfranka", reason="pylibfranka is not installed: `make robot-server`")
    bench = Bench(realtime=True)  # as an arm is
    try:
        # no arm is there: it looks for one
        assert interface(bench.add(FrankaNode, address="127.0.0.1")) == documented("driver")
    finally:
        bench.close()


def test_those_of_the_planner(bench):
    found = set()
    for output in ("joint_trajectory", "target_pose"):
        found |= interface(bench.add(PlannerNode, namespace=output, output=output), output)
    assert found == documented("planner")
