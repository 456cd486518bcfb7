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
COVERED = 0.08  # radius of a sphere around the goal [m]


@pytest.fixture(scope="module")
def planner() -> ReactivePlanner:
    return ReactivePlanner(Skill.load("panda_reach_to_grasp"), PlannerSettings(grid_shape=(30, 30, 30)))


def test_an_arm_passes_through_all_modes(planner: ReactivePlanner) -> None:
    """The goal is covered while it is on its way; something comes to where it stands, and passes; then the goal is free
    again, and a hold is requested in motion.
    """
    skill, modes, met = planner.skill, [], 4.0
    planner.stand_at(skill.canonical.start_poles[0], 0.0)
    goal = planner.robot.forward(skill.canonical.goal_poles[0])
    velocity = np.array([0.0, 0.0, -0.2])
    hand = np.zeros(3)
    for number in range(1500):
        now = TICK * number
        if number == 5:
            assert planner.set_goal(*goal).ok
        if number == 60:
            assert planner.set_obstacles(goal[0][None], np.array([COVERED])).ok
        if number == 150:
            hand, _ = planner.robot.forward(planner.commanded(now)[0])
        if 150 <= number < 700:
            centres = np.stack([goal[0], hand + (now - met) * velocity])
            radii, velocities = np.array([COVERED, 0.04]), np.stack([np.zeros(3), velocity])
            assert planner.set_obstacles(centres, radii, velocities, now).ok
        if number == 700:
            assert planner.set_obstacles(np.empty((0, 3)), np.empty(0)).ok
        modes.append((planner.stop(now, HOLD) if 740 <= number < 900 else planner.tick(now)).mode)
    seen = [modes[0], *(after for before, after in pairwise(modes) if after is not before)]
    assert seen[:4] == [Mode.IDLE, Mode.FOLLOWING, Mode.STOPPING, Mode.WAITING]
    assert seen[4] is Mode.EVADING
    assert seen[-4:] == [Mode.FOLLOWING, Mode.STOPPING, Mode.HOLDING, Mode.FOLLOWING]
    assert set(seen) == set(Mode)
    assert all(after in TRANSITIONS[before] for before, after in pairwise(modes))


def test_what_stands_has_nothing_to_stop() -> None:
    assert all((Mode.STOPPING in TRANSITIONS[mode]) is not mode.at_rest for mode in Mode)
