"""Stream: the trajectories that an arm plays, each of which takes over from the one before. Judges nothing.

A new trajectory repeats the old one until it takes over, and is continuous with it in position, velocity and
acceleration; every one ends at rest.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from geodesic_motion_ros.planning.certificate import ArmCertifier, JudgedTrajectory
from geodesic_motion_ros.planning.plan import Plan
from geodesic_motion_ros.planning.situation import Followed, PlayedTrajectory, Step
from geodesic_motion_ros.planning.status import Verdict
from geodesic_motion_ros.trajectory.trajectory import JointReference


class Stream:
    """What one arm plays, one trajectory after the other, and what that is played for.

    Attributes
    ----------
    played : the newest trajectory handed out; None where it is not known where the arm stands.
    followed : what it was planned for; None where the arm was only said to stand.
    """

    def __init__(self, certifier: ArmCertifier) -> None:
        self._certifier = certifier
        self.forget()

    def forget(self) -> None:
        """Where the arm is is not known any more."""
        self.played: PlayedTrajectory | None = None
        self.followed: Followed | None = None
        # What was played until `played` began: the arm's newest state may be older than that.
        self._played_before: PlayedTrajectory | None = None

    def stand(self, trajectory: JudgedTrajectory, now: float) -> None:
        """The arm stands where a trajectory does from `now` [s] on."""
        self.forget()
        self.played = PlayedTrajectory(trajectory, now, self._certifier)

    def take_certifier(self, certifier: ArmCertifier) -> None:
        """What is played from now on is certified by another one."""
        self._certifier = certifier

    def certify_anew(self, trajectory: JudgedTrajectory) -> None:
        """What is being played has another certificate."""
        assert self.played is not None
        self.played = PlayedTrajectory(trajectory, self.played.begin, self._certifier)

    def commanded(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Position, velocity and acceleration (eta,) played at `time` [s]; None where nothing is."""
        played = self.played
        if played is None:
            return None
        if time < played.begin and self._played_before is not None:
            played = self._played_before
        return played.reference.sample(time - played.begin)

    def playing(self, now: float) -> tuple[JointReference, float] | None:
        """What is being played from its last knot at or before `now` [s] on, and the time of that; None where that is
        not known, or over.
        """
        played = self.played
        if played is None or not played.begin <= now < played.end:
            return None
        knot = played.knot_before(now)
        return played.reference.rest(knot - played.begin), knot

    def to_goal(self) -> tuple[JointReference, float] | None:
        """What is being played and the time of its first knot [s], where it leads to the goal."""
        if self.played is None or self.followed is None or not self.followed.verdict.ok:
            return None
        return self.played.reference, self.played.begin

    def braked(self, trajectory: JudgedTrajectory, begin: float, verdict: Verdict) -> None:
        """The arm does not play what it was to play, but a stop that begins at a time [s]: why."""
        self._replace(trajectory, begin)
        if self.followed is not None:
            self.followed = replace(self.followed, verdict=verdict, path=None, rejected=None, remaining=math.inf)

    def take(self, step: Step, now: float) -> Plan:
        """Play what a step at `now` [s] hands out: the plan with all that is played from the knot before on."""
        self.followed, plan = step.followed, step.plan
        if plan.trajectory is None:
            return plan
        assert self.played is not None
        begin, old = self.played.knot_before(now), self.played.trajectory
        if not np.any(old.reference.latent):
            # Where the arm stood before its first path had no latent point yet.
            latent = np.repeat(plan.trajectory.reference.latent[:1], len(old.reference.times), axis=0)
            old = replace(old, reference=replace(old.reference, latent=latent))
        whole = old.continued_by(plan.trajectory, begin - self.played.begin, plan.begin - self.played.begin)
        self._replace(whole, begin)
        return replace(plan, trajectory=whole, begin=begin)

    def _replace(self, trajectory: JudgedTrajectory, begin: float) -> None:
        self._played_before, self.played = self.played, PlayedTrajectory(trajectory, begin, self._certifier)
