"""`demonstrate`: demonstrations made by a simulated arm, to train on."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from geodesic_motion_ros.cli.arguments import HelpFormatter, seed, writable
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.utils.errors import ParameterError

WITH_FAMILIES = ("reach-to-grasp", "reach-to-grasp-separated")
OF_JOINTS = (*WITH_FAMILIES, "circle", "pouring-joint")
OF_THE_TOOL = ("pouring", "passing")
DEFAULT_FAMILIES = 3

_DESCRIPTION = """\
A scripted teacher guides a simulated arm through a task, each time a little differently; what the arm did is written
to a file. For trying things out without a recording: a person varies in respects that are not modelled.
"""
_EPILOG = """\
of the whole arm (joint positions [rad], files .npz or .csv):
  reach-to-grasp            to an object 0.5 m away, the hand turning by 90 degrees; families of demonstrations whose
                            elbows swing out to different sides in between; --count is for each family
  reach-to-grasp-separated  the same, but the elbows of a family stay on their side from start to goal
  circle                    once around a circle of 12 cm in an upright plane
  pouring-joint             three bottles to three cups, whose paths cross; --count is for each bottle

of the tool (positions [m] and quaternions, files .npz, to be read with --units m):
  pouring                   a bottle that stands anywhere in a region to a cup anywhere in another
  passing                   past a pillar; --count is for each side

examples:
  geodesic-motion demonstrate reach-to-grasp --out reach.npz --picture reach.png
  geodesic-motion demonstrate reach-to-grasp-separated --families 2 --count 8 --seed 3 --out apart.csv
  geodesic-motion demonstrate pouring --count 12 --out pouring.npz
  geodesic-motion demonstrate reach-to-grasp --robot iiwa14 --families 2 --count 8 --out reach.npz
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "demonstrate", help="demonstrations made by a simulated arm, to train on",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("task", choices=(*OF_JOINTS, *OF_THE_TOOL), metavar="TASK", help="one of those below")
    parser.add_argument(
        "--robot", default=DEFAULT_ROBOT,
        help="whose arm does it, of seven joints in tasks of the whole arm: the name of a shipped one, or the path of "
        "a folder (%(default)s)",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="where the demonstrations go")
    parser.add_argument("--count", type=int, default=5, help="demonstrations, or those of each family, bottle or side")
    parser.add_argument("--families", type=int, help=f"of the reach to grasp; {DEFAULT_FAMILIES} without it")
    parser.add_argument("--seed", type=seed, default=0, help="the same seed gives the same demonstrations, bit by bit")
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="draw the paths of tool and elbow")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Demonstrate, save, draw."""
    from tqdm import tqdm

    from geodesic_motion_ros.cli.recorded import evenly_sampled
    from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
    from geodesic_motion_ros.demonstrations.writers import save_demonstrations, save_joint_demonstrations

    _check(arguments)
    teacher, motions = _motions(arguments)
    for path in (arguments.out, arguments.picture):
        writable(path)

    def progress(motions: Sequence) -> tqdm:
        # A log that no person watches gets a line now and then.
        interval = 0.1 if sys.stderr.isatty() else 10.0
        return tqdm(motions, desc=arguments.task, unit="demonstration", mininterval=interval)

    demonstrations = teacher.performed(motions, progress, arguments.robot)
    if isinstance(demonstrations, JointDemonstrations):
        in_rows = arguments.out.suffix.lower() == ".csv"
        save_joint_demonstrations(demonstrations if in_rows else evenly_sampled(demonstrations), arguments.out)
    else:
        save_demonstrations(evenly_sampled(demonstrations), arguments.out)
    durations = [item.times[-1] - item.times[0] for item in demonstrations]
    print(
        f"wrote {len(demonstrations)} demonstrations of {min(durations):.1f} to {max(durations):.1f} s "
        f"to {arguments.out}"
    )
    if arguments.picture is not None:
        from matplotlib.image import imsave

        imsave(arguments.picture, teacher.picture(motions, demonstrations, robot=arguments.robot))
        print(f"wrote their picture to {arguments.picture}")


def _check(arguments: argparse.Namespace) -> None:
    """Refuse options that do not go together."""
    from geodesic_motion_ros.demonstrations.writers import JOINT_SUFFIXES, check_suffix

    if arguments.families is not None and arguments.task not in WITH_FAMILIES:
        raise ParameterError(f"{arguments.task} has no families: --families is for {' and '.join(WITH_FAMILIES)}")
    check_suffix(arguments.out, JOINT_SUFFIXES if arguments.task in OF_JOINTS else (".npz",))
    if arguments.picture is not None and arguments.picture.suffix.lower() != ".png":
        raise ParameterError(f"{arguments.picture}: a picture is written to a .png file")


def _motions(arguments: argparse.Namespace) -> tuple[ModuleType, Sequence]:
    """Who teaches the task, and what is about to be performed."""
    from geodesic_motion_ros.simulation import joint_teacher, teacher

    count, seed = arguments.count, arguments.seed
    if arguments.task in WITH_FAMILIES:
        families = DEFAULT_FAMILIES if arguments.families is None else arguments.families
        connected = arguments.task == "reach-to-grasp"
        return joint_teacher, joint_teacher.reach_guidances(count, seed, families, connected)
    if arguments.task == "circle":
        return joint_teacher, joint_teacher.circle_guidances(count, seed)
    if arguments.task == "pouring-joint":
        return joint_teacher, joint_teacher.pouring_guidances(count, seed)
    if arguments.task == "pouring":
        return teacher, teacher.multi_goal_motions(count, seed)
    return teacher, teacher.two_mode_motions(count, seed)
