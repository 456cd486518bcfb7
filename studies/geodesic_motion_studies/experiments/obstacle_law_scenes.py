"""Scenes of `obstacle_laws`: a start, a goal, and a sphere on or near the path that the planner takes without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.arm_queries import ArmQuery, body_spheres, distances, draw_query
from geodesic_motion_studies.experiments.blocked_arm import every

#: Radii of spheres [m], and how far their centres are from a place in the arm [m], as a standard deviation.
RADII, OFF = (0.02, 0.06), 0.08
#: What a scene's sphere does, and how near the path without obstacles comes to it, at least and at most [m].
BETWEEN: dict[str, tuple[float, float]] = {"near": (0.0, 0.04), "one path": (-0.04, -0.01), "touched": (-0.04, -0.01)}
#: Kept from the sphere by start and goal, and by the mean path of another family [m].
FREE_END, FREE_PATH = 0.015, 0.02
#: Part of a path on which spheres are drawn.
INTERIOR = (0.2, 0.8)
#: Time between the postures at which a reference is judged [s].
CHECK_PERIOD = 0.01
#: Places that are tried for a sphere, and queries for a scene.
_PLACES, _QUERIES = 300, 30


@dataclass(frozen=True, eq=False)
class LawScene:
    """A start and a goal, the path between them without obstacles, and a sphere: its centre (3,) and radius [m], and
    what it does, a key of `BETWEEN`.
    """

    sphere: str
    query: ArmQuery
    nominal: JointReference
    centre: np.ndarray
    radius: float


def draw_scene(planner: ReactivePlanner, random: np.random.Generator, number: int) -> LawScene:
    """Scene number `number`.

    Raises
    ------
    ParameterError : none was found, as where the skill has one family; or the skill is on the raw sheet.
    """
    sphere = tuple(BETWEEN)[number % len(BETWEEN)]
    for _ in range(_QUERIES):
        query, nominal = draw_query(planner, random)
        path = every(CHECK_PERIOD, nominal)
        others = np.delete(query.mean_paths, query.family(path), axis=0) if sphere == "one path" else []
        found = _place(planner, path, others, np.stack([query.start, query.goal]), BETWEEN[sphere], random)
        if found is not None:
            return LawScene(sphere, query, nominal, *found)
    raise ParameterError(f"no scene of the kind '{sphere}' was found on {_QUERIES} paths of the skill")


def _place(
    planner: ReactivePlanner,
    path: np.ndarray,
    others: Sequence[np.ndarray],
    ends: np.ndarray,
    between: tuple[float, float],
    random: np.random.Generator,
) -> tuple[np.ndarray, float] | None:
    """Centre and radius of a sphere that the arm comes as near to on its path (n, eta) as is requested, that start and
    goal, `ends` (2, eta), leave free, and so does one of some other paths, if there are any; None where none was found.
    """
    bodies, at_ends = body_spheres(planner, path), body_spheres(planner, ends)
    at_others = [body_spheres(planner, other) for other in others]
    for _ in range(_PLACES):
        radius = random.uniform(*RADII)
        along = int(random.uniform(*INTERIOR) * len(bodies))
        centre = bodies[along, random.integers(bodies.shape[1])] + random.normal(scale=OFF, size=3)
        if distances(planner, at_ends, centre, radius).min() < FREE_END:
            continue
        if not between[0] <= distances(planner, bodies, centre, radius).min() <= between[1]:
            continue
        if not at_others or max(distances(planner, other, centre, radius).min() for other in at_others) >= FREE_PATH:
            return centre, radius
    return None
