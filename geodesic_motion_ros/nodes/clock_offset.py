"""The difference of two clocks, out of readings that are taken a little late each time; knows nothing of ROS."""

from __future__ import annotations

# Share of a new reading in the estimate: readings of about the last hundred count.
SHARE = 0.01
# Readings further off than this [s] do not count, unless so many in a row are: then one of the clocks was set, or stood
# still for a while.
LARGEST_ERROR = 0.05
MOST_OUTLIERS = 5


class ClockOffset:
    """Smoothed offset of a clock against another one that runs at the same rate."""

    def __init__(self) -> None:
        self._offset: float | None = None
        self._outliers = 0

    def update(self, reading: float, other: float) -> float:
        """Take readings [s] of both clocks; returns the first minus the other [s]."""
        offset = reading - other
        if self._offset is None:
            self._offset = offset
        error = offset - self._offset
        self._outliers = self._outliers + 1 if abs(error) > LARGEST_ERROR else 0
        if self._outliers > MOST_OUTLIERS:
            self._offset, self._outliers = offset, 0
        elif self._outliers == 0:
            self._offset += SHARE * error
        return self._offset
