"""Standing spheres on the arm's path: does the joint-space planner find another, and does it say when there is none?

Every scene has a start and a goal as they were demonstrated, and the planner's path between them without obstacles, the
*nominal* one. Spheres of 3 to 6 cm are drawn around places of the arm on its path; start and goal stay free of them by
`FREE_END`. Three kinds:

- *one path*: one sphere that the nominal path hits, while the mean path of another family stays `FREE_PATH` from it;
- *all paths*: one sphere on the mean path of each family, in every other scene one that is on all of them;
- *elbow*: one sphere that the nominal path hits, while the hand keeps `FREE_HAND` from it.

What hits is judged by PyBullet on the arm's meshes: of references every 5 ms, of mean paths at their samples. The
control of the third kind is the same planner with the collision spheres of the hand alone, and without the soft metric,
which would see the rest of the arm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.body_points import BodyPoints
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.arm_queries import ArmQuery, body_spheres, distances, draw_query
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

Kind = Literal["one path", "all paths", "elbow"]
KINDS: tuple[Kind, ...] = ("one path", "all paths", "elbow")
#: Radii of spheres [m], and how far their centres are from a place in the arm [m], as a standard deviation.
RADII, OFF = (0.03, 0.06), 0.03
#: Kept from the spheres by start and goal, by another family's mean path, and by the hand [m].
FREE_END, FREE_PATH, FREE_HAND = 0.015, 0.02, 0.1
#: Part of a path on which spheres are drawn.
INTERIOR = (0.2, 0.8)
#: Time between the postures at which a reference is judged [s].
CHECK_PERIOD = 0.005
#: The link that carries hand and fingers.
HAND = "panda_hand"
#: Places that are tried before another start and goal are drawn, and how often that is done.
_PLACES, _QUERIES = 300, 30
#: Every so many postures of a path are judged while a place is looked for.
_COARSE = 4


@dataclass(frozen=True)
class Answer:
    """What the planner made of a scene.

    Attributes
    ----------
    reason : of the verdict. answered : whether there was a reference.
    clearance, certified : least distance of the arm from the spheres [m], as measured and as promised; NaN unanswered.
    switched : whether the path follows another family than the nominal one.
    """

    reason: str
    answered: bool
    clearance: float = math.nan
    certified: float = math.nan
    switched: bool = False

    @property
    def hits(self) -> bool:
        """Whether the arm was sent into a sphere."""
        return self.answered and not self.clearance > 0.0


@dataclass(frozen=True, eq=False)
class BlockedScene:
    """A query, spheres (o, 3), (o,) [m] on its path, the nominal reference, and the planner's answers.

    `answer` is the planner's, with the reference where there was one; `hand_only` that of the control.
    """

    kind: Kind
    number: int
    query: ArmQuery
    centres: np.ndarray
    radii: np.ndarray
    nominal: JointReference
    answer: Answer
    reference: JointReference | None
    hand_only: Answer | None


class BlockedPaths:
    """Draws scenes on the paths of a skill, and has them planned and judged."""

    def __init__(self, skill: Skill, settings: PlannerSettings) -> None:
        self._planner = ReactivePlanner(skill, settings)
        hand = hand_alone(self._planner.collision)
        self._hand_only = ReactivePlanner(skill, replace(settings, ambient_strength=0.0), collision=hand)
        self._geometry = CollisionGeometry("panda")

    def scene(self, kind: Kind, number: int, seed: int) -> BlockedScene:
        """Scene number `number` of a kind; it depends on nothing else but the seed.

        Raises
        ------
        ParameterError : no such scene was found, as where the skill has one family; or the skill is on the raw sheet.
        """
        random = np.random.default_rng([seed, KINDS.index(kind), number])
        for _ in range(_QUERIES):
            query, nominal = draw_query(self._planner, random)
            spheres = self._spheres(kind, number, query, nominal, random)
            if spheres is not None:
                answer, reference = self._answered(self._planner, query, nominal, *spheres)
                control = self._answered(self._hand_only, query, nominal, *spheres)[0] if kind == "elbow" else None
                return BlockedScene(kind, number, query, *spheres, nominal, answer, reference, control)
        raise ParameterError(
            f"no scene of the kind '{kind}' was found on {_QUERIES} paths: "
            f"the skill has {len(query.mean_paths)} families"
        )

    def clearance(self, configurations: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> float:
        """Least distance [m] of the arm in configurations (n, eta) from spheres (o, 3), (o,), by PyBullet."""
        return arm_clearance(self._geometry, configurations, centres, radii)

    def _answered(
        self,
        planner: ReactivePlanner,
        query: ArmQuery,
        nominal: JointReference,
        centres: np.ndarray,
        radii: np.ndarray,
    ) -> tuple[Answer, JointReference | None]:
        planner.set_obstacles(centres, radii)
        plan = query.plan(planner)
        if plan.reference is None:
            return Answer(plan.verdict.reason, False), None
        path = every(CHECK_PERIOD, plan.reference)
        switched = query.family(path) != query.family(every(CHECK_PERIOD, nominal))
        clearance = self.clearance(path, centres, radii)
        return Answer("", True, clearance, plan.verdict.figures.clearance, switched), plan.reference

    # -------------------------------------------------------------- drawing

    def _spheres(
        self, kind: Kind, number: int, query: ArmQuery, nominal: JointReference, random: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Centres (o, 3) and radii (o,) of a scene [m]; None where none was found."""
        path = every(_COARSE * CHECK_PERIOD, nominal)
        if kind == "all paths":
            each = [[mean] for mean in query.mean_paths] if number % 2 == 0 else [query.mean_paths]
            found = [self._sphere_on(paths, query, random) for paths in each]
            if any(sphere is None for sphere in found):
                return None
            return np.array([sphere[0] for sphere in found]), np.array([sphere[1] for sphere in found])
        others = np.delete(query.mean_paths, query.family(path), axis=0)
        for _ in range(_PLACES):
            sphere = self._sphere_on([path], query, random)
            if sphere is None:
                return None
            centre, radius = sphere[0][None], np.array([sphere[1]])
            if kind == "elbow":
                fits = self._hand_clearance(path, *sphere) >= FREE_HAND
            else:
                fits = any(self.clearance(other, centre, radius) >= FREE_PATH for other in others)
            if fits:
                return centre, radius
        return None

    def _sphere_on(
        self, paths: Sequence[np.ndarray], query: ArmQuery, random: np.random.Generator
    ) -> tuple[np.ndarray, float] | None:
        """A sphere that all of some paths hit and that leaves start and goal free; None where none was found."""
        ends = body_spheres(self._planner, np.stack([query.start, query.goal]))
        places = body_spheres(self._planner, paths[0])
        for _ in range(_PLACES):
            radius = random.uniform(*RADII)
            along = int(random.uniform(*INTERIOR) * len(places))
            centre = places[along, random.integers(places.shape[1])] + random.normal(scale=OFF, size=3)
            # The arm's spheres hold its meshes: what they tell to be free is.
            if distances(self._planner, ends, centre, radius).min() < FREE_END:
                continue
            sphere = centre[None], np.array([radius])
            if all(self.clearance(path[::2], *sphere) < 0.0 for path in paths):
                return centre, radius
        return None

    def _hand_clearance(self, path: np.ndarray, centre: np.ndarray, radius: float) -> float:
        """No more than the distance [m] of the hand from a sphere on a path (n, eta)."""
        bodies = body_spheres(self._hand_only, path)
        return float(np.min(distances(self._hand_only, bodies, centre, radius)))


def arm_clearance(
    geometry: CollisionGeometry, configurations: np.ndarray, centres: np.ndarray, radii: np.ndarray
) -> float:
    """Least distance [m] of an arm's meshes in configurations (n, eta) from spheres (o, 3), (o,); inf without any."""
    least = math.inf
    for configuration in configurations:
        geometry.place(configuration)
        for centre, radius in zip(centres, radii, strict=True):
            least = min(least, geometry.clearance(centre, float(radius)))
    return least


def hand_alone(model: CollisionModel) -> CollisionModel:
    """The spheres of the hand and its fingers, for planning with the end-effector alone."""
    kept = np.array([name == HAND for name in model.points.names])
    points = BodyPoints((HAND,) * int(kept.sum()), model.points.frames[kept], model.points.offsets[kept])
    return CollisionModel(points, model.radii[kept], model.moving[kept], np.empty((0, 2), dtype=np.int64))


def every(period: float, reference: JointReference) -> np.ndarray:
    """Configurations (n, eta) [rad] of a reference at times `period` [s] apart, its end among them."""
    times = np.append(np.arange(0.0, reference.duration, period), reference.duration)
    return reference.samples(times)[0]
