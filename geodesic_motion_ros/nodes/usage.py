"""What a node says to --help, and to arguments that it does not know."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence

from rclpy.utilities import remove_ros_args

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.nodes.parameter_tables import TABLES
from geodesic_motion_ros.nodes.parameters import Parameter, short_text

#: Options of --ros-args that a value follows.
_WITH_VALUE = {
    "-p", "--param", "-r", "--remap", "--params-file", "--log-level", "--log-config-file", "--log-file-name", "-e",
    "--enclave",
}  # fmt: skip


def answer(name: str, arguments: Sequence[str] | None) -> int | None:
    """The exit code where a command line (without the program) asks for help or cannot be; it is answered then.

    arguments : None for those of this process.
    """
    try:
        if not wants_help(name, sys.argv[1:] if arguments is None else arguments):
            return None
    except ParameterError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 1
    print(usage(name, TABLES[name]))
    return 0


def wants_help(name: str, arguments: Sequence[str]) -> bool:
    """Whether a command line (without the program) asks for help; ParameterError names what it must not hold."""
    try:
        others = remove_ros_args(args=[name, *arguments])[1:]
    except RuntimeError:  # a ROS argument that cannot be read; rclpy.init will say so
        return False
    if {"-h", "--help"} & set(others):
        return True
    for word in _bare_assignments(arguments):
        raise ParameterError(f"{word}: parameters need -p: --ros-args -p {word}; names to remap need -r")
    if others:
        raise ParameterError(
            f"{' '.join(others)}: there are no such arguments; parameters go as --ros-args -p NAME:=VALUE, see --help"
        )
    return False


def _bare_assignments(arguments: Sequence[str]) -> list[str]:
    """FROM:=TO among the ROS arguments without an option: rcl remaps a name by it, and few people mean that."""
    found, ros, before = [], False, ""
    for word in arguments:
        if word in ("--ros-args", "--"):
            ros = word == "--ros-args"
        elif ros and ":=" in word and before not in _WITH_VALUE:
            found.append(word)
        before = word
    return found


def usage(name: str, table: Sequence[Parameter]) -> str:
    """How to start a node, and all of its parameters."""
    lines = [
        f"usage: {name} [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] [-r __ns:=NAMESPACE]]",
        "",
        f"parameters with their defaults (config/{name}.yaml is a file of them):",
    ]
    for parameter in table:
        lines.append(f"  {parameter.name} = {short_text(parameter.default)}")
        said = f"{parameter.description}; {parameter.allowed}"
        lines += textwrap.wrap(said, 110, initial_indent="      ", subsequent_indent="      ")
    return "\n".join(lines)
