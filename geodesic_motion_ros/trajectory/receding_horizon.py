"""What is sent of a joint reference: so much of it that the arm stops by itself when nothing more is heard.

A reference leads to the goal, seconds away. If all of it were sent, an arm whose planner has died, hangs, or can no
longer be heard would go there, whatever comes into its path meanwhile. What is sent follows the reference for a horizon
from now, brakes along its path, and ends at rest; long before that it is sent again, reaching further.

The certificate of the whole reference holds for it: obstacles are expected to stand after `prediction`, the horizon is
no shorter, and from there on the same path is passed among the same obstacles, only later. Of an
optimistic path it holds as long as that of the path itself: for the prediction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.stopping import stopping_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference, joined

#: What is sent reaches further again after this share of the horizon.
_RENEWED_AFTER = 0.5
#: For so long after the first of a stream [s], and so often [s], what is sent is sent again: a controller that has only
#: just found the sender hears nothing of what came before.
_FOUND_LATE, _AGAIN = 1.0, 0.1


@dataclass(frozen=True)
class Sent:
    """A reference as it was sent, when it begins [s], and from when on it brakes [s], inf where it is a whole one."""

    reference: JointReference
    begin: float
    brakes: float


class Horizon:
    """Bounds the references of one stream, and remembers what was sent last. Times are of the stream's clock."""

    def __init__(self, length: float) -> None:
        """length : of what is sent, before it brakes [s]."""
        self.length = length
        self._sent: Sent | None = None
        self._first, self._newest = math.inf, -math.inf

    def bound(self, reference: JointReference, begin: float, now: float, limits: JointLimits) -> Sent:
        """Bound what is sent at `now` [s] of a reference that begins at a time [s], and remember it; limits : that it
        keeps, and brakes by.
        """
        self._first, self._newest = min(self._first, now), now
        # The stop begins at a knot: shorter pieces than those between knots gain nothing.
        ahead = now + self.length - begin
        brakes = float(max(reference.times[reference.times <= ahead], default=0.0))
        if reference.duration <= ahead or brakes == 0.0:
            self._sent = Sent(reference, begin, math.inf)
        else:
            stop = stopping_reference(reference, brakes, limits)
            self._sent = Sent(joined(reference, 0.0, stop, brakes), begin, begin + brakes)
        return self._sent

    def must_renew(self, now: float) -> bool:
        """Whether what was sent last should reach further by now [s], or may not have been heard."""
        sent = self._sent
        if sent is None:
            return False
        is_new = now < self._first + _FOUND_LATE and now < sent.begin + sent.reference.duration
        return (is_new and now >= self._newest + _AGAIN) or now >= sent.brakes - (1.0 - _RENEWED_AFTER) * self.length

    def overrun(self, soon: float) -> Sent | None:
        """What was sent last, where the arm will brake by itself by a time [s]: that is what it plays then."""
        return self._sent if self._sent is not None and soon >= self._sent.brakes else None

    @property
    def sent(self) -> Sent | None:
        """What was sent last; None where nothing was, or that does not count any more."""
        return self._sent

    def fall_back(self, sent: Sent) -> None:
        """What was sent last has not been taken: another one, of before, is played."""
        self._sent = sent

    def forget(self) -> None:
        """What was sent last does not count any more."""
        self._sent = None
