"""Obstacles that move a little from tick to tick, around places on or beside the obstacle-free path.

none_near       ten spheres that the path does not feel
one_r005        one sphere of 5 cm in the middle of the path
one_r010        one of 10 cm
goal_enclosed   spheres of 5 cm all around the tool at the goal, 22 cm from it
start_enclosed  the same at the start
ten_on_path     ten spheres of 5 cm along the path
wall_gap        a wall of spheres of 3 cm across the path, with a gap where the arm would go around a sphere of 10 cm
cloud_10k       10,000 points of a table top beneath the tool, as a distance field; making that is not part of a tick,
                for the node does it in a thread of its own

The path is that of the body point which moves farthest. No sphere touches the arm at the start or at the goal: those
that would are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.manifold.ambient_metric import CUTOFF
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_studies.benchmarks.engine import SearchProblem, free_path, mark, search

NAMES = (
    "none_near", "one_r005", "one_r010", "goal_enclosed", "start_enclosed", "ten_on_path", "wall_gap", "cloud_10k",
)  # fmt: skip
RATE = 100.0
"""Ticks a second."""
PERIOD = 600
"""Ticks until a motion repeats itself."""
#: How far spheres swing to each side [m], alone, and together with others.
_SWING, _SWING_TOGETHER = 0.03, 0.01
#: How many spheres of 5 cm enclose an end, and how far from it they are [m]: too dense for anything to pass.
_SHELL, _SHELL_DISTANCE = 80, 0.22
#: What obstacles that are placed leave between them and the arm at both ends, before they swing [m].
_ROOM = 0.035
#: Spacing and radius of the wall's spheres [m].
_WALL_STEP, _WALL_RADIUS = 0.1, 0.03
#: Edge of the cloud's cubes, radius around its points, their thickness, and how far from a point it keeps all off [m].
_EDGE, _POINT_RADIUS, _THICKNESS, _CLOUD_ROOM = 0.02, 0.02, 0.05, 0.055


@dataclass(frozen=True)
class Scene:
    """Spheres that swing about their places: c + swing sin(2 pi (tick / period + phase)), or points of a cloud.

    Attributes
    ----------
    centres, radii : (o, 3), (o,) [m]; swings : (o, 3) [m]; phases : (o,) [turns].
    cloud : whether the spheres are points of a cloud, which all swing as the first one.
    """

    name: str
    centres: np.ndarray
    radii: np.ndarray
    swings: np.ndarray
    phases: np.ndarray
    cloud: bool = False

    def at(self, tick: int) -> Obstacles:
        """Where the spheres are at a tick, and how fast they move; a cloud has no velocity."""
        angle = 2.0 * np.pi * (tick / PERIOD + self.phases)[:, None]
        if self.cloud:
            field = DistanceField.of(self.centres + np.sin(angle) * self.swings, _EDGE, _POINT_RADIUS, _THICKNESS)
            return replace(Obstacles.none(), cloud=field)
        velocities = 2.0 * np.pi * RATE / PERIOD * np.cos(angle) * self.swings
        return Obstacles.of_spheres(self.centres + np.sin(angle) * self.swings, self.radii, velocities, tick / RATE)


def scenes_of(problem: SearchProblem, seed: int = 0) -> list[Scene]:
    """Every scene, in the order of `NAMES`; the same for the same seed."""
    random = np.random.default_rng(seed)
    path = free_path(problem)
    points, tool = _farthest_moving(problem, path), problem.body.points[path, problem.tool]
    ends = np.array([problem.source, problem.target])
    large = _alone("one_r010", _along(problem, points, 1, 0.10), 0.10, random)
    detour = search(problem, mark(problem, large.at(0)), limited=False).nodes

    def clear(places: np.ndarray, radius: float, nodes: np.ndarray = ends) -> np.ndarray:
        return places[_room(problem, places, radius, nodes) > _ROOM]

    return [
        _alone("none_near", _unfelt(problem, path, random), 0.05, random),
        _alone("one_r005", _along(problem, points, 1, 0.05), 0.05, random),
        large,
        _together("goal_enclosed", clear(_shell(tool[-1]), 0.05), 0.05, random),
        _together("start_enclosed", clear(_shell(tool[0]), 0.05), 0.05, random),
        spheres_on_path(problem, 10, seed),
        _together("wall_gap", clear(_wall(points), _WALL_RADIUS, np.append(ends, detour)), _WALL_RADIUS, random),
        replace(_together("cloud_10k", clear(_table_top(tool, random), _CLOUD_ROOM), 0.0, random), cloud=True),
    ]


def spheres_on_path(problem: SearchProblem, count: int, seed: int = 0) -> Scene:
    """Spheres of 5 cm along the path; `ten_on_path` with another count."""
    points = _farthest_moving(problem, free_path(problem))
    return _alone("ten_on_path", _along(problem, points, count, 0.05), 0.05, np.random.default_rng(seed))


def _alone(name: str, places: np.ndarray, radius: float, random: np.random.Generator) -> Scene:
    """Each sphere swings on its own."""
    count = len(places)
    directions = random.normal(size=(count, 3))
    swings = _SWING * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return Scene(name, places, np.full(count, radius), swings, random.uniform(size=count))


def _together(name: str, places: np.ndarray, radius: float, random: np.random.Generator) -> Scene:
    """All spheres swing as one."""
    count, direction = len(places), random.normal(size=3)
    swing = _SWING_TOGETHER * direction / np.linalg.norm(direction)
    return Scene(name, places, np.full(count, radius), np.tile(swing, (count, 1)), np.zeros(count))


def _farthest_moving(problem: SearchProblem, path: np.ndarray) -> np.ndarray:
    """Places (p, 3) [m] on a path of that body point which moves farthest."""
    points = problem.body.points[path]
    lengths = np.sum(np.linalg.norm(np.diff(points, axis=0), axis=2), axis=0)
    return points[:, int(np.argmax(lengths))]


def _at(points: np.ndarray, shares: np.ndarray | list[float]) -> np.ndarray:
    """Places at shares of a path's length, (s, 3)."""
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    return np.stack([np.interp(np.asarray(shares) * length[-1], length, axis) for axis in points.T], axis=1)


