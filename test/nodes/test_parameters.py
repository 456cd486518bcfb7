"""The parameter table: what it accepts, and that the YAML files say the same."""

from __future__ import annotations

import math
from array import array
from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.nodes.parameter_tables import TABLES
from geodesic_motion_ros.nodes.parameters import Parameter, markdown_page, yaml_document
from geodesic_motion_ros.paper.paper_parameters import PAPER
from geodesic_motion_ros.robot.description import shipped_robots
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError

CONFIG = Path(__file__).resolve().parents[2] / "config"
ALL = [(node, parameter) for node, table in TABLES.items() for parameter in table]


def test_the_page_for_people_is_that_of_the_code():
    """Otherwise: `python -m geodesic_motion_ros.nodes.parameters page > doc/parameters.md`."""
    assert (CONFIG.parent / "doc" / "parameters.md").read_text() == markdown_page(TABLES)
    assert not [parameter.name for _, parameter in ALL if "|" in parameter.description]


@pytest.mark.parametrize("node", TABLES)
def test_the_shipped_file_is_the_table(node):
    assert (CONFIG / f"{node}.yaml").read_text() == yaml_document(node, TABLES[node])


@pytest.mark.parametrize("node", TABLES)
def test_the_shipped_file_holds_every_default(node):
    content = yaml.safe_load((CONFIG / f"{node}.yaml").read_text())
    values = content[f"/**/{node}"]["ros__parameters"]
    assert values == {parameter.name: parameter.default for parameter in TABLES[node]}
    for parameter in TABLES[node]:
        parameter.check(values[parameter.name])


def test_the_papers_profile_sets_parameters_of_its_node_and_says_what_it_is_for():
    content = yaml.safe_load((CONFIG / "paper.yaml").read_text())["/**/planner"]["ros__parameters"]
    known = {parameter.name: parameter for parameter in PAPER}
    for name, value in content.items():
        known[name].check(value)
    assert content["simulation_only"] is True


@pytest.mark.parametrize(("node", "parameter"), ALL, ids=lambda value: getattr(value, "name", value))
def test_every_parameter_is_described_and_bounded(node, parameter):
    assert parameter.description
    numbers = parameter.default if isinstance(parameter.default, list) else [parameter.default]
    if type(numbers[0]) in (int, float):
        assert parameter.lowest is not None
        assert parameter.highest is not None


def test_names_are_unique():
    for table in TABLES.values():
        assert len({parameter.name for parameter in table}) == len(table)


def test_the_node_plans_with_the_defaults_of_the_planner():
    """But for the tool, of which the node knows the hand."""
    known = {parameter.name: parameter.default for parameter in TABLES["planner"]}
    defaults = {setting.name: setting.default for setting in fields(PlannerSettings) if setting.name in known}
    assert {"prediction", "obstacle_margin", "speed"} < set(defaults)
    # A parameter has no None.
    assert {name: -1.0 if value is None else value for name, value in defaults.items()} == {
        name: known[name] for name in defaults
    }


def test_the_twin_and_the_real_controller_wait_as_long_for_a_new_trajectory():
    controller = yaml.safe_load((CONFIG / "ros2_controllers.yaml").read_text())["joint_trajectory_controller"]
    given = controller["ros__parameters"]
    (ours,) = (parameter.default for parameter in TABLES["twin"] if parameter.name == "cmd_timeout")
    assert given["cmd_timeout"] == ours
    # The controller's condition for heeding any; the twin has none, for its goal_time is always 0.
    assert given["constraints"]["goal_time"] == 0.0


@pytest.mark.parametrize("robot", shipped_robots())
def test_every_shipped_robot_has_a_file_of_its_joints_for_the_controller(robot):
    given = yaml.safe_load((CONFIG / f"controllers/{robot}.yaml").read_text())
    joints = given["joint_trajectory_controller"]["ros__parameters"]
    assert tuple(joints["joints"]) == Robot.named(robot).joint_names
    assert list(joints["constraints"]) == joints["joints"]
    (tolerance,) = (known.default for known in TABLES["planner"] if known.name == "tracking_tolerance_joint")
    assert all(limit["trajectory"] > tolerance for limit in joints["constraints"].values())


