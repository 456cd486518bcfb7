"""What others want an arm to do, played through the motion filter: chunks of the cloned policy, or plans."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from geodesic_motion_ros.filtering.motion_filter import MotionFilter, Recovery
from geodesic_motion_ros.kernels.loading import load_filter_kernels
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.cloned_policy import RENEWED, cloned_policy
from geodesic_motion_studies.comparison.method import Answer
from geodesic_motion_studies.comparison.methods.rapid_plans import PERIOD, RapidPlans
from geodesic_motion_studies.comparison.scene import Scene
from geodesic_motion_studies.comparison.spheres_seen import SpheresSeen


class Filtered(ABC):
    """A filter with its defaults, and what is offered to it.

    period : how often something is offered [s].
    """

    settings: dict[str, Any]
    period: float

    def __init__(self, arena: Arena, recover: Recovery = "wait", kind: type[MotionFilter] = MotionFilter) -> None:
        """recover : of the filter. kind : what filters."""
        self._arena, self._recover, self._kind = arena, recover, kind
        # By what is declared around the arm: a filter has one scene.
        self._filters: dict[bytes, MotionFilter] = {}

    def reset(self, scene: Scene) -> None:
        """The arm stands at the start."""
        declared = scene.declared.solids.tobytes()
        if declared not in self._filters:
            made = self._kind(self._arena.name, scene.declared, recover=self._recover)
            load_filter_kernels(made)
            self._filters[declared] = made
        self._filter = self._filters[declared]
        self._seen = SpheresSeen()
        self._filter.observe(Obstacles.none())
        self._filter.stand_at(scene.start, 0.0)
        self._offered = -np.inf

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """As the filter node's cycle."""
        self._filter.observe(self._seen.with_errors(now, obstacles))
        if now >= self._offered + self.period - 1e-6:
            self._offered = now
            self._offer(now, obstacles)
        plan = self._filter.tick(now)
        refusal = "" if plan.verdict.ok else f"{plan.verdict.code.name}: {plan.verdict.reason}"
        if plan.reference is None or now >= plan.begin + plan.reference.duration:
            return Answer(refusal=refusal)
        return Answer.playing(plan.reference, plan.begin, refusal)

    @abstractmethod
    def _offer(self, now: float, obstacles: Obstacles) -> None:
        """Offer what is wanted at a time [s]."""

    def _commanded(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        state = self._filter.commanded_state(time)
        assert state is not None
        return state


class FilteredPolicy(Filtered):
    """The chunks of the cloned policy, from where the arm is commanded to be."""

    period = RENEWED

    def __init__(self, arena: Arena, recover: Recovery = "wait", kind: type[MotionFilter] = MotionFilter) -> None:
        super().__init__(arena, recover, kind)
        self._policy = cloned_policy(arena)
        self.settings = {"recover": recover, "filter": kind.__name__, **self._policy.settings}

    def reset(self, scene: Scene) -> None:
        """The arm stands at the start."""
        super().reset(scene)
        self._goal = scene.goal

    def _offer(self, now: float, obstacles: Obstacles) -> None:
        self._filter.offer(*self._policy.chunk(self._commanded(now)[0], self._goal), begin=now)


class FilteredPlans(Filtered):
    """The plans of RRT-Connect, made anew where obstacles, taken to stand, block them."""

    period = PERIOD

    def __init__(self, arena: Arena, recover: Recovery = "wait") -> None:
        super().__init__(arena, recover)
        self._plans = RapidPlans(arena)
        self.settings = {"recover": recover, **self._plans.settings}

    def reset(self, scene: Scene) -> None:
        """The arm stands at the start."""
        super().reset(scene)
        self._plans.reset(scene)

    def _offer(self, now: float, obstacles: Obstacles) -> None:
        switch = now + self._filter.latency
        state = self._commanded(switch)
        if self._plans.is_free(state[0], obstacles):
            return
        plan = self._plans.planned(*state, obstacles)
        if plan is not None:
            self._filter.offer(plan.times, plan.positions, plan.velocities, begin=switch)


class Braking(MotionFilter):
    """Braking alone: where a chunk is not free the arm stops at once, along what it plays."""

    def _free_part(self, *attempt: Any) -> None:
        return None
