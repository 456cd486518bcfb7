"""`goal`: send an arm where a skill ends."""

from __future__ import annotations

import argparse

from geodesic_motion_ros.cli.arguments import HelpFormatter, needing

_DESCRIPTION = """\
Sends the goal of a skill to a planner that runs, once, and prints whether the planner accepts it. If so the arm goes,
unless the planner says what holds it (STALE_OBSTACLES, HOLD, ...): then as soon as nothing does.
For those who have no `ros2` command line: for those who have, it prints the command that does the same.
"""
_EPILOG = """\
examples:
  geodesic-motion goal panda_reach_to_grasp
  geodesic-motion goal panda_reach_to_grasp --move 0 0.02 0
  geodesic-motion goal panda_reach_to_grasp --ros-args -r __ns:=/left

Exit status: 0 the planner has accepted the goal, 2 it has refused it, or there is no planner.
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "goal", help="send the goal of a skill to a running planner",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("skill", help="skill folder, or the name of a shipped skill")
    parser.add_argument(
        "--move", type=float, nargs=3, metavar=("X", "Y", "Z"), default=(0.0, 0.0, 0.0),
        help="this far from the skill's goal [m]",
    )  # fmt: skip
    parser.add_argument("--print", action="store_true", dest="only_print", help="only print the command, send nothing")
    parser.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=(), metavar="...",
        help="arguments of ROS, the last ones: -r __ns:=/left for a planner in a namespace, -r goal_pose:=..., ...",
    )  # fmt: skip
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Print the goal, send it, print the answer."""
    from geodesic_motion_ros.skill.skill import Skill

    with needing("a goal needs", "source your ROS 2"):
        from geodesic_motion_ros.nodes.goal_sender import by_hand, send_goal
    skill = Skill.load(arguments.skill)
    goal = skill.goal_pose.copy()
    goal[:3] += arguments.move

    def show(topic: str) -> None:
        print(by_hand(goal, skill.base_frame, topic), flush=True)

    if arguments.only_print:
        show("/goal_pose")
    else:
        print(f"goal accepted; the planner says {send_goal(goal, skill.base_frame, arguments.ros_args, show)}")
