"""Whether the arm is where it was sent, and whether it rests where it was found instead. Knows nothing of ROS."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.nodes.deviation import have_joints_moved
from geodesic_motion_ros.nodes.input_faults import Halt

#: An arm that was lost rests when it has stayed this long [s] near one place.
REST_TIME = 0.5


@dataclass(frozen=True)
class UnsettledArm:
    """An arm that is to rest before it is commanded again: why, and for how long [s] it has rested near which
    configuration (eta,) [rad].
    """

    refusal: Refusal
    near: np.ndarray
    rested: float = 0.0

    @property
    def is_at_rest(self) -> bool:
        """Whether it has rested for long enough."""
        return self.rested >= REST_TIME

    def after_measurement(self, measured: np.ndarray, passed: float) -> UnsettledArm:
        """Return what is known of it when it is measured again after a time [s]."""
        if have_joints_moved(measured, self.near):
            return replace(self, near=measured, rested=0.0)
        return replace(self, rested=self.rested + passed)


class ArmWatch:
    """A watch that finds an arm lost that is not where it was sent, until it has rested for a moment wherever it is.

    Attributes
    ----------
    lost : the lost arm; None while it is not. strayed : whether it was lost because it was not where it was sent.
    missing : whether joint states have been missing for so long that the goal was dropped.
    jump : of the clock [s], since the arm last was where it was sent: what was commanded before is of another time.
    """

    def __init__(self) -> None:
        self.lost: UnsettledArm | None = None
        self.strayed = self.missing = False
        self.jump = 0.0

    def begin(self) -> None:
        """Begin where it stands, which is where it is commanded to stand from now on."""
        self.lost, self.strayed, self.missing, self.jump = None, False, False, 0.0

    def unrest(self, measured: np.ndarray, passed: float) -> Refusal | None:
        """Return why a lost arm that is measured again after a time [s] is not commanded; None once it has rested."""
        assert self.lost is not None
        self.lost = self.lost.after_measurement(measured, passed)
        return None if self.lost.is_at_rest else self.lost.refusal

    def lose(self, measured: np.ndarray, deviation: tuple[str, str] | None, stalled: str = "") -> Halt | None:
        """Find the arm lost, and return why what is commanded is no longer to be trusted; None while it follows.

        deviation : how far it is from where it was sent, and what is allowed; None where it follows, or that is not
        known. stalled : how far its drive stands still from where it was sent; "" where it does not. Both drop the
        goal.
        """
        dropping = ""
        if self.jump:
            cause = f"the clock was set by {self.jump:+.1f} s"
        elif deviation is not None:
            where, limit = deviation
            dropping = f"the arm was {where} from where it was sent"
            cause = (
                f"joint_states: the arm is {where} from where it was sent (allowed by {limit}; does its driver "
                "follow, and is it armed?)"
            )
        elif stalled:
            dropping = f"the drive stood still, {stalled} from where it was sent"
            cause = (
                f"commanded_joint_states: the drive stands still, {stalled} from where it was sent (does it "
                "follow, and is it armed?)"
            )
        elif self.missing:
            cause = "joint_states: the arm is back after a long silence"
        else:
            return None
        reason = f"{cause}: nothing is commanded until the arm has rested for {REST_TIME:g} s"
        halt = Halt(Refusal(VerdictCode.BAD_INPUT, reason), dropping)
        self.lost, self.strayed = UnsettledArm(halt.refusal, measured), deviation is not None
        return halt
