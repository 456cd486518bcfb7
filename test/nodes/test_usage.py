"""--help and unknown arguments of the nodes."""

from __future__ import annotations

import pytest

from geodesic_motion_ros.nodes import planner_node, twin_node
from geodesic_motion_ros.nodes.parameter_tables import TABLES
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


@pytest.mark.parametrize("module", [planner_node, twin_node])
def test_programs_help_and_refuse(module, capsys) -> None:
    assert module.main(["--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: ")
    assert module.main(["--bogus"]) == 1
    assert "--bogus: there are no such arguments" in capsys.readouterr().err
