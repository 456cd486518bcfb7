"""The commands that the pages show are understood by what they are for: programs, services, messages, `make`."""

from __future__ import annotations

import importlib
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from geodesic_motion_ros.cli import build_parser
from geodesic_motion_ros.nodes.usage import PROGRAMS

REPOSITORY = Path(__file__).resolve().parents[1]
PAGES = [REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "config/README.md")]
PAGES += sorted((REPOSITORY / "doc").glob("*.md"))
TEXT = "\n".join(page.read_text() for page in PAGES)
#: What stands in blocks of the shell, a line each, and between backquotes.
BLOCKS = "\n".join(re.findall(r"^ *```bash\n(.*?)```", TEXT, re.DOTALL | re.MULTILINE))
LINES = re.sub(r"\\\n *", " ", re.sub(r",\n +(?=\w+:)", ", ", BLOCKS)).splitlines()
_SENTENCES = re.sub(r"```.*?```", "", TEXT, flags=re.DOTALL)
INLINE = [" ".join(text.split()) for text in re.findall(r"(?<!`)`([^`]+)`(?!`)", _SENTENCES)]
SHOWN = sorted({line.split("  #")[0].strip() for line in (*LINES, *INLINE)})
PARSER = build_parser()
TARGETS = re.findall(r"^([a-z-]+):", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)


def shown(pattern: str) -> list[str]:
    """The commands that begin as a pattern says, without the comments behind them."""
    return [line for line in SHOWN if re.match(pattern, line)]


def fill(message: Any, fields: dict[str, Any]) -> None:
    """Set fields of a message, of messages in it, and of lists of messages, as `ros2 topic pub` does."""
    kinds = message.get_fields_and_field_types()
    for name, value in fields.items():
        assert name in kinds, f"{type(message).__name__} has no field {name}"
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            package, kind = kinds[name].removeprefix("sequence<").removesuffix(">").split("/")
            for one in value:
                fill(getattr(importlib.import_module(f"{package}.msg"), kind)(), one)
        else:
            kept = getattr(message, name)
            setattr(message, name, float(value) if isinstance(kept, float) else value)


def interface(name: str) -> Any:
    """The class of a message or service type such as std_srvs/srv/Trigger."""
    package, folder, kind = name.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), kind)


@pytest.mark.parametrize("line", shown(r"(\.venv/bin/)?geodesic-motion [a-z]+ \S"))
def test_the_command_line_of_the_package_is_understood(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        PARSER.parse_args(shlex.split(line)[1:])
    except SystemExit:
        # A sentence may show a part of a line, and leave the rest to the reader: NAME, or dots.
        assert line in INLINE
        assert re.search(r"required|'[A-Z]+'|\.\.\.'|expected one", capsys.readouterr().err)


@pytest.mark.parametrize("line", shown(r"make "))
def test_make_has_the_target(line: str) -> None:
    targets = [word for word in shlex.split(line, comments=True)[1:] if "=" not in word]
    assert set(targets) - {"TARGET", "..."} <= set(TARGETS)


@pytest.mark.parametrize("line", shown(r"ros2 (topic pub|service call) .*/(msg|srv)/"))
def test_ros_understands_the_message(line: str) -> None:
    words = [word for word in shlex.split(line)[3:] if not word.startswith("--") and word != "transient_local"]
    kind = interface(words[1])
    fill(kind.Request() if "/srv/" in words[1] else kind(), yaml.safe_load(words[2]) if len(words) > 2 else {})


@pytest.mark.parametrize("line", shown(r"ros2 param set"))
def test_the_node_has_the_parameter(line: str) -> None:
    node, name = shlex.split(line)[3:5]
    assert name in {parameter.name for parameter in PROGRAMS[node.rpartition("/")[2]].parameters}


@pytest.mark.parametrize("line", shown(r"(ros2 run geodesic_motion_ros|\.venv/bin/(?!geodesic-motion|python)) *\S"))
def test_the_program_exists(line: str) -> None:
    words = shlex.split(line)
    name = words[3] if words[0] == "ros2" else Path(words[0]).name
    assert name.isupper() or name in PROGRAMS


def test_a_message_without_the_field_is_refused() -> None:
    with pytest.raises(AssertionError, match="no field positions"):
        fill(interface("sensor_msgs/msg/JointState")(), {"positions": [0.0]})
