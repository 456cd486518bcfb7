"""`experiment`: what the method is claimed to do, measured; a table and a figure each."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geodesic_motion_ros.cli.arguments import (
    HelpFormatter,
    add_json,
    add_recording,
    indices,
    metres,
    name_list,
    writable,
)
from geodesic_motion_ros.studies.cli import experiment_measures as measures
from geodesic_motion_ros.utils.errors import ExperimentError
from geodesic_motion_ros.utils.tables import text_table, write_json

_DESCRIPTION = """\
toy-task   a J in the plane with orientations that draw a C on the sphere: two clusters, walls, geodesic and line
toy-joint  an arm of two joints that draws an S in two postures: two clusters, geodesic and line
circle     the whole arm draws circles in four postures: switches between them with two and three latent dimensions
geodesics  methods for a shortest path on one skill: gradient descent, graphs of 50x50 and 100x100 nodes; lengths, times
avoidance  spheres dead-centre on the planned path of held-out demonstrations: clear, or rightly declared infeasible?
crossing   what it costs to change between the clusters of q and -q, and whether the energy threshold refuses it
goals      simulated demonstrations between places that vary: held-out ones predicted from start and goal
modes      simulated demonstrations past a pillar on both sides: one mode followed, the other taken when it is blocked
whole-arm  spheres on the path of the whole arm, standing and moving: another path taken, rightly refused, no contact?
obstacle-laws  the same scenes of spheres on the arm's path under laws, strengths and widths of the ambient metric
grasp-task   reach to grasp, poses of the tool: targets that were not shown, and paths across the clusters of q and -q
pouring-task three bottles to three cups, poses of the tool: all nine pairs, a moving sphere, a chain over all cups
detours    a sphere appears on the tool's path: the same motion with several largest detours, played side by side
largest-sphere  the largest sphere on the tool's path that is passed, place by place, by how far a detour may lead
limbs      a sphere beside the tool's path: how many solutions of inverse kinematics hit it, and a skill that sees it
grasp-joint  reach to grasp with the whole arm in families: energies within and across, which paths stay when blocked
pouring-joint  three bottles to three cups with the whole arm: geodesics through several groups, played by the arm
volume     one whole-arm skill learned without and with the volume term of the paper's evidence lower bound
dimension  two to five latent dimensions of the whole arm, on a grid and on a graph of nearest neighbours
rate       planner and twin as two processes: ticks a second with a goal that stays or moves, a moving sphere, clouds;
           with a skill of joint space also the time from an obstacle's message to the trajectory that answers it
literal    held-out demonstrations by the paper's models and planner to the letter, beside the default ones
reshaped-tubes  how a moving sphere reshapes the metric of the whole arm: a cut through latent tubes, the path in it
paper-rate the same of the paper's planner in both spaces, and how often a tick ends with the cheapest path
all        every experiment that needs no recording, with its default arguments, one after the other; an hour

What the paper shows and what these show stands in geodesic_motion_ros/studies/experiments/README.md. Table, figure and
JSON go to out/experiments/NAME/. avoidance, crossing, goals and modes train skills, each once: they are kept in
out/experiments/skills and taken from there when data, settings and training code are the same; so are the models of
circle, in out/experiments/models. goals and modes make their demonstrations themselves, with an arm in PyBullet; one
skill per seed, two minutes each.
"""
_EPILOG = """\
examples:
  geodesic-motion experiment toy-task
  geodesic-motion experiment geodesics --skill panda_pouring
  geodesic-motion experiment avoidance --demos pouring.npy bottle2shelf.npy --units cm --folds 0,3,6/1,4,7/2,5,8
  geodesic-motion experiment crossing --demos pouring.npy --units cm
  geodesic-motion experiment goals --shown 20
  geodesic-motion experiment modes --save two_modes.npz
  geodesic-motion experiment whole-arm --moving-scenes 500 --processes 2
  geodesic-motion experiment obstacle-laws --scenes 200
  geodesic-motion experiment largest-sphere --skill panda_reach_to_grasp
  geodesic-motion experiment volume
  geodesic-motion experiment all --seeds-from 10000
  geodesic-motion experiment rate --skill panda_reach_to_grasp --rates 100,250,500
