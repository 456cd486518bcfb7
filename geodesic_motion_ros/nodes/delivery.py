"""How late what is sent arrives, as it is measured. Knows nothing of ROS.

A trajectory that takes over repeats the one before until then, so one that arrives in time gives no step of the
command, and one that arrives later does. No controller says when it has heard one. What is measured is how long
messages of the arm take to here, and how long they pause: while its process stands still it hears nothing either; and
how late cycles send what they have found.
"""

from __future__ import annotations

import math
import struct
from collections import deque

from geodesic_motion_ros.nodes.node_time import Moment
from geodesic_motion_ros.nodes.sender_clock import SenderClock

#: What was measured counts for so long [s]: a busy machine is late again and again.
COUNTED = 5.0
#: Takeovers move by steps of this [s], and by no more than that, for reactions are as much later; messages are later
#: where the machine is too busy, or the clocks differ.
LATE_STEP, LATEST = 0.01, 0.15
#: Stamps of which none is less far off [s] are of another clock.
OTHER_CLOCK = 0.25
#: One figure is kept of so long [s].
_SPAN = 0.5
#: A message that comes so long [s] after the one before is the first after a silence, of which others judge.
_SILENCE = 0.5


class Lately:
    """The largest figure of the last `COUNTED` seconds."""

    def __init__(self) -> None:
        # When each span began [s], and the largest figure in it.
        self._spans: deque[tuple[float, float]] = deque(maxlen=math.ceil(COUNTED / _SPAN) + 2)

    def add(self, figure: float, now: float) -> None:
        """Count a figure from now on [s]."""
        if self._spans and now - self._spans[-1][0] < _SPAN:
            begun, largest = self._spans[-1]
            self._spans[-1] = begun, max(largest, figure)
        else:
            self._spans.append((now, figure))

    def largest(self, now: float) -> float:
        """Return the largest figure, as of now [s]; 0 where there is none."""
        return max((largest for begun, largest in self._spans if begun >= now - COUNTED - _SPAN), default=0.0)


class TransitWatch:
    """How late messages of one sender come, at most: by their stamps, and by the pauses between them."""

    def __init__(self) -> None:
        self._clock, self._lately = SenderClock(), Lately()
        # When this span began [s], and how many messages have come in it; a pause that messages come at [s].
        self._begun, self._count, self._period = -math.inf, 0, math.inf
        self._newest = -math.inf

    def take(self, stamp: float, arrival: Moment) -> None:
        """Take a message with a stamp [s], 0 for none, as it arrives.

        A stamp of the future says that the clocks differ, and by how much less this one hears of what is sent in time.
        Clocks that differ by more than `OTHER_CLOCK` say nothing but by how much longer than others a message took.
        """
        now, period = arrival.running, self._period
        late = max(0.0, self._end_pause(now) - period)
        if stamp != 0.0:
            self._clock.age(stamp, arrival)
            transit, least = arrival.transit(stamp), self._clock.least
            late = max(late, abs(transit) if abs(least) < OTHER_CLOCK else transit - least)
        # What is later than that was stamped by a clock that was set since, or before a simulated one was heard.
        if late < COUNTED:
            self._lately.add(late, now)

    def _end_pause(self, now: float) -> float:
        """Take note that a message comes now [s], and return how long nothing had come before; 0 after a silence."""
        pause, self._newest = now - self._newest, now
        if now - self._begun >= _SPAN:
            # Of the first span nothing is known.
            self._period = (now - self._begun) / self._count if self._count else math.inf
            self._begun, self._count = now, 0
        self._count += 1
        return pause if pause < _SILENCE else 0.0

    def longest(self, now: float) -> float:
        """Return by how much the latest of the last `COUNTED` seconds was late [s]; 0 without any."""
        return self._lately.largest(now)

    def remark(self, now: float) -> str:
        """Return what a person should know of it, where it is more than can be allowed for; "" where it is not."""
        longest = self.longest(now)
        if longest <= LATEST:
            return ""
        return (
            f"messages of the arm came up to {1e3 * longest:.0f} ms late: a trajectory that late does not reach it in "
            f"time, which is planned for with {1e3 * LATEST:.0f} ms. Once, as programs start: nothing to do; again and "
            "again: the machine or the network is too busy"
        )


def stamp_of(wire: bytes) -> float:
    """Return the stamp [s] of a serialised message that begins with a header: of each one, where few are read."""
    seconds, nanoseconds = struct.unpack_from("<iI" if wire[1] & 1 else ">iI", wire, 4)
    return float(seconds + 1e-9 * nanoseconds)


def takeover_delay(late: float) -> float:
    """Return by how much takeovers are to be later [s], where messages arrive so late [s]: in steps of `LATE_STEP`, up
    to `LATEST`.
    """
    return min(LATEST, LATE_STEP * math.ceil(max(0.0, late) / LATE_STEP - 1e-6))
