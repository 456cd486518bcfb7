"""`hardware`: the node `franka` on a simulated FR3 behind Franka's own protocol, with all of its reflexes.

Repeats the demo's sphere with the skill fr3_reach_to_grasp, and counts arrivals and stops: by the arm's own time,
which waits for who commands it, and by the machine's, where a busy machine is a reason for a reflex. Clearance is that
of the arm's meshes at the joints that were measured. With --faults, in motion: planner and driver are killed, and a
network between driver and arm, a process on loopback, is cut, and holds all packets for 20, 200 and 2000 ms. `make
robot-server` installs the arm.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from geodesic_motion_ros.cli.arguments import HelpFormatter, add_json, needing, writable

if TYPE_CHECKING:
    from geodesic_motion_studies.hardware.served_runs import Row


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "hardware", help="drive a simulated FR3 over its own protocol, again and again (ROS 2, four processes)",
        description=__doc__, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument("--runs", type=int, default=10, metavar="N", help="around the sphere, in the arm's own time")
    parser.add_argument("--real", type=int, default=0, metavar="N", help="around the sphere, in real time")
    parser.add_argument("--control", type=int, default=1, metavar="N", help="with avoidance off: they must hit")
    parser.add_argument(
        "--faults", type=int, nargs="?", default=0, const=1, metavar="N", help="each fault so often; once without N"
    )
    parser.add_argument("--out", type=Path, default=Path("out/hardware"), metavar="OUT", help="folder for logs")
    parser.add_argument(
        "--domain", type=int, choices=range(1, 102), metavar="1..101", default=1 + os.getpid() % 101,
        help="ROS domain of the nodes; one of its own, so that nothing disturbs it",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run all that is requested, print the table, write the file; 1 where a run around the sphere had a stop or a
    contact, or one without avoidance had none."""
    with needing("the simulated arm needs", "source your ROS 2, and `make robot-server`"):
        from geodesic_motion_ros.demo.demo_run import termination_as_interrupt
        from geodesic_motion_ros.utils.tables import write_json
        from geodesic_motion_studies.hardware.served_runs import cases, run_cases, table
    writable(arguments.json)
    rows: list[Row] = []

    def ended(row: Row) -> None:
        rows.append(row)
        print(f"{row.name}, seed {row.seed}: {row.newest}", flush=True)

    try:
        with termination_as_interrupt():
            chosen = cases(arguments.runs, arguments.real, arguments.control, arguments.faults)
            run_cases(chosen, arguments.out, arguments.domain, ended)
    finally:
        if rows:
            print(table(rows))
            if arguments.json is not None:
                write_json(arguments.json, {"runs": [row.as_dict() for row in rows]})
    around = [row for row in rows if row.name == "sphere"]
    control = [row for row in rows if row.name == "sphere, avoidance off"]
    failed = [row for row in around if row.stops or not row.clearance > 0.0]
    return 1 if failed or any(row.clearance > 0.0 for row in control) else 0
