"""`judge`: motions of any planner, as tables of joint positions, in the benchmark's scenes.

Judges motions of a Panda in scenes that `benchmark --save-scenes` wrote, whichever program made the motions. The table
that it prints has the columns of `benchmark`; those of processor time are empty.

scenes    a .npz file of numbers, described in studies/geodesic_motion_studies/comparison/scene_file.py: starts, goals,
          spheres, and what similarity is compared with
motions   .csv: a header `demonstration,t,panda_joint1,..,panda_joint7`, then one row a sample: FAMILY-NUMBER of the
          scene, as crossing-3, seconds from 0 on, radians. Or .npz: configurations (N, T, 7), times (N, T), names (N,)
          and joint_names (7,). Every scene needs a motion, which begins at its start; where a method refuses, two rows
          there suffice. 200 samples a second are judged as they are; fewer are interpolated linearly, which makes jerk
          meaningless
judged    without physics, 200 times a second: contacts by PyBullet's distances of the meshes of what the scenes guard,
          in motion or within 0.5 s after it, or of an arm that stands, as spheres cross, or chase the arm of the table;
          the goal within 10 mm and 0.1 rad, at rest; similarity
"""

from __future__ import annotations

import argparse
from pathlib import Path

from geodesic_motion_ros.cli.arguments import HelpFormatter, add_json, needing, writable

_EPILOG = """\
examples:
  geodesic-motion benchmark --skill panda_pouring --guard arm --scenes 20 --save-scenes scenes.npz
  geodesic-motion judge --scenes scenes.npz --motions mine.csv --name mine --json out/mine.json
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "judge", help="motions of any planner in the scenes of the benchmark", description=__doc__,
        epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("--scenes", type=Path, required=True, metavar="FILE", help="of benchmark --save-scenes")
    parser.add_argument("--motions", type=Path, required=True, metavar="FILE", help="tables of joint positions")
    parser.add_argument("--name", metavar="NAME", help="of the table's row; that of the file of motions without it")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Judge all motions, print the table, write the figures."""
    with needing("the judge needs"):
        from geodesic_motion_studies.comparison.motions import judged
        from geodesic_motion_studies.comparison.report import Report
        from geodesic_motion_studies.comparison.scene_file import SceneFile
    from geodesic_motion_ros.utils.tables import write_json

    scenes = SceneFile.read(arguments.scenes)
    writable(arguments.json)
    row = arguments.name or arguments.motions.stem
    played = list(judged(scenes, arguments.motions, row))
    report = Report(scenes.skill, scenes.seed, played, {row: f"the motions of {arguments.motions.name}"},
                    guard=scenes.guard)  # fmt: skip
    print(report.plain())
    if arguments.json is not None:
        write_json(arguments.json, report.as_dict())
