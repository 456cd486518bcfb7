"""Replanning: what methods that plan paths have in common.

The path being followed is certified in every tick, with obstacles that move on linearly for a while and the solids that
the scene declares, with the collision spheres and the certificate that our planner uses. While it is free it stays.
Otherwise another one is asked for, timed within the arena's limits from the state of motion in which it takes over, and
taken where it is free. Where there is none the arm stops along the path being followed, and asks again every `RETRY`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.certificate import ArmCertifier, SweptArm
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.trajectory.stopping import stopping_reference
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference, joined
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.method import Answer
from geodesic_motion_studies.comparison.scene import Scene

#: A new reference takes over so long after it was asked for, obstacles are expected to move on for so long, and a path
#: is asked for again so long after there was none [s]; the first two as our planner.
LATENCY, PREDICTION, RETRY = PlannerSettings.latency, PlannerSettings.prediction, 0.1
#: Kept from obstacles that move by a new reference [m], as by our planner's; those that stand must not be touched.
MARGIN = 0.01


class Playing:
    """A method that plays references, each joined to the one before."""

    settings: dict[str, Any]

    def __init__(self, arena: Arena) -> None:
        self._arena = arena

    def reset(self, scene: Scene) -> None:
        """Forget all that was before."""
        self._played = JointReference.standing(scene.start, np.zeros(1))
        self._begin = 0.0

    def rests(self, time: float) -> bool:
        """Whether what is being played has ended by a time [s]."""
        return time >= self._begin + self._played.duration

    def _play(self, reference: JointReference, now: float, switch: float, refusal: str) -> Answer:
        """What is being played until the switch, and the reference from there on."""
        local = now - self._begin
        if local >= self._played.duration:
            since = local
        else:
            since = float(self._played.times[np.searchsorted(self._played.times, local, side="right") - 1])
        whole = joined(self._played, since, reference, switch - self._begin)
        self._played, self._begin = whole, self._begin + since
        return Answer.playing(whole, self._begin, refusal)

    def _stop(self, now: float, switch: float, refusal: str) -> Answer:
        """The soonest stop from the switch on, along what is being played; an arm at rest stays."""
        if self.rests(switch):
            return Answer(refusal=refusal)
        stop = stopping_reference(self._played, switch - self._begin, self._arena.limits)
        return self._play(stop, now, switch, refusal)


class Replanning(Playing, ABC):
    """A method that plans paths from where the arm will be."""

    def __init__(self, arena: Arena) -> None:
        super().__init__(arena)
        self._certifier = ArmCertifier(arena.robot, arena.collision)

    def reset(self, scene: Scene) -> None:
        """Forget all that was before."""
        super().reset(scene)
        self._goal, self._solids = scene.goal, scene.declared.solids
        self._asked = -np.inf
        self._swept: tuple[JointReference, SweptArm] | None = None
        self._follows_path = False
        self.prepare(scene)

    @abstractmethod
    def prepare(self, scene: Scene) -> None:
        """What is done once for a scene, before its first tick."""

    @abstractmethod
    def paths(self, start: np.ndarray, progress: float, obstacles: Obstacles) -> Iterator[np.ndarray]:
        """Paths (m, eta) [rad] to try one after the other, from a configuration (eta,) to the scene's goal.

        progress : share of the path that has been followed. obstacles : where they are when the path begins.
        """

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        switch = now + LATENCY
        expected = obstacles.at(switch, PREDICTION).beside(self._solids)
        if self._follows_path and self._left_is_free(switch, expected):
            return Answer()
        if self._follows_path or now >= self._asked + RETRY - 1e-6:
            self._asked = now
            reference = self._new_reference(switch, expected)
            if reference is not None:
                self._follows_path = True
                return self._play(reference, now, switch, "")
        refusal = "no free path was found"
        if self._follows_path:
            self._follows_path = False
            return self._stop(now, switch, refusal)
        return Answer(refusal=refusal)

    def _left_is_free(self, switch: float, obstacles: Obstacles) -> bool:
        if self._swept is None or self._swept[0] is not self._played:
            self._swept = self._played, self._certifier.sweep(self._played)
        left = self._swept[1].since(switch - self._begin)
        certificate = self._certifier.certify_swept(left, obstacles, PREDICTION)
        return not self._certifier.objection(certificate)

    def _new_reference(self, switch: float, obstacles: Obstacles) -> JointReference | None:
        local = switch - self._begin
        position, velocity, acceleration = self._played.sample(local)
        progress = float(self._played.latent_at(local)[0])
        margin = 0.0 if obstacles.is_static else MARGIN
        limits = self._arena.limits
        for path in self.paths(position, progress, obstacles):
            shares = np.linspace(progress, 1.0, len(path))[:, None]
            inside = np.clip(path, limits.lower, limits.upper)
            reference = timed_joint_reference(inside, shares, limits, velocity, acceleration)
            if reference is None:
                continue
            certificate = self._certifier.certify(reference, obstacles, PREDICTION)
            if not self._certifier.objection(certificate, margin):
                return reference
        return None


def meeting(path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """A path (m, eta) [rad] moved, linearly in its samples, to begin at a start and end at a goal (eta,)."""
    share = np.linspace(0.0, 1.0, len(path))[:, None]
    return path + (1.0 - share) * (start - path[0]) + share * (goal - path[-1])
