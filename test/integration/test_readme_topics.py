"""The pages' tables of topics and services, with their types, are those of the nodes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from bench import Bench
from rclpy.node import Node

from geodesic_motion_ros.nodes.extras import extra
from geodesic_motion_ros.nodes.filter_node import FilterNode
from geodesic_motion_ros.nodes.franka_node import FrankaNode
from geodesic_motion_ros.nodes.planner_node import PlannerNode
from geodesic_motion_ros.nodes.record_node import RecordNode
from geodesic_motion_ros.nodes.twin_node import TwinNode

DOC = Path(__file__).resolve().parents[2] / "doc"
#: What stands before the table of a node: where on a page.
HEADINGS = {
    "planner": "Topics and services of the planner ", "twin": "Topics and services of the twin ",
    "recorder": "Topics and services of the recorder ", "page": "Topics and services of [`view`]",
    "driver": "Topics and services of the driver ", "filter": "filter --ros-args -p robot:=panda -p scene:=none\n```",
}  # fmt: skip
#: Rows of actions, which are neither topics nor services, and of topics that need a package, by its message.
ACTIONS = {"move_to_goal", "trajectory_action", "follow_joint_trajectory"}
NEEDS = {
    "planning_scene": "moveit_msgs/msg/PlanningScene", "tf": "tf2_msgs/msg/TFMessage",
    "tf_static": "tf2_msgs/msg/TFMessage",
}  # fmt: skip
#: What every node of rclpy has.
EVERY = {"rcl_interfaces", "type_description_interfaces", "rosgraph_msgs"}


def documented(node: str, page: str = "ros_interface.md") -> dict[str, str]:
    """Types of topics and services in the table of a node, by their names; "" for a type "as above".

    Those that are there on this machine, without the `/msg/` of a message. Several types in a row are those of its
    names in turn.
    """
    table = (DOC / page).read_text().split(HEADINGS[node])[1].split("\n\n", 2)[1]
    types: dict[str, str] = {}
    for row in table.splitlines()[2:]:
        names, kinds = row.replace(r"\|", "/").split("|")[1:3]
        of_row = [kind.strip() for kind in kinds.split(",")] if kinds.strip() != "as above" else [""]
        found = re.findall("`/?(.+?)`", names)
        assert len(of_row) in (1, len(found)), f"{len(found)} names, {len(of_row)} types: {row[:80]}"
        package = of_row[0].rpartition("/")[0]
        of_row = [kind if "/" in kind or not kind else f"{package}/{kind}" for kind in of_row]
        types |= zip(found, of_row * (len(found) if len(of_row) == 1 else 1), strict=True)
    return {
        name: kind
        for name, kind in types.items()
        if name not in ACTIONS and not (name in NEEDS and extra(NEEDS[name]) is None)
    }


def interface(node: Node, namespace: str = "") -> dict[str, str]:
    """Types of topics and services of a node in a namespace, by their names, its own with `~/`, the others without a
    leading slash.
    """
    ends = [(end.topic_name, end.msg_type) for end in (*node.publishers, *node.subscriptions)]
    ends += [(end.srv_name, end.srv_type) for end in (*node.services, *node.clients)]
    types = {}
    for name, kind in ends:
        package, folder = kind.__module__.split(".")[:2]
        if package not in EVERY:
            name = name.removeprefix(f"/{namespace}").removeprefix("/")
            own = name.removeprefix(f"{node.get_name()}/")
            name = name if own == name else f"~/{own}"
            types[name] = "/".join([package, *([folder] if folder != "msg" else []), kind.__name__])
    return types


def agree(found: dict[str, str], table: dict[str, str]) -> bool:
    """Whether a table names all that a node has, with its types where it states them."""
    return found.keys() == table.keys() and all(kind in ("", found[name]) for name, kind in table.items())


def test_those_of_the_twin(bench):
    # With all that it may publish.
    assert agree(interface(bench.add(TwinNode, cloud_rate=1.0)), documented("twin"))


def test_those_of_the_recorder(bench, tmp_path):
    assert agree(interface(bench.add(RecordNode, folder=str(tmp_path))), documented("recorder"))


def test_those_of_the_driver():
    pytest.importorskip("pylibfranka", reason="pylibfranka is not installed: `make robot-server`")
    bench = Bench(realtime=True)  # as an arm is
    try:
        # no arm is there: it looks for one
        assert agree(interface(bench.add(FrankaNode, address="127.0.0.1")), documented("driver"))
    finally:
        bench.close()


def test_those_of_the_planner(bench):
    found = {}
    for output in ("joint_trajectory", "target_pose"):
        found |= interface(bench.add(PlannerNode, namespace=output, output=output), output)
    assert agree(found, documented("planner"))


def test_those_of_the_filter(bench):
    found = interface(bench.add(FilterNode, robot="panda", scene="none"))
    own = documented("filter", "filter.md")
    assert own.items() <= found.items()
    # the others "are those of the planner"
    assert found.items() - own.items() <= documented("planner").items()


def test_those_of_the_page(bench):
    pytest.importorskip("viser", reason="viser is not installed: `make view`")
    from geodesic_motion_ros.nodes.view_node import ViewNode

    found = interface(bench.add(ViewNode, port=0, control=True, skill="panda_reach_to_grasp"))
    # an arm of seven joints takes poses; parameters are set by every node's own service
    assert found.keys() == documented("page").keys() - {"goal_joints", "planner/set_parameters"}
    others = documented("planner") | {"twin/reset": documented("twin")["~/reset"]}
    assert found.items() <= {(name.replace("~/", "planner/"), kind) for name, kind in others.items()}
