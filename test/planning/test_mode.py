"""The mode that a plan states: what the arm does, and what may follow it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from geodesic_motion_ros.planning.mode import TRANSITIONS, Mode
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.verdict import Verdict, VerdictCode

TICK = 0.01
HOLD = Verdict(VerdictCode.HOLD_REQUESTED, "a hold was requested")


@pytest.fixture(scope="module")
def planner() -> ReactivePlanner:
    return ReactivePlanner(Skill.load("panda_reach_to_grasp"), PlannerSettings(grid_shape=(30, 30, 30)))


def test_an_arm_is_idle_follows_stops_waits_and_holds(planner: ReactivePlanner) -> None:
    """The goal is covered while it is on its way, and free again; then a hold is requested in motion."""
    skill, modes = planner.skill, []
    planner.stand_at(skill.canonical.start_poles[0], 0.0)
    goal = planner.robot.forward(skill.canonical.goal_poles[0])
    covered = (goal[0][None], np.array([0.08]))
    for number in range(900):
        now = TICK * number
        if number == 5:
            assert planner.set_goal(*goal).ok
        if number in (60, 300):
            assert planner.set_obstacles(*(covered if number == 60 else (np.empty((0, 3)), np.empty(0)))).ok
        held = 340 <= number < 500
        modes.append((planner.stop(now, HOLD) if held else planner.tick(now)).mode)
    seen = [modes[0], *(after for before, after in pairwise(modes) if after is not before)]
    assert seen == [
        Mode.IDLE, Mode.FOLLOWING, Mode.STOPPING, Mode.WAITING, Mode.FOLLOWING, Mode.STOPPING, Mode.HOLDING,
        Mode.FOLLOWING,
    ]  # fmt: skip
    assert all(after in TRANSITIONS[before] for before, after in pairwise(modes))


def test_what_stands_has_nothing_to_stop() -> None:
    assert all((Mode.STOPPING in TRANSITIONS[mode]) is not mode.at_rest for mode in Mode)
