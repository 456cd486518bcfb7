"""Scenes: a start, a goal and spheres on the demonstrations moved between them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.geometry.curves import Pose, PoseCurve
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.demonstrated_motions import DemonstratedMotions
from geodesic_motion_studies.comparison.families import (
    FAMILIES,
    SPARED,
    Family,
    NoPlaceError,
    check_families,
    declared_in,
    draw_family,
)
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

#: So many starts and goals are drawn for a scene.
_ENDS = 20


@dataclass(frozen=True, eq=False)
class Scene:
    """One scene, the same for every method.

    Attributes
    ----------
    start, goal : (eta,) [rad]. goal_pose : of the tool there.
    spheres : of the scene. tool_chased : whether chasing ones move towards the tool, or the elbow.
    demonstrations : those shown, moved to start and goal and played.
    free : (N,) bool, which of them stay free (`demonstrated_motions.py`).
    compared : motions of the tool, the closest of which a method's is compared with: those of the demonstrations, or
        that of the one held out.
    declared : what always stands around the arm, known to every method that plans and to the judge.
    """

    family: Family
    number: int
    seed: int
    start: np.ndarray
    goal: np.ndarray
    goal_pose: Pose
    spheres: tuple[MovingSphere, ...]
    tool_chased: bool
    demonstrations: tuple[JointReference, ...]
    free: np.ndarray
    compared: tuple[PoseCurve, ...]
    declared: DeclaredScene = field(default_factory=DeclaredScene.empty)

    @property
    def mostly_free(self) -> bool:
        """Whether at least half of the demonstrations stay free."""
        return float(np.mean(self.free)) >= SPARED


def draw_scene(arena: Arena, family: Family, number: int, seed: int) -> Scene:
    """Scene number `number` of a family: the start of one demonstration, the goal of another one, and spheres.

    Demonstrations are spared in scenes of even number. A scene depends on nothing else but its family, its number and
    the seed. Where there is no place for the spheres another start and another goal are drawn. ParameterError where
    there is no such family in the arena, NoPlaceError where there is no place between any of them.
    """
    random = scene_generator(arena, family, number, seed)
    for drawn in range(1, _ENDS + 1):
        first, last = random.integers(len(arena.shown), size=2)
        try:
            return draw_between(arena, arena.shown[first, 0], arena.shown[last, -1], family, number, seed, random)
        except NoPlaceError:
            if drawn == _ENDS:
                raise
    raise AssertionError


def scene_generator(arena: Arena, family: Family, number: int, seed: int) -> np.random.Generator:
    """What all that is random in a scene comes from; ParameterError where there is no such family in the arena."""
    check_families(arena.skill.name, arena.guard, (family,))
    return np.random.default_rng([seed, FAMILIES.index(family), number])


def draw_between(
    arena: Arena,
    start: np.ndarray,
    goal: np.ndarray,
    family: Family,
    number: int,
    seed: int,
    random: np.random.Generator,
) -> Scene:
    """A scene between a start and a goal (eta,) [rad]; NoPlaceError where there is no place for the spheres, or where
    start or goal is not clear of the declared scene.
    """
    tool_chased = bool(random.uniform() < 0.5) or arena.guard == "tool"
    played = moved_demonstrations(arena, start, goal)
    declared = declared_in(family)
    demonstrated = DemonstratedMotions(arena, played, tool_chased, declared)
    spheres, free = draw_family(family, demonstrated, random, number % 2 == 0, not arena.whole_arm)
    compared = tuple(arena.tool_curve(item.positions) for item in played)
    return Scene(
        family, number, seed, start, goal, arena.robot.forward(goal), spheres, tool_chased, played, free, compared,
        declared,
    )  # fmt: skip


def moved_demonstrations(arena: Arena, start: np.ndarray, goal: np.ndarray) -> tuple[JointReference, ...]:
    """The demonstrations moved to a start and a goal (eta,) [rad] and played; ParameterError where that fails."""
    return tuple(arena.timed(path) for path in arena.moved(start, goal))
