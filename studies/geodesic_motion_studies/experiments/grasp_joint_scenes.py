"""Scenes of `grasp_joint`: spheres drawn on the arm's motion, what they leave of what was shown, and the answers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill.sheet import JointSheet
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.arm_players import Families, Played, Player
from geodesic_motion_studies.experiments.arm_queries import body_spheres, distances
from geodesic_motion_studies.experiments.blocked_arm import arm_clearance
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

#: Radius of the spheres [m].
RADIUS = 0.04
#: Parts of a path, as shares of the body's arc: begin and end, and the first opening.
BEGIN, END, FIRST = (0.0, 0.3), (0.6, 1.0), (0.15, 0.35)
#: Every so many samples of paths are tried for a place.
_EVERY = 6
#: A path that is in a family for less than this share of it only brushes against it, where families meet.
PASSED = 0.15


@dataclass(frozen=True, eq=False)
class Scene:
    """From where some families begin to where others end, among spheres.

    Attributes
    ----------
    start, goals : families whose mean start it is, and whose mean ends, each of which would do.
    centres, radii : (o, 3), (o,) of the spheres [m].
    left : demonstrated motions from this start that no sphere touches: the family, or those of the two halves.
    covered : whether a sphere touches the arm at the start, or at the end of that family (of those families); then
        nothing else is evaluated.
    """

    start: tuple[int, ...]
    goals: tuple[tuple[int, ...], ...]
    centres: np.ndarray
    radii: np.ndarray
    left: tuple[tuple[int, ...], ...]
    covered: bool = False

    @property
    def hybrids_alone(self) -> bool:
        """Whether all that is left changes from one family to another on the path."""
        return bool(self.left) and all(len(families) > 1 for families in self.left)


@dataclass(frozen=True, eq=False)
class SceneAnswer:
    """What a planner makes of a scene.

    Attributes
    ----------
    reason : why it refused, else empty. passed : the families that it passes, one after the other.
    clearance : least distance of the arm's meshes from the spheres [m], NaN refused.
    """

    scene: Scene
    reason: str
    passed: tuple[int, ...] = ()
    clearance: float = math.nan
    played: Played | None = field(default=None, repr=False)

    @property
    def kind(self) -> str:
        """refused (or not planned), clear or hits."""
        if self.played is None:
            return "refused"
        return "clear" if self.clearance > 0.0 else "hits"

    def as_dict(self) -> dict[str, Any]:
        """What `--json` writes."""
        played, scene = self.played, self.scene
        return {
            **vars(scene), "answer": self.kind, "reason": self.reason, "passed": self.passed,
            "clearance": self.clearance,
            "promised": math.nan if played is None else played.promised,
            "duration": math.nan if played is None else played.duration,
        }  # fmt: skip


def mean_paths(skill: Skill) -> np.ndarray:
    """Mean canonical motions (F, S, eta) [rad] of a skill's families.

    Raises
    ------
    ParameterError : the skill is not of joint space, or on the raw sheet, which knows no families.
    """
    sheet = skill.canonical
    if not isinstance(sheet, JointSheet):
        raise ParameterError(f"'{skill.name}' is not a joint-space skill on a canonical sheet: it knows no families")
    return np.array([
        sheet.configurations[sheet.modes == mode].mean(axis=0) for mode in range(int(sheet.modes.max()) + 1)
    ])  # fmt: skip


def sphere_on(planner: ReactivePlanner, blocked: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Centre (3,) [m] of a sphere in the arm somewhere on a motion (n, eta), as far as may be from it on another."""
    places = body_spheres(planner, blocked[::_EVERY]).reshape(-1, 3)
    bodies = body_spheres(planner, free[::_EVERY])
    return max(places, key=lambda place: float(distances(planner, bodies, place, RADIUS).min()))


