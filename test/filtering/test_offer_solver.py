"""Where a detour for a stream ends: beyond the chunk, or beside its end."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.filtering.offer import Offer
from geodesic_motion_ros.filtering.offer_solver import FREE_PLACE
from geodesic_motion_ros.motion.detour import Detour
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from test.filtering.conftest import BEGIN, MOVED, Filtering

RADIUS, REACH = 0.03, 0.25


def chunk() -> Offer:
    """Half a second straight on, which ends in motion."""
    times = np.arange(16) / 30.0
    return Offer(times, BEGIN + 0.5 * times[:, None] * MOVED)


def along(filtering: Filtering, begin: float, end: float) -> Obstacles:
    """Spheres on the hand's path, from a time [s] of the chunk on to another, as it goes on."""
    times = np.linspace(begin, end, 1 + round((end - begin) / 0.1))
    hands = [filtering.filter.robot.forward(BEGIN + 0.5 * time * MOVED)[0] for time in times]
    return Obstacles.of_spheres(np.array(hands), np.full(len(hands), RADIUS))


@pytest.mark.parametrize("end", [0.6, 20.0], ids=["beyond", "beside"])
def test_a_detour_for_a_chunk_ends_where_the_arm_is_free(filtering: Filtering, end: float) -> None:
    """Spheres cover the end of the chunk, and a little beyond it, or all that follows."""
    solver, obstacles = filtering.filter.arm.solver, along(filtering, 0.5, end)

    def clearance(position: np.ndarray) -> float:
        return obstacle_clearance(solver.collision, solver.robot, position, obstacles)[0]

    assert clearance(chunk().positions[-1]) < 0.0
    detour = solver.find_detour(chunk(), BEGIN, 0.0, obstacles, REACH)
    assert isinstance(detour, Detour)
    goal = detour.query.goal
    assert clearance(goal) >= FREE_PLACE
    # How far the goal lies off the straight line, on which the chunk goes on.
    passed = (goal - BEGIN) @ MOVED / (MOVED @ MOVED)
    beside = np.max(np.abs(goal - BEGIN - passed * MOVED))
    assert (beside < 1e-9) == (end == 0.6)
