"""`train`: from a recording to a skill folder and its report."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geodesic_motion_ros.cli import train_joint, train_task
from geodesic_motion_ros.cli.arguments import (
    HelpFormatter,
    add_json,
    add_recording,
    indices,
    latent_dimension,
    pictured,
    seed,
    writable,
)
from geodesic_motion_ros.cli.progress_bar import progress_bar
from geodesic_motion_ros.cli.report import planner_of, write_report
from geodesic_motion_ros.demonstrations.column_names import (
    DEFAULT_COLUMNS,
    find_quaternion_order,
    parse_columns,
)
from geodesic_motion_ros.demonstrations.takes import Action
from geodesic_motion_ros.skill.description import check_text
from geodesic_motion_ros.utils.checked_numbers import LARGEST_DIMENSION
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json

if TYPE_CHECKING:
    from geodesic_motion_ros.certification.declared_scene import DeclaredScene
    from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
    from geodesic_motion_ros.demonstrations.recordings import Recording
    from geodesic_motion_ros.planning.planner import ReactivePlanner
    from geodesic_motion_ros.skill.skill import Skill

# Motions smaller than this [m] look like a wrong unit; an error of this share of the motion is no skill.
_SMALL, _POOR = 0.02, 0.2
#: Most characters of --source and of --licence.
_LONGEST_PROVENANCE = 2000
#: Exit status where the skill that was written has no motion of its own.
_UNUSABLE = 1
_REMEDY = (
    "are --robot, --units and the frame of the recording right (report.html shows the motion)? If so, give it more "
    "--steps, or demonstrations of one task that the arm can hold"
)
#: The same where the arm, as it is modelled, is the cause.
_REMEDIES = {
    "IN_COLLISION": "is --robot right, and what its hand carries? If so, its spheres are too large there, or two links "
    "are kept apart that are not: look at spheres.png of its folder, and mend spheres.yaml",
}
_SPACES = {"task": train_task, "joint": train_joint}
_SPACE_NOTES = {
    "task": "poses of the tool: a skill of poses is learned",
    "joint": "configurations of the whole arm: a joint-space skill is learned",
}
#: Settings of the training that both spaces have.
_SHARED = (
    "latent_dimension", "seed", "steps", "kernels", "bandwidth_factor", "far_sigma", "sheet", "schedule", "kl_weight",
    "closed",
)  # fmt: skip

_DESCRIPTION = """\
Learns a skill from a handful of demonstrations of one task: a latent space with a Riemannian metric that is cheap to
cross where people moved. Takes a few minutes on one core; the same seed gives the same skill, bit by bit.

A recording of the tool's poses becomes a skill of poses; one of an arm's joints, a file with joint positions in
radians as `demonstrate` writes it or a bag with joint states, becomes a joint-space skill, which moves the whole arm.

What is wrong with a recording (lost samples, spikes, an interrupted demonstration, one of another task) is stated,
and repaired or left out; `inspect` shows it before the training.
"""
_EPILOG = """\
With --held-out the skill is learned from the other demonstrations, and how well it predicts the held-out ones from
their start and goal is printed and kept in the skill. The folder also gets report.png, the picture of its latent
space, and report.html, all that is known of the skill on one page. An existing skill in the folder is replaced,
anything else is left alone.

Last the skill is planned with, from the demonstrations' mean start to their mean goal. Exit status: 0 it has that
motion; 1 it was written, and has none: a warning says why; 2 nothing was learned; 130 interrupted.

examples:
  geodesic-motion train --demos pouring.npy --units cm --out skills/pouring
  geodesic-motion train --demos pouring.npy --units cm --held-out 0,3,6 --out skills/pouring_036 --json out/036.json
  geodesic-motion train --demos reach.csv --units m --columns t,px,py,pz,qx,qy,qz,qw --out skills/reach
  geodesic-motion train --demos reach.npz --space joint --out skills/reach
  geodesic-motion train --demos recordings --out skills/reach
  geodesic-motion train --demos reach.npz --latent auto --out skills/reach
  geodesic-motion train --demos log.txt --units m --columns t=stamp,px=x,py=y,pz=z --out skills/reach