class Stage:
    """Draws scenes of some families, and judges what planners make of them.

    Attributes
    ----------
    families : that were shown. connected : whether they begin and end alike, and meet in the middle.
    seed : of the spheres. again : scenes that were drawn again so far.
    """

    def __init__(self, families: Families, connected: bool, seed: int = 0) -> None:
        self.families, self.connected, self.seed = families, connected, seed
        self.again = 0
        self._geometry = CollisionGeometry("panda")
        self._trees = [cKDTree(path) for path in families.mean_paths]

    def ends(self) -> list[tuple[tuple[int, ...], tuple[tuple[int, ...], ...]]]:
        """Starts and goals that are requested, as of `Scene`."""
        each = range(len(self.families.mean_paths))
        if self.connected:
            return [(tuple(each), (tuple(each),))]
        return [((family,), tuple((other,) for other in each)) for family in each]

    def drawn(self, places: int, spheres: int) -> list[Scene]:
        """So many scenes from each start, of so many spheres each: somewhere in the arm, anywhere on its mean motion.

        The sphere is in a family's motion that is drawn; of two, one is in the first half of a family's motion, the
        other in the second half of another's, so that hybrids may be left. Where all starts are covered spheres are
        drawn again, which is counted in `again`.
        """
        random = np.random.default_rng([self.seed, spheres])
        scenes: list[Scene] = []
        while len(scenes) < places * len(self.ends()):
            on = random.permutation(len(self.families.mean_paths))[:spheres]
            parts = np.linspace(0.0, 1.0, spheres + 1)
            parts_of_motions = [part_of(self.families.mean_paths[k], *parts[i : i + 2]) for i, k in enumerate(on)]
            centres = np.array([self._place(part, random) for part in parts_of_motions])
            found = [self.scene(*ends, centres) for ends in self.ends()]
            if all(scene.covered for scene in found):
                self.again += 1
            else:
                scenes += found
        return scenes

    def scene(self, start: tuple[int, ...], goals: tuple[tuple[int, ...], ...], centres: np.ndarray) -> Scene:
        """From a start to goals among spheres at centres (o, 3) [m]."""
        centres = np.reshape(centres, (-1, 3))
        radii = np.full(len(centres), RADIUS)
        ends = np.array([self.families.ends(start, at) for at in (0, -1)])
        if self.clearance(ends, centres) <= 0.0:
            return Scene(start, goals, centres, radii, (), covered=True)
        left = [known for known in self._shown_from(start) if self.clearance(self._motion(known), centres) > 0.0]
        return Scene(start, goals, centres, radii, tuple(left))

    def answer(self, player: Player, scene: Scene) -> SceneAnswer:
        """Ask a planner, and judge."""
        played = player.play(scene.start, scene.goals, scene.centres, scene.radii)
        if isinstance(played, str):
            return SceneAnswer(scene, played)
        nearest = np.argmin([tree.query(played.configurations)[0] for tree in self._trees], axis=0)
        clearance = self.clearance(played.configurations, scene.centres)
        return SceneAnswer(scene, "", passed_in_turn(nearest), clearance, played)

    def clearance(self, configurations: np.ndarray, centres: np.ndarray) -> float:
        """Least distance [m] of the arm's meshes in configurations (n, eta) from spheres at centres (o, 3) [m]."""
        return arm_clearance(self._geometry, configurations, centres, np.full(len(centres), RADIUS))

    def _shown_from(self, start: tuple[int, ...]) -> list[tuple[int, ...]]:
        """What demonstrations know from a start: a family, or the first half of one and the second of another."""
        if not self.connected:
            return [(family,) for family in start]
        return [(first,) if first == second else (first, second) for first, second in product(start, repeat=2)]

    def _motion(self, known: tuple[int, ...]) -> np.ndarray:
        first, second = self.families.mean_paths[known[0]], self.families.mean_paths[known[-1]]
        return np.concatenate([part_of(first, 0.0, 0.5), part_of(second, 0.5, 1.0)])

    @staticmethod
    def _place(motion: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """The centre (3,) [m] of one of the arm's collision spheres somewhere on a motion (n, eta)."""
        model, robot = CollisionModel.named("panda"), Robot.named("panda")
        bodies = model.positions(robot, motion[random.integers(len(motion))][None])[0, model.moving]
        return bodies[random.integers(len(bodies))]


def part_of(motion: np.ndarray, first: float, last: float) -> np.ndarray:
    """A motion (n, eta) between two shares of it."""
    return motion[round(first * (len(motion) - 1)) : round(last * (len(motion) - 1)) + 1]


def passed_in_turn(families: np.ndarray) -> tuple[int, ...]:
    """Of families (n,) that a path is in, those that it stays in for more than PASSED of it, in turn."""
    bounds = np.flatnonzero(np.diff(families, prepend=-1, append=-1))
    stays = [
        int(families[begin]) for begin, end in pairwise(bounds)
        if end - begin > PASSED * len(families)
    ]  # fmt: skip
    return tuple(family for i, family in enumerate(stays) if i == 0 or family != stays[i - 1])


def blocking_spheres(planner: ReactivePlanner, stage: Stage) -> dict[str, Sequence[np.ndarray]]:
    """Spheres (3,) [m] that are put so that they block none, one, or all of the families.

    Of families that are apart: late in the arm of the first, as far as may be from the others; at the goal of the hand,
    which all share. Of families that meet: on the first opening of one, or of both.
    """
    paths = stage.families.mean_paths
    if stage.connected:
        ends = paths[:, [0, -1]].reshape(-1, paths.shape[-1])
        one = sphere_on(planner, part_of(paths[0], *FIRST), paths[1])
        return {"free": [], "one family blocked": [one],
                "all blocked": [sphere_on(planner, part_of(path, *FIRST), ends) for path in paths]}  # fmt: skip
    # Where the arm starts it is not to stand in the sphere.
    free = np.concatenate([*paths[1:], part_of(paths[0], *BEGIN)])
    one = sphere_on(planner, part_of(paths[0], *END), free)
    hand = planner.robot.forward(paths[0, -1])[0]
    return {"free": [], "one family blocked": [one], "all blocked": [hand]}
