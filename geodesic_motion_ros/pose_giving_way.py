"""PoseGivingWay: a tool that has no way to its goal gets out of the way of what is coming to where it stops or stands.

As `giving_way.Evasion` for the whole arm. Where to is looked for by `pose_solver.PoseSolver.aside`, and beside what
was shown by its `sidestep`; here is told when, and how long it goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from geodesic_motion_ros.deadline import Deadline
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.pose_solver import Motion, Plan, PoseSolver, Scene
from geodesic_motion_ros.pose_stream import PoseStream
from geodesic_motion_ros.query import Pose, Query
from geodesic_motion_ros.reference import TaskSpaceReference
from geodesic_motion_ros.refuge import AGAIN, AHEAD
from geodesic_motion_ros.sidestep import SOON, STOP_SHARE
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: Of times [s].
_ROUNDING = 1e-6


class PoseGivingWay:
    """Takes the stream of one tool aside."""

    def __init__(
        self, settings: PlannerSettings, solver: PoseSolver, stream: PoseStream, may_start: Callable[[Pose], bool]
    ) -> None:
        """may_start : whether a motion may start at a pose: there alone sidesteps lead."""
        self._settings, self._solver, self._stream, self._may_start = settings, solver, stream, may_start
        self.forget()

    def forget(self) -> None:
        """What was looked for in vain may be found: there is another goal, or none."""
        # When it was looked for in vain [s].
        self._looked = -np.inf

    def plan(
        self,
        query: Query,
        start: Pose,
        latent: np.ndarray,
        scene: Scene,
        motion: Motion,
        verdict: Verdict,
        stop: TaskSpaceReference | None,
        deadline: Deadline,
    ) -> Plan | None:
        """A way aside where something comes to where the tool stops or stands, and it has no way to the goal; a
        sidestep, where it is about to be touched as it stands.

        None where there is none, or nothing comes: then to stop along the way being gone is the answer.

        Parameters
        ----------
        query, start, latent, scene, motion : what there is no way for, as of `PoseSolver.solve`.
        verdict : why there is none; the plan's tells the same, and that the tool gives way.
        stop : that stop; None: the tool stands.
        """
        obstacles, prediction, stream = scene.in_task, self._settings.prediction, self._stream
        if verdict.code is not VerdictCode.NO_FEASIBLE_PATH or not self._settings.avoidance or obstacles.stand:
            return None

        def stoppable(reference: TaskSpaceReference) -> bool:
            return stream.leaves_a_stop(reference, start, obstacles)

        def just_stoppable(reference: TaskSpaceReference) -> bool:
            return stream.leaves_a_stop(reference, start, obstacles, STOP_SHARE)

        going = motion.rest if stream.gives_way else None
        left = stop if going is None else going
        looks = abs(obstacles.time - self._looked) >= AGAIN - _ROUNDING and not deadline.passed
        for horizon in (AHEAD * prediction, prediction):
            clearance = self._solver.clearance_until(left, start, obstacles, horizon)
            if clearance > 0.0 and (going is None or stoppable(going)):
                return None if going is None else _aside(going, verdict, clearance)
            plan = None
            if looks:
                plan = self._solver.aside(query, start, latent, scene, motion, horizon, stoppable, deadline)
            if plan is not None:
                return _aside(plan.reference, verdict, plan.verdict.clearance)
        self._looked = obstacles.time if looks else self._looked
        clearance = self._solver.clearance_until(left, start, obstacles, SOON)
        if going is not None and clearance > 0.0 and just_stoppable(going):
            stopped = self._solver.clearance_until(stop, start, obstacles, prediction)
            return None if stopped > 0.0 else _aside(going, verdict, clearance)
        if clearance > 0.0 or motion.speed > 0.0 or not looks:
            return None
        for horizon in (prediction, SOON):
            plan = self._solver.sidestep(start, latent, scene, horizon, self._may_start, just_stoppable, deadline)
            if plan is not None:
                return _aside(plan.reference, verdict, plan.verdict.clearance)
        return None

    def gone_on(self, start: Pose, motion: Motion, scene: Scene) -> Plan | None:
        """The way aside being followed, where there was no time to look for another: as long as that is free soon, and
        just leaves the tool a stop. None where it is not, or nothing moves any more, or the tool does not give way.
        """
        stream, going, obstacles = self._stream, motion.rest, scene.in_task
        if going is None or not stream.gives_way or obstacles.stand:
            return None
        clearance = self._solver.clearance_until(going, start, obstacles, SOON)
        if clearance <= 0.0 or not stream.leaves_a_stop(going, start, obstacles, STOP_SHARE):
            return None
        assert stream.followed is not None
        return Plan(going, replace(stream.followed.verdict, clearance=clearance))


def _aside(reference: TaskSpaceReference | None, verdict: Verdict, clearance: float) -> Plan:
    reason = f"{verdict.reason}; giving way to what is coming"
    return Plan(reference, replace(verdict, clearance=clearance, reason=reason))
