"""An arm that lags: it plays whatever it is sent a stated time late, and so is behind by that time's motion.

This is a delay of all that the controller is handed: trajectories begin later by the lag, and what replaces them comes
later by it, so that the arm passes exactly where it was sent, after the lag. How far it is behind follows from how fast
it moves, and is measured: `Outcome.lag`. Methods that count how the arm follows (`TracksArm`) are given the measured
joints.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.execution import Outcome, PlayedMethod, Stage
from geodesic_motion_studies.comparison.guard import GuardedArm
from geodesic_motion_studies.comparison.method import TICK, Answer, Method, TracksArm
from geodesic_motion_studies.comparison.scene import Scene

#: A lag is no longer than this [s]: no controller that is of use is so late.
LONGEST_LAG = 1.0


def check_lag(lag: float) -> None:
    """ParameterError: a lag [s] that is no multiple of a tick, or too long."""
    if not (0.0 <= lag <= LONGEST_LAG and abs(math.remainder(lag, TICK)) < 1e-6):
        raise ParameterError(f"the lag is {lag:g} s: it must be a multiple of {TICK:g} s, at most {LONGEST_LAG:g} s")


class LateArm(PlayedMethod):
    """A method, and the arm in physics that plays its answers late."""

    def __init__(self, world: ArmWorld, method: Method, arm: GuardedArm, lag: float) -> None:
        super().__init__(world, method)
        self._tracks = method if isinstance(method, TracksArm) else None
        self._arm, self._lag, self._ticks = arm, lag, round(lag / TICK)

    def reset(self, scene: Scene) -> None:
        super().reset(scene)
        self._delayed: deque[Answer] = deque(Answer() for _ in range(self._ticks))
        self._measured: deque[np.ndarray] = deque(maxlen=self._ticks + 1)

    def tick(self, now: float, obstacles: Obstacles) -> None:
        self._measured.append(self.joint_positions)
        # By now the arm is to be where it was to be a lag ago without the lag.
        both = self._arm.body(np.stack([self._measured[0], self.commanded_positions]))
        self.effort.lag = max(self.effort.lag, float(np.max(np.linalg.norm(both[0] - both[1], axis=1))))
        if self._tracks is not None:
            self._tracks.track(self.joint_positions, now)
        super().tick(now, obstacles)

    def hand_over(self, answer: Answer) -> None:
        self._delayed.append(replace(answer, begin=answer.begin + self._lag))
        super().hand_over(self._delayed.popleft())


class LateStage(Stage):
    """A stage whose arm lags by a time [s]."""

    def __init__(self, arm: GuardedArm, lag: float) -> None:
        super().__init__(arm)
        self._lag = lag

    def play(self, scene: Scene, method: Method) -> tuple[Outcome, np.ndarray]:
        return self.judge(scene, LateArm(self.world, method, self.arm, self._lag))
