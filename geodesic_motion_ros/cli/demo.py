"""`demo`: planner and twin as two processes, with and without avoidance."""

from __future__ import annotations

import argparse

from geodesic_motion_ros.cli.arguments import HelpFormatter, needing

_DESCRIPTION = """\
A simulated arm does a shipped skill three times over real ROS 2: without an obstacle, with one that moves into the
elbow's or the hand's path and avoidance off, and with the same one and avoidance on. Prints a table; pictures and
summary.json go to out/demo. With --view it shows the arm in the browser, for obstacles that are dragged by the mouse.
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command; all its options are the demo's own."""
    parser = commands.add_parser(
        "demo", help="an arm does a skill around a moving obstacle (ROS 2, two processes)", add_help=False,
        description=_DESCRIPTION, formatter_class=HelpFormatter, prefix_chars="\0",
    )  # fmt: skip
    parser.add_argument("options", nargs=argparse.REMAINDER)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Hand over to the demo; it parses its own options."""
    remedy = "run `make demo`, or source your ROS 2 and install the extras simulation and learn"
    with needing("the demo needs", remedy):
        from geodesic_motion_ros.demo.start import demo

        return demo(arguments.options)
