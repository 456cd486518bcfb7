"""The clock of the inputs, from one cycle to the next. Knows nothing of ROS."""

from __future__ import annotations

from geodesic_motion_ros.nodes.cycle import CycleInputs
from geodesic_motion_ros.nodes.input_faults import NO_CLOCK

#: What is commanded moves on by at most this [s] of a simulation in one cycle, so that a late one is no step of the
#: arm: 4 mm and 0.016 rad at the default speeds.
LONGEST_ADVANCE = 0.02


class CycleClock:
    """A clock that tells how time passes from one cycle to the next.

    Attributes
    ----------
    step : by which what is commanded moves on in the newest cycle whose inputs are known [s].
    jump : by which the clock that trajectories are stamped with was set since the cycle before [s].
    """

    def __init__(self) -> None:
        self.step = self.jump = 0.0
        self._heard = self._set_by = 0.0
        self._simulated = False

    def read(self, inputs: CycleInputs, period: float) -> str:
        """Read the clock of a cycle of a period [s]; returns why it drops the goal, "" where it does not.

        What is commanded moves on by the period, or by what has passed of a simulation.
        """
        passed, self._heard = inputs.heard - self._heard, inputs.heard
        self.jump, self._set_by = inputs.set_by - self._set_by, inputs.set_by
        was_simulated, self._simulated = self._simulated, inputs.simulated
        self.step = min(passed, LONGEST_ADVANCE) if inputs.simulated else period
        if self.jump == 0.0:
            return ""
        # A simulation that is reset begins at 0, too.
        no_clock = not inputs.has_clock and not was_simulated
        return NO_CLOCK if no_clock else f"the clock was set by {self.jump:+.1f} s"
