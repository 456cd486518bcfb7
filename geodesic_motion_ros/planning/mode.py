"""Mode: what the arm does after a tick, and which modes may follow each other."""

from __future__ import annotations

from enum import Enum

from geodesic_motion_ros.planning.status import Verdict, VerdictCode


class Mode(Enum):
    """What the arm does."""

    IDLE = "idle"  # it stands, and there is no goal
    FOLLOWING = "following"  # it is on a certified path to the goal, or there
    WAITING = "waiting"  # it stands, and there is no path to the goal
    STOPPING = "stopping"  # it comes to rest along the path that it followed
    APPROACHING = "approaching"  # the goal is covered: it goes as near to it as it can
    EVADING = "evading"  # it makes room for what comes to where it stood or stopped
    HOLDING = "holding"  # it stands, as an input is missing or a hold was requested

    @property
    def at_rest(self) -> bool:
        """Whether the arm stands in this mode; FOLLOWING: it may."""
        return self in (Mode.IDLE, Mode.WAITING, Mode.HOLDING)

    @classmethod
    def moving(cls, leads_to_goal: bool, approaching: bool, evading: bool) -> Mode:
        """Of an arm that moves."""
        if leads_to_goal:
            return cls.FOLLOWING
        if approaching:
            return cls.APPROACHING
        return cls.EVADING if evading else cls.STOPPING

    @classmethod
    def standing(cls, verdict: Verdict) -> Mode:
        """Of an arm that stands, with the verdict of the tick."""
        if verdict.ok:
            return cls.FOLLOWING
        if verdict.code is VerdictCode.NO_GOAL:
            return cls.IDLE
        return cls.WAITING if verdict.planned else cls.HOLDING


#: Which modes may follow each one: what stands has nothing to stop.
TRANSITIONS: dict[Mode, frozenset[Mode]] = {
    mode: frozenset(Mode) - ({Mode.STOPPING} if mode.at_rest else set()) for mode in Mode
}
