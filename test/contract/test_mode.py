"""The mode that a plan states: what the arm does, and what may follow it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from geodesic_motion_ros.contract.mode import TRANSITIONS, Mode
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill

TICK = 0.01
HOLD = Refusal(VerdictCode.HOLD_REQUESTED, "a hold was requested")
#: Of spheres on the goal and falling past the arm [m], how fast that one falls [m/s], and how long [s].
ON_GOAL, FALLING, FALL, PASSING = 0.05, 0.04, np.array([0.0, 0.0, -0.2]), 4.5


@pytest.fixture(scope="module")
def planner(reach_skill: Skill) -> ReactivePlanner:
    return ReactivePlanner(reach_skill, PlannerSettings(grid_shape=(30, 30, 30)))


def test_an_arm_passes_through_all_modes(planner: ReactivePlanner) -> None:
    """The goal is covered while it moves, and it goes near; something falls to where it stands, and past; then
    the goal is free again, and a hold is requested in motion.
    """
    sheet, modes = planner.skill.canonical, []
    goal, robot = sheet.goal_poles[0], planner.robot
    covered = robot.forward(goal)[0]
    now = 0.0

    def run(seconds: float, stopped: bool = False) -> None:
        nonlocal now
        for _ in range(round(seconds / TICK)):
            modes.append((planner.stop(now, HOLD) if stopped else planner.tick(now)).mode)
            now += TICK

    planner.stand_at(sheet.start_poles[0], now)
    run(0.05)
    assert planner.set_goal_configuration(goal).ok
    run(TICK)
    reference, _ = planner.motion_to_goal()
    run(0.5 * reference.duration)
    planner.set_obstacles(covered[None], np.array([ON_GOAL]))
    run(2.0)
    hand, met = robot.forward(planner.commanded_state(now)[0])[0], now + 3.0
    for _ in range(round(PASSING / TICK)):
        centres = np.stack([covered, hand + (now - met) * FALL])
        velocities = np.stack([np.zeros(3), FALL])
        planner.set_obstacles(centres, np.array([ON_GOAL, FALLING]), velocities, now)
        run(TICK)
    planner.set_obstacles(np.empty((0, 3)), np.empty(0))
    run(0.3)
    run(1.0, stopped=True)
    run(0.1)
    seen = [modes[0], *(after for before, after in pairwise(modes) if after is not before)]
    assert seen[:5] == [Mode.IDLE, Mode.FOLLOWING, Mode.APPROACHING, Mode.WAITING, Mode.EVADING]
    assert seen[-4:] == [Mode.FOLLOWING, Mode.STOPPING, Mode.HOLDING, Mode.FOLLOWING]
    assert all(after in TRANSITIONS[before] for before, after in pairwise(modes))


def test_what_stands_has_nothing_to_stop() -> None:
    assert all((Mode.STOPPING in TRANSITIONS[mode]) is not mode.at_rest for mode in Mode)
