"""--help and unknown arguments of the nodes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping
from pathlib import Path

import pytest
import rclpy

from geodesic_motion_ros.nodes import planner_node, twin_node
from geodesic_motion_ros.nodes.parameters import NodeParameters, Value
from geodesic_motion_ros.nodes.twin_parameters import scripted_spheres
from geodesic_motion_ros.nodes.usage import PROGRAMS, Program, usage, wants_help
from geodesic_motion_ros.paper import paper_node
from geodesic_motion_ros.paper.paper_parameters import PROGRAM as PAPERS_PROGRAM
from geodesic_motion_ros.utils.errors import ParameterError

#: By their names.
ALL = {program.name: program for program in (*PROGRAMS.values(), PAPERS_PROGRAM)}


@pytest.mark.parametrize("program", ALL.values(), ids=ALL)
def test_the_usage_names_every_parameter_with_what_is_allowed(program: Program) -> None:
    text = " ".join(usage(program).split())
    for parameter in program.parameters:
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
    with pytest.raises(ParameterError, match=r"skill:=mine: parameters need -p: --ros-args -p skill:=mine"):
        wants_help("planner", ["skill:=mine"])
    with pytest.raises(ParameterError, match=r"rate:=50.0: parameters need -p"):
        wants_help("planner", ["--ros-args", "-p", "skill:=mine", "--", "rate:=50.0"])
    assert not wants_help("planner", ["--ros-args", "--params-file", "of:=mine.yaml", "-r", "ee_pose:=tool"])


def test_a_mapping_without_quotes_is_answered_with_them() -> None:
    ball = "{ball: {kind: static, centre: [0.3, 0.0, 0.3], radius: 0.04}}"
    with pytest.raises(ParameterError, match=r"quotes within quotes: -p spheres:=") as caught:
        wants_help("twin", ["--ros-args", "-p", f"spheres:={ball}"])
    line = str(caught.value).split("quotes within quotes: ")[1]
    assert scripted_spheres(given(f"--ros-args {line}", "twin")["spheres"]).items["ball"].radius == 0.04


def given(line: str, name: str) -> Mapping[str, Value]:
    """The parameters of a node as a command line sets them, through a shell and ROS."""
    context = rclpy.Context()
    rclpy.init(args=shlex.split(line, comments=True), context=context)
    # The paper's takes the name, too, of the planner whose place it takes.
    node = rclpy.create_node(name.removeprefix("paper_"), context=context)
    try:
        return NodeParameters(node, ALL[name].parameters, lambda values: None, lambda values: None).values
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)


REPOSITORY = Path(__file__).resolve().parents[2]
PAGES = [REPOSITORY / "config" / "README.md", *sorted((REPOSITORY / "doc").glob("*.md"))]
TEXT = "\n".join([*(page.read_text() for page in PAGES), *map(usage, ALL.values())])
#: Command lines that start a node, each with its name.
STARTS = re.findall(
    r"^ *((?:ros2 run geodesic_motion_ros |\.venv/bin/)?(twin|planner|record|paper_planner) --ros-args .*)$",
    TEXT.replace("\\\n", " "), re.MULTILINE,
)  # fmt: skip


def test_the_command_lines_of_pages_and_help_are_understood() -> None:
    with_spheres = []
    for line, name in STARTS:
        values = given(line, name)
        if values.get("spheres"):
            assert values["spawn_at_start"]
            assert scripted_spheres(values["spheres"]).items["ball"].radius == 0.04
            with_spheres.append(line.split(" --ros-args")[0])
    assert set(with_spheres) == {"ros2 run geodesic_motion_ros twin", ".venv/bin/twin", "twin"}


def test_spheres_without_inner_quotes_are_refused() -> None:
    (line,) = [line for line, _ in STARTS if line.startswith("twin ") and "spheres" in line]
    with pytest.raises(RuntimeError, match="parse"):
        given(line.replace("'", ""), "twin")


@pytest.mark.parametrize("module", [planner_node, twin_node, paper_node])
def test_programs_help_and_refuse(module, capsys) -> None:
    assert module.main(["--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: ")
    assert module.main(["--bogus"]) == 1
    assert "--bogus: there are no such arguments" in capsys.readouterr().err
