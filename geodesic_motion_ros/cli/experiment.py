"""`experiment`: what the method is claimed to do, measured; a table and a figure each."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from geodesic_motion_ros.cli.arguments import (
    HelpFormatter,
    add_json,
    add_recording,
    evenly_sampled,
    indices,
    metres,
    read_recording,
    writable,
)
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.writers import save_demonstrations
from geodesic_motion_ros.errors import ExperimentError, ParameterError
from geodesic_motion_ros.tables import text_table, write_json

if TYPE_CHECKING:
    from tqdm import tqdm

    from geodesic_motion_ros.experiments.trained import Trained
    from geodesic_motion_ros.manifold.training import TrainingSettings

_DESCRIPTION = """\
toy-task   a J in the plane with orientations that draw a C on the sphere: two clusters, walls, geodesic and line
toy-joint  an arm of two joints that draws an S in two postures: two clusters, geodesic and line
circle     the whole arm draws circles in four postures: switches between them with two and three latent dimensions
geodesics  ways to a shortest path on one skill: gradient descent, graphs of 50x50 and 100x100 nodes; lengths, times
avoidance  spheres dead-centre on the planned path of held-out demonstrations: clear, or rightly declared infeasible?
crossing   what it costs to change between the clusters of q and -q, and whether the planner's graph forbids it
goals      simulated demonstrations between places that vary: held-out ones predicted from start and goal
modes      simulated demonstrations past a pillar on both sides: one way followed, the other taken when it is blocked
whole-arm  spheres on the way of the whole arm, standing and moving: another way taken, rightly refused, no contact?
moving-tool  spheres that cross the tool's way or chase it, with a skill of the tool: no contact where it can brake?
obstacle-laws  the same scenes of spheres on the arm's way under laws, strengths and widths of the ambient metric
grasp-task   reach to grasp, poses of the tool: targets that were not shown, and paths across the clusters of q and -q
pouring-task three bottles to three cups, poses of the tool: all nine pairs, a moving sphere, a chain over all cups
limbs      a sphere beside the tool's way: how many solutions of the inverse kinematics hit it, and a skill that sees it
grasp-joint  reach to grasp with the whole arm in families: energies within and across, which ways are left when blocked
pouring-joint  three bottles to three cups with the whole arm: geodesics through several groups, played by the arm
volume     one whole-arm skill learned without and with the volume term of the paper's evidence lower bound
dimension  two to five latent dimensions of the whole arm, on a grid and on a graph of nearest neighbours
rate       planner and twin as two processes: ticks a second with a goal that stays or moves, a moving sphere, clouds;
           with a skill of joint space also the time from an obstacle's message to the trajectory that answers it
all        every experiment that needs no recording, with its default arguments, one after the other; hours

What the paper shows and what these show stands in geodesic_motion_ros/experiments/README.md. Table, figure and JSON go
to out/experiments/NAME/. avoidance, crossing, goals and modes train skills, each once: they are kept in
out/experiments/skills and taken from there when data, settings and training code are the same. goals and modes make
their demonstrations themselves, with an arm in PyBullet; one skill per seed, two minutes each.
"""
_EPILOG = """\
examples:
  geodesic-motion experiment toy-task
  geodesic-motion experiment geodesics --skill panda_pouring
  geodesic-motion experiment avoidance --demos pouring.npy bottle2shelf.npy --units cm --folds 0,3,6/1,4,7/2,5,8
  geodesic-motion experiment crossing --demos pouring.npy --units cm
  geodesic-motion experiment goals --shown 20
  geodesic-motion experiment modes --save two_ways.npz
  geodesic-motion experiment whole-arm --moving-scenes 500 --processes 2
  geodesic-motion experiment moving-tool --skill panda_bottle2shelf --scenes 20 --seeds 0,1,2,3 --processes 2
  geodesic-motion experiment obstacle-laws --scenes 200
  geodesic-motion experiment volume
  geodesic-motion experiment all
  geodesic-motion experiment rate --skill panda_reach_to_grasp --rates 100,250,500
