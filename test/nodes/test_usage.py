"""--help and unknown arguments of the nodes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
import rclpy

from geodesic_motion_ros.nodes import planner_node, twin_node
from geodesic_motion_ros.nodes.parameter_tables import TABLES, TWIN
from geodesic_motion_ros.nodes.parameters import NodeParameters, Value
from geodesic_motion_ros.nodes.twin_parameters import scripted_spheres
from geodesic_motion_ros.nodes.usage import usage, wants_help
from geodesic_motion_ros.utils.errors import ParameterError


@pytest.mark.parametrize("node", TABLES)
def test_the_usage_names_every_parameter_with_what_is_allowed(node: str) -> None:
    text = " ".join(usage(node, TABLES[node]).split())
    for parameter in TABLES[node]:
        assert f" {parameter.name} = " in text
        assert parameter.allowed in text


@pytest.mark.parametrize("arguments", [["-h"], ["--help"], ["--ros-args", "-p", "rate:=50.0", "--", "--help"]])
def test_help_is_recognised(arguments: list[str]) -> None:
    assert wants_help("planner", arguments)


def test_ros_arguments_are_not_touched() -> None:
    assert not wants_help("planner", ["--ros-args", "-p", "rate:=50.0", "-r", "__ns:=/left"])


def test_unknown_arguments_are_named() -> None:
    with pytest.raises(ParameterError, match="--bogus 3: there are no such arguments"):
        wants_help("planner", ["--bogus", "3", "--ros-args", "-p", "rate:=50.0"])


def test_a_parameter_without_p_is_not_taken_for_a_name_to_remap() -> None:
    with pytest.raises(ParameterError, match=r"skill:=mine: parameters need -p: --ros-args -p skill:=mine"):
        wants_help("planner", ["--ros-args", "skill:=mine"])
    assert not wants_help("planner", ["--ros-args", "--params-file", "of:=mine.yaml", "-r", "ee_pose:=tool"])


def given_to_the_twin(line: str) -> Mapping[str, Value]:
    """The twin's parameters as a command line sets them, through a shell and ROS."""
    context = rclpy.Context()
    rclpy.init(args=shlex.split(line), context=context)
    node = rclpy.create_node("twin", context=context)
    try:
        return NodeParameters(node, TWIN, lambda values: None, lambda values: None).values
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def test_the_spheres_of_examples_are_understood() -> None:
    page = Path(__file__).resolve().parents[2] / "config" / "README.md"
    begin = r"^ *((?:ros2 run geodesic_motion_ros |\.venv/bin/)?twin --ros-args .*)$"
    lines = re.findall(begin, page.read_text() + usage("twin", TWIN), re.MULTILINE)
    assert [line.split(" --ros-args")[0] for line in lines] == [
        "ros2 run geodesic_motion_ros twin", ".venv/bin/twin", "twin",
    ]  # fmt: skip
    for line in lines:
        values = given_to_the_twin(line)
        assert values["spawn_at_start"]
        np.testing.assert_allclose(scripted_spheres(values["spheres"]).items["ball"].centre, [0.24, 0.17, 0.44])
    with pytest.raises(RuntimeError, match="parse"):
        given_to_the_twin(lines[-1].replace("'", ""))


@pytest.mark.parametrize("module", [planner_node, twin_node])
def test_programs_help_and_refuse(module, capsys) -> None:
    assert module.main(["--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: ")
    assert module.main(["--bogus"]) == 1
    assert "--bogus: there are no such arguments" in capsys.readouterr().err
