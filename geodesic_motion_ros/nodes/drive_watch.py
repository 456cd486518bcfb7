"""Where a motion is to begin: at what the arm's drive commands, for there the drive goes on. Knows nothing of ROS.

An arm rests some mrad beside what it is commanded, by friction and load. A motion that began where it is measured would
be a step of the command: small, but a drive that judges its commands stops there (a Franka Research 3 at 0.01 mrad).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.nodes.arm_watch import REST_TIME
from geodesic_motion_ros.nodes.deviation import farthest, joint_deviation
from geodesic_motion_ros.nodes.sent_trajectories import LEFT

#: The topic of what the drive commands.
DRIVE_TOPIC = "commanded_joint_states"
#: Configurations that differ by less in each joint [rad] are one: what rounding leaves of it.
SAME_PLACE = 1e-6
#: Before a motion the drive has commanded one place for so long [s].
DRIVE_RESTS = 0.1


@dataclass(frozen=True)
class Start:
    """Where the arm is commanded to stand (eta,) [rad] as a motion begins, and what the log says of it."""

    configuration: np.ndarray
    news: str


class DriveWatch:
    """What the drive commands, and since when it has been the same; nothing, where no node says it. Times are of one
    clock [s].

    Attributes
    ----------
    commanded : (eta,) [rad] the newest; None before the first. taken : its time.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """names : of the joints."""
        self._names = tuple(names)
        self.commanded: np.ndarray | None = None
        self.taken = -np.inf
        self._place = np.full(len(self._names), np.nan)
        self._since = -np.inf
        # Since when the drive has been elsewhere than it was sent to move to, and how far that is.
        self._parted, self._apart = np.inf, ""

    def take(self, commanded: np.ndarray, taken: float) -> None:
        """Take a configuration (eta,) [rad] that the drive commanded at a time."""
        if not is_same_place(commanded, self._place):
            self._place, self._since = commanded, taken
        self.commanded, self.taken = commanded, taken

    @property
    def rested(self) -> float:
        """For how long the drive had commanded one place [s], when it was heard last."""
        return self.taken - self._since

    def start(self, measured: np.ndarray, sent: np.ndarray | None, tolerance: float, oldest: float) -> Start | Refusal:
        """Choose where a motion begins: where the drive commands the arm to stand; where that is not known, where the
        arm was sent to stand, and else where it is measured.

        measured : (eta,) [rad]. sent : where the planner sent the arm, to stand there; None where that does not count.
        tolerance : [rad] a joint that is farther from what is commanded is not where it was sent to be. oldest : what
        the drive commanded before does not count. A refusal where the drive commands another place than that of the
        arm, moves it, or has fallen silent.
        """
        if self.commanded is None:
            if sent is not None and joint_deviation(measured, sent, self._names, tolerance) is None:
                return Start(sent, f"motions begin where the arm was sent to stand, {self._off(measured, sent)}")
            return Start(
                measured,
                "motions begin where the joints are measured, for nothing is heard of what the drive commands: it "
                f"steps by as much as the arm is beside that; {DRIVE_TOPIC} would tell",
            )
        if self.taken < oldest:
            return Refusal(
                VerdictCode.STALE_STATE,
                f"{DRIVE_TOPIC}: the newest is older than state_timeout, and where a motion has to begin is not known",
            )
        deviation = joint_deviation(measured, self.commanded, self._names, tolerance)
        if deviation is not None:
            where, limit = deviation
            return Refusal(
                VerdictCode.BAD_INPUT,
                f"{DRIVE_TOPIC}: the arm is {where} from where its drive commands it (allowed by {limit}): "
                "nothing is commanded until the drive commands it where it is",
            )
        if self.rested < DRIVE_RESTS:
            return Refusal(
                VerdictCode.STALE_STATE,
                f"{DRIVE_TOPIC}: the drive has not commanded one place for {DRIVE_RESTS:g} s yet: nothing is commanded "
                "until it does",
            )
        return Start(
            self.commanded, f"motions begin where the drive commands the arm, {self._off(measured, self.commanded)}"
        )

    def compare(self, sent: np.ndarray | None) -> None:
        """Compare what the drive commands with where it was sent to be by then (eta,) [rad], in motion; None where it
        was sent to rest, or that is not known.
        """
        if sent is None or self.commanded is None:
            self._parted = np.inf
            return
        off, name = farthest(self.commanded - sent, self._names)
        self._apart = f"{off:.3f} rad in '{name}'"
        self._parted = min(self._parted, self.taken) if off >= LEFT else np.inf

    @property
    def stalled(self) -> str:
        """How far the drive stands still from where it was sent to move; "" where it does not."""
        return self._apart if min(self.rested, self.taken - self._parted) >= REST_TIME else ""

    def has_left(self, sent: np.ndarray, oldest: float) -> bool:
        """Whether the drive has rested elsewhere than at `sent` (eta,) [rad]: it was stopped, or begun anew, by others.
        """
        if self.commanded is None or self.taken < oldest or self.rested < REST_TIME:
            return False
        return not is_same_place(self.commanded, sent)

    def _off(self, measured: np.ndarray, commanded: np.ndarray) -> str:
        size, name = farthest(measured - commanded, self._names)
        return f"{1e3 * size:.2f} mrad in '{name}' from where it is measured"


def is_same_place(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two configurations (eta,) [rad] are one, but for rounding."""
    return bool(np.max(np.abs(one - other)) <= SAME_PLACE)
