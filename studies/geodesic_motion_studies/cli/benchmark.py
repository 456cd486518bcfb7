"""`benchmark`: reactions to moving obstacles that keep the skill, beside what people use today.

Plays seeded scenes on the simulated arm of a skill with every method, the same stream of obstacles for each of them,
and judges what the arm does: by PyBullet's distances of its meshes, and by how near it stays to the demonstrations.

skills    of the whole arm (panda_reach_to_grasp): all of the arm is guarded; of the tool (panda_pouring,
          panda_bottle2shelf): the hand alone is, for every method, and spheres are drawn on its path
guard     --guard arm with a skill of the tool: all of the arm is guarded. Scenes are drawn and demonstrations found
          free by all of the arm, and a contact of any link ends a scene. Free demonstration, the rows + detour, ProMP,
          RRT-Connect and barriers avoid with all of the arm, and so does ours
families  none; static and elbow: spheres that stand on the path of arm or hand, or of the arm alone (where all of the
          arm is guarded); crossing; chasing; gate: closes on the hand's path, and opens again; crowd: five that stand
          and five that cross; table: three to six columns of spheres on a table, which is declared to the methods
methods   ours; ours, detour 0 (it waits where obstacles block all that was demonstrated); and parts of that: ours, hard
          (no soft metric) and ours, soft (the soft metric alone, nothing removed or certified; not the paper's
          planner); replay (of the nearest demonstration, blind: the control); free demonstration (the nearest that is
          free, another one joined where it is blocked); mean demonstration + detour, ProMP + detour and nearest
          demonstration + detour (our detours from other base paths than the skill's geodesic); and peers, which are
          left out where their libraries are not installed, as is ProMP + detour:
          pip install 'geodesic_motion_studies[benchmark]'
studies   --methods filter names all rows of the study of the motion filter: chunks of a policy that was cloned from the
          demonstrations, alone, through the filter (it waits, or passes around), braked alone, and among control
          barriers; and plans of RRT-Connect at 10 Hz, alone and through the filter. They are played by name only
columns   success: the goal within 10 mm and 0.1 rad, no contact; moving: scenes that ended as the arm touched a sphere
          in motion or within 0.5 s after it, standing: as a sphere touched the arm that had stood for longer; refused:
          ended short of the goal, untouched, with a stated reason; lost: without one, or not there after 15 s;
          least, clear: least and median smallest clearance, of scenes with spheres; dtw, orient: distance and angle
          from the closest demonstration; avoiding: dtw in the scenes in which replay fails, so that something had to be
          avoided; jerk: root mean square [rad/s^3]; time: to the goal; p50, p99: processor time of ticks that answered
          something new: a motion or a stop that was planned then, with DMP and barriers every tick, as they plan one
          step ahead; in time: share of the ticks within 10 ms of processor time; scene: scenes that ended as the arm
          touched the declared table; arm: scenes, ended or not, in which a part of the arm touched a sphere or the
          table that is not guarded.
          Clearance, similarity, jerk and time are those of successes. Intervals: Wilson, bootstrap of the median
tables    all scenes; those in which at least half of the demonstrations stay free, where to copy a free one suffices,
          and the rest; successes by family; where there are any, the scenes that ended with a contact of the arm that
          stood: those in which an arm that waits at the start is not touched, and those in which it is
files     in the folder SKILL of the output folder, in it in guard_arm where --guard arm is not what the skill guards by
          itself, in lag_SECONDS with --lag, in camera with --camera, in cloud with --cloud, and in held_out with
          --held-out: table.txt and the same tables in table.md, figures.json, success.png, clearance.png, strip.png
scenes    --save-scenes FILE plays nothing and writes the scenes that would be played as numbers, .npz; --scenes-from
          FILE plays exactly these, whichever version of the code would draw others, and keeps its results in a folder
          scenes_DIGEST of the file's own; `judge` judges motions of other programs in them
lag       --lag SECONDS: the arm plays all that it is sent so late, trajectories and what replaces them, and is behind
          by what it moves in that time; how far at most the title says. Ours counts how late and how far off its
          path the arm is measured to be, as the planner node does; the others do not
camera    --camera, not with --lag: every method is handed what a camera and the planner node's tracker know of the
          spheres, not where they truly are: 30 frames a second, each published 80 ms later, positions with noise of
          1 cm on each axis, one detection in twenty lost, nothing where the arm hides it. The judge goes by the true
          spheres
cloud     --cloud, not with --lag or --camera: every method is handed what clouds of a rendered depth camera show, with
          the arm in view, with noise and without what is hidden: 30 clouds a second of 212 x 120 pixels, each published
          80 ms later, through the planner node's self-filter, clusters and tracker
held out  with --held-out every method is given two thirds of the demonstrations, a skill trained on these alone; a
          scene goes from where one of the others began to where it ended, and dtw and orient are distance and angle
          from this one, which no method has seen: the control is no distance from what it replays, but it is from
          what another person, or the same one another time, does. Three skills are trained first and kept beside the
          results (minutes; with the settings that the skill was trained with, on what it keeps of its demonstrations)

A slow method is flattered: however long it thinks, its answer reaches the arm one tick later. What was played is kept
in the output folder and not played again as long as the skill and the method's settings are the same, whichever
version of the code played it: after a change of the code give another folder (--out).
"""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

