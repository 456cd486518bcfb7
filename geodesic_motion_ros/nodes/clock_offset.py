"""The difference of two clocks, out of readings that are taken a little late each time; knows nothing of ROS."""

from __future__ import annotations

# Share of a new reading in the estimate: readings of about the last hundred count.
SHARE = 0.01
# A difference that differs by more than this [s] is no late reading: one of the clocks was set, or stood still.
LARGEST_ERROR = 0.05


class ClockOffset:
    """Smoothed offset of a clock against another one that runs at the same rate."""

    def __init__(self) -> None:
        self._offset: float | None = None

    def update(self, reading: float, other: float) -> float:
        """Take readings [s] of both clocks; returns the first minus the other [s]."""
        offset = reading - other
        if self._offset is None or abs(offset - self._offset) > LARGEST_ERROR:
            self._offset = offset
        self._offset += SHARE * (offset - self._offset)
        return self._offset
