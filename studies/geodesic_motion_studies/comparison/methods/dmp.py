"""DMP: a dynamic movement primitive of the tool, bent around obstacles by a coupling term, followed by the arm.

A. Ijspeert et al., "Dynamical movement primitives", Neural Computation 25 (2013), with its obstacle term for positions
(H. Hoffmann et al., ICRA 2009); orientations by A. Ude et al., ICRA 2014; both of the library movement_primitives,
which knows obstacles as points. The arm follows by damped least squares and is drawn to the demonstration's posture;
what avoids is the tool alone. It never says that there is no path.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.inverse_kinematics import differential_step
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.method import TICK, Answer
from geodesic_motion_studies.comparison.scene import Scene
from geodesic_motion_studies.experiments.baselines import DMP_WEIGHTS, require_peers

#: Of the coupling term: strength and how it falls with the angle; and how near a sphere's surface must be to count [m].
GAMMA, BETA, REACH = 1000.0, 20.0 / np.pi, 0.15
#: How fast the arm is drawn to the demonstration's posture [1/s].
POSTURE_GAIN = 5.0


class DynamicPrimitive:
    """The demonstration that begins and ends nearest, as a primitive from the scene's start to its goal."""

    def __init__(self, arena: Arena, gamma: float = GAMMA, beta: float = BETA, reach: float = REACH) -> None:
        """gamma, beta, reach : see the constants."""
        self._arena, self._gamma, self._beta, self._reach = arena, gamma, beta, reach
        require_peers()
        self.settings: dict[str, Any] = {
            "library": "movement_primitives", "weights": DMP_WEIGHTS, "gamma": gamma, "beta": beta, "reach": reach,
            "posture_gain": POSTURE_GAIN,
        }  # fmt: skip

    def reset(self, scene: Scene) -> None:
        """Learn the primitive."""
        from movement_primitives.dmp import DMP, CartesianDMP

        self._reference = scene.demonstrations[self._arena.nearest(scene.start, scene.goal)]
        times = np.arange(0.0, self._reference.duration, TICK)
        tool = self._arena.tool_curve(self._reference.samples(times)[0])
        self._position = DMP(3, execution_time=times[-1], dt=TICK, n_weights_per_dim=DMP_WEIGHTS)
        self._position.imitate(times, tool.positions)
        self._turning = CartesianDMP(execution_time=times[-1], dt=TICK, n_weights_per_dim=DMP_WEIGHTS, int_dt=TICK)
        self._turning.imitate(times, np.hstack([tool.positions, tool.quaternions]))
        self._at, self._moving = tool.positions[0].copy(), np.zeros(3)
        self._pose, self._turn = np.hstack([tool.positions[0], tool.quaternions[0]]), np.zeros(6)
        self._joints = scene.start.copy()

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """One step of the primitive, and of the arm after it."""
        coupling = _Obstacles(obstacles, self._gamma, self._beta, self._reach)
        if now > self._position.execution_time_:
            # Nothing was learned for later: what the forcing terms go on with would carry the tool off the goal again.
            for term in (self._position.forcing_term, self._turning.forcing_term_rot):
                term.weights_[:] = 0.0
        before = self._at
        self._at, self._moving = self._position.step(self._at, self._moving, coupling_term=coupling)
        self._pose, self._turn = self._turning.step(self._pose, self._turn)
        feed_forward = np.concatenate([(self._at - before) / TICK, np.zeros(3)])
        limits = self._arena.limits
        velocities = differential_step(
            self._arena.robot, self._joints, self._at, normalise(self._pose[3:]), TICK, feed_forward=feed_forward,
            posture=self._reference.sample(now)[0], posture_gain=POSTURE_GAIN,
        )  # fmt: skip
        velocities = velocities / max(1.0, float(np.max(np.abs(velocities) / limits.velocity)))
        self._joints = np.clip(self._joints + TICK * velocities, limits.lower, limits.upper)
        return Answer.moving(self._joints, velocities, now)


class _Obstacles:
    """The library's coupling terms of all obstacles that are near, as one."""

    def __init__(self, obstacles: Obstacles, gamma: float, beta: float, reach: float) -> None:
        self._obstacles, self._gamma, self._beta, self._reach = obstacles, gamma, beta, reach

    def coupling(self, y: np.ndarray, yd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is added to velocity and acceleration, (3,) each."""
        from movement_primitives.dmp import CouplingTermObstacleAvoidance3D

        total = np.zeros(3)
        if np.linalg.norm(yd) < 1e-6:
            return np.zeros(3), total
        for centre, radius in zip(self._obstacles.centres, self._obstacles.radii, strict=True):
            if np.linalg.norm(centre - y) - radius <= self._reach:
                total += CouplingTermObstacleAvoidance3D(centre, self._gamma, self._beta).coupling(y, yd)[1]
        return np.zeros(3), total