from geodesic_motion_ros.cli.arguments import HelpFormatter, add_json, given, name_list, needing, seed, writable
from geodesic_motion_ros.utils.errors import ParameterError

_EPILOG = """\
examples:
  geodesic-motion benchmark
  geodesic-motion benchmark --scenes 100 --processes 2 --json out/benchmark.json
  geodesic-motion benchmark --skill panda_pouring
  geodesic-motion benchmark --skill panda_pouring --held-out
  geodesic-motion benchmark --skill panda_pouring --guard arm
  geodesic-motion benchmark --skill panda_pouring --guard arm --methods ours --lag 0.15
  geodesic-motion benchmark --methods filter --families crossing,gate
  geodesic-motion benchmark --scenes 20 --camera
  geodesic-motion benchmark --scenes 20 --save-scenes out/reach.npz
  geodesic-motion benchmark --scenes-from out/reach.npz --methods ours
  geodesic-motion benchmark --methods 'ours; replay' --families crossing,gate --scenes 20
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser of the command line."""
    parser = commands.add_parser(
        "benchmark", help="reactions to moving obstacles, beside replay, primitives, sampling and barriers",
        description=__doc__, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    parser.add_argument(
        "--skill", default="panda_reach_to_grasp", metavar="SKILL", help="its folder, or the name of a shipped one"
    )
    parser.add_argument(
        "--scenes", type=int, metavar="N", help="of each family; 6 without it, with --kept all that are kept"
    )
    parser.add_argument("--methods", type=name_list(";"), metavar="NAME;NAME", help="all that can run without it")
    parser.add_argument("--families", type=name_list(","), metavar="NAME,NAME", help="all without it")
    parser.add_argument("--seed", type=seed, help="of the scenes; 0 without it")
    parser.add_argument("--save-scenes", type=Path, metavar="FILE", help="write the scenes to a file, play nothing")
    parser.add_argument(
        "--scenes-from", type=Path, metavar="FILE",
        help="play the scenes of a file: not with --scenes, --families, --seed, --held-out",
    )  # fmt: skip
    parser.add_argument(
        "--held-out", action="store_true", help="scenes of demonstrations that no method was given; trains three skills"
    )
    parser.add_argument(
        "--guard", choices=("arm", "tool"),
        help="what is kept clear and judged; without it arm with a skill of the whole arm, tool with one of the tool",
    )  # fmt: skip
    parser.add_argument(
        "--strip", type=_scene, metavar="FAMILY:NUMBER", help="draw this scene as every method plays it: strip.png"
    )
    parser.add_argument(
        "--lag", type=float, metavar="SECONDS", help="the arm plays what it is sent so late: a multiple of 0.01"
    )
    parser.add_argument(
        "--camera", action="store_true",
        help="methods are handed what a camera and a tracker know of the spheres; not with --lag",
    )  # fmt: skip
    parser.add_argument(
        "--cloud", action="store_true",
        help="methods are handed what the clouds of a depth camera show; not with --lag, --camera",
    )  # fmt: skip
    parser.add_argument("--processes", type=int, default=1, help="that play scenes")
    parser.add_argument(
        "--kept", action="store_true",
        help="play nothing: what every method has played of the scenes, with the skill and the settings as they are",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, default=Path("out/benchmark"), metavar="FOLDER", help="for results")
    add_json(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> None:
    """Play what has not been played, print the tables, write the files."""
    from tqdm import tqdm

    with needing("the benchmark needs"):
        from geodesic_motion_studies.comparison.catalogue import ROWS, chosen
        from geodesic_motion_studies.comparison.families import check_families, families_of
        from geodesic_motion_studies.comparison.figures import draw_clearances, draw_strip, draw_success
        from geodesic_motion_studies.comparison.guard import guard_of
        from geodesic_motion_studies.comparison.report import Report
        from geodesic_motion_studies.comparison.run import Bench, BenchmarkSettings, kept_benchmark, play_benchmark
        from geodesic_motion_studies.comparison.scene_file import SceneFile
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.utils.tables import write_json

    methods = chosen(arguments.methods)
    left_out = [f"{name} ({row.missing} is not installed)" for name, row in ROWS.items() if row.missing]
    skill = Skill.load(arguments.skill)
    guard = guard_of(skill, arguments.guard)
    names = "scenes", "seed", "processes", "held_out", "scenes_from", "lag", "camera", "cloud"
    chosen_options = given(arguments, *names)
    families = arguments.families or families_of(guard)
    _check_scene_options(arguments)
    if arguments.scenes_from is not None:
        file = SceneFile.read(arguments.scenes_from)
        file.check(skill, guard)
        families, chosen_options["seed"] = file.families, file.seed
        if arguments.strip is not None:
            file.scene(*arguments.strip)
    settings = BenchmarkSettings(methods, families, guard=guard, **chosen_options)
    check_families(skill.name, guard, families if arguments.strip is None else (*families, arguments.strip[0]))
    if arguments.save_scenes is not None:
        writable(arguments.save_scenes)
        bench = Bench(skill, settings, arguments.out)
        scenes = [bench.draw(*scene) for scene in tqdm(bench.scene_ids(), desc="scenes", unit="scene")]
        SceneFile.of(skill, guard, settings.seed, scenes).write(arguments.save_scenes)
        print(f"wrote {len(scenes)} scenes to {arguments.save_scenes}")
        return
    if settings.held_out:
        with needing("--held-out trains skills, which needs"):
            import_module("geodesic_motion_ros.learning.training")
    if arguments.methods is None and left_out:
        print(f"left out: {', '.join(left_out)}")
    folder = settings.results_folder(arguments.out, skill)
    # Where nothing is kept no file is touched.
    kept = kept_benchmark(skill, settings, arguments.out, arguments.scenes) if arguments.kept else None
    for path in (folder / "table.txt", arguments.json):
        writable(path)
    played = list(play_benchmark(skill, settings, arguments.out)) if kept is None else kept
    descriptions = {name: ROWS[name].description for name in methods}
    report = Report(
        skill.name, settings.seed, played, descriptions, settings.held_out, guard, settings.lag, settings.camera,
        settings.cloud,
    )
    print(report.plain())
    (folder / "table.txt").write_text(report.plain() + "\n")
    (folder / "table.md").write_text(report.markdown() + "\n")
    write_json(folder / "figures.json", report.as_dict())
    if arguments.json is not None:
        write_json(arguments.json, report.as_dict())
    draw_success(report, folder / "success.png")
    draw_clearances(report, folder / "clearance.png")
    if arguments.strip is not None:
        bench = Bench(skill, settings, arguments.out)
        arena, scene = bench.arena(*arguments.strip), bench.draw(*arguments.strip)
        rows = {row: bench.method(row, arena) for row in methods}
        draw_strip(bench.stage, scene, rows, folder / "strip.png")
    print(f"wrote tables and figures to {folder}")


def _check_scene_options(arguments: argparse.Namespace) -> None:
    """ParameterError: options that say otherwise than a file of scenes, or than to play nothing."""
    for option, others in (
        ("scenes_from", ("scenes", "families", "seed", "held_out", "save_scenes")),
        ("save_scenes", ("held_out", "kept", "strip", "json")),
    ):
        if getattr(arguments, option) is not None:
            for other in others:
                if getattr(arguments, other) is not None and getattr(arguments, other) is not False:
                    raise ParameterError(f"--{option} and --{other} exclude each other".replace("_", "-"))


def _scene(text: str) -> tuple[str, int]:
    from geodesic_motion_studies.comparison.families import FAMILIES

    family, _, number = text.partition(":")
    if family not in FAMILIES or not number.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' is not a family and a number like crossing:0")
    return family, int(number)