REACH = Parameter("reach", 1.0, "how far", "m", 0.5, 2.0)
COUNT = Parameter("count", 3, "how many", "", 1, 5)
MODE = Parameter("mode", "a", "which", choices=("a", "b"))
FLAG = Parameter("flag", True, "whether")
PAIR = Parameter("pair", [0.0, 0.0], "both", "m", -1.0, 1.0)
ROWS = Parameter("rows", [0.0, 0.0], "pairs", "m", -1.0, 1.0, row=2)
NAMES = Parameter("names", [""], "which", choices=("a", "b"))


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        (REACH, 0.5), (REACH, 2.0), (COUNT, 5), (MODE, "b"), (FLAG, False), (PAIR, [1.0, -1.0]), (ROWS, [0.0] * 6),
        (NAMES, [""]), (NAMES, ["b", "a"]),
    ],
)  # fmt: skip
def test_accepts(parameter, value):
    parameter.check(value)


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        (REACH, 0.49), (REACH, 2.01), (REACH, math.nan), (REACH, math.inf), (REACH, 1), (REACH, "1.0"), (REACH, True),
        (COUNT, 0), (COUNT, 2.0), (COUNT, True), (MODE, "c"), (MODE, 1), (FLAG, 1), (FLAG, "true"),
        (PAIR, [0.0]), (PAIR, [0.0, 1.5]), (PAIR, [0.0, math.nan]), (PAIR, [0, 0]), (PAIR, "00"),
        (ROWS, [0.0] * 3), (ROWS, []), (NAMES, ["c"]), (NAMES, ["a", 1]), (NAMES, "a"),
    ],
)  # fmt: skip
def test_refuses_and_says_what_is_allowed(parameter, value):
    with pytest.raises(ParameterError) as caught:
        parameter.check(value)
    message = str(caught.value)
    assert message == f"parameter {parameter.name} = {value!r}: expected {parameter.allowed}"


@pytest.mark.parametrize("value", [None, []])
def test_an_empty_list_of_texts_is_refused_as_what_was_written(value):
    with pytest.raises(ParameterError, match=r'names = \[\]: .*an empty list has no type in ROS, write \[""\]'):
        NAMES.check(value)


def test_an_empty_list_of_numbers_is_shown_as_it_was_written():
    with pytest.raises(ParameterError, match=r"pair = \[\]: expected 2 floats"):
        PAIR.check(None)


@pytest.mark.parametrize("name", ["/b", "/robot/b", "~/b"])
def test_a_text_with_a_slash_too_many_is_named(name):
    with pytest.raises(ParameterError, match=r"expected a list of a, b; .*; write b, without a slash$"):
        NAMES.check(["a", name])


@pytest.mark.parametrize(
    ("parameter", "value", "declared"),
    [
        (REACH, 1, 1.0), (REACH, 1.5, 1.5), (PAIR, [0, 1], [0.0, 1.0]), (PAIR, array("q", [0, 1]), [0.0, 1.0]),
        (ROWS, array("d", [0.5, 1.0]), [0.5, 1.0]), (COUNT, 3, 3), (FLAG, True, True), (REACH, True, True),
        (REACH, "1", "1"), (PAIR, [True, 0.0], [True, 0.0]), (NAMES, ["a"], ["a"]), (PAIR, None, None),
    ],
)  # fmt: skip
def test_integers_count_as_floats_where_floats_are_declared(parameter, value, declared):
    taken = parameter.as_declared(value)
    assert taken == declared
    assert type(taken) is type(declared)
    if isinstance(taken, list):
        assert [type(item) for item in taken] == [type(item) for item in declared]


def test_words_for_what_is_allowed():
    assert REACH.allowed == "a float from 0.5 to 2 [m]"
    assert COUNT.allowed == "an integer from 1 to 5"
    assert MODE.allowed == "one of a, b"
    assert ROWS.allowed == "rows of 2 floats from -1 to 1 [m]"
    assert NAMES.allowed == 'a list of a, b; [""] for none'


def test_descriptors_carry_range_and_meaning():
    descriptor = REACH.descriptor()
    assert descriptor.description == "how far [m]"
    assert (descriptor.floating_point_range[0].from_value, descriptor.floating_point_range[0].to_value) == (0.5, 2.0)
    assert descriptor.read_only
    assert COUNT.descriptor().integer_range[0].to_value == 5
    assert MODE.descriptor().additional_constraints == "one of a, b"
