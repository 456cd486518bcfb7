"""Evasion: an arm that has no way to its goal gets out of the way of what is coming to where it stands or stops.

Where to is looked for by `solver.Solver.aside`; here is told when, and how long it goes on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geodesic_motion_ros.deadline import Deadline
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.planning.solver import HeldQuery, MotionState, Plan, Solver
from geodesic_motion_ros.planning.stream import Followed, Moment, Stream
from geodesic_motion_ros.refuge import AGAIN, AHEAD
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: Of times [s].
_ROUNDING = 1e-6


class Evasion:
    """Takes the stream of one arm aside."""

    def __init__(self, settings: PlannerSettings, solver: Solver, stream: Stream) -> None:
        self._settings, self._solver, self._stream = settings, solver, stream
        self.forget()

    def forget(self) -> None:
        """The arm stands elsewhere now: what was looked for in vain may be found."""
        # When it was looked for in vain [s].
        self._looked = -np.inf

    def plan(
        self, query: HeldQuery, state: MotionState, verdict: Verdict, moment: Moment, deadline: Deadline
    ) -> Plan | None:
        """A way aside where something comes to where the arm stops or stands, and it has no way to the goal.

        None where there is none, or nothing comes: then to stop along the way being gone is the answer.

        Parameters
        ----------
        query, state : what there is no way for, and where another reference takes over.
        verdict : why there is none; the plan's tells the same, and that the arm gives way.
        """
        prediction = self._settings.prediction
        if verdict.code is not VerdictCode.NO_FEASIBLE_PATH or not self._settings.avoidance:
            return None
        if moment.obstacles.stand:
            return None
        obstacles = moment.obstacles.at(state.time, prediction)
        now, stream, certifier = moment.now, self._stream, self._solver.certifier
        assert stream.played is not None
        followed = stream.followed
        if followed is not None and followed.verdict.ok and now < stream.played.end:
            left = certifier.swept(stream.soonest_stop(moment)[0])
        else:
            left = stream.left(state.time)
        going = Plan(None, now, verdict) if followed is not None and followed.gives_way else None
        for horizon in (AHEAD * prediction, prediction):
            certificate = certifier.certify_swept(left, obstacles, horizon, beyond=False)
            if certifier.objection(certificate) is None:
                return going
            looks = now >= self._looked + AGAIN - _ROUNDING
            plan = self._solver.aside(query, state, obstacles, horizon, deadline) if looks else None
            if plan is not None:
                break
        else:
            self._looked = now if looks else self._looked
            return None
        if moment.late.passed and (gone_on := self.gone_on(state.time, moment)) is not None:
            return gone_on
        reason = f"{verdict.reason}; giving way to what is coming"
        plan = replace(plan, verdict=replace(verdict, clearance=plan.verdict.clearance, reason=reason))
        return stream.play(plan, replace(Followed.begun(query, plan, moment), gives_way=True), moment)

    def gone_on(self, time: float, moment: Moment) -> Plan | None:
        """The way aside being played, where there was no time to look for another: as long as that is free from a time
        [s] on, and the arm can still stop on it. None where it is not, or nothing moves any more, or the arm does not
        give way.
        """
        stream, certifier, prediction = self._stream, self._solver.certifier, self._settings.prediction
        followed = stream.followed
        if followed is None or not followed.gives_way or moment.obstacles.stand:
            return None
        assert stream.played is not None
        obstacles = moment.obstacles.at(time, prediction)
        certificate = certifier.certify_swept(stream.left(time), obstacles, prediction, beyond=False)
        if certifier.objection(certificate) is not None or not stream.can_still_stop(stream.played, time, obstacles):
            return None
        return Plan(None, moment.now, replace(followed.verdict, clearance=float(np.min(certificate.clearance))))
