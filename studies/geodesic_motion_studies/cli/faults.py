"""`faults`: what planner and twin do when something goes wrong.

Runs the nodes `planner` and `twin` as two processes over real ROS 2, on this machine and heard by nobody else, injects
one fault after the other, and measures what comes of it: at the start, before the arm has a goal; in motion; and near
the goal. Besides the criterion of its row, every command of every run is judged: it must be finite, inside the limits
with their margins, begin within 0.02 rad of what was last commanded, end at rest, and have no old stamp.

Without names the faults that take seconds each, together about a quarter of an hour; --all adds the long ones.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from geodesic_motion_ros.cli.arguments import HelpFormatter, add_json, indices, needing, writable
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError
from geodesic_motion_studies.faults.fault import FILTER, PHASES, PLANNER

if TYPE_CHECKING:
    from geodesic_motion_studies.faults.fault import Row
    from geodesic_motion_studies.faults.suite import Case

_EPILOG = """\
examples:
  geodesic-motion faults
  geodesic-motion faults --only state_stops,planner_killed --phases motion --seeds 0,1,2
  geodesic-motion faults --skill panda_pouring --output target_pose --json out/faults.json
  geodesic-motion faults --filter --markdown out/filter_faults.md
  geodesic-motion faults --list

Exit status: 0 where all rows pass, 1 where one does not. Rows that this machine or the skill has no means for are
skipped, with the reason. Parameter files and logs of the nodes go to OUT.
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "faults", help="inject faults into planner and twin, and measure what they do (ROS 2, two processes)",
        description=__doc__, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("--list", action="store_true", help="name all faults and when they pass, run nothing")
    parser.add_argument("--only", type=_names, metavar="NAME,NAME", help="these faults, long ones too")
    parser.add_argument(
        "--phases", type=_phases, default=",".join(PHASES), metavar="PHASE,PHASE", help="in these phases only"
    )
    parser.add_argument("--seeds", type=indices, default="0", metavar="SEED,SEED", help="when exactly, where, how much")
    parser.add_argument("--soak-minutes", type=float, default=30.0, metavar="MIN", help="how long the fault soak takes")
    parser.add_argument("--all", action="store_true", help="the faults that take minutes as well")
    parser.add_argument(
        "--skill", default="panda_reach_to_grasp", metavar="SKILL", help="its folder, or the name of a shipped one"
    )
    parser.add_argument(
        "--output", choices=("joint_trajectory", "target_pose"), default="joint_trajectory",
        help="what commands the arm; default: %(default)s",
    )  # fmt: skip
    parser.add_argument(
        "--filter", action="store_true",
        help="of the node filter, in the planner's place: the skill's motions are offered to it, and trajectories "
        "that are none",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path("out/faults"), metavar="OUT", help="folder for logs")
    parser.add_argument(
        "--domain", type=int, choices=range(1, 102), metavar="1..101", default=1 + os.getpid() % 101,
        help="ROS domain of the nodes; one of its own, so that nothing disturbs it",
    )  # fmt: skip
    add_json(parser)
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help="write a table with a line for each fault as well"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the requested faults, print the table, write the file; 1 where a row has failed."""
    with needing("the faults need", "source your ROS 2 and install the extra simulation"):
        from geodesic_motion_ros.demo.demo_run import termination_as_interrupt
        from geodesic_motion_ros.nodes.running import go_first
        from geodesic_motion_studies.faults.catalogue import chosen
        from geodesic_motion_studies.faults.long_faults import Soak
        from geodesic_motion_studies.faults.report import markdown, table
        from geodesic_motion_studies.faults.suite import cases
    subject = FILTER if arguments.filter else PLANNER
    if arguments.filter and arguments.output != "joint_trajectory":
        raise ParameterError(f"--output {arguments.output}: a filter sends joint_trajectory alone; leave --output out")
    faults = chosen(arguments.only, arguments.all or arguments.list, subject)
    for fault in faults:
        if isinstance(fault, Soak):
            fault.minutes = arguments.soak_minutes
    if arguments.list:
        for fault in faults:
            print(f"{fault.name}{' (long)' if fault.long else ''}\n    {fault.criterion}")
        return 0
    writable(arguments.json)
    writable(arguments.markdown)
    todo = cases(faults, arguments.phases, arguments.seeds)
    if not todo:
        raise GeodesicMotionError(f"none of these faults has a phase {' or '.join(arguments.phases)}")
    # Messages that this process passes on must not wait for whatever else keeps the cores busy.
    go_first()
    rows: list[Row] = []
    try:
        with termination_as_interrupt():
            _run_all(arguments, todo, rows, subject)
    finally:
        # Where none has run, figures of before are not written over.
        if rows:
            _write(arguments.json, rows)
            if arguments.markdown is not None:
                arguments.markdown.write_text(markdown(rows))
            print(f"{table(rows)}\nload of the machine at the end: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    return 1 if any(row.passed is False for row in rows) else 0


def _run_all(arguments: argparse.Namespace, todo: list, rows: list[Row], subject: str) -> None:
    from tqdm import tqdm

    from geodesic_motion_studies.faults.suite import run_cases

    with tqdm(total=len(todo), unit="row") as bar:

        def begun(case: Case) -> None:
            bar.set_description(f"{case.fault.name}, {case.phase}")

        given = arguments.skill, arguments.out, arguments.domain, todo, begun, arguments.output, subject
        for row in run_cases(*given):
            rows.append(row)
            bar.update()
            if row.passed is False:
                bar.write(f"FAILED {row.name}, {row.phase}, seed {row.seed}: {row.measured}")


def _write(path: Path | None, rows: list[Row]) -> None:
    from geodesic_motion_ros.utils.tables import write_json

    if path is not None:
        write_json(path, {"faults": [row.as_dict() for row in rows]})


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _phases(text: str) -> tuple[str, ...]:
    phases = tuple(name.strip() for name in text.split(","))
    unknown = [phase for phase in phases if phase not in PHASES]
    if unknown:
        raise argparse.ArgumentTypeError(f"'{unknown[0]}' is no phase: they are {', '.join(PHASES)}")
    return phases
