"""The time that an arm's commands are played by: the arm's own milliseconds, drawn to the clock that stamps them."""

from __future__ import annotations

#: Largest share by which it goes faster or slower than the arm's own, and how much that share may change in a
#: millisecond: of 1 rad/s a hundredth of 1 rad/s^2.
RATE, SLEW = 0.05, 1e-5
#: The error is drawn in within about so long [s]; arrival times jitter, and are averaged over 0.1 s.
_DRAWN_IN, _AVERAGED = 2.0, 0.01


class RobotClock:
    """A clock that goes on by the arm's periods and follows another one without a jump: the jitter of a network never
    reaches the arm. Times are in seconds.
    """

    def __init__(self, now: float) -> None:
        self.now = now
        self._rate = self._error = 0.0

    def step(self, period: float, shown: float | None) -> float:
        """Go on by a period of the arm, drawn to what the other clock shows; None: by the arm's time alone."""
        if shown is not None:
            self._error += _AVERAGED * (shown - self.now - self._error)
            wanted = min(max(self._error / _DRAWN_IN, -RATE), RATE)
            self._rate += min(max(wanted - self._rate, -SLEW), SLEW)
        self.now += period * (1.0 + self._rate)
        return self.now
