"""Demonstrations held out: how near a method comes to what a person did whom it has never seen do so.

A method that replays a recording is no distance from it, which says nothing of what it has learned. Here the
demonstrations are split into `studies.experiments.folds.default_folds`, and for each fold a skill is trained, as the
skill itself was, on those that are not in it: these alone are given to every method. A scene begins and ends where a
demonstration that is held out began and ended, and similarity is measured to this one.

Skills are trained on the demonstrations that a skill keeps, a hundred samples each: no recording is needed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.pose_graph import MetricSettings
from geodesic_motion_ros.skill.sheet import CanonicalSheet
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.families import FAMILIES, Family
from geodesic_motion_studies.comparison.scene import Scene, draw_between, scene_generator
from geodesic_motion_studies.comparison.tool_demonstrations import recorded_curves
from geodesic_motion_studies.experiments.folds import Fold, default_folds
from geodesic_motion_studies.experiments.trained import trained_on_folds

if TYPE_CHECKING:
    from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Scenes of one seed, each of a demonstration that is held out.

    Attributes
    ----------
    whole : with all demonstrations.
    folds, arenas : indices of demonstrations in `whole`, and what is without these.
    """

    whole: Arena
    seed: int
    folds: Sequence[Fold]
    arenas: Sequence[Arena]

    @classmethod
    def of(cls, whole: Arena, seed: int, folder: Path, show_progress: bool = True) -> HeldOut:
        """Of all demonstrations of a skill, with skills out of a folder, or trained and put there.

        Raises
        ------
        ParameterError : the skill does not say how it was trained, or the arm cannot carry the tool along what is left.
        DemonstrationError : there is one demonstration only.
        """
        demonstrations = shown_demonstrations(whole)
        folds, settings = default_folds(len(demonstrations)), training_settings(whole.skill)
        trained = trained_on_folds(
            whole.skill.name, demonstrations, folds, (settings.seed,), folder, settings, show_progress
        )
        return cls(whole, seed, folds, tuple(Arena.of(item.skill, whole.guard) for item in trained))

    def arena(self, family: Family, number: int) -> Arena:
        """What is without the demonstration that a scene is of."""
        index = self.demonstration(family, number)
        return next(arena for fold, arena in zip(self.folds, self.arenas, strict=True) if index in fold)

    def demonstration(self, family: Family, number: int) -> int:
        """That of a scene: each of them once, in an order that is drawn, before one comes again."""
        count = len(self.whole.shown)
        # Numbers in a row share an order, so that it cannot be drawn by the generator of one scene.
        turn, place = divmod(number, count)
        order = np.random.default_rng([self.seed, FAMILIES.index(family), turn, count]).permutation(count)
        return int(order[place])

    def repeats(self, family: Family, number: int) -> bool:
        """Whether a scene is one again that has a smaller number: without spheres nothing else tells two apart than
        their demonstrations.
        """
        return family == "none" and number >= len(self.whole.shown)

    def digest(self, family: Family, number: int) -> str:
        """Of what was learned for a scene, and of what is held out there."""
        return digest(self.arena(family, number).skill, self.whole.shown[self.demonstration(family, number)])

    def draw(self, family: Family, number: int) -> Scene:
        """As `draw_scene`, from the start to the goal of a demonstration that is held out, compared with this one."""
        random = scene_generator(self.whole, family, number, self.seed)
        shown = self.whole.shown[self.demonstration(family, number)]
        arena = self.arena(family, number)
        scene = draw_between(arena, shown[0], shown[-1], family, number, self.seed, random)
        return replace(scene, compared=(self.whole.tool_curve(shown),))


def shown_demonstrations(arena: Arena) -> Demonstrations | JointDemonstrations:
    """What the arena's skill was trained on, as far as it keeps it: equally spaced along arcs, without times."""
    sheet, robot = arena.skill.canonical, arena.robot
    times = np.arange(float(arena.shown.shape[1]))
    if isinstance(sheet, CanonicalSheet):
        return Demonstrations(tuple(
            Demonstration(curve.positions, curve.quaternions, times, f"demonstration {i}")
            for i, curve in enumerate(recorded_curves(sheet))
        ))  # fmt: skip
    items = [JointDemonstration(shown, times, f"demonstration {i}") for i, shown in enumerate(arena.shown)]
    return JointDemonstrations(tuple(items), robot.joint_names, arena.skill.robot)


def training_settings(skill: Skill) -> TrainingSettings | JointTrainingSettings:
    """How a skill was trained; ParameterError where it does not say so."""
    from geodesic_motion_ros.learning.settings import JointTrainingSettings, TrainingSettings

    of_joints = skill.space == "joint"
    kind, metric = (JointTrainingSettings, JointMetricSettings) if of_joints else (TrainingSettings, MetricSettings)
    try:
        settings = skill.provenance["settings"]
        return kind(**(settings | {"metric": metric(**settings["metric"])}))
    except (KeyError, TypeError) as error:
        raise ParameterError(
            f"'{skill.name}' does not say how it was trained, so that it cannot be trained with demonstrations held out"
        ) from error


def digest(skill: Skill, *held_out: np.ndarray) -> str:
    """Of what was learned, and of demonstrations (S, eta) that were not: tells them from others."""
    learned = hashlib.sha256(skill.codes.tobytes())
    for shown in held_out:
        learned.update(np.ascontiguousarray(shown).tobytes())
    for _, array in sorted(skill.decoder.arrays().items()):
        learned.update(np.ascontiguousarray(array).tobytes())
    return learned.hexdigest()[:16]
