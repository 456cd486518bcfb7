"""RRT-Connect of OMPL in joint space, planned again at each change that blocks the path.

J. Kuffner, S. LaValle, "RRT-Connect: an efficient approach to single-query path planning", ICRA 2000; I. Sucan,
M. Moll, L. Kavraki, "The Open Motion Planning Library", IEEE RAM 19, 2012. Configurations are valid where the collision
spheres keep off the arm itself and off obstacles, where these are and will be within the prediction. Paths are cut
short and smoothed by the library, and timed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.collision_model import self_clearance
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.replanning import LATENCY, MARGIN, PREDICTION, RETRY, Replanning
from geodesic_motion_studies.comparison.scene import Scene

#: Configurations that a search may look at, longest step of the tree [rad], how finely motions are looked at, as a
#: share of the joints' ranges, what is kept from obstacles while searching [m], and configurations on a path.
CHECKS, RANGE, RESOLUTION, KEPT_OFF, POINTS = 3000, 0.25, 0.01, 0.02, 100


class RapidTrees(Replanning):
    """A new path from where the arm will be whenever the one being followed is not free."""

    def __init__(self, arena: Arena, checks: int = CHECKS, step: float = RANGE, kept_off: float = KEPT_OFF) -> None:
        """checks, step, kept_off : see the constants."""
        super().__init__(arena)
        self._checks, self._step, self._kept_off = checks, step, kept_off
        self.settings: dict[str, Any] = {
            "library": "ompl", "planner": "RRTConnect", "checks": checks, "range": step, "resolution": RESOLUTION,
            "kept_off": kept_off, "latency": LATENCY, "prediction": PREDICTION, "retry": RETRY, "margin": MARGIN,
        }  # fmt: skip

    def prepare(self, scene: Scene) -> None:
        """Seed the library's random numbers."""
        from ompl import util

        util.setLogLevel(util.LOG_NONE)
        util.RNG.setSeed(scene.number + 1)

    def paths(self, start: np.ndarray, progress: float, obstacles: Obstacles) -> Iterator[np.ndarray]:
        """One, where one is found."""
        from ompl import base, geometric

        swept, looked_at = obstacles.swept(PREDICTION), 0
        # An arm that stands nearer to an obstacle may leave it, and may go to a goal that is.
        kept_off = min(self._kept_off, 0.5 * max(0.0, self._clearance(start, swept)))
        at_goal = max(0.0, self._clearance(self._goal, swept))
        kept_off = kept_off if at_goal > kept_off else 0.5 * at_goal
        # The library would wait for another goal, for ever.
        if not all(self._valid(end, swept, kept_off) for end in (start, self._goal)):
            return

        def valid(state: Any) -> bool:
            nonlocal looked_at
            looked_at += 1
            return self._valid(np.array([state[i] for i in range(len(start))]), swept, kept_off)

        space = base.RealVectorStateSpace(len(start))
        bounds = base.RealVectorBounds(len(start))
        for joint, (low, high) in enumerate(zip(self._arena.limits.lower, self._arena.limits.upper, strict=True)):
            bounds.setLow(joint, float(low))
            bounds.setHigh(joint, float(high))
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(valid)
        setup.getSpaceInformation().setStateValidityCheckingResolution(RESOLUTION)
        planner = geometric.RRTConnect(setup.getSpaceInformation())
        planner.setRange(self._step)
        setup.setPlanner(planner)
        ends = [space.allocState(), space.allocState()]
        for state, configuration in zip(ends, (start, self._goal), strict=True):
            for joint, value in enumerate(configuration):
                state[joint] = float(value)
        setup.setStartAndGoalStates(*ends)
        out_of_checks = base.PlannerTerminationCondition(lambda: looked_at > self._checks)
        if not setup.solve(out_of_checks) or not setup.haveExactSolutionPath():
            return
        path, simplifier = setup.getSolutionPath(), setup.getPathSimplifier()
        simplifier.reduceVertices(path)
        simplifier.ropeShortcutPath(path)
        simplifier.smoothBSpline(path, 3)
        path.interpolate(POINTS)
        yield np.array([[state[i] for i in range(len(start))] for state in path.getStates()])

    def _clearance(self, configuration: np.ndarray, obstacles: Obstacles) -> float:
        return obstacle_clearance(self._arena.collision, self._arena.robot, configuration, obstacles)[0]

    def _valid(self, configuration: np.ndarray, obstacles: Obstacles, kept_off: float) -> bool:
        if self._clearance(configuration, obstacles) <= kept_off:
            return False
        return self_clearance(self._arena.collision, self._arena.robot, configuration)[0] > 0.0
