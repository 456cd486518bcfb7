"""Purpose: what a motion is for. Mode: what the arm does after a tick, and which modes may follow each other."""

from __future__ import annotations

from enum import Enum

from geodesic_motion_ros.contract.status import Verdict, VerdictCode


class Purpose(Enum):
    """The purpose that a motion is planned for."""

    GOAL = "goal"  # a certified path to the goal
    EVASION = "evasion"  # to make room for an obstacle that comes to where the arm stands or stops
    APPROACH = "approach"  # to come as near to a covered goal as is free
    STOP = "stop"  # to come to rest, no more


class Mode(Enum):
    """The activity of the arm after a tick, as `~/status` states it."""

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
    def from_purpose(cls, purpose: Purpose) -> Mode:
        """Return the mode of an arm whose motion has a purpose."""
        return {
            Purpose.GOAL: cls.FOLLOWING, Purpose.APPROACH: cls.APPROACHING, Purpose.EVASION: cls.EVADING,
            Purpose.STOP: cls.STOPPING,
        }[purpose]  # fmt: skip

    @classmethod
    def from_verdict(cls, verdict: Verdict) -> Mode:
        """Return the mode of an arm that stands, with the verdict of the tick."""
        if verdict.ok:
            return cls.FOLLOWING
        if verdict.code is VerdictCode.NO_GOAL:
            return cls.IDLE
        return cls.WAITING if verdict.is_of_planning else cls.HOLDING


#: Which modes may follow each one: what stands has nothing to stop.
TRANSITIONS: dict[Mode, frozenset[Mode]] = {
    mode: frozenset(Mode) - ({Mode.STOPPING} if mode.at_rest else set()) for mode in Mode
}
