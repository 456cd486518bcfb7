"""The options of the demo; light, for `--help`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from rclpy.utilities import remove_ros_args

SKILL, SCENE = "panda_reach_to_grasp", "table"
#: The skill that is shown on the robot server.
SERVED_SKILL = "fr3_reach_to_grasp"

_DESCRIPTION = """\
A simulated arm does a skill as it was demonstrated: three times over real ROS 2, planner and twin in two processes.

  no_obstacle    the learned motion, undisturbed
  avoidance_off  a sphere moves into the path, and the planner ignores it: the arm hits it
  avoidance_on   the same sphere; the planner looks for another path a hundred times a second

With a whole-arm skill whose demonstrations have the elbow on either side the sphere goes where the elbow would swing
to, far from the hand, and the arm takes its elbow to the other side; with every other skill the sphere goes into the
path of the hand. It begins clear of the arm: a skill for which there is no such sphere is refused, and nothing starts.

It takes about a minute and ends by itself; Ctrl-C ends it and its processes earlier. With --view it goes on in the
browser until then."""

_EPILOG = """\
what it writes to the folder OUT:
  summary.json   the figures of the table, one object a run, the planner parameters that are not the defaults, and
                 whether the demo has passed; where the sphere is at the elbow also the families of demonstrations that
                 the arm was in, one after the other
  latent.png     the skill's latent space with the motion of the arm, without and with the obstacle
  paths.png      the same motions in space, among the demonstrations
  strip.png, arm.gif    the arm, avoidance off above (left) and on below (right)
  RUN/*.yaml, RUN/*.log    the parameter files and logs of the two nodes of each run

exit code: 0 when the demo does what it promises, 1 when it does not (it says what), 2 when it cannot be as requested,
130 after Ctrl-C; a machine so busy that the planner misses its rate gets a warning, and is waited for as long as the
nodes live. The table counts missed deadlines, of 10 ms, by their cause: a tick worked longer and came to no path, or to
one (search), or worked less, and waited for the machine

To look at it in RViz, join its ROS domain: demo --domain 7, and in another terminal
  ROS_DOMAIN_ID=7 ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST rviz2 -d config/geodesic_motion.rviz"""


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The options of a command line (without the program), of this process where it is None; as argparse, SystemExit
    where it has answered."""
    given = remove_ros_args(args=list(sys.argv if arguments is None else ["demo", *arguments]))[1:]
    parser = _parser()
    options = parser.parse_args(given)
    if options.view and options.robot_server:
        parser.error("--view shows the twin: leave out --robot-server")
    options.skill = options.skill or (SERVED_SKILL if options.robot_server else SKILL)
    return options


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="demo", description=_DESCRIPTION, epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/demo"), help="folder for the results (%(default)s)")
    parser.add_argument(
        "--skill",
        help=f"skill folder, or the name of a shipped skill ({SKILL}; with --robot-server {SERVED_SKILL})",
    )
    parser.add_argument(
        "--robot-server", action="store_true",
        help="in the place of the twin an FR3 that is simulated by franka-sim behind Franka's own protocol, with all "
        "its reflexes, and driven by the node franka; `make robot-server` installs it",
    )  # fmt: skip
    parser.add_argument(
        "--scene", default="",
        help="what always stands around the arm, for planner and twin: a file, the name of one in config/scenes, or "
        f"none; without it what the skill was recorded in, and where it does not say {SCENE}",
    )  # fmt: skip
    parser.add_argument(
        "--view", action="store_true",
        help="in the place of the three runs a page in the browser, until Ctrl-C: the arm moves again and again, and "
        "what is dragged there with the mouse is an obstacle; `make view` installs it",
    )  # fmt: skip
    parser.add_argument("--gui", action="store_true", help="open PyBullet's window; needs a display")
    parser.add_argument(
        "--domain", type=int, choices=range(1, 102), metavar="1..101", default=1 + os.getpid() % 101,
        help="ROS domain of the demo's nodes; by default one of its own, so that nothing disturbs it",
    )  # fmt: skip
    parser.add_argument("--no-pictures", action="store_true", help="figures only")
    return parser
