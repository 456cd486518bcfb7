"""`timing`: how fast the search engine answers, beside well-known graph libraries; `benchmark` plays scenes.

Searches two graphs again and again while obstacles move: a large one that is made up (50x50x50 nodes, 26 neighbours,
8 body points) and that of a skill. Prints one table for each, the stages of the planner's tick on the skill, and how a
tick grows with nodes, obstacles and body points. About five minutes, a few GB of memory, no network.

scenes   none_near (ten spheres that the path does not feel), one_r005 and one_r010 (one sphere of 5, 10 cm in the
         middle of the path), goal_enclosed, start_enclosed, ten_on_path, wall_gap, cloud_10k (a table top of 10,000
         points)
columns  a tick is: mark the obstacles, search, name the path. p50, p99: wall time [ms]; cpu, cpu99: the same of the
         thread's processor time; looked: nodes for which it was worked out what obstacles do; none: share of the
         ticks in which obstacles block every path that the planner would take; error: largest relative difference of
         the cost from scipy's Dijkstra on the graph with all edges weighed anew
         with a deadline of 10 ms of processor time: <10ms: share of the ticks within; found: with a path; none: with
         the proof that there is none; open: with neither; gap: by how much of it a path may be dearer than the cheapest
peers    exact (the same search where no cost is too large), A* (this package's, from one end), dijkstra (the same
         without a heuristic, all nodes worked out before), scipy, igraph, networkit, networkx: how many times the
         processor time they take for the same tick. Libraries get the edges' weights from the same numpy code; networkx
         copies its graph for every tick. Those that are not installed are left out:
         pip install 'geodesic_motion_studies[timing]'

--moving measures something else: processor time of the planner's ticks on skills of either kind, all shipped ones or
those given, among so many spheres that cross a demonstrated motion at 0.05 to 0.5 m/s, seen elsewhere in every tick (0:
one that the arm does not feel); six motions, each played three times, a tick counts by its fastest; searches beside A*
from one end and Dijkstra on the graph with obstacles worked out everywhere. And the time from a goal that is new in
motion to the first reference that leads to it; and that of the first tick from a stand with a new start, a new goal and
two new spheres. About five minutes.

--detours measures processor time of detours on skills of either kind, all shipped ones or those given, among so many
spheres of 3 to 6 cm that stand on the demonstrations: none of these stays free, and the planner has no path without a
detour. Eight motions with five sets of spheres each, each solved three times; a scene counts by its fastest. About ten
minutes.

found      scenes where the lattice has a path; why the others have none stands in the file of --json
certified  of these, how many lattice paths are certified as they are; p50, p99: base path to certificate
of bands   how many are certified after the band has drawn them tight; p50, p99: band, time law, certificate
cost, p99  of the band over that of the lattice's path, by the metric of the search

--clouds measures what a point cloud of so many points costs the planner's node, each step from the message to its
distance field, where a quarter of the points are of the moving arm and are taken out: processor time, and the share of
a core at 30 clouds a second. Half a minute.

--trainings measures trainings on so many demonstrations of 300 samples, of poses and of joints, each in a process of
its own, without the report that `train` ends with: time, processor time (that of the system, too) and the most memory
of the process, beside what is said beforehand, and the time over that of the next fewer demonstrations. With --revision
the code of a git revision trains on the fewest as well, in a work tree of its own whose kernels are compiled first.
About ten minutes.

A loaded machine lengthens wall times; cpu and the ratios hold.
"""

from __future__ import annotations

import argparse

from geodesic_motion_ros.cli.arguments import HelpFormatter, add_json, indices, writable
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json

_EPILOG = """\
examples:
  geodesic-motion timing
  geodesic-motion timing --quick
  geodesic-motion timing --skill panda_reach_to_grasp --json out/timing.json
  geodesic-motion timing --moving 0,1,5
  geodesic-motion timing --moving 1 --skill panda_pouring panda_bottle2shelf --quick
  geodesic-motion timing --detours 1,5,10
  geodesic-motion timing --clouds 10000,100000,300000
  geodesic-motion timing --trainings 16,126,253 --revision fd0cae2b
"""

