"""The commands of the product, from demonstrations to a motion; `studies.cli` adds those that measure.

One file per command. A command's libraries (torch, matplotlib, rclpy) are imported when it runs, not before, so that
`--help` answers at once.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from typing import Protocol

from geodesic_motion_ros.cli import demo, demonstrate, goal, guide, inspect, robot, train
from geodesic_motion_ros.cli.arguments import HelpFormatter, needing
from geodesic_motion_ros.planning.kernels import compile_kernels
from geodesic_motion_ros.utils.errors import GeodesicMotionError
from geodesic_motion_ros.utils.piped_output import until_reader_leaves

_DESCRIPTION = """\
Reactive robot motion learned from demonstrations: a skill is a latent space whose shortest paths are the motion.

From first to last: record a few demonstrations, or let a simulated arm `demonstrate` or `guide` it; `train` a skill on
them, look at it with `inspect`, and run `demo` to see an arm do it around an obstacle.
"""
_EXAMPLES = (
    "demonstrate reach-to-grasp --out reach.npz",
    "train --demos pouring.npy --units cm --out skills/pouring",
    "inspect skills/pouring",
    "demo",
    "goal skills/pouring",
)
_EPILOG = """\
examples:
{examples}

`geodesic-motion COMMAND --help` explains a command. Exit status: 0 done, 1 `train` has written a skill that
has no motion, 2 a request is not possible (one line on standard error says what, and what would be), 130 interrupted.
"""


class Command(Protocol):
    """A command of `geodesic-motion`: a module, or another object, that adds itself to the parser."""

    def add_command(self, commands: argparse._SubParsersAction) -> None:
        """Add it to the parser; it sets `run`, a function of the parsed arguments."""


COMMANDS: tuple[Command, ...] = (demonstrate, guide, train, inspect, demo, goal, robot)


def build_parser(
    commands: Iterable[Command] = COMMANDS, description: str = _DESCRIPTION, examples: Iterable[str] = _EXAMPLES
) -> argparse.ArgumentParser:
    """The parser with some commands, what they are for as a whole, and examples of command lines."""
    epilog = _EPILOG.format(examples="\n".join(f"  geodesic-motion {example}" for example in examples))
    parser = argparse.ArgumentParser(
        prog="geodesic-motion", description=description, epilog=epilog, formatter_class=HelpFormatter
    )
    added = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for command in commands:
        command.add_command(added)
    return parser


def main(argv: Sequence[str] | None = None, parser: argparse.ArgumentParser | None = None) -> int:
    """Run a command; returns the exit status. argparse leaves by SystemExit on a wrong command line and on --help, an
    interrupt by KeyboardInterrupt.

    parser : by default that of the product's commands.
    """
    return until_reader_leaves(lambda: _run(argv, parser))


def _run(argv: Sequence[str] | None, parser: argparse.ArgumentParser | None) -> int:
    try:
        arguments = (parser or build_parser()).parse_args(argv)
        compile_kernels()
        with needing(f"'{arguments.command}' needs"):
            return arguments.run(arguments) or 0
    except GeodesicMotionError as error:
        print(f"geodesic-motion: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
