"""`guide`: pull the twin's arm by the hand."""

from __future__ import annotations

import argparse

from geodesic_motion_ros.cli.arguments import HelpFormatter, needing, seed
from geodesic_motion_ros.utils.errors import GeodesicMotionError

_DESCRIPTION = """\
Pulls the tool of the simulated arm along the demonstrations of a skill, each time a little differently, as a person
guides an arm that is in free drive. For trying out a recording without an arm: the node `twin` is the arm.

With --record each path is a take of the node `record`; else a person at its terminal begins and ends them.
"""
_EPILOG = """\
example, the nodes in terminals of their own:
  twin --ros-args -p skill:=panda_pouring
  record --ros-args -p folder:=recordings
  geodesic-motion guide panda_pouring --takes 5 --record

Exit status: 0 done, 2 a node is not there, or a take was refused.
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "guide", help="pull the simulated arm by the hand, to record it",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("skill", help="skill folder, or the name of a shipped skill")
    parser.add_argument("--takes", type=int, default=3, help="how many paths")
    parser.add_argument("--duration", type=float, default=5.0, metavar="SECONDS", help="of each, about")
    parser.add_argument("--seed", type=seed, default=0, help="the same seed gives the same paths")
    parser.add_argument("--record", action="store_true", help="let the node `record` make a take of each")
    parser.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=(), metavar="...",
        help="arguments of ROS, the last ones: -r __ns:=/left for nodes in a namespace, -r record/begin:=..., ...",
    )  # fmt: skip
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Pull, and print what came of each path."""
    from geodesic_motion_ros.skill.skill import Skill

    with needing("a hand needs", "source your ROS 2"):
        from geodesic_motion_ros.nodes.hand_guide import guide

    def show(line: str) -> None:
        print(line, flush=True)

    kept = guide(
        Skill.load(arguments.skill), arguments.takes, arguments.seed, arguments.duration, arguments.record,
        arguments.ros_args, show,
    )  # fmt: skip
    if kept < arguments.takes:
        raise GeodesicMotionError(f"{kept} of {arguments.takes} takes were kept")
