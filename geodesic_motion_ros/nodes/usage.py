"""The answers of a node to --help, and to arguments that it does not know."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from rclpy.utilities import remove_ros_args

from geodesic_motion_ros.nodes.parameter_tables import FILTER, FRANKA, PLANNER, RECORD, TWIN, VIEW
from geodesic_motion_ros.nodes.parameters import Parameter, short_text
from geodesic_motion_ros.utils.errors import ParameterError


@dataclass(frozen=True)
class Program:
    """A program that runs a node, as its help describes it.

    Attributes
    ----------
    parameters : of the node. file : in config/, sets some of them.
    about : what to know before them. examples : command lines that show what the parameters cannot.
    """

    name: str
    parameters: Sequence[Parameter]
    file: str
    about: str = ""
    examples: tuple[str, ...] = ()


PROGRAMS = {
    program.name: program
    for program in (
        Program("planner", PLANNER, "planner.yaml"),
        Program(
            "filter",
            FILTER,
            "filter.yaml",
            "Plays what others offer on `~/joint_trajectory` and `~/joint_target`, and brakes before obstacles.",
            ("filter --ros-args -p robot:=fr3 -p scene:=none -r ~/joint_trajectory:=/policy/actions",),
        ),
        Program(
            "twin",
            TWIN,
            "twin.yaml",
            examples=(
                "twin --ros-args -p spawn_at_start:=true -p spheres:=\"'"
                "{ball: {kind: static, centre: [0.24, 0.17, 0.44], radius: 0.04}}'\"",
            ),
        ),
        Program("record", RECORD, "record.yaml"),
        Program(
            "franka",
            FRANKA,
            "franka.yaml",
            "The driver of a Franka Research 3. Read doc/first_hour.md before it moves an arm.",
            ("franka --ros-args -p address:=172.16.0.2",),
        ),
        Program(
            "view",
            VIEW,
            "view.yaml",
            "A page in the browser: the arm, its path, its obstacles and its status; with control, what commands it.",
            ("view --ros-args -p control:=true -p skill:=panda_pouring",),
        ),
    )
}


def answer(program: Program, arguments: Sequence[str] | None) -> int | None:
    """Return the exit code where a command line (without the program) asks for help or cannot be; it is answered then.

    arguments : None for those of this process.
    """
    try:
        if not wants_help(program.name, sys.argv[1:] if arguments is None else arguments):
            return None
    except ParameterError as error:
        print(f"{program.name}: {error}", file=sys.stderr)
        return 1
    print(usage(program))
    return 0


def wants_help(name: str, arguments: Sequence[str]) -> bool:
    """Whether a command line (without the program) asks for help; ParameterError names what it must not hold."""
    try:
        others = remove_ros_args(args=[name, *arguments])[1:]
    except RuntimeError as error:  # a ROS argument that cannot be read; rclpy.init will say so
        if mappings := [word for word in arguments if ":={" in word]:
            parameter, _, mapping = mappings[0].partition(":=")
            raise ParameterError(
                f"{mappings[0]}: a mapping goes as a text, in quotes within quotes: -p {parameter}:=\"'{mapping}'\""
            ) from error
        _refuse_bare([word for word in arguments if ":=" in word and repr(word) in str(error)])
        return False
    if {"-h", "--help"} & set(others):
        return True
    _refuse_bare(_outside(arguments))
    if others:
        raise ParameterError(
            f"{' '.join(others)}: there are no such arguments; parameters go as --ros-args -p NAME:=VALUE, see --help"
        )
    return False


def _outside(arguments: Sequence[str]) -> list[str]:
    """The words NAME:=VALUE that are not among the ROS arguments, where rcl still takes them for names to remap."""
    found, inside = [], False
    for word in arguments:
        inside = word == "--ros-args" or (inside and word != "--")
        if not inside and ":=" in word:
            found.append(word)
    return found


def _refuse_bare(words: Sequence[str]) -> None:
    """Refuse parameters without -p: ParameterError has the arguments that set them."""
    if words:
        raise ParameterError(
            f"{' '.join(words)}: parameters need -p: --ros-args {' '.join(f'-p {word}' for word in words)}"
        )


def usage(program: Program) -> str:
    """Return how to start a node, and all of its parameters."""
    name = program.name
    lines = [
        f"usage: {name} [--ros-args [-p NAME:=VALUE] [--params-file FILE] [-r FROM:=TO] [-r __ns:=NAMESPACE]]",
        "",
        *([*textwrap.wrap(program.about, 110), ""] if program.about else []),
        f"parameters with their defaults (config/{program.file} is a file of them):",
    ]
    for parameter in program.parameters:
        lines.append(f"  {parameter.name} = {short_text(parameter.default)}")
        description = f"{parameter.description}; {parameter.allowed}"
        lines += textwrap.wrap(description, 110, initial_indent="      ", subsequent_indent="      ")
    if program.examples:
        lines += ["", "examples:", *(f"  {example}" for example in program.examples)]
    return "\n".join(lines)