def _unfelt(problem: SearchProblem, path: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Ten places around the arm's workspace where a sphere of 5 cm is not felt on a path."""
    body, radius = problem.body, 0.05
    felt = CUTOFF * problem.settings.ambient_width_ratio * (radius + body.point_radii.max()) + _SWING
    places = random.uniform(body.lower - 0.3, body.upper + 0.3, size=(4000, 3))
    points = body.points[path].reshape(-1, 3)
    nearest = np.array([np.min(np.linalg.norm(points - place, axis=1)) for place in places])
    return places[nearest > felt][:10]


def _along(problem: SearchProblem, points: np.ndarray, count: int, radius: float) -> np.ndarray:
    """Evenly spaced places of so many spheres on the part of a path where they leave the arm's ends free.

    On a path so short that there is none, all where it is farthest from them.
    """
    places = _at(points, np.linspace(0.0, 1.0, 500))
    room = _room(problem, places, radius, np.array([problem.source, problem.target]))
    places = places[room > min(_ROOM, np.max(room) - 1e-9)]
    return places[np.linspace(0, len(places) - 1, count + 2).astype(int)[1:-1]]


def _room(problem: SearchProblem, places: np.ndarray, radius: float, nodes: np.ndarray) -> np.ndarray:
    """Distance (p,) [m] of spheres at places (p, 3) from the body at some nodes."""
    body = problem.body
    gaps = np.linalg.norm(places[:, None, None] - body.spheres[nodes], axis=3) - body.sphere_radii - radius
    return np.min(gaps, axis=(1, 2))


def _shell(middle: np.ndarray) -> np.ndarray:
    """Places (s, 3) evenly around a place (3,): a Fibonacci lattice on a sphere."""
    number = np.arange(_SHELL) + 0.5
    height, turn = 1.0 - 2.0 * number / _SHELL, np.pi * (1.0 + np.sqrt(5.0)) * number
    ring = np.sqrt(1.0 - height**2)
    return middle + _SHELL_DISTANCE * np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)


def _wall(points: np.ndarray) -> np.ndarray:
    """Places of eight by eight spheres across the middle of a path, too dense for the tool."""
    middle, before, after = _at(points, [0.5, 0.45, 0.55])
    across = np.linalg.svd((after - before)[None])[2][1:]
    row, column = np.array(np.divmod(np.arange(64), 8)) - 3.5
    return middle + _WALL_STEP * np.stack([row, column], axis=1) @ across


def _table_top(tool: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """10,000 points (o, 3) [m] of a table top of 0.8 m by 0.8 m."""
    corner = np.append(tool[:, :2].mean(axis=0) - [0.2, 0.4], tool[:, 2].min() - 0.075)
    return corner + random.uniform(size=(10_000, 3)) * [0.8, 0.8, 0.01]