"""

Option = tuple[str, dict[str, Any]]


@dataclass(frozen=True)
class Experiment:
    """One of them.

    Attributes
    ----------
    summary : what it is, in a line; description : more of it.
    measure : what its arguments request. options : its arguments, with argparse's keywords.
    save : writes the demonstrations that it makes to the file `--save`. on_recordings : it is given recordings.
    """

    summary: str
    measure: Callable[[argparse.Namespace], measures.Measured]
    options: tuple[Option, ...] = ()
    description: str | None = None
    save: Callable[[argparse.Namespace], None] | None = None
    on_recordings: bool = False


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(float(number) for number in text.split(","))


def _count(flag: str, default: int, help_text: str) -> Option:
    return flag, {"type": int, "default": default, "help": help_text}


def _seeds(help_text: str, default: str = "0,1,2") -> Option:
    return "--seeds", {"type": indices, "default": default, "metavar": "SEEDS", "help": help_text}


def _skill(default: str, help_text: str = "its folder, or a shipped name") -> Option:
    return "--skill", {"default": default, "metavar": "SKILL", "help": help_text}


_OF_JOINTS = _skill("panda_reach_to_grasp", "of joint space: its folder, or a shipped name")
_STEPS: Option = ("--steps", {"type": int, "help": "of the training; TrainingSettings' default without it"})
_SAVE: Option = (
    "--save",
    {
        "type": Path, "metavar": "FILE.npz",
        "help": "write the demonstrations of the first seed to a file to train on (units m) and measure nothing",
    },
)  # fmt: skip
_OF_DATA = (_seeds("of data and training, one skill each"), _STEPS, _SAVE)
_OF_FOLDS: tuple[Option, ...] = (
    ("--folds", {"metavar": "FOLDS", "help": "to hold out, 0,3,6/1,4,7; without it three folds"}),
    _seeds("one training each", "0"),
    _STEPS,
)
_TRAININGS = _seeds("of the trainings, one skill each")

EXPERIMENTS: dict[str, Experiment] = {
    "toy-task": Experiment("the paper's letters J and C", measures.of_seeds, (_seeds("one training each"),)),
    "toy-joint": Experiment("an S in two postures", measures.of_seeds, (_seeds("one training each"),)),
    "circle": Experiment("two and three latent dimensions", measures.circle, (_seeds("two trainings each"),)),
    "geodesics": Experiment(
        "methods for a geodesic compared", measures.geodesics,
        (_skill("panda_pouring"), _count("--pairs", 3, "pairs of ends")),
    ),
    "avoidance": Experiment(
        "spheres on the path", measures.avoidance,
        (
            ("--radii", {"type": metres, "default": "0.02,0.04,0.08", "metavar": "M,M", "help": "of spheres [m]"}),
            ("--tool-radius", {
                "type": float, "default": 0.0, "metavar": "M",
                "help": "of a sphere around the tool's origin [m]; 0: the radii already stand for obstacle and tool "
                "together",
            }),
            _count("--scenes", 8, "places on the path of each held-out demonstration"),
            ("--sheet", {
                "choices": ("canonical", "raw"), "default": "canonical", "help": "skills are learned on",
            }),
            *_OF_FOLDS,
        ),
        on_recordings=True,
    ),
    "crossing": Experiment("what changing clusters costs", measures.crossing, _OF_FOLDS, on_recordings=True),
    "goals": Experiment(
        "starts and goals that vary", measures.of_data,
        (
            _count("--shown", 12, "demonstrations that a skill is learned from"),
            _count("--held-out", 12, "demonstrations that are predicted"),
            *_OF_DATA,
        ),
        save=measures.save_goals,
    ),
    "modes": Experiment(
        "two modes past a pillar", measures.of_data,
        (
            _count("--shown", 6, "demonstrations of each mode that a skill is learned from"),
            _count("--cases", 40, "starts and goals that are requested of each skill"),
            *_OF_DATA,
        ),
        save=measures.save_modes,
    ),
    "whole-arm": Experiment(
        "avoidance with the whole arm", measures.whole_arm,
        (
            _OF_JOINTS,
            ("--parts", {
                "type": name_list(","), "default": "tubes,one path,all paths,elbow,moving", "metavar": "PART,PART",
                "help": "what is measured",
            }),
            _count("--scenes", 40, "of standing spheres, or of none, in each part"),
            _count("--moving-scenes", 40, "of moving spheres"),
            _count("--seed", 0, "of the scenes"),
            _count("--processes", 1, "that play scenes of moving spheres"),
        ),
    ),
    "grasp-task": Experiment(
        "reach to grasp in task space", measures.of_settings,
        (
            _count("--shown", 8, "demonstrations"),
            _count("--targets", 20, "random starts and goals for each seed"),
            _TRAININGS,
        ),
    ),
    "pouring-task": Experiment(
        "pouring in task space", measures.of_settings,
        (_count("--shown", 3, "demonstrations of each of three pairs"), _TRAININGS),
    ),
    "detours": Experiment(
        "one obstacle, several detours", measures.detours,
        (
            _skill("panda_pouring"),
            ("--detours", {
                "type": metres, "default": "0,0.1,0.2", "metavar": "M,M", "help": "how far the tool may leave it [m]",
            }),
            ("--radius", {"type": float, "default": 0.065, "metavar": "M", "help": "of the sphere [m]"}),
            ("--place", {"type": float, "default": 0.45, "help": "share of the motion at which the tool meets it"}),
            ("--appears", {"type": float, "default": 0.2, "help": "share of the motion at which it appears"}),
        ),
    ),
    "largest-sphere": Experiment(
        "what detours pass", measures.largest_sphere,
        (
            _skill("panda_pouring"),
            _count("--places", 20, "on the tool's path"),
            ("--detours", {
                "type": metres, "default": "0,0.1,0.22", "metavar": "M,M", "help": "how far the tool may leave it [m]",
            }),
        ),
    ),
    "limbs": Experiment(
        "what a skill of the tool does not see", measures.limbs,
        (
            _skill(
                "panda_reach_to_grasp", "of joint space, of the same reach to grasp: its folder, or a shipped name"
            ),
            _count("--side", 150, "nodes along each side of the latent grid"),
            _count("--solutions", 100, "of the inverse kinematics for each node"),
        ),
    ),
    "grasp-joint": Experiment(
        "families of grasps, blocked", measures.of_settings,
        (_count("--shown", 3, "demonstrations of each family"), _TRAININGS),
    ),
    "pouring-joint": Experiment(
        "groups of pourings", measures.of_settings,
        (_count("--shown", 3, "demonstrations of each of three pairs"), _TRAININGS),
    ),
    "obstacle-laws": Experiment(
        "ambient metrics compared", measures.obstacle_laws,
        (
            _OF_JOINTS,
            _count("--scenes", 120, "of a sphere near the path, or on it"),
            _count("--seed", 0, "of the scenes"),
        ),
    ),
    "volume": Experiment(
        "the volume term off and on", measures.volume,
        (
            ("--demos", {
                "type": Path, "metavar": "FILE",
                "help": "recorded joints, as `demonstrate`'s; without it a simulated reach to grasp, four times in two "
                "families",
            }),
            ("--robot", {"default": "panda", "help": "whose joints were recorded"}),
            ("--weights", {"type": _numbers, "default": "0,1", "metavar": "W,W", "help": "of the volume term"}),
            ("--steps", {"type": int, "help": "of the training; JointTrainingSettings' default without it"}),
        ),
    ),
    "dimension": Experiment(
        "two to five latent dimensions", measures.of_seeds, (_seeds("four trainings each", "0,1"),)
    ),
    "rate": Experiment(
        "ticks a second of the running nodes", measures.rate,
        (
            _skill("panda_pouring"),
            ("--rates", {"type": _numbers, "default": "100", "metavar": "HZ,HZ", "help": "of the planner"}),
            ("--seconds", {"type": float, "default": 8.0, "help": "length of each stretch"}),
            ("--goals-hz", {"type": float, "default": 10.0, "help": "new goals a second"}),
            _count("--obstacles", 10, "spheres beside the path"),
            _count("--spheres", 100, "that appear on the path, to time answers; 0: none"),
        ),
    ),
    "literal": Experiment(
        "the paper to the letter beside this package's default, on held-out demonstrations", measures.literal,
        (_OF_FOLDS[0], _count("--seed", 0, "of the trainings"), _STEPS), on_recordings=True,
    ),
    "reshaped-tubes": Experiment("a cut through latent tubes as a sphere moves", measures.reshaped_tubes),
    "paper-rate": Experiment(
        "the same of the paper's planner, and how often it ends with the cheapest path", measures.paper_rate,
        (
            ("--rate", {"type": float, "default": 100.0, "metavar": "HZ", "help": "of the planner"}),
            ("--seconds", {"type": float, "default": 8.0, "help": "length of each stretch"}),
        ),
    ),
}  # fmt: skip


def add_command(commands: argparse._SubParsersAction) -> None:
    """Add the command and its experiments to the parser of the command line."""
    parser = commands.add_parser(
        "experiment", help="measure what is claimed: geodesics, avoidance, crossing, goals, modes, whole-arm, more",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    names = parser.add_subparsers(dest="experiment", metavar="NAME", required=True)
    for name, experiment in EXPERIMENTS.items():
        own = names.add_parser(
            name, help=experiment.summary, description=experiment.description, formatter_class=HelpFormatter
        )
        for flag, keywords in experiment.options:
            own.add_argument(flag, **keywords)
        if experiment.on_recordings:
            add_recording(own, several=True, joints=name == "literal")
        own.set_defaults(run=_run)
    alone = {name: names.choices[name] for name, experiment in EXPERIMENTS.items() if not experiment.on_recordings}
    everything = names.add_parser("all", help="one after the other", formatter_class=HelpFormatter)
    everything.add_argument(
        "--seeds-from", type=int, default=0, metavar="SEED",
        help="add SEED to every experiment's default seeds (default: 0, to develop on); tables are made with 10000",
    )  # fmt: skip
    everything.set_defaults(run=lambda arguments: _all(arguments, alone))
    for own in names.choices.values():
        own.add_argument("--out", type=Path, default=Path("out/experiments"), metavar="FOLDER", help="for results")
        add_json(own)


def _run(arguments: argparse.Namespace) -> None:
    """Measure, draw and hand over; or save what would have been measured on."""
    experiment = EXPERIMENTS[arguments.experiment]
    if experiment.save is not None and arguments.save is not None:
        experiment.save(arguments)
        return
    folder = _folder(arguments)
    measured = experiment.measure(arguments)
    if measured.draw is not None:
        measured.draw(folder / f"{arguments.experiment.replace('-', '_')}.png")
    _hand_over(arguments, folder, measured.table, measured.figures)


def _all(arguments: argparse.Namespace, parsers: Mapping[str, argparse.ArgumentParser]) -> None:
    """Run every experiment as it is by default; what fails is reported and does not stop the others."""
    folder, rows = _folder(arguments), []
    for number, (name, parser) in enumerate(parsers.items(), start=1):
        print(f"[{number}/{len(parsers)}] {name}", flush=True)
        own = parser.parse_args(["--out", str(arguments.out)], argparse.Namespace(experiment=name))
        if "seeds" in own:
            own.seeds = tuple(seed + arguments.seeds_from for seed in own.seeds)
        if "seed" in own:
            own.seed += arguments.seeds_from
        if "processes" in own:
            own.processes = len(os.sched_getaffinity(0))
        began, busy, error = time.monotonic(), _processor_time(), ""
        try:
            own.run(own)
        except Exception as failure:
            error = " ".join(f"{type(failure).__name__}: {failure}".split())
            print(f"failed: {error}", flush=True)
        took = {"seconds": time.monotonic() - began, "processor_seconds": _processor_time() - busy}
        rows.append({"experiment": name, **took, "error": error})
    lines = [
        [row["experiment"], "failed" if row["error"] else "done", row["seconds"], row["processor_seconds"],
         row["error"]]
        for row in rows
    ]  # fmt: skip
    table = text_table(["experiment", "", "seconds", "of processor", ""], lines, digits=0, left=(0, 1, 4))
    _hand_over(arguments, folder, table, {"experiments": rows})
    failed = [row["experiment"] for row in rows if row["error"]]
    if failed:
        raise ExperimentError(f"{len(failed)} of {len(rows)} experiments failed: {', '.join(failed)}")


def _processor_time() -> float:
    """Of this process and of those that it has waited for [s]: it tells on a busy machine what a quiet one takes."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


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
