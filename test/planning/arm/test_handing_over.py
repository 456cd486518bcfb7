"""What is handed out may be late, or not be sent: what is played goes on."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.utils.errors import PlanningError

#: Of positions [rad], velocities and accelerations where one trajectory takes over from another.
ROUNDING = 1e-6
LATE = 0.08


@pytest.fixture
def blocked(planner: ReactivePlanner, on_elbow: tuple[np.ndarray, np.ndarray]) -> Obstacles:
    """A sphere on the path of the elbow: the present path is left for another one, or stopped on."""
    centres, radii = on_elbow
    return Obstacles.of_spheres(centres, radii)


def played(planner: ReactivePlanner, times: np.ndarray) -> np.ndarray:
    return np.array([np.concatenate(planner.commanded_state(float(time))) for time in times])


def test_until_it_takes_over_a_new_trajectory_repeats_the_old_one_however_late_it_is(stream, planner, nominal, blocked):
    stream.run(0.4 * nominal.duration)
    now = stream.now
    planner.set_late(LATE)
    try:
        planner.take_obstacles(blocked)
        until = now + planner.settings.latency + LATE
        times = np.linspace(now, until, 50)
        before, later = played(planner, times), played(planner, times + 0.5)
        plan = planner.tick(now)
    finally:
        planner.set_late(0.0)
    assert plan.reference is not None
    assert planner.takeover >= until
    np.testing.assert_allclose(played(planner, times), before, atol=ROUNDING)
    assert np.max(np.abs(played(planner, times + 0.5) - later)) > 1e-3


def test_what_was_not_sent_is_taken_back_and_the_next_tick_finds_it_again(stream, planner, nominal, blocked):
    stream.run(0.4 * nominal.duration)
    now = stream.now
    times = np.linspace(now, now + nominal.duration, 200)
    before, motion = played(planner, times), planner.motion_to_goal()
    planner.take_obstacles(blocked)
    plan = planner.tick(now)
    assert plan.reference is not None
    assert np.max(np.abs(played(planner, times) - before)) > 1e-3
    planner.withdraw()
    np.testing.assert_array_equal(played(planner, times), before)
    assert planner.motion_to_goal()[0] is motion[0]
    again = planner.tick(now)
    assert again.verdict.code is plan.verdict.code
    np.testing.assert_allclose(again.reference.positions, plan.reference.positions, atol=ROUNDING)


@pytest.mark.parametrize("late", [-0.01, np.nan, np.inf])
def test_no_message_arrives_before_it_is_sent(planner, late):
    with pytest.raises(PlanningError, match="late"):
        planner.set_late(late)
