"""Requirement: what a motion must satisfy before it is played, and to go on being played. This is the safety contract.

Clearances are those from obstacles that are enlarged by all that may be wrong with their positions
(`Inputs.enlarged_obstacles`). Besides, no motion but a stop may touch the arm itself or enter the declared scene.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.obstacles.obstacles import Obstacles


@dataclass(frozen=True)
class Margin:
    """A clearance that is kept [m], or a share of the clearance that there is already, where that is less.

    So an arm that is nearer to an obstacle than a margin may stay there, and may leave.
    """

    clearance: float
    share: float = math.inf

    def of(self, present: float = math.inf) -> float:
        """Return the margin [m] where the clearance is `present` [m] already."""
        return self.clearance if math.isinf(self.share) else min(self.clearance, self.share * present)


NO_CONTACT = Margin(0.0)
#: An arm that is nearer than the margin comes no nearer, but for rounding: this share of the clearance is kept.
_NO_NEARER = 0.999


@dataclass(frozen=True)
class Requirement:
    """The requirement of one kind of motion.

    Attributes
    ----------
    searched : what the search keeps from obstacles, where it can. Nothing depends on it that is certified.
    certified : what the certificate requires where an obstacle moves. standing : where all stand.
    horizon : obstacles that move go on for this time [s].
    stands_after : after the horizon they stand where they have come to; False: they do not count any more.
    """

    searched: Margin
    certified: Margin
    horizon: float
    stands_after: bool = True
    standing: Margin = NO_CONTACT

    def margin(self, obstacles: Obstacles, present: float = math.inf) -> float:
        """Return what a certificate among obstacles requires [m]; present : the clearance that there is already [m]."""
        return (self.standing if obstacles.is_static else self.certified).of(present)

    def until(self, time: float) -> Requirement:
        """Return the requirement of a motion that has to be free until a time [s] of it, and no longer."""
        return replace(self, horizon=time)


@dataclass(frozen=True)
class Requirements:
    """The requirements of all kinds of motion.

    Attributes
    ----------
    goal, optimistic : of a new path to the goal. The clearance that there is already: at the end of the path that is
        nearer to an obstacle.
    detour : of a path beside what was demonstrated.
    offer : of a motion that somebody else wants: nothing searches for it, so the certificate requires the margin. The
        clearance that there is already: where the arm is.
    evasion, beside_graph : of a motion that makes room, to a place on the graph and to one beside it. To pass an
        obstacle narrowly is better than to be met by it: no margin is required. An arm that touches already what moves
        may leave it (`ArmCertifier.assess_leaving`).
    approach : of a motion towards a covered goal. The clearance that there is already: where the arm is.
    stop : of the soonest stop, which is played whatever its certificate states.
    later_stop : what the stop that a motion must leave keeps from wherever an obstacle may halt
        (`Situation.may_follow`).
    """

    goal: Requirement
    optimistic: Requirement
    detour: Requirement
    offer: Requirement
    evasion: Requirement
    beside_graph: Requirement
    approach: Requirement
    stop: Requirement
    later_stop: Margin

    def to_go_on(self, purpose: Purpose, optimistic: bool) -> Requirement:
        """Return the requirement of a motion that is followed already, of every purpose but a stop: no contact, as to
        pass an obstacle narrowly is better than to stop there.
        """
        begun = {
            Purpose.GOAL: self.optimistic if optimistic else self.goal, Purpose.EVASION: self.evasion,
            Purpose.APPROACH: self.approach,
        }[purpose]  # fmt: skip
        return replace(begun, certified=NO_CONTACT, standing=NO_CONTACT)

    @classmethod
    def of(cls, settings: PlannerSettings) -> Requirements:
        """Return the requirements with a user's settings."""
        margin, horizon = settings.obstacle_margin, settings.prediction
        moving = constants.DYNAMIC_MARGIN_FACTOR * margin
        goal = Requirement(Margin(margin, 0.5), Margin(moving, 0.5), horizon)
        evasion = Requirement(Margin(moving), NO_CONTACT, horizon, stands_after=False)
        soon = min(constants.EVASION_DISPLACED_WITHIN, 0.5 * horizon)
        # Where the present clearance is less, too, the certificate requires two thirds of what the search keeps.
        nearer = constants.DYNAMIC_MARGIN_FACTOR / constants.APPROACH_MARGIN_FACTOR
        approached = Margin(constants.APPROACH_MARGIN_FACTOR * margin, 0.99)
        return cls(
            goal=goal,
            optimistic=replace(goal, stands_after=False),
            detour=replace(goal, certified=Margin(moving)),
            offer=Requirement(NO_CONTACT, Margin(moving, _NO_NEARER), horizon, standing=Margin(margin, _NO_NEARER)),
            evasion=evasion,
            beside_graph=replace(evasion, horizon=soon),
            approach=Requirement(approached, Margin(moving, nearer * approached.share), horizon),
            stop=Requirement(NO_CONTACT, Margin(-math.inf), horizon),
            later_stop=Margin(moving),
        )
