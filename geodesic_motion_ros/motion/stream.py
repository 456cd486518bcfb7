"""Stream: the trajectories that an arm plays, each of which takes over from the one before. They come certified.

A new trajectory repeats the old one until it takes over, and is continuous with it in position, velocity and
acceleration; every one ends at rest.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

import numpy as np

from geodesic_motion_ros.certification.certificate import ArmCertifier, JudgedTrajectory
from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.played import FollowedPlan, PlayedTrajectory, Step
from geodesic_motion_ros.trajectory.trajectory import JointReference


class Stream:
    """The trajectories of one arm, joined into one motion: which of them is being played, and what for.

    Attributes
    ----------
    played : the newest trajectory that was handed out; None where it is not known where the arm stands.
    followed : the plan behind it; None where the arm was only said to stand.
    takeover : when it departs from the one before [s].
    """

    def __init__(self, certifier: ArmCertifier) -> None:
        self._certifier = certifier
        self.forget()

    def forget(self) -> None:
        """Forget all that was played: where the arm is is not known any more."""
        self.played: PlayedTrajectory | None = None
        self.followed: FollowedPlan | None = None
        self.takeover = -math.inf
        # The trajectory until `played` began: the arm's newest state may be older than that.
        self._played_before: PlayedTrajectory | None = None

    def stand(self, trajectory: JudgedTrajectory, now: float) -> None:
        """Let the stream begin anew: the arm stands where a trajectory stands, from `now` [s] on."""
        self.forget()
        self.played = PlayedTrajectory(trajectory, now, self._certifier)

    def take_certifier(self, certifier: ArmCertifier) -> None:
        """Use another certifier for what is played from now on."""
        self._certifier = certifier

    def replace_certificate(self, trajectory: JudgedTrajectory) -> None:
        """Replace the certificate of what is being played."""
        assert self.played is not None
        self.played = PlayedTrajectory(trajectory, self.played.begin, self._certifier)

    def commanded_state(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Return the position, velocity and acceleration (eta,) played at `time` [s]; None where nothing is."""
        played = self.played
        if played is None:
            return None
        if time < played.begin and self._played_before is not None:
            played = self._played_before
        return played.reference.sample(time - played.begin)

    def is_moving(self, now: float) -> bool:
        """Tell whether a motion is being played at `now` [s]."""
        played = self.played
        return played is not None and played.begin <= now < played.end

    def remaining_motion(self, now: float) -> tuple[JointReference, float] | None:
        """Return the rest of the motion that is being played, from its last knot at or before `now` [s] on, and the
        time of that knot; None where no motion is known, or it is over.
        """
        played = self.played
        if played is None or not self.is_moving(now):
            return None
        knot = played.knot_before(now)
        return played.reference.rest(knot - played.begin), knot

    def motion_to_goal(self) -> tuple[JointReference, float] | None:
        """Return the motion that is being played and the time of its first knot [s]; None where it leads to no goal."""
        if self.played is None or self.followed is None or self.followed.purpose is not Purpose.GOAL:
            return None
        return self.played.reference, self.played.begin

    def record_braking(self, trajectory: JudgedTrajectory, begin: float, verdict: Refusal) -> None:
        """Record that the arm fell back to the stop at the end of what was sent, which begins at a time [s].

        verdict : why.
        """
        self._replace(trajectory, begin)
        if self.followed is not None:
            self.followed = FollowedPlan(self.followed.query, Purpose.STOP, verdict, self.followed.last_search)

    def commit(self, step: Step, now: float) -> Plan:
        """Play the trajectory of a step at `now` [s], where it has one; returns the step's plan, with the whole motion
        from the knot at or before `now` on.
        """
        self.followed, plan = step.followed, step.plan
        if plan.trajectory is None:
            return plan
        assert self.played is not None
        begin, old = self.played.knot_before(now), self.played.trajectory
        if not np.any(old.reference.latent):
            # Where the arm stood before its first path had no latent point yet.
            latent = np.repeat(plan.trajectory.reference.latent[:1], len(old.reference.times), axis=0)
            old = replace(old, reference=replace(old.reference, latent=latent))
        elif step.followed is not None and step.followed.query.round_frame is not None:
            # The new query may be whole rounds away.
            here, there = old.reference.latent_at(plan.begin - self.played.begin), plan.trajectory.reference.latent[0]
            moved = step.followed.query.round_frame.nearest(here, there) - here
            old = replace(old, reference=replace(old.reference, latent=old.reference.latent + moved))
        whole = old.continue_by(plan.trajectory, begin - self.played.begin, plan.begin - self.played.begin)
        self._replace(whole, begin)
        self.takeover = plan.begin
        return replace(plan, trajectory=whole, begin=begin)

    def kept(self) -> Stream:
        """Return the stream as it is now, which goes on with what is played now where that is to be taken back."""
        return copy(self)

    def _replace(self, trajectory: JudgedTrajectory, begin: float) -> None:
        self._played_before, self.played = self.played, PlayedTrajectory(trajectory, begin, self._certifier)
