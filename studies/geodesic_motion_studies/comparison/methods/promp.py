"""ProMP: probabilistic movement primitives in joint space, conditioned on where the arm is and on the goal.

A. Paraschos et al., "Probabilistic movement primitives", NIPS 2013, as the library movement_primitives has them, one
for each mode of the demonstrations. Tried are the mean motions, and then samples of the distributions: what the
demonstrations vary in is what can be avoided with.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.replanning import LATENCY, MARGIN, PREDICTION, RETRY, Replanning, meeting
from geodesic_motion_studies.comparison.scene import Scene
from geodesic_motion_studies.experiments.baselines import PROMP_NOISE, PROMP_WEIGHTS, require_peers

#: Samples of each primitive that are tried, and configurations on a path.
SAMPLES, POINTS = 10, 60


class Primitives(Replanning):
    """One primitive for each mode; the one whose mean begins nearest to where the arm is comes first."""

    def __init__(self, arena: Arena, samples: int = SAMPLES) -> None:
        """samples : of each primitive that are tried."""
        super().__init__(arena)
        primitive, _ = require_peers()
        phase = np.linspace(0.0, 1.0, arena.shown.shape[1])
        self._samples, self._primitives = samples, []
        for mode in range(int(arena.modes.max()) + 1):
            shown = arena.shown[arena.modes == mode]
            learned = primitive(n_dims=shown.shape[2], n_weights_per_dim=PROMP_WEIGHTS)
            learned.imitate(np.tile(phase, (len(shown), 1)), shown)
            self._primitives.append(learned)
        self.settings: dict[str, Any] = {
            "library": "movement_primitives", "weights": PROMP_WEIGHTS, "noise": PROMP_NOISE, "samples": samples,
            "latency": LATENCY, "prediction": PREDICTION, "retry": RETRY, "margin": MARGIN,
        }  # fmt: skip

    def prepare(self, scene: Scene) -> None:
        """Condition on the goal."""
        self._random = np.random.RandomState(scene.number)
        self._to_goal = [self._conditioned(item, scene.goal, 1.0) for item in self._primitives]

    def paths(self, start: np.ndarray, progress: float, obstacles: Obstacles) -> Iterator[np.ndarray]:
        """The means, then samples; their ends are met exactly, as conditioning leaves what its noise allows."""
        phase = np.linspace(progress, 1.0, POINTS)
        off = [np.linalg.norm(item.mean_trajectory(phase)[0] - start) for item in self._to_goal]
        nearest_first = [self._to_goal[number] for number in np.argsort(off)]
        conditioned = [self._conditioned(item, start, progress) for item in nearest_first]
        for item in conditioned:
            yield meeting(item.mean_trajectory(phase), start, self._goal)
        for item in conditioned:
            for path in item.sample_trajectories(phase, self._samples, self._random):
                yield meeting(path, start, self._goal)

    def _conditioned(self, primitive: Any, configuration: np.ndarray, phase: float) -> Any:
        noise = PROMP_NOISE * np.eye(len(configuration))
        return primitive.condition_position(configuration, y_cov=noise, t=phase, t_max=1.0)
