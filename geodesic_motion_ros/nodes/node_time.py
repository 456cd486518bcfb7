"""The time that a node lives by: real, or that of a simulation, which may stand, run slowly or fast, and be set.

A float of seconds since 1970 is a multiple of 0.24 us, in which an arm moves far enough to break the limit of its jerk.
So the node counts its seconds from when it began; a message is stamped with them and a whole number of nanoseconds.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

# A real clock that gains or loses this much [s] against the steady one from one look to the next was set.
_SET = 0.5
# So was a simulated one that goes on by more [s] at once.
_LONGEST_STEP = 2.0


class RosTime(Protocol):
    """The part of rclpy's Time that is used."""

    nanoseconds: int


class RosClock(Protocol):
    """The part of rclpy's ROSClock that is used."""

    @property
    def ros_time_is_active(self) -> bool:
        """Whether it shows the time of `/clock`."""

    def now(self) -> RosTime:
        """Return the time that messages are stamped with."""


@dataclass(frozen=True)
class Moment:
    """One reading of the node's clocks.

    Attributes
    ----------
    now : the ROS clock since the node began [s], without its jumps.
    running : the real time that has passed [s]; while a simulated clock is published, its time. It never goes back, and
        does not count jumps of a clock.
    simulated : whether the ROS clock is a simulated one.
    set_by : sum of all jumps of the ROS clock so far [s].
    ros_time : the ROS clock, as messages are stamped [ns].
    stood : for how long a simulated clock has shown the same, of real time [s]; 0 of a real one.
    """

    now: float
    running: float
    simulated: bool
    set_by: float
    ros_time: int
    stood: float = 0.0

    @property
    def has_clock(self) -> bool:
        """Whether the ROS clock shows a time: one that is to be simulated is at 0 until `/clock` is published."""
        return not (self.simulated and self.ros_time == 0)

    def transit(self, stamp: float) -> float:
        """Return how long a message that arrives now was in transit by its stamp, both [s]: 0 without a stamp, less
        than that with one of the future.

        It is asked on arrival and never again: what becomes of the clock later makes nothing older.
        """
        return 0.0 if stamp == 0.0 else 1e-9 * self.ros_time - stamp


class NodeTime:
    """The time of a ROS clock and of the steady one; any thread may ask."""

    def __init__(self, clock: RosClock, steady: Callable[[], int] = time.monotonic_ns) -> None:
        """steady : [ns]."""
        self._clock, self._steady = clock, steady
        self._lock = threading.Lock()
        self._now, self._steady_now = clock.now().nanoseconds, steady()
        self._began = self._now
        self._running = self._steady_now
        self._set_by = 0
        self._moved_on = self._steady_now

    def read(self) -> Moment:
        """Return the time now."""
        with self._lock:
            simulated = self._clock.ros_time_is_active
            now, steady = self._clock.now().nanoseconds, self._steady()
            step, real = now - self._now, steady - self._steady_now
            if simulated:
                # however long nobody looked: a clock that stands, or runs slowly, was not set
                jump = 0 if 0 <= step <= 1e9 * _LONGEST_STEP else step
                self._running += step - jump
            else:
                jump = 0 if abs(step - real) <= 1e9 * _SET else step - real
                self._running += real
            self._set_by += jump
            if step != 0 or not simulated:
                self._moved_on = steady
            self._now, self._steady_now = now, steady
            passed = now - self._began - self._set_by
            stood = 1e-9 * (steady - self._moved_on)
            return Moment(1e-9 * passed, 1e-9 * self._running, simulated, 1e-9 * self._set_by, now, stood)

    def ros_time(self, now: float) -> int:
        """Return what the ROS clock shows [ns] at a time as of `Moment.now` [s]."""
        # One number is read: without the lock, for which a control loop would wait while others ask for the time.
        return self._began + self._set_by + round(1e9 * now)

    def running(self) -> float:
        """Return `Moment.running` now."""
        return self.read().running
