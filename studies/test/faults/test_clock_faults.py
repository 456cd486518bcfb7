"""How fast joints were, by a clock that jumps, pauses and runs slowly."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_studies.faults.clock_faults import fastest
from geodesic_motion_studies.faults.record import ArmState

LIMITS = np.array([1.0, 2.0])


def states(stamps: np.ndarray, late: np.ndarray | float = 0.0) -> list[ArmState]:
    """The first joint moves with 0.8 rad/s of real time, 0.01 s of which pass from one state to the next."""
    arrived = 0.01 * np.arange(len(stamps))
    return [
        ArmState(float(at), float(stamp), np.array([0.8 * passed, 0.0]))
        for at, stamp, passed in zip(arrived + late, stamps, arrived, strict=True)
    ]


def test_states_that_arrive_late_are_no_faster() -> None:
    late = np.random.default_rng(0).uniform(0.0, 0.1, 100)
    assert fastest(states(0.01 * np.arange(100.0), late), LIMITS) == pytest.approx(0.8)


def test_by_a_clock_of_half_the_speed_they_are_twice_as_fast() -> None:
    assert fastest(states(0.005 * np.arange(100.0)), LIMITS) == pytest.approx(1.6)


@pytest.mark.parametrize("jump", [5.0, -5.0, -0.2])
def test_a_jump_of_the_clock_is_no_motion_and_hides_none(jump) -> None:
    stamps = 0.01 * np.arange(100.0)
    stamps[50:] += jump
    assert fastest(states(stamps), LIMITS) == pytest.approx(0.8)


def test_a_clock_that_stands_tells_no_speed() -> None:
    assert fastest(states(np.zeros(100)), LIMITS) == 0.0
