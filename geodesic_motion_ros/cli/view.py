"""`view`: show an arm and its planner in the browser."""

from __future__ import annotations

import argparse

from geodesic_motion_ros.cli.arguments import HelpFormatter, needing

_DESCRIPTION = """\
Shows a planner that runs, and its arm, in the browser: meshes, path, obstacles, latent space, and the status in words.
It commands nothing, unless --control says so: then obstacles are dragged with the mouse, and goals, hold, speed and
reset are on the page. It needs viser: pip install 'geodesic_motion_ros[view]'.
"""
_EPILOG = """\
examples:
  geodesic-motion view
  geodesic-motion view panda_pouring --control
  geodesic-motion view ur5_reach --control --joint-prefix left_ --ros-args -r __ns:=/left

Exit status: 0 after Ctrl-C; 1 it cannot be as requested (one line says why).
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "view", help="show a running planner and its arm in the browser",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument(
        "skill", nargs="?", default="panda_reach_to_grasp",
        help="with --control: whose goal the page sends, a skill folder or the name of a shipped one",
    )  # fmt: skip
    parser.add_argument("--control", action="store_true", help="command the arm from the page, and drag obstacles")
    parser.add_argument("--repeat", action="store_true", help="with --control, beside a twin: repeat the motion")
    parser.add_argument("--planner", default="planner", help="name of the node that is shown: planner, or filter")
    parser.add_argument("--host", default="127.0.0.1", help="address that the page is served at; 0.0.0.0 for all")
    parser.add_argument("--port", type=int, default=8080, help="port of the page; where it is taken, the next free one")
    parser.add_argument(
        "--joint-prefix", default="", metavar="TEXT", help="the parameter joint_prefix of the planner, such as left_"
    )
    parser.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=(), metavar="...",
        help="arguments of ROS, the last ones: -r __ns:=/left for a planner in a namespace, ...",
    )  # fmt: skip
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the node `view`; returns its exit code."""
    with needing("a view needs", "source your ROS 2"):
        from geodesic_motion_ros.nodes.view_node import main
    names = ("skill", "control", "repeat", "planner", "host", "port", "joint_prefix")
    given = [word for name in names for word in ("-p", f"{name}:={_text(getattr(arguments, name))}")]
    return main(["--ros-args", *given, *arguments.ros_args])


def _text(value: str | bool | int) -> str:
    """A value as a ROS argument has it: texts in quotes, which may look like numbers."""
    return f"'{value}'" if isinstance(value, str) else str(value).lower()