#: Numbers of demonstrations: those of a shipped skill, and of a recording of months.
_TRAININGS = (16, 126, 253)
#: With --moving or --detours where none is given, and without.
_SKILLS, _SKILL = ("panda_pouring", "panda_bottle2shelf", "panda_reach_to_grasp"), ("panda_reach_to_grasp",)


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "timing", help="how fast the search answers while obstacles move, beside graph libraries",
        description=__doc__, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument(
        "--skill", nargs="+", metavar="SKILL",
        help="folder or shipped name; one of joint space (default: panda_reach_to_grasp), or any with --moving or "
        "--detours",
    )  # fmt: skip
    among = parser.add_mutually_exclusive_group()
    among.add_argument(
        "--moving", type=indices, metavar="COUNTS", help="ticks among so many moving spheres instead, like 0,1,5"
    )
    among.add_argument(
        "--detours", type=indices, metavar="COUNTS", help="detours around so many standing spheres instead, like 1,5,10"
    )
    among.add_argument(
        "--clouds", type=indices, metavar="COUNTS", help="point clouds of so many points instead, like 10000,300000"
    )
    among.add_argument(
        "--trainings", type=indices, nargs="?", const=_TRAININGS, metavar="COUNTS",
        help="trainings of so many demonstrations instead; 16,126,253 without COUNTS",
    )  # fmt: skip
    parser.add_argument(
        "--revision", metavar="REVISION",
        help="with --trainings: a tag, branch or commit whose code trains on the fewest demonstrations as well",
    )  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="half a minute: smaller graphs, fewer ticks")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Measure, print the tables, write the file."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_studies.benchmarks.clouds import measure_clouds
    from geodesic_motion_studies.benchmarks.detours_report import DetourBenchSettings, measure_detours
    from geodesic_motion_studies.benchmarks.moving_report import MovingSettings, measure_moving
    from geodesic_motion_studies.benchmarks.run import BenchSettings, alone, measured_alone
    from geodesic_motion_studies.benchmarks.trainings import BRIEFLY, measure_trainings

    writable(arguments.json)
    moving, detours, clouds, trainings = (
        getattr(arguments, name) for name in ("moving", "detours", "clouds", "trainings")
    )
    if moving is not None and min(moving) < 0:
        raise ParameterError(f"--moving {','.join(map(str, moving))}: numbers of spheres cannot be negative")
    if detours is not None and min(detours) < 1:
        raise ParameterError(f"--detours {','.join(map(str, detours))}: numbers of spheres must be positive")
    if clouds is not None and min(clouds) < 1:
        raise ParameterError(f"--clouds {','.join(map(str, clouds))}: numbers of points must be positive")
    if trainings is None and arguments.revision is not None:
        raise ParameterError("--revision: only with --trainings")
    if trainings is not None and min(trainings) < 1:
        raise ParameterError(f"--trainings {','.join(map(str, trainings))}: numbers of demonstrations must be positive")
    if trainings is not None and arguments.skill is not None:
        raise ParameterError("--skill: not with --trainings, which trains skills of its own")
    of_one = moving is None and detours is None
    named = () if trainings is not None else arguments.skill or (_SKILL if of_one else _SKILLS)
    skills = [Skill.load(name) for name in named]
    if trainings is not None:
        report = measure_trainings(trainings, arguments.revision, BRIEFLY if arguments.quick else None)
    elif moving is not None:
        settings = MovingSettings.quick() if arguments.quick else MovingSettings()
        report = alone(measure_moving, skills, moving, settings)
    elif detours is not None:
        of_detours = DetourBenchSettings.quick() if arguments.quick else DetourBenchSettings()
        report = alone(measure_detours, skills, detours, of_detours)
    elif len(skills) > 1:
        raise ParameterError(f"--skill: one skill without --moving or --detours, not {len(skills)}")
    elif clouds is not None:
        report = alone(measure_clouds, skills[0].robot, clouds, 20 if arguments.quick else 200)
    else:
        report = measured_alone(skills[0], BenchSettings.quick() if arguments.quick else BenchSettings())
    print(report.table())
    if arguments.json is not None:
        write_json(arguments.json, report.as_dict())
        print(f"wrote {arguments.json}")
