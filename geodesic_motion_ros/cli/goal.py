"""`goal`: send an arm where a skill ends, or begins."""

from __future__ import annotations

import argparse

from geodesic_motion_ros.cli.arguments import HelpFormatter, needing, seconds

_DESCRIPTION = """\
Sends the goal of a skill to a planner, once, and says what becomes of it: accepted, moving, arrived. It waits for a
planner that starts. Where something holds the arm (NO_FEASIBLE_PATH, STALE_OBSTACLES, ...) the line says what, and the
arm goes as soon as nothing does. The goal is a pose of the tool, or for arms of fewer than six joints a configuration.
For those who have no `ros2` command line: for those who have, it prints the command that sends the same.
"""
_EPILOG = """\
examples:
  geodesic-motion goal panda_reach_to_grasp
  geodesic-motion goal panda_reach_to_grasp --move 0 0.02 0
  geodesic-motion goal panda_reach_to_grasp --back
  geodesic-motion goal ur5_reach --joint-prefix left_ --ros-args -r __ns:=/left

Exit status: 0 the arm has arrived; 2 the planner has refused or dropped the goal, or is not there, or the arm stood for
longer than --wait (one line says which); 130 after Ctrl-C, which leaves the goal with the planner.
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
    parser.add_argument("--back", action="store_true", help="send the arm back to where the skill begins")
    parser.add_argument(
        "--joint-prefix", default="", metavar="TEXT", help="the parameter joint_prefix of the planner, such as left_"
    )
    parser.add_argument(
        "--wait", type=seconds, default=30.0, metavar="SECONDS",
        help="how long to wait for a planner that is not there, and for an arm that stands before it has arrived",
    )  # fmt: skip
    parser.add_argument("--print", action="store_true", dest="only_print", help="only print the command, send nothing")
    parser.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=(), metavar="...",
        help="arguments of ROS, the last ones: -r __ns:=/left for a planner in a namespace, -r goal_pose:=..., ...",
    )  # fmt: skip
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Print the command, send the goal, print what becomes of it."""
    from geodesic_motion_ros.skill.skill import Skill

    with needing("a goal needs", "source your ROS 2"):
        from geodesic_motion_ros.nodes.goal_sender import goal_of_skill, send_goal
    end = "start" if arguments.back else "goal"
    goal = goal_of_skill(Skill.load(arguments.skill), arguments.joint_prefix, arguments.move, end)

    def show(line: str) -> None:
        print(line, flush=True)

    if arguments.only_print:
        show(goal.by_hand(f"/{goal.topic}"))
    else:
        show(f"arrived after {send_goal(goal, arguments.ros_args, arguments.wait, show):.1f} s")
