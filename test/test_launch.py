"""The launch files: what they start, set and load exists, and each argument is explained and used."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from geodesic_motion_ros.nodes.parameter_tables import TABLES

REPOSITORY = Path(__file__).resolve().parents[1]
FILES = sorted((REPOSITORY / "launch").glob("*.yaml"))
PACKAGE_SHARE = "$(find-pkg-share geodesic_motion_ros)"
#: What a default of a parameter is for a launch file.
TYPES = {"str": str, "bool": bool, "int": int, "float": float, "list_of_str": list, "list_of_float": list}

each_file = pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)


def entities(file: Path, kind: str) -> list[dict[str, Any]]:
    """What a launch file has of one kind: arg, node."""
    return [entity[kind] for entity in yaml.safe_load(file.read_text())["launch"] if kind in entity]


def test_there_are_launch_files() -> None:
    assert FILES


@each_file
def test_every_argument_is_explained_and_used(file: Path) -> None:
    text = file.read_text()
    arguments = {argument["name"]: argument for argument in entities(file, "arg")}
    for name, argument in arguments.items():
        assert len(argument["description"]) > 10, name
    assert set(re.findall(r"\$\(var (\w+)\)", text)) == set(arguments)


@each_file
def test_nodes_and_their_parameters_exist(file: Path) -> None:
    executables = {script.name for script in (REPOSITORY / "resource" / "executables").iterdir()}
    nodes = entities(file, "node")
    assert nodes
    for node in nodes:
        assert node["pkg"] == "geodesic_motion_ros"
        assert node["exec"] in executables
        parameters = {parameter.name: parameter for parameter in TABLES[node["exec"]]}
        for entry in node["param"]:
            if "from" in entry:
                continue
            default = parameters[entry["name"]].default
            # An empty text would be read as null, and one of digits as a number, without its type.
            assert isinstance(default, TYPES[entry["type"]]), entry["name"]


@each_file
def test_the_files_that_it_loads_are_installed(file: Path) -> None:
    for place in re.findall(re.escape(PACKAGE_SHARE) + r"/([\w/.]+)", file.read_text()):
        assert (REPOSITORY / place).is_file()


@each_file
def test_launch_itself_reads_it(file: Path) -> None:
    pytest.importorskip("launch_yaml", reason="launch is no package of PyPI")
    from launch.frontend import Parser

    with file.open() as stream:
        entity, parser = Parser.load(stream)
    parser.parse_description(entity)
