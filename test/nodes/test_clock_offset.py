"""The offset of two clocks is steady while readings are not, and soon another when a clock was set."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.nodes.clock_offset import LARGEST_ERROR, MOST_OUTLIERS, ClockOffset

AHEAD = 1.7e9


def test_late_readings_hardly_move_the_estimate() -> None:
    generator = np.random.default_rng(0)
    offset = ClockOffset()
    times = np.arange(2000) / 240.0
    late = generator.exponential(1e-3, len(times))
    measured = [offset.update(AHEAD + time + wait, time) for time, wait in zip(times, late, strict=True)]
    measured = np.array(measured) - AHEAD
    assert np.all(np.abs(measured[500:] - 1e-3) < 0.5e-3)
    assert np.max(np.abs(np.diff(measured[500:]))) < 0.1e-3


def test_a_drift_is_followed() -> None:
    offset = ClockOffset()
    for time in np.arange(2000) / 240.0:
        measured = offset.update(AHEAD + 1.001 * time, time)
    assert measured - AHEAD == pytest.approx(1e-3 * time, abs=1e-3)


@pytest.mark.parametrize("leap", [-3600.0, -1.1 * LARGEST_ERROR, 1.1 * LARGEST_ERROR, 3600.0])
def test_a_clock_that_was_set_is_believed_soon_and_one_late_reading_never(leap: float) -> None:
    offset = ClockOffset()
    for time in (0.0, 0.1, 0.2):
        offset.update(AHEAD + time, time)
    for _ in range(3):
        for _ in range(MOST_OUTLIERS):
            assert offset.update(AHEAD + 0.3 + leap, 0.3) == pytest.approx(AHEAD, abs=1e-6)
        assert offset.update(AHEAD + 0.4, 0.4) == pytest.approx(AHEAD, abs=1e-6)
    for _ in range(MOST_OUTLIERS + 1):
        measured = offset.update(AHEAD + 0.5 + leap, 0.5)
    assert measured - AHEAD == pytest.approx(leap, abs=1e-6)
