"""The clock of commands: the arm's own, drawn to the machine's without a jump."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.hardware.robot_clock import RATE, SLEW, RobotClock

PERIOD = 1e-3


@pytest.mark.parametrize("offset", [-0.03, 0.0, 0.02])
def test_it_is_drawn_to_what_is_shown_and_never_jumps(offset: float) -> None:
    random = np.random.default_rng(0)
    clock, times = RobotClock(0.0), []
    for number in range(1, 20_001):
        # arrivals jitter by a millisecond, and the other clock gains 50 ppm
        shown = offset + PERIOD * number * (1.0 + 5e-5) + random.exponential(1e-3)
        times.append(clock.step(PERIOD, shown))
    steps = np.diff([0.0, *times])
    assert np.all(np.abs(steps / PERIOD - 1.0) <= RATE + 1e-12)
    assert np.all(np.abs(np.diff(steps / PERIOD)) <= SLEW + 1e-9)
    # jitter is late by a millisecond on average
    assert abs(times[-1] - (offset + 20.0 * (1.0 + 5e-5) + 1e-3)) < 1e-3


def test_by_the_time_of_the_arm_alone_it_goes_on_exactly() -> None:
    clock = RobotClock(1.5)
    for _ in range(3):
        clock.step(PERIOD, None)
    assert clock.now == pytest.approx(1.503, abs=1e-15)