"""


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command and its experiments to the parser of the command line."""
    parser = commands.add_parser(
        "experiment", help="measure what is claimed: geodesics, avoidance, crossing, goals, modes, whole-arm, more",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    names = parser.add_subparsers(dest="experiment", metavar="NAME", required=True)

    toy_task = names.add_parser("toy-task", help="the paper's letters J and C", formatter_class=HelpFormatter)
    toy_task.add_argument("--seeds", type=indices, default="0,1,2", metavar="SEEDS", help="one training each")
    toy_task.set_defaults(run=_toy_task)

    toy_joint = names.add_parser("toy-joint", help="an S in two postures", formatter_class=HelpFormatter)
    toy_joint.add_argument("--seeds", type=indices, default="0,1,2", metavar="SEEDS", help="one training each")
    toy_joint.set_defaults(run=_toy_joint)

    circle = names.add_parser("circle", help="two and three latent dimensions", formatter_class=HelpFormatter)
    circle.add_argument("--seeds", type=indices, default="0,1,2", metavar="SEEDS", help="two trainings each")
    circle.set_defaults(run=_circle)

    geodesics = names.add_parser("geodesics", help="ways to a geodesic compared", formatter_class=HelpFormatter)
    geodesics.add_argument("--skill", default="panda_pouring", metavar="SKILL", help="its folder, or a shipped name")
    geodesics.add_argument("--pairs", type=int, default=3, help="pairs of ends")
    geodesics.set_defaults(run=_geodesics)

    avoidance = names.add_parser("avoidance", help="spheres on the path", formatter_class=HelpFormatter)
    avoidance.add_argument("--radii", type=metres, default="0.02,0.04,0.08", metavar="M,M", help="of spheres [m]")
    avoidance.add_argument(
        "--tool-radius", type=float, default=0.0, metavar="M",
        help="of a sphere around the tool's origin [m]; 0: the radii already stand for obstacle and tool together",
    )  # fmt: skip
    avoidance.add_argument("--scenes", type=int, default=8, help="places on the path of each held-out demonstration")
    avoidance.add_argument("--sheet", choices=("canonical", "raw"), default="canonical", help="skills are learned on")
    avoidance.set_defaults(run=_avoidance)

    crossing = names.add_parser("crossing", help="what changing clusters costs", formatter_class=HelpFormatter)
    crossing.set_defaults(run=_crossing)

    for trains in (avoidance, crossing):
        add_recording(trains, several=True)
        trains.add_argument("--folds", metavar="FOLDS", help="to hold out, 0,3,6/1,4,7; without it three folds")
        trains.add_argument("--seeds", type=indices, default="0", metavar="SEEDS", help="one training each")
        trains.add_argument("--steps", type=int, help="of the training; TrainingSettings' default without it")

    goals = names.add_parser("goals", help="starts and goals that vary", formatter_class=HelpFormatter)
    goals.add_argument("--shown", type=int, default=12, help="demonstrations that a skill is learned from")
    goals.add_argument("--held-out", type=int, default=12, help="demonstrations that are predicted")
    goals.set_defaults(run=_goals)

    modes = names.add_parser("modes", help="two ways past a pillar", formatter_class=HelpFormatter)
    modes.add_argument("--shown", type=int, default=6, help="demonstrations of each way that a skill is learned from")
    modes.add_argument("--cases", type=int, default=40, help="starts and goals that each skill is asked for")
    modes.set_defaults(run=_modes)

    for simulated in (goals, modes):
        simulated.add_argument(
            "--seeds", type=indices, default="0,1,2", metavar="SEEDS", help="of data and training, one skill each"
        )
        simulated.add_argument("--steps", type=int, help="of the training; TrainingSettings' default without it")
        simulated.add_argument(
            "--save", type=Path, metavar="FILE.npz",
            help="write the demonstrations of the first seed to a file to train on (units m) and measure nothing",
        )  # fmt: skip

    whole_arm = names.add_parser("whole-arm", help="avoidance with the whole arm", formatter_class=HelpFormatter)
    whole_arm.add_argument(
        "--skill", default="panda_reach_to_grasp", metavar="SKILL", help="of joint space: its folder, or a shipped name"
    )  # fmt: skip
    whole_arm.add_argument(
        "--parts", type=_names, default="tubes,one way,all ways,elbow,moving", metavar="PART,PART",
        help="what is measured",
    )  # fmt: skip
    whole_arm.add_argument("--scenes", type=int, default=40, help="of standing spheres, or of none, in each part")
    whole_arm.add_argument("--moving-scenes", type=int, default=40, help="of moving spheres")
    whole_arm.add_argument("--seed", type=int, default=0, help="of the scenes")
    whole_arm.add_argument("--processes", type=int, default=1, help="that play scenes of moving spheres")
    whole_arm.set_defaults(run=_whole_arm)

    moving_tool = names.add_parser(
        "moving-tool", help="moving spheres with a skill of the tool", formatter_class=HelpFormatter,
        description="Spheres cross the tool's way or chase it; each scene is played once more with a planner that is "
        "not told of them. Exact distances of the tool's spheres are judged 200 times a second: with such a skill "
        "nothing but the tool avoids obstacles. What counts are contacts of a tool that moved and had had room to "
        "brake; there should be none.",
    )  # fmt: skip
    moving_tool.add_argument(
        "--skill", default="panda_pouring", metavar="SKILL", help="of task space: its folder, or a shipped name"
    )
    moving_tool.add_argument(
        "--tools", type=_names, default="hand,slim", metavar="TOOL,TOOL",
        help="hand: tool_spheres of the planner node, 18 cm wide; slim: one sphere of 4 cm at the tool's origin",
    )  # fmt: skip
    moving_tool.add_argument("--scenes", type=int, default=40, help="of each seed, with each tool")
    moving_tool.add_argument("--seeds", type=indices, default="0", metavar="SEEDS", help="of the scenes")
    moving_tool.add_argument("--processes", type=int, default=1, help="that play scenes")
    moving_tool.set_defaults(run=_moving_tool)

    grasp_task = names.add_parser("grasp-task", help="reach to grasp in task space", formatter_class=HelpFormatter)
    grasp_task.add_argument("--shown", type=int, default=8, help="demonstrations")
    grasp_task.add_argument("--targets", type=int, default=20, help="random starts and goals for each seed")
    grasp_task.set_defaults(run=_grasp_task)

    pouring_task = names.add_parser("pouring-task", help="pouring in task space", formatter_class=HelpFormatter)
    pouring_task.add_argument("--shown", type=int, default=3, help="demonstrations of each of three pairs")
    pouring_task.set_defaults(run=_pouring_task)

    limbs = names.add_parser("limbs", help="what a skill of the tool does not see", formatter_class=HelpFormatter)
    limbs.add_argument(
        "--skill", default="panda_reach_to_grasp", metavar="SKILL",
        help="of joint space, of the same reach to grasp: its folder, or a shipped name",
    )  # fmt: skip
    limbs.add_argument("--side", type=int, default=150, help="nodes along each side of the latent grid")
    limbs.add_argument("--solutions", type=int, default=100, help="of the inverse kinematics for each node")
    limbs.set_defaults(run=_limbs)

    grasp_joint = names.add_parser("grasp-joint", help="families of grasps, blocked", formatter_class=HelpFormatter)
    grasp_joint.add_argument("--shown", type=int, default=3, help="demonstrations of each family")
    grasp_joint.set_defaults(run=_grasp_joint)

    pouring_joint = names.add_parser("pouring-joint", help="groups of pourings", formatter_class=HelpFormatter)
    pouring_joint.add_argument("--shown", type=int, default=3, help="demonstrations of each of three pairs")
    pouring_joint.set_defaults(run=_pouring_joint)

    for learned in (grasp_task, pouring_task, grasp_joint, pouring_joint):
        learned.add_argument(
            "--seeds", type=indices, default="0,1,2", metavar="SEEDS", help="of the trainings, one skill each"
        )

    laws = names.add_parser("obstacle-laws", help="ambient metrics compared", formatter_class=HelpFormatter)
    laws.add_argument(
        "--skill", default="panda_reach_to_grasp", metavar="SKILL", help="of joint space: its folder, or a shipped name"
    )  # fmt: skip
    laws.add_argument("--scenes", type=int, default=120, help="of a sphere near the way, or in it")
    laws.add_argument("--seed", type=int, default=0, help="of the scenes")
    laws.set_defaults(run=_obstacle_laws)

    volume = names.add_parser("volume", help="the volume term off and on", formatter_class=HelpFormatter)
    volume.add_argument(
        "--demos", type=Path, metavar="FILE",
        help="recorded joints, as `demonstrate`'s; without it a simulated reach to grasp, four times in two families",
    )  # fmt: skip
    volume.add_argument("--robot", default="panda", help="whose joints were recorded")
    volume.add_argument("--weights", type=_numbers, default="0,1", metavar="W,W", help="of the volume term")
    volume.add_argument("--steps", type=int, help="of the training; JointTrainingSettings' default without it")
    volume.set_defaults(run=_volume)

    dimension = names.add_parser("dimension", help="two to five latent dimensions", formatter_class=HelpFormatter)
    dimension.add_argument("--seeds", type=indices, default="0,1", metavar="SEEDS", help="four trainings each")
    dimension.set_defaults(run=_dimension)

    rate = names.add_parser("rate", help="ticks a second of the running nodes", formatter_class=HelpFormatter)
    rate.add_argument("--skill", default="panda_pouring", metavar="SKILL", help="its folder, or a shipped name")
    rate.add_argument("--rates", type=_numbers, default="100", metavar="HZ,HZ", help="of the planner")
    rate.add_argument("--seconds", type=float, default=8.0, help="length of each stretch")
    rate.add_argument("--goals-hz", type=float, default=10.0, help="new goals a second")
    rate.add_argument("--obstacles", type=int, default=10, help="spheres beside the way")
    rate.add_argument("--spheres", type=int, default=100, help="that appear in the way, to time answers; 0: none")
    rate.set_defaults(run=_rate)

    alone = dict(names.choices)
    for needs_recording in ("avoidance", "crossing"):
        del alone[needs_recording]
    everything = names.add_parser("all", help="one after the other", formatter_class=HelpFormatter)
    everything.set_defaults(run=lambda arguments: _all(arguments, alone))
    for experiment in names.choices.values():
        experiment.add_argument(
            "--out", type=Path, default=Path("out/experiments"), metavar="FOLDER", help="for results"
        )
        add_json(experiment)


def _all(arguments: argparse.Namespace, parsers: Mapping[str, argparse.ArgumentParser]) -> None:
    """Run every experiment as it is by default; what fails is told and does not stop the others."""
    folder, rows = _folder(arguments), []
    for number, (name, parser) in enumerate(parsers.items(), start=1):
        print(f"[{number}/{len(parsers)}] {name}", flush=True)
        own = parser.parse_args(["--out", str(arguments.out)], argparse.Namespace(experiment=name))
        began, error = time.monotonic(), ""
        try:
            own.run(own)
        except Exception as failure:
            error = " ".join(f"{type(failure).__name__}: {failure}".split())
            print(f"failed: {error}", flush=True)
        rows.append({"experiment": name, "seconds": time.monotonic() - began, "error": error})
    lines = [[row["experiment"], "failed" if row["error"] else "done", row["seconds"], row["error"]] for row in rows]
    table = text_table(["experiment", "", "seconds", ""], lines, digits=0, left=(0, 1, 3))
    _hand_over(arguments, folder, table, {"experiments": rows})
    failed = [row["experiment"] for row in rows if row["error"]]
    if failed:
        raise ExperimentError(f"{len(failed)} of {len(rows)} experiments failed: {', '.join(failed)}")


def _toy_task(arguments: argparse.Namespace) -> None:
    from tqdm import tqdm

    from geodesic_motion_ros.experiments.toy_task import draw_toy_task, measure_toy_task

    folder = _folder(arguments)
    with tqdm(desc="toy-task", unit="model") as bar:
        report = measure_toy_task(arguments.seeds, progress=_counted_on(bar))
    draw_toy_task(report, folder / "toy_task.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _toy_joint(arguments: argparse.Namespace) -> None:
    from tqdm import tqdm

    from geodesic_motion_ros.experiments.toy_joint import draw_toy_joint, measure_toy_joint

    folder = _folder(arguments)
    with tqdm(desc="toy-joint", unit="model") as bar:
        report = measure_toy_joint(arguments.seeds, progress=_counted_on(bar))
    draw_toy_joint(report, folder / "toy_joint.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _circle(arguments: argparse.Namespace) -> None:
    from tqdm import tqdm

    from geodesic_motion_ros.experiments.circle import draw_circle, measure_circle

    folder = _folder(arguments)
    with tqdm(desc="circle", unit="model") as bar:
        report = measure_circle(arguments.seeds, progress=_counted_on(bar))
    draw_circle(report, folder / "circle.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _geodesics(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.geodesics import compare_geodesics, draw_geodesics
    from geodesic_motion_ros.skill import Skill

    skill = Skill.load(arguments.skill)
    folder = _folder(arguments)
    report = compare_geodesics(skill, arguments.pairs)
    draw_geodesics(report, folder / "geodesics.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _rate(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.nodes import node_rate, reaction_time
    from geodesic_motion_ros.skill import Skill

    folder, rates = _folder(arguments), arguments.rates
    rows = node_rate.measure_rates(
        arguments.skill, folder, rates, arguments.seconds, arguments.goals_hz, arguments.obstacles
    )
    text, told = node_rate.table(rows), {"rows": [asdict(row) for row in rows]}
    if arguments.spheres > 0 and Skill.load(arguments.skill).space == "joint":
        reactions = reaction_time.measure_reaction(arguments.skill, folder, rates, arguments.spheres)
        text += "\n\n" + reaction_time.table(reactions)
        told["reactions"] = [asdict(row) for row in reactions]
    _hand_over(arguments, folder, text, told)


def _avoidance(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.avoidance import AvoidanceSettings, draw_avoidance, measure_avoidance

    settings = AvoidanceSettings(arguments.radii, arguments.tool_radius, arguments.scenes)
    folder = _folder(arguments)
    report = measure_avoidance(_skills(arguments, arguments.sheet), settings)
    draw_avoidance(report, folder / "avoidance.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _crossing(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.crossing import crossing_report, draw_crossings

    folder = _folder(arguments)
    # Clusters of q and -q are the paper's, on the raw sheet.
    report = crossing_report(_skills(arguments, "raw"))
    draw_crossings(report, folder / "crossing.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _goals(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.goals import GoalsSettings, draw_goals, drawn, measure_goals

    settings = GoalsSettings(arguments.shown, arguments.held_out, arguments.seeds)
    if arguments.save is not None:
        everything, fold = drawn(settings, settings.seeds[0])
        _save(arguments.save, everything, f"the last {len(fold)} are those held out")
        return
    folder = _folder(arguments)
    report = measure_goals(settings, arguments.out / "skills", _training(arguments, "canonical"))
    draw_goals(report, folder / "goals.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _modes(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.modes import ModesSettings, draw_modes, measure_modes
    from geodesic_motion_ros.simulation.teacher import two_mode_demonstrations

    settings = ModesSettings(arguments.shown, arguments.cases, arguments.seeds)
    if arguments.save is not None:
        shown = two_mode_demonstrations(settings.shown, settings.seeds[0])
        _save(arguments.save, shown, f"first {settings.shown} on the left of the pillar, then as many on its right")
        return
    folder = _folder(arguments)
    report = measure_modes(settings, arguments.out / "skills", _training(arguments, "canonical"))
    draw_modes(report, folder / "modes.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _whole_arm(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.whole_arm import WholeArmSettings, draw_whole_arm, measure_whole_arm
    from geodesic_motion_ros.skill import Skill

    settings = WholeArmSettings(
        arguments.parts, arguments.scenes, arguments.moving_scenes, arguments.seed, arguments.processes
    )
    skill = Skill.load(arguments.skill)
    folder = _folder(arguments)
    report = measure_whole_arm(skill, settings)
    draw_whole_arm(report, folder)
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _moving_tool(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.moving_tool import MovingToolSettings, draw_moving_tool, measure_moving_tool
    from geodesic_motion_ros.nodes.demo_scene import DEFAULTS
    from geodesic_motion_ros.nodes.skill_kinds import task_settings
    from geodesic_motion_ros.planner_settings import PlannerSettings
    from geodesic_motion_ros.skill import Skill

    known = {"hand": task_settings(DEFAULTS), "slim": PlannerSettings()}
    unknown = [tool for tool in arguments.tools if tool not in known]
    if unknown:
        raise ParameterError(f"tools are {', '.join(arguments.tools)}: choose from {', '.join(known)}")
    tools = {tool: known[tool] for tool in arguments.tools}
    settings = MovingToolSettings(tools, arguments.scenes, arguments.seeds, arguments.processes)
    skill = Skill.load(arguments.skill)
    folder = _folder(arguments)
    report = measure_moving_tool(skill, settings)
    draw_moving_tool(report, folder / "moving_tool.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _grasp_task(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.grasp_task import GraspTaskSettings, draw_grasp_task, measure_grasp_task

    settings = GraspTaskSettings(arguments.shown, arguments.targets, arguments.seeds)
    folder = _folder(arguments)
    report = measure_grasp_task(settings, arguments.out / "skills")
    draw_grasp_task(report, folder / "grasp_task.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _pouring_task(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.pouring_task import (
        PouringTaskSettings,
        draw_pouring_task,
        measure_pouring_task,
    )

    settings = PouringTaskSettings(arguments.shown, arguments.seeds)
    folder = _folder(arguments)
    report = measure_pouring_task(settings, arguments.out / "skills")
    draw_pouring_task(report, folder / "pouring_task.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _limbs(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.limbs import LimbsSettings, draw_limbs, measure_limbs
    from geodesic_motion_ros.skill import Skill

    settings = LimbsSettings((arguments.side, arguments.side), arguments.solutions)
    skill = Skill.load(arguments.skill)
    folder = _folder(arguments)
    report = measure_limbs(skill, settings, arguments.out / "skills")
    draw_limbs(report, folder / "limbs.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _grasp_joint(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.grasp_joint import (
        GraspJointSettings,
        draw_grasp_joint,
        measure_grasp_joint,
    )

    settings = GraspJointSettings(arguments.shown, arguments.seeds)
    folder = _folder(arguments)
    report = measure_grasp_joint(settings, arguments.out / "skills")
    draw_grasp_joint(report, folder / "grasp_joint.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _pouring_joint(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.pouring_joint import (
        PouringJointSettings,
        draw_pouring_joint,
        measure_pouring_joint,
    )

    settings = PouringJointSettings(arguments.shown, arguments.seeds)
    folder = _folder(arguments)
    report = measure_pouring_joint(settings, arguments.out / "skills")
    draw_pouring_joint(report, folder / "pouring_joint.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _obstacle_laws(arguments: argparse.Namespace) -> None:
    from geodesic_motion_ros.experiments.obstacle_laws import compare_laws, draw_laws
    from geodesic_motion_ros.skill import Skill

    skill = Skill.load(arguments.skill)
    folder = _folder(arguments)
    report = compare_laws(skill, arguments.scenes, arguments.seed)
    draw_laws(report, folder / "obstacle_laws.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _volume(arguments: argparse.Namespace) -> None:
    from tqdm import tqdm

    from geodesic_motion_ros.demonstrations.readers import read_joint_demonstrations
    from geodesic_motion_ros.experiments.imitation import stage_shown_on
    from geodesic_motion_ros.experiments.volume import compare_volume, draw_volume
    from geodesic_motion_ros.manifold.joint_training import JointTrainingSettings
    from geodesic_motion_ros.simulation.joint_teacher import reach_to_grasp

    if arguments.demos is None:
        demonstrations = reach_to_grasp(4, seed=0, families=2)
    else:
        demonstrations = read_joint_demonstrations(arguments.demos, arguments.robot)
    settings = JointTrainingSettings()
    if arguments.steps is not None:
        settings = replace(settings, steps=arguments.steps)
    folder = _folder(arguments)
    with tqdm(desc="volume") as bar:
        report = compare_volume(
            demonstrations, arguments.weights, arguments.out / "skills", settings, stage_shown_on(bar)
        )
    draw_volume(report, folder / "volume.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _dimension(arguments: argparse.Namespace) -> None:
    from tqdm import tqdm

    from geodesic_motion_ros.experiments.dimension import draw_dimension, measure_dimension

    folder = _folder(arguments)
    with tqdm(desc="dimension", unit="model") as bar:
        report = measure_dimension(seeds=arguments.seeds, progress=_counted_on(bar))
    draw_dimension(report, folder / "dimension.png")
    _hand_over(arguments, folder, report.table(), report.as_dict())


def _counted_on(bar: tqdm) -> Callable[[str], None]:
    """Tell on a bar what begins."""

    def show(begins: str) -> None:
        bar.set_postfix_str(begins)
        bar.update()

    return show


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(number) for number in text.split(","))


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(","))


def _save(path: Path, demonstrations: Demonstrations, said: str) -> None:
    """Write demonstrations with equally many samples each, as the file wants them."""
    save_demonstrations(evenly_sampled(demonstrations), path)
    print(f"wrote {len(demonstrations)} demonstrations to {path}: {said}; read them with --units m")


def _training(arguments: argparse.Namespace, sheet: Literal["canonical", "raw"]) -> TrainingSettings:
    """The defaults, but for --steps."""
    from geodesic_motion_ros.manifold.training import TrainingSettings

    settings = TrainingSettings(sheet=sheet)
    return settings if arguments.steps is None else replace(settings, steps=arguments.steps)


def _skills(arguments: argparse.Namespace, sheet: Literal["canonical", "raw"]) -> Iterator[Trained]:
    """The skills of every recording, fold and seed."""
    from geodesic_motion_ros.experiments.imitation import default_folds, parse_folds
    from geodesic_motion_ros.experiments.trained import trained_on_folds

    settings = _training(arguments, sheet)
    recordings = {path.stem: read_recording(arguments, path) for path in arguments.demos}
    if len(recordings) < len(arguments.demos):
        raise ParameterError("two recordings have the same file name; the table calls tasks by it: rename one")
    for task, demonstrations in recordings.items():
        count = len(demonstrations)
        folds = parse_folds(arguments.folds, count) if arguments.folds else default_folds(count)
        kept = arguments.out / "skills"
        yield from trained_on_folds(task, demonstrations, folds, arguments.seeds, kept, settings)


def _folder(arguments: argparse.Namespace) -> Path:
    """Where the results of an experiment go; ParameterError where that cannot be written, before anything long."""
    folder = arguments.out / arguments.experiment
    for path in (folder / "table.txt", arguments.json):
        writable(path)
    return folder


def _hand_over(arguments: argparse.Namespace, folder: Path, table: str, content: dict) -> None:
    print(table)
    (folder / "table.txt").write_text(table + "\n")
    write_json(folder / "figures.json", content)
    if arguments.json is not None:
        write_json(arguments.json, content)
    print(f"wrote table, figures and picture to {folder}")
