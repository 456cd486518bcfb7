"""Our detours from other base paths than the skill's geodesic: what the manifold is worth as the path that they leave.

The detour planner takes any path of configurations as its base (`detours/detour_frame.py`). What is left of it is
played; where that is blocked the arm stops, and a detour beside it is searched from where it rests. Search, band and
margin are those of ours, and so is the metric: the covariance of what the nearest demonstration's mode shows at the
same share of the path. Bases:

- *mean demonstration*: the mean of the demonstrations that took the nearest one's mode;
- *ProMP*: the mean of the primitive that begins nearest, conditioned on start and goal;
- *nearest demonstration*: that one itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Figures
from geodesic_motion_ros.detours.detour_frame import DemonstratedSpread, DetourFrame
from geodesic_motion_ros.motion.detour import Detour, DetourPlanner
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.trajectory.trajectory import interpolated
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.methods.free_demonstration import POINTS
from geodesic_motion_studies.comparison.methods.promp import Primitives
from geodesic_motion_studies.comparison.replanning import MARGIN, RETRY, Replanning, meeting
from geodesic_motion_studies.comparison.scene import Scene

BaseName = Literal["mean demonstration", "ProMP", "nearest demonstration"]
#: The base path (m, eta) [rad] from a scene's start to its goal, at equal shares.
BasePath = Callable[[Scene], np.ndarray]


@dataclass(frozen=True, eq=False)
class Ends:
    """Where a detour begins and ends, (eta,) [rad]. A base path is moved to both: they are not off it (`PathEnds`)."""

    start: np.ndarray
    goal: np.ndarray
    misfits: Figures = field(default_factory=Figures)


class DetouredBase(Replanning):
    """A base path of its own, left by our detour where it is blocked."""

    def __init__(self, arena: Arena, base: BaseName) -> None:
        super().__init__(arena)
        # References are timed without limits of the tool, as by every method that replans.
        settings = PlannerSettings(speed=0.0, angular_speed=0.0, acceleration=0.0)
        graph = arena.skill.graph(settings.grid_shape, settings.neighbours)
        # What a scene declares is among the obstacles.
        solver = Solver(arena.skill, graph, settings, arena.robot, arena.collision, arena.limits)
        self._spread = DemonstratedSpread.of(arena.skill, arena.robot)
        self._detours = DetourPlanner(solver, self._spread)
        self._base_of, self._reach = _BASES[base](arena), settings.detour
        self.settings: dict[str, Any] = {
            "base": base, "retry": RETRY, "margin": MARGIN, "points": POINTS, **asdict(settings)
        }  # fmt: skip

    def prepare(self, scene: Scene) -> None:
        """Move the base path to start and goal."""
        self._base = self._base_of(scene)
        self._mode = self._arena.modes[self._arena.nearest(scene.start, scene.goal)]

    def paths(self, start: np.ndarray, progress: float, obstacles: Obstacles) -> Iterator[np.ndarray]:
        """What is left of the base path; then, for an arm at rest, the detour beside that."""
        shares = np.linspace(progress, 1.0, POINTS)
        left = meeting(interpolated(shares, np.linspace(0.0, 1.0, len(self._base)), self._base), start, self._goal)
        yield left
        if not self.rests(obstacles.time):
            return
        covariances = self._spread.at(shares, self._mode)
        frame = DetourFrame.of_base_path(self._arena.robot, left, shares[:, None], covariances)
        found = self._detours.find_beside(frame, Ends(start, self._goal), obstacles, self._reach)
        if isinstance(found, Detour):
            yield meeting(found.configurations, start, self._goal)


def _mean_demonstration(arena: Arena) -> BasePath:
    def base(scene: Scene) -> np.ndarray:
        mode = arena.modes[arena.nearest(scene.start, scene.goal)]
        return np.mean([_demonstration(scene, number) for number in np.flatnonzero(arena.modes == mode)], axis=0)

    return base


def _nearest_demonstration(arena: Arena) -> BasePath:
    return lambda scene: _demonstration(scene, arena.nearest(scene.start, scene.goal))


def _conditioned_promp(arena: Arena) -> BasePath:
    primitives = Primitives(arena)

    def base(scene: Scene) -> np.ndarray:
        primitives.reset(scene)
        return next(primitives.paths(scene.start, 0.0, Obstacles.none()))

    return base


def _demonstration(scene: Scene, number: int) -> np.ndarray:
    """A demonstration (POINTS, eta) [rad] that was moved to start and goal, at equal shares."""
    moved = scene.demonstrations[number]
    return interpolated(np.linspace(0.0, 1.0, POINTS), np.ascontiguousarray(moved.latent[:, 0]), moved.positions)


_BASES: dict[BaseName, Callable[[Arena], BasePath]] = {
    "mean demonstration": _mean_demonstration,
    "ProMP": _conditioned_promp,
    "nearest demonstration": _nearest_demonstration,
}
