"""How much a stream of positions accelerates, from messages that come late or get lost. Knows nothing of ROS."""

from __future__ import annotations

from collections import deque

import numpy as np

#: Steps from the first to the last pose of a window, of which a velocity is taken.
_STEPS = 4
#: Stamps of a stream that nothing disturbs are wrong by so much [s].
_JITTER = 0.002
#: Where stamps are further apart than so many periods, whatever made the stream stood still: that is no acceleration.
_LONGEST_GAP = 2.5


class StreamAcceleration:
    """The acceleration of streamed positions: of the velocities over two adjacent windows of five poses each, their
    difference over the time between them.

    A pose that is sent late moves on by one period all the same, and a lost message leaves a gap in the stamps. So the
    times between poses are read twice, from the stamps and as one period each, and the smaller acceleration
    counts.
    """

    def __init__(self, period: float) -> None:
        """period : of the stream [s]."""
        self._period = period
        self._heard: deque[tuple[float, np.ndarray]] = deque(maxlen=2 * _STEPS + 1)

    def begin_anew(self) -> None:
        """The next pose does not follow those before."""
        self._heard.clear()

    def hear(self, stamp: float, position: np.ndarray) -> float:
        """The acceleration [m/s^2] with the next pose, position (3,) [m] and stamp [s], less what jitter of the stamps
        may make of none; 0 where it cannot be computed.
        """
        self._heard.append((stamp, position))
        if len(self._heard) <= 2 * _STEPS:
            return 0.0
        stamps = np.array([stamp for stamp, _ in self._heard])
        gaps = np.diff(stamps)
        if np.any(gaps > _LONGEST_GAP * self._period):
            return 0.0
        displacements = np.diff(np.array([position for _, position in self._heard])[::_STEPS], axis=0)
        counted = _change(displacements, np.full(2, _STEPS * self._period))
        if np.any(gaps <= 0.0):  # the clock was set
            return counted
        times = np.diff(stamps[::_STEPS])
        # Either end of a window is wrong by the jitter, and so is the time that its displacement is divided by.
        blurred = 2.0 * _JITTER * float(np.sum(np.linalg.norm(displacements, axis=1) / times**2)) / np.mean(times)
        return max(0.0, min(counted, _change(displacements, times) - blurred))


def _change(displacements: np.ndarray, times: np.ndarray) -> float:
    """The velocities of two displacements (2, 3) [m] in `times` (2,) [s]: their change over the time between."""
    velocities = displacements / times[:, None]
    return float(np.linalg.norm(velocities[1] - velocities[0]) / np.mean(times))
