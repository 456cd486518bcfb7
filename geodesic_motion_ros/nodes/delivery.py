"""How late what is sent arrives, as it is measured. Knows nothing of ROS.

A trajectory that takes over repeats the one before until then, so one that arrives in time gives no step of the
command, and one that arrives later does. No controller says when it has heard one. What is measured is how long
messages of the arm take to here, on the same machines and by the same network; and how late cycles send what they have
found.
"""

from __future__ import annotations

import math
import struct
from collections import deque

from geodesic_motion_ros.nodes.node_time import Moment
from geodesic_motion_ros.nodes.sender_clock import SenderClock

#: What was measured counts for so long [s]: a busy machine is late again and again.
COUNTED = 5.0
#: Takeovers move by steps of this [s], and by no more than that: of an arm of which so much is known so late
#: `state_timeout` is the remedy; stamps that are farther off are of another clock.
LATE_STEP, LATEST = 0.01, 0.25
#: One figure is kept of so long [s].
_SPAN = 0.5


class Lately:
    """The largest figure of the last `COUNTED` seconds."""

    def __init__(self) -> None:
        # When each span began [s], and the largest figure in it.
        self._spans: deque[tuple[float, float]] = deque()

    def add(self, figure: float, now: float) -> None:
        """Count a figure from now on [s]."""
        if self._spans and now - self._spans[-1][0] < _SPAN:
            begun, largest = self._spans[-1]
            self._spans[-1] = begun, max(largest, figure)
        else:
            self._spans.append((now, figure))

    def largest(self, now: float) -> float:
        """Return the largest figure, as of now [s]; 0 where there is none."""
        while self._spans and self._spans[0][0] < now - COUNTED - _SPAN:
            self._spans.popleft()
        return max((largest for _, largest in self._spans), default=0.0)


class TransitWatch:
    """How long messages of one sender take, at most; any stamp that is 0 says nothing."""

    def __init__(self) -> None:
        self._clock, self._lately = SenderClock(), Lately()

    def take(self, stamp: float, arrival: Moment) -> None:
        """Take a message with a stamp [s] as it arrives.

        One of the future says that the clocks differ, and by how much less this one hears of what is sent in time.
        Clocks that differ by more than `LATEST` say nothing but by how much longer than others a message took.
        """
        if stamp == 0.0:
            return
        self._clock.age(stamp, arrival)
        transit, least = arrival.transit(stamp), self._clock.least
        self._lately.add(abs(transit) if abs(least) < LATEST else transit - least, arrival.running)

    def longest(self, now: float) -> float:
        """Return the longest transit of the last `COUNTED` seconds [s]; 0 without any."""
        return self._lately.largest(now)


def stamp_of(wire: bytes) -> float:
    """Return the stamp [s] of a serialised message that begins with a header: of each one, where few are read."""
    seconds, nanoseconds = struct.unpack_from("<iI" if wire[1] & 1 else ">iI", wire, 4)
    return float(seconds + 1e-9 * nanoseconds)


def takeover_delay(late: float) -> float:
    """Return by how much takeovers are to be later [s], where messages arrive so late [s]: in steps of `LATE_STEP`, up
    to `LATEST`.
    """
    return min(LATEST, LATE_STEP * math.ceil(max(0.0, late) / LATE_STEP - 1e-6))
