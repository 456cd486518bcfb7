"""The demonstrations, moved to the start and the goal of a scene and played, as spheres are drawn on them.

A demonstration *stays free* where, moved to the scene's start and goal and played from the beginning within the
arena's limits, none of the arena's collision spheres, those of what is guarded, touches a sphere of the scene
until its end, nor what is declared to stand around the arm. Spheres that chase chase it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numba
import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.chasing import chased_point, sphere_centres
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

#: Between the instants at which the motions are evaluated [s].
_PERIOD = 0.02
#: Links that come so far in the motion move [m].
_MOVES = 0.15
#: Part of a motion on which spheres are drawn.
_INTERIOR = (0.2, 0.8)
#: How far spheres are drawn from the body's place, as a standard deviation [m].
_OFF = 0.03


class DemonstratedMotions:
    """The body in every motion at instants from 0 on.

    Attributes
    ----------
    hand : (B,) bool, which of the body's spheres are of the hand.
    scene_clearance : least distance [m] of the body at the start and at the goal from the declared scene.
    """

    def __init__(
        self,
        arena: Arena,
        references: Sequence[JointReference],
        tool_chased: bool,
        scene: DeclaredScene | None = None,
    ) -> None:
        """scene : what always stands around the arm; None: nothing."""
        self._radii = arena.body_radii
        self._links = np.array(arena.collision.points.names)[arena.collision.moving]
        self.hand = self._links == arena.hand
        self.durations = [reference.duration for reference in references]
        instants = [np.append(np.arange(0.0, duration, _PERIOD), duration) for duration in self.durations]
        postures = [item.samples(times)[0] for item, times in zip(references, instants, strict=True)]
        self._times = instants
        self._bodies = [arena.body(item) for item in postures]
        self._chased = [np.array([chased_point(arena, tool_chased, one) for one in item]) for item in postures]
        scene = scene or DeclaredScene.empty()
        apart = [scene.clearances(body, self._radii) for body in self._bodies]
        self._leaves_scene_free = np.array([np.min(one) > 0.0 for one in apart])
        self.scene_clearance = float(min(apart[0][0], apart[0][-1]))
        comes_far = np.linalg.norm(np.ptp(self._bodies[0], axis=0), axis=-1) > _MOVES
        self._moving = np.unique(self._links[comes_far])

    def place(self, random: np.random.Generator) -> tuple[int, float, np.ndarray]:
        """The index of a motion, a time in it [s], and a place (3,) [m] in or near a link that moves, at that time."""
        index = int(random.integers(len(self._bodies)))
        at = int(random.uniform(*_INTERIOR) * len(self._times[index]))
        of_link = np.flatnonzero(self._links == random.choice(self._moving))
        place = self._bodies[index][at, random.choice(of_link)] + random.normal(scale=_OFF, size=3)
        return index, float(self._times[index][at]), place

    def hand_motion(self, random: np.random.Generator) -> tuple[float, np.ndarray, np.ndarray]:
        """A time in a motion [s], the middle of the hand then (3,) [m], and its horizontal direction (3,) of motion."""
        index = int(random.integers(len(self._bodies)))
        at = int(random.uniform(*_INTERIOR) * len(self._times[index]))
        middle = self._bodies[index][at - 1 : at + 2, self.hand].mean(axis=1)
        along = (middle[2] - middle[0]) * [1.0, 1.0, 0.0]
        return float(self._times[index][at]), middle[1], along / max(float(np.linalg.norm(along)), 1e-9)

    def chased(self, random: np.random.Generator) -> np.ndarray:
        """A place (3,) [m] at which what is chased is at some time."""
        points = self._chased[random.integers(len(self._chased))]
        return points[int(random.uniform(*_INTERIOR) * len(points))]

    def start_clearance(self, centres: np.ndarray, radius: float) -> float:
        """Least distance [m] of the body at the start from a sphere at centres (n, 3)."""
        return self._clearance(self._bodies[0][0], centres, radius)

    def goal_clearance(self, centres: np.ndarray, radius: float) -> float:
        """Least distance [m] of the body at the goal from a sphere at centres (n, 3)."""
        return self._clearance(self._bodies[0][-1], centres, radius)

    def clearances(self, index: int, centre: np.ndarray, radius: float) -> np.ndarray:
        """Least distance (B,) [m] of each of the body's spheres from a sphere that stands, in a motion."""
        return _nearest(self._bodies[index], centre) - self._radii - radius

    def hand_keeps(self, distance: float, spheres: Sequence[MovingSphere]) -> np.ndarray:
        """On which demonstrations the hand keeps a distance [m] from spheres that stand, (N,) bool."""
        return np.array([
            all(np.min(self.clearances(index, item.begin, item.radius)[self.hand]) >= distance for item in spheres)
            for index in range(len(self._bodies))
        ])  # fmt: skip

    def free_of(self, spheres: Sequence[MovingSphere]) -> np.ndarray:
        """Which motions stay free of spheres and of the declared scene, (N,) bool."""
        indices = range(len(self._bodies))
        touched = np.array([any(self._touches(index, sphere) for sphere in spheres) for index in indices])
        return self._leaves_scene_free & ~touched

    def _clearance(self, body: np.ndarray, centres: np.ndarray, radius: float) -> float:
        apart = np.linalg.norm(body - np.asarray(centres)[:, None], axis=-1) - self._radii
        return float(np.min(apart)) - radius

    def _touches(self, index: int, sphere: MovingSphere) -> bool:
        times = self._times[index]
        there = slice(*np.searchsorted(times, [sphere.appears, sphere.vanishes]))
        centres = sphere_centres(sphere, times, self._chased[index])[there]
        return bool(_touched(self._bodies[index][there], centres, self._radii + sphere.radius))


@numba.njit(cache=True, nogil=True)
def _nearest(bodies: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Least distance (B,) [m] of each of the centres (n, B, 3), at any of n instants, from a point (3,)."""
    squared = np.full(bodies.shape[1], np.inf)
    for i in range(bodies.shape[0]):
        for b in range(bodies.shape[1]):
            x, y, z = bodies[i, b, 0] - centre[0], bodies[i, b, 1] - centre[1], bodies[i, b, 2] - centre[2]
            squared[b] = min(squared[b], x * x + y * y + z * z)
    return np.sqrt(squared)


@numba.njit(cache=True, nogil=True)
def _touched(bodies: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> bool:
    """Whether any of the centres (n, B, 3) comes within its radius (B,) [m] of the point (n, 3) at the same instant."""
    for i in range(bodies.shape[0]):
        for b in range(bodies.shape[1]):
            x, y, z = bodies[i, b, 0] - centres[i, 0], bodies[i, b, 1] - centres[i, 1], bodies[i, b, 2] - centres[i, 2]
            if x * x + y * y + z * z <= radii[b] * radii[b]:
                return True
    return False
