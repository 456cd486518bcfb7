"""What each experiment measures, by the arguments that `experiment` was given. Libraries are imported when one runs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import asdict, fields, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from geodesic_motion_ros.cli.arguments import evenly_sampled, read_joint_recording, read_recording
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.writers import save_demonstrations
from geodesic_motion_ros.utils.errors import ParameterError

if TYPE_CHECKING:
    from tqdm import tqdm

    from geodesic_motion_ros.learning.settings import TrainingSettings
    from geodesic_motion_ros.studies.experiments.trained import Trained


class Measured(NamedTuple):
    """The table as text, the figures for JSON, and what draws the picture to a file; None where there is none."""

    table: str
    figures: dict[str, Any]
    draw: Callable[[Path], None] | None

    @classmethod
    def of(cls, report: Any, draw: Callable[[Any, Path], None]) -> Measured:
        """A report that has a table and figures."""
        return cls(report.table(), report.as_dict(), partial(draw, report))


def of_seeds(arguments: argparse.Namespace) -> Measured:
    """Experiments NAME whose `measure_NAME` takes seeds and tells what begins."""
    from tqdm import tqdm

    module, name = _module(arguments)
    with tqdm(desc=arguments.experiment, unit="model") as bar:
        report = getattr(module, f"measure_{name}")(seeds=arguments.seeds, progress=_counted_on(bar))
    return Measured.of(report, getattr(module, f"draw_{name}"))


def of_settings(arguments: argparse.Namespace, training: TrainingSettings | None = None) -> Measured:
    """Experiments NAME whose `measure_NAME` takes settings, the cache of skills, and the training's settings."""
    module, name = _module(arguments)
    report = getattr(module, f"measure_{name}")(_settings(arguments), arguments.out / "skills", training)
    return Measured.of(report, getattr(module, f"draw_{name}"))


def of_data(arguments: argparse.Namespace) -> Measured:
    """The same of those that are trained as skills are, on the canonical sheet, but for --steps."""
    return of_settings(arguments, _training(arguments, "canonical"))


def save_goals(arguments: argparse.Namespace) -> None:
    """Write what `goals` would show and hold out."""
    from geodesic_motion_ros.studies.experiments.goals import drawn

    settings = _settings(arguments)
    everything, fold = drawn(settings, settings.seeds[0])
    _save(arguments.save, everything, f"the last {len(fold)} are those held out")


def save_modes(arguments: argparse.Namespace) -> None:
    """Write what `modes` would show."""
    from geodesic_motion_ros.simulation.teacher import two_mode_demonstrations

    settings = _settings(arguments)
    shown = two_mode_demonstrations(settings.shown, settings.seeds[0])
    _save(arguments.save, shown, f"first {settings.shown} on the left of the pillar, then as many on its right")


def circle(arguments: argparse.Namespace) -> Measured:
    """Circles in two and in three latent dimensions; trained models are kept."""
    from tqdm import tqdm

    from geodesic_motion_ros.studies.experiments.circle import draw_circle, measure_circle

    with tqdm(desc="circle", unit="model") as bar:
        report = measure_circle(arguments.seeds, progress=_counted_on(bar), folder=arguments.out / "models")
    return Measured.of(report, draw_circle)


def geodesics(arguments: argparse.Namespace) -> Measured:
    """Methods for a geodesic on one skill."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.studies.experiments.geodesics import compare_geodesics, draw_geodesics

    return Measured.of(compare_geodesics(Skill.load(arguments.skill), arguments.pairs), draw_geodesics)


def avoidance(arguments: argparse.Namespace) -> Measured:
    """Spheres on the paths of skills of every recording, fold and seed."""
    from geodesic_motion_ros.studies.experiments.avoidance import AvoidanceSettings, draw_avoidance, measure_avoidance

    settings = AvoidanceSettings(arguments.radii, arguments.tool_radius, arguments.scenes)
    return Measured.of(measure_avoidance(_skills(arguments, arguments.sheet), settings), draw_avoidance)


def crossing(arguments: argparse.Namespace) -> Measured:
    """The clusters of skills of every recording, fold and seed."""
    from geodesic_motion_ros.studies.experiments.crossing import crossing_report, draw_crossings

    # Clusters of q and -q are the paper's, on the raw sheet.
    return Measured.of(crossing_report(_skills(arguments, "raw")), draw_crossings)


def whole_arm(arguments: argparse.Namespace) -> Measured:
    """The requested parts, on one skill."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.studies.experiments.whole_arm import WholeArmSettings, draw_whole_arm, measure_whole_arm

    settings = WholeArmSettings(
        arguments.parts, arguments.scenes, arguments.moving_scenes, arguments.seed, arguments.processes
    )
    report = measure_whole_arm(Skill.load(arguments.skill), settings)
    return Measured.of(report, lambda report, path: draw_whole_arm(report, path.parent))


