"""The command line of a module that plays scenes on one skill and prints a table of what came of them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_studies.comparison.arena import Arena


def print_scene_table(
    name: str, description: str | None, measured: Callable[[Arena, int, int], str], argv: Sequence[str] | None
) -> int:
    """Print the table of a skill with all of the arm guarded; returns the exit status, 2 where that cannot be done.

    Parameters
    ----------
    name, description : of the module, for errors and `--help`.
    measured : the table of so many scenes of each family, and a seed.
    argv : the options; None: those of this process.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--skill", default="panda_reach_to_grasp", help="its folder, or the name of a shipped one")
    parser.add_argument("--scenes", type=int, default=20, metavar="N", help="of each family (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the scenes (default: %(default)s)")
    arguments = parser.parse_args(argv)
    try:
        if arguments.scenes < 1:
            raise ParameterError(f"--scenes {arguments.scenes}: at least 1 of each family is needed")
        print(measured(Arena.of(Skill.load(arguments.skill), "arm"), arguments.scenes, arguments.seed))
    except GeodesicMotionError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    return 0