from bags, recorded in one go with a standstill before and after each demonstration, or marked by a topic:
  geodesic-motion train --bag reach_bag --topic /joint_states --out skills/reach
  geodesic-motion train --bag monday.mcap tuesday.mcap --topic /tf:panda_link0:panda_hand --out skills/pouring
  geodesic-motion train --bag old.bag --topic /joint_states --split /mark --out skills/reach
  geodesic-motion train --bag reach_bag --split 3.2-9.8,14-20.5 --strict --out skills/reach

as the paper has it, for both kinds of recordings (by default changed where that was measured to be better); options
beside --paper change it again:
  geodesic-motion train --demos pouring.npy --units cm --paper --out skills/paper_pouring
"""


@dataclass(frozen=True)
class Measure:
    """Measures how well a new skill predicts demonstrations held out of its training, for `train --held-out`.

    The measure is a study, which the product does not import: the command is handed it.

    Attributes
    ----------
    check : called before the training; a GeodesicMotionError where what it needs is missing.
    quality : called with all demonstrations, the indices held out, the seed and the skill; figures by their names.
    """

    check: Callable[[], None]
    quality: Callable[[Any, tuple[int, ...], int, Skill], dict[str, Any]]


def add_command(commands: argparse._SubParsersAction, measures: Mapping[str, Measure] | None = None) -> None:
    """Add the command to the parser of the command line.

    measures : by the space of the recording, "task" or "joint"; None: --held-out is refused.
    """
    parser = commands.add_parser(
        "train", help="learn a skill from demonstrations",
        description=_DESCRIPTION, epilog=_EPILOG, formatter_class=HelpFormatter,
    )  # fmt: skip
    add_recording(parser, joints=True, bags=True)
    skill = parser.add_argument_group("skill")
    skill.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="where the skill goes")
    skill.add_argument("--name", help="what it is called; without it, like its folder")
    skill.add_argument(
        "--scene",
        help="what stood around the arm, kept in the skill: a file, as in config/scenes, the name of one of those, or "
        "none; refused where demonstrations enter it",
    )  # fmt: skip
    skill.add_argument("--source", metavar="TEXT", help="where the data come from, kept in the skill")
    skill.add_argument("--licence", metavar="TEXT", help="licence of the data, kept in the skill")
    skill.add_argument(
        "--held-out", type=indices, metavar="NUMBERS", help="demonstrations to measure on instead of learning from: 0,3"
    )
    _add_training(parser.add_argument_group("training"))
    train_task.add_options(parser.add_argument_group("training on recordings of the tool"))
    train_joint.add_options(parser.add_argument_group("training on recordings of joints"))
    add_json(parser)
    parser.set_defaults(run=partial(run, measures=measures))


def _add_training(group: argparse._ArgumentGroup) -> None:
    """Settings of the training; what is not given stays at the defaults."""
    group.add_argument(
        "--paper", action="store_true",
        help="the paper's model: raw sheet, everything learned together, nothing weighted, change of variables",
    )  # fmt: skip
    group.add_argument(
        "--latent", "--latent-dimension", dest="latent_dimension", type=latent_dimension, metavar="N",
        help="dimensions of the latent space, 1 to 6, or auto: as few as give held-out demonstrations back as well as "
        "any; 2 without it, of joints 3",
    )  # fmt: skip
    group.add_argument("--seed", type=seed, help="of everything random; 0 without it")
    group.add_argument("--steps", type=int, help="of the optimiser; 5000 without it")
    group.add_argument("--kernels", type=int, help="radial-basis kernels of the deviations; 500 without it")
    group.add_argument(
        "--bandwidth-factor", type=float,
        help="width of those kernels over the distance between neighbours; 1 without it, of joints 2; the paper states "
        "none",
    )  # fmt: skip
    group.add_argument(
        "--far-sigma", type=float,
        help="deviation far from the demonstrations [m], of joints [rad]: how high walls are; 1 without it; the paper "
        "states none",
    )  # fmt: skip
    group.add_argument(
        "--sheet", choices=("canonical", "raw"),
        help="demonstrations endpoint-normalised, with start and goal offsets taken out (default), or the paper's: as "
        "they were recorded",
    )  # fmt: skip
    group.add_argument(
        "--schedule", choices=("two_stage", "joint"),
        help="means first, then deviations (default), or the paper's: everything together",
    )  # fmt: skip
    group.add_argument("--sigma-weight", type=float, help="weight of sigma in the metric; 10 without it, the paper: 1")
    group.add_argument(
        "--kl-weight", type=float,
        help="weight of the divergence; 0.6 without it, of rounds and on the raw sheet 0.3; the paper: 1",
    )  # fmt: skip


def run(arguments: argparse.Namespace, measures: Mapping[str, Measure] | None = None) -> int:
    """Train, measure, save, plan with the skill, report; returns the exit status."""
    from geodesic_motion_ros.certification.declared_scene import DeclaredScene
    from geodesic_motion_ros.cli.recorded import read_recorded, refuse_unsaid_order

    paths = tuple(arguments.bag or (arguments.demos,))
    options = {name: module.OPTIONS for name, module in _SPACES.items()}
    recording = read_recorded(arguments, paths, of_bags=arguments.bag is not None, options=options)
    space = "joint" if recording.robot else "task"
    _note_the_flaws(recording)
    # as was found, where nothing was said
    arguments.closed = True if recording.rounds is not None else None
    chosen_by_data = arguments.latent_dimension == "auto"
    if chosen_by_data:
        if recording.rounds is not None:
            raise ParameterError("--latent auto: rounds are learned in 2 or 3 latent dimensions: say which")
        arguments.latent_dimension = None
    training: train_joint.JointTraining | train_task.TaskTraining = (
        train_joint.JointTraining if space == "joint" else train_task.TaskTraining
    ).from_arguments(arguments, recording.demonstrations(arguments.strict), _SHARED)  # fmt: skip
    measure = _measure(measures, space) if arguments.held_out else None
    name = arguments.out.resolve().name if arguments.name is None else arguments.name
    check_text("--name", name)
    for option in ("source", "licence"):
        if (text := getattr(arguments, option)) is not None:
            check_text(f"--{option}", text, _LONGEST_PROVENANCE)
    scene = None if arguments.scene is None else DeclaredScene.from_name(arguments.scene)
    _refuse_foreign(arguments.out)
    _refuse_unwritable(arguments.out)
    writable(arguments.json)
    closed = f"; {len(recording.rounds.motions)} rounds, a closed skill" if recording.rounds is not None else ""
    print(f"{', '.join(map(str, paths))}: {_SPACE_NOTES[space]}{closed}")
    demonstrations = training.tool_demonstrations()
    extent = _extent(demonstrations)
    _note_the_recording(demonstrations, extent, space)
    if space == "task" and demonstrations.has_orientation and arguments.demos is not None:
        refuse_unsaid_order(arguments, arguments.demos, demonstrations)
        _report_orientations(arguments, demonstrations)
    provenance = _provenance(arguments, paths)
    if chosen_by_data:
        training, provenance["dimension"] = _with_chosen_dimension(training, paths[0].stem)
    workload = training.workload()
    seconds = workload.measure_seconds()
    print(f"{workload}; about {seconds:.0f} s on this machine, if it is not busy, before graph and report", flush=True)
    with progress_bar(paths[0].stem) as progress:
        skill = training.learn(name, progress, provenance)
    if scene is not None:
        skill = _recorded_in(scene, skill)
    if measure is not None:
        figures = measure.quality(training.demonstrations, training.held_out, training.settings.seed, skill)
        skill = replace(skill, quality=skill.quality | {"held_out": list(arguments.held_out)} | figures)
    folder = skill.save(arguments.out)
    for name, value in skill.quality.items():
        print(f"{name:32} {value:.2f}" if isinstance(value, float) else f"{name:32} {value}")
    _note_the_result(skill.quality, extent)
    print(f"wrote the skill to {folder}")
    pictured(skill, folder / "report.png")
    planner = planner_of(skill)
    objection = own_objection(planner)
    write_report(planner, folder / "report.png", folder / "report.html", recording)
    if arguments.json is not None:
        figures = {"skill": skill.name, "folder": folder.as_posix(), "quality": skill.quality, "unusable": objection}
        write_json(arguments.json, figures)
    if objection:
        _note(f"the skill in {folder} moves no arm yet: {objection}")
    return _UNUSABLE if objection else 0


def _with_chosen_dimension(
    training: train_joint.JointTraining | train_task.TaskTraining, name: str
) -> tuple[train_joint.JointTraining | train_task.TaskTraining, dict[str, Any]]:
    """The training with the latent dimension that its demonstrations speak for, and the figures it was chosen by."""
    from tqdm import tqdm

    from geodesic_motion_ros.learning.dimension import FOLDS, DimensionFigures, shortened

    brief: Any = shortened(training.settings)
    # Of each model the means alone are learned.
    once = replace(training, settings=replace(brief, precision_iterations=1)).workload().measure_seconds()
    print(
        f"choosing the latent dimension: 1 to {LARGEST_DIMENSION}, {FOLDS} folds of {brief.steps} steps each; about "
        f"{LARGEST_DIMENSION * FOLDS * once:.0f} s on this machine, if it is not busy\n"
        "dimensions  error, held out [mm]  standard error [mm]",
        flush=True,
    )

    def noted(dimension: int, errors: np.ndarray) -> None:
        figures = DimensionFigures((dimension,), errors[None])
        mean, error = 1e3 * figures.means[0], 1e3 * figures.standard_errors[0]
        with tqdm.external_write_mode():
            print(f"{dimension:10}  {mean:20.2f}  {error:19.2f}", flush=True)

    with progress_bar(name) as progress:
        figures = training.compare_dimensions(progress, noted)
    print(f"chosen: {figures.chosen}, the smallest within one standard error of the best")
    settings: Any = replace(training.settings, latent_dimension=figures.chosen)
    return replace(training, settings=settings), figures.as_dict()


def _measure(measures: Mapping[str, Measure] | None, space: str) -> Measure:
    """What measures on held-out demonstrations, checked; ParameterError where nothing does."""
    if measures is None:
        raise ParameterError("--held-out: nothing here measures: the studies do, pip install ./studies in the sources")
    measures[space].check()
    return measures[space]


def _recorded_in(scene: DeclaredScene, skill: Skill) -> Skill:
    """The skill with the scene that it was recorded in; SkillError where its demonstrations enter that."""
    from geodesic_motion_ros.certification.declared_scene import check_demonstrations
    from geodesic_motion_ros.queries.output_space import OutputSpace
    from geodesic_motion_ros.robot.collision_model import CollisionModel
    from geodesic_motion_ros.robot.kinematics import Robot

    arm = Robot.named(skill.robot), CollisionModel.named(skill.robot)
    check_demonstrations(scene, skill, *OutputSpace.of(skill).demonstrated_spheres(skill, *arm))
    return replace(skill, scene=scene.described)


def _provenance(arguments: argparse.Namespace, paths: tuple[Path, ...]) -> dict[str, Any]:
    given = {"data": ", ".join(path.name for path in paths), "source": arguments.source, "licence": arguments.licence}
    if arguments.held_out:
        given["held_out"] = list(arguments.held_out)
    return {name: value for name, value in given.items() if value is not None}


def _refuse_foreign(folder: Path) -> None:
    """Say so before the training, not after it."""
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir()) and not (folder / "skill.yaml").is_file()):
        raise ParameterError(f"{folder} exists and is not a skill folder: choose another --out, nothing was changed")


def _refuse_unwritable(folder: Path) -> None:
    """Try what saving will do: a draft beside the folder."""
    try:
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.absolute().parent):
            pass
    except OSError as error:
        raise ParameterError(f"{folder} cannot be written ({error.strerror}): choose another --out") from error


def _extent(demonstrations: Demonstrations) -> float:
    """How large the motions are [m]: diagonal of the box around one of them, the median."""
    return float(np.median([np.linalg.norm(np.ptp(item.positions, axis=0)) for item in demonstrations]))


def _note_the_flaws(recording: Recording) -> None:
    """State what was found, and what is learned from where that is not all."""
    for flaw in recording.flaws:
        if flaw.action in (Action.KEPT, Action.REPAIRED, Action.LEFT_OUT):
            _note(f"demonstration {flaw}")
        elif flaw.action is Action.READ:
            print(f"demonstration {flaw}")
    between = [flaw for flaw in recording.flaws if flaw.action is Action.PASSED_OVER]
    if between:
        print(f"{len(between)} motions lead back to the start and are passed over; `inspect` lists them")
    names = [motion.name for motion in recording.motions if motion.name not in recording.left_out_names]
    if len(names) < len(recording.motions):
        print(f"learning from {', '.join(names)}; --held-out counts these, from 0")


def _note_the_recording(demonstrations: Demonstrations, extent: float, space: str) -> None:
    if len(demonstrations) == 1:
        _note(
            "one demonstration only: the skill can carry it to other starts and goals, but has no other path around an "
            "obstacle, and start and goal choose nothing (no density of them, no regression on them)"
        )
    if extent < _SMALL:
        doubt = ": is --units right?" if space == "task" else ", as the tool moves"
        _note(f"the motions are only {1e3 * extent:.2g} mm large{doubt}")


def _report_orientations(arguments: argparse.Namespace, demonstrations: Demonstrations) -> None:
    """Print the order in which quaternions were read, and how the tool points then."""
    from geodesic_motion_ros.demonstrations.quaternion_order import mean_tilts

    if arguments.demos.suffix.lower() not in (".npy", ".npz"):
        order = "the names of the columns say"
    else:
        order = ",".join(find_quaternion_order(parse_columns(arguments.columns or DEFAULT_COLUMNS)))
    first, last = mean_tilts(demonstrations)
    print(
        f"quaternions read as {order}: the tool's z axis begins {first:.0f} and ends {last:.0f} deg from straight down"
    )


def _note_the_result(quality: Mapping[str, Any], extent: float) -> None:
    error = quality["training_position_error_mm"]
    if error > _POOR * 1e3 * extent:
        _note(
            f"a poor skill: it is {error:.1f} mm off its own demonstrations on average, which are {1e3 * extent:.0f} "
            "mm large; give it more --steps, or demonstrations of one task only"
        )


def own_objection(planner: ReactivePlanner) -> str:
    """Plan from the demonstrations' mean start to their mean goal, as demonstrated and without an obstacle: why there
    is no motion, and what may help; "" where there is one.
    """
    skill = planner.skill
    planner.set_detour(0.0)
    verdict = planner.plan(*np.split(skill.start_pose, [3]), *np.split(skill.goal_pose, [3])).verdict
    planner.set_detour(planner.settings.detour)
    if verdict.ok:
        return ""
    code = verdict.code.name
    remedy = _REMEDIES.get(code, _REMEDY)
    return f"from its mean start to its mean goal, without an obstacle, {code}: {verdict.reason}; {remedy}"


def _note(text: str) -> None:
    print(f"geodesic-motion: warning: {text}", file=sys.stderr)