def detours(arguments: argparse.Namespace) -> Measured:
    """One motion of one skill, played with each largest detour."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.studies.experiments.detours import draw_detours, measure_detours

    report = measure_detours(
        Skill.load(arguments.skill), arguments.detours, arguments.radius, arguments.place, arguments.appears
    )
    return Measured.of(report, draw_detours)


def largest_sphere(arguments: argparse.Namespace) -> Measured:
    """Spheres on the path of one skill."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.studies.experiments.largest_sphere import draw_largest, measure_largest

    found = measure_largest(Skill.load(arguments.skill), arguments.places, arguments.detours)
    return Measured.of(found, draw_largest)


def limbs(arguments: argparse.Namespace) -> Measured:
    """The tool's skill, trained for it, beside one of joint space."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.studies.experiments.limbs import LimbsSettings, draw_limbs, measure_limbs

    settings = LimbsSettings((arguments.side, arguments.side), arguments.solutions)
    return Measured.of(measure_limbs(Skill.load(arguments.skill), settings, arguments.out / "skills"), draw_limbs)


def obstacle_laws(arguments: argparse.Namespace) -> Measured:
    """The laws on one skill."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.studies.experiments.obstacle_law_figures import draw_laws
    from geodesic_motion_ros.studies.experiments.obstacle_laws import compare_laws

    return Measured.of(compare_laws(Skill.load(arguments.skill), arguments.scenes, arguments.seed), draw_laws)


def volume(arguments: argparse.Namespace) -> Measured:
    """A skill for each weight of the volume term, of recorded or simulated joints."""
    from tqdm import tqdm

    from geodesic_motion_ros.demonstrations.readers import read_joint_demonstrations
    from geodesic_motion_ros.learning.settings import JointTrainingSettings
    from geodesic_motion_ros.simulation.joint_teacher import reach_to_grasp
    from geodesic_motion_ros.studies.experiments.imitation import stage_shown_on
    from geodesic_motion_ros.studies.experiments.volume import compare_volume, draw_volume

    if arguments.demos is None:
        demonstrations = reach_to_grasp(4, seed=0, families=2)
    else:
        demonstrations = read_joint_demonstrations(arguments.demos, arguments.robot)
    settings = JointTrainingSettings.paper()
    if arguments.steps is not None:
        settings = replace(settings, steps=arguments.steps)
    with tqdm(desc="volume") as bar:
        report = compare_volume(
            demonstrations, arguments.weights, arguments.out / "skills", settings, stage_shown_on(bar)
        )
    return Measured.of(report, draw_volume)


