"""The commands of the product, from demonstrations to a motion, and those that other distributions add, as studies do.

One file per command. A command's libraries (torch, matplotlib, rclpy) are imported when it runs, not before, so that
`--help` answers at once.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Protocol

from geodesic_motion_ros.cli import demo, demonstrate, goal, guide, inspect, robot, train, view
from geodesic_motion_ros.cli.arguments import HelpFormatter, needing
from geodesic_motion_ros.kernels.compile_ahead import compile_kernels
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_ros.utils.piped_output import until_reader_leaves

_DESCRIPTION = """\
Reactive robot motion learned from demonstrations: a skill is a latent space whose shortest paths are the motion.

From first to last: record a few demonstrations, or let a simulated arm `demonstrate` or `guide` it; `train` a skill on
them, look at it with `inspect`, and run `demo` to see an arm do it around an obstacle; `view` shows it in the browser.
"""
_EPILOG = """\
examples:
{examples}

`geodesic-motion COMMAND --help` explains a command. Exit status: 0 done, 1 `train` has written a skill that
has no motion, 2 a request is not possible (one line on standard error says what, and what would be), 130 interrupted.
"""


#: The group of entry points by which a distribution adds a `CommandSet`.
GROUP = "geodesic_motion_ros.commands"
#: Commands that the distribution in studies/ adds.
OF_STUDIES = ("benchmark", "evaluate", "experiment", "faults", "hardware", "judge", "timing")


class Command(Protocol):
    """A command of `geodesic-motion`: a module, or another object, that adds itself to the parser."""

    def add_command(self, commands: argparse._SubParsersAction) -> None:
        """Add it to the parser; it sets `run`, a function of the parsed arguments."""


@dataclass(frozen=True)
class CommandSet:
    """The commands of a distribution by their names: they take the place of others of these names.

    Attributes
    ----------
    examples : command lines. about : what they are for as a whole, after what the product says.
    """

    commands: Mapping[str, Command]
    examples: tuple[str, ...]
    about: str = ""


PRODUCT = CommandSet(
    {
        "demonstrate": demonstrate, "guide": guide, "train": train, "inspect": inspect, "demo": demo, "goal": goal,
        "robot": robot, "view": view,
    },
    (
        "demonstrate reach-to-grasp --out reach.npz",
        "train --demos pouring.npy --units cm --out skills/pouring",
        "inspect skills/pouring",
        "demo",
        "goal skills/pouring",
        "view --control",
    ),
)  # fmt: skip


def installed_sets() -> list[CommandSet]:
    """The commands that are installed: the product's, and those of other distributions."""
    return [PRODUCT, *(point.load() for point in entry_points(group=GROUP))]


def build_parser(sets: Sequence[CommandSet] | None = None) -> argparse.ArgumentParser:
    """The parser with the commands of some sets; None: with all that are installed."""
    sets = installed_sets() if sets is None else sets
    epilog = _EPILOG.format(examples="\n".join(f"  geodesic-motion {line}" for one in sets for line in one.examples))
    description = "\n".join([_DESCRIPTION, *(one.about for one in sets if one.about)])
    parser = argparse.ArgumentParser(
        prog="geodesic-motion", description=description, epilog=epilog, formatter_class=HelpFormatter
    )
    added = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    commands = {name: command for one in sets for name, command in one.commands.items()}
    for command in commands.values():
        command.add_command(added)
    return parser


def main(argv: Sequence[str] | None = None, sets: Sequence[CommandSet] | None = None) -> int:
    """Run a command; returns the exit status. argparse leaves by SystemExit on a wrong command line and on --help, an
    interrupt by KeyboardInterrupt.

    sets : the commands there are; None: all that are installed.
    """
    return until_reader_leaves(lambda: _run(sys.argv[1:] if argv is None else argv, sets))


def _run(argv: Sequence[str], sets: Sequence[CommandSet] | None) -> int:
    try:
        sets = installed_sets() if sets is None else sets
        _refuse_missing(argv, sets)
        arguments = build_parser(sets).parse_args(argv)
        compile_kernels()
        with needing(f"'{arguments.command}' needs"):
            return arguments.run(arguments) or 0
    except GeodesicMotionError as error:
        print(f"geodesic-motion: {' '.join(str(error).split())}", file=sys.stderr)
        return 2


def _refuse_missing(argv: Sequence[str], sets: Sequence[CommandSet]) -> None:
    """Say what brings a command of the studies where they are not installed."""
    named = argv[0] if argv else ""
    if named in OF_STUDIES and not any(named in one.commands for one in sets):
        raise ParameterError(
            f"'{named}' is a command of the studies, which are not installed: pip install ./studies, in the sources of "
            "this package"
        )