def rate(arguments: argparse.Namespace) -> Measured:
    """The nodes with one skill; has no picture."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.studies.rates import node_rate, reaction_time

    folder, rates = arguments.out / arguments.experiment, arguments.rates
    rows = node_rate.measure_rates(
        arguments.skill, folder, rates, arguments.seconds, arguments.goals_hz, arguments.obstacles
    )
    table, figures = node_rate.table(rows), {"rows": [asdict(row) for row in rows]}
    if arguments.spheres > 0 and Skill.load(arguments.skill).space == "joint":
        reactions = reaction_time.measure_reaction(arguments.skill, folder, rates, arguments.spheres)
        table += "\n\n" + reaction_time.table(reactions)
        figures["reactions"] = [asdict(row) for row in reactions]
    return Measured(table, figures, None)


def literal(arguments: argparse.Namespace) -> Measured:
    """The paper's models and planner beside ours on every recording, of poses and of joints."""
    from geodesic_motion_ros.demonstrations.readers import holds_joints
    from geodesic_motion_ros.studies.experiments.folds import default_folds, parse_folds
    from geodesic_motion_ros.studies.experiments.literal import compare_literal, draw_literal

    recordings = {}
    for path in arguments.demos:
        space = arguments.space or ("joint" if holds_joints(path) else "task")
        recordings[path.stem] = (read_joint_recording if space == "joint" else read_recording)(arguments, path)
    folds = {
        name: parse_folds(arguments.folds, len(each)) if arguments.folds else default_folds(len(each))
        for name, each in recordings.items()
    }
    report = compare_literal(recordings, folds, arguments.out / "skills", arguments.seed, arguments.steps)
    return Measured.of(report, draw_literal)


def reshaped_tubes(arguments: argparse.Namespace) -> Measured:
    """One skill of the whole arm, with a latent space of three dimensions."""
    from geodesic_motion_ros.skill.skill import Skill
    from geodesic_motion_ros.studies.experiments.reshaped_tubes import draw_reshaped, measure_reshaped

    return Measured.of(measure_reshaped(Skill.load("paper_reach")), draw_reshaped)


def paper_rate(arguments: argparse.Namespace) -> Measured:
    """The nodes with the paper's planner; has no picture."""
    from geodesic_motion_ros.studies.rates import node_rate

    rows = node_rate.measure_paper(arguments.out / arguments.experiment, arguments.rate, arguments.seconds)
    return Measured(node_rate.table(rows), {"rows": [asdict(row) for row in rows]}, None)


def _module(arguments: argparse.Namespace) -> tuple[ModuleType, str]:
    """The file of an experiment, and its name as in Python."""
    name = arguments.experiment.replace("-", "_")
    return import_module(f"geodesic_motion_ros.studies.experiments.{name}"), name


def _settings(arguments: argparse.Namespace) -> Any:
    """The settings of an experiment: those that there are arguments for, the others by default."""
    module, name = _module(arguments)
    settings = getattr(module, f"{name.title().replace('_', '')}Settings")
    values = {each.name: getattr(arguments, each.name) for each in fields(settings) if hasattr(arguments, each.name)}
    return settings(**values)


def _counted_on(bar: tqdm) -> Callable[[str], None]:
    """Tell on a bar what begins."""

    def show(begins: str) -> None:
        bar.set_postfix_str(begins)
        bar.update()

    return show


def _save(path: Path, demonstrations: Demonstrations, contents: str) -> None:
    """Write demonstrations with equally many samples each, as the file wants them."""
    save_demonstrations(evenly_sampled(demonstrations), path)
    print(f"wrote {len(demonstrations)} demonstrations to {path}: {contents}; read them with --units m")


def _training(arguments: argparse.Namespace, sheet: Literal["canonical", "raw"]) -> TrainingSettings:
    """The defaults, but for --steps."""
    from geodesic_motion_ros.learning.settings import TrainingSettings

    settings = TrainingSettings(sheet=sheet)
    return settings if arguments.steps is None else replace(settings, steps=arguments.steps)


def _skills(arguments: argparse.Namespace, sheet: Literal["canonical", "raw"]) -> Iterator[Trained]:
    """The skills of every recording, fold and seed."""
    from geodesic_motion_ros.studies.experiments.folds import default_folds, parse_folds
    from geodesic_motion_ros.studies.experiments.trained import trained_on_folds

    settings = _training(arguments, sheet)
    recordings = {path.stem: read_recording(arguments, path) for path in arguments.demos}
    if len(recordings) < len(arguments.demos):
        raise ParameterError("two recordings have the same file name; the table calls tasks by it: rename one")
    for task, demonstrations in recordings.items():
        count = len(demonstrations)
        folds = parse_folds(arguments.folds, count) if arguments.folds else default_folds(count)
        kept = arguments.out / "skills"
        yield from trained_on_folds(task, demonstrations, folds, arguments.seeds, kept, settings)
