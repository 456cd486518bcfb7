"""A goal at the place where the arm stands: it is answered at once, and nothing moves."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill


def standing(planner: ReactivePlanner, share: float) -> np.ndarray:
    """Let the planner's arm stand at a share of the skill's own motion; the configuration (eta,) there."""
    start, goal = planner.skill.start_pose, planner.skill.goal_pose
    plan = planner.plan(start[:3], start[3:], goal[:3], goal[3:])
    assert plan.reference is not None, plan.verdict.reason
    configuration, _, _ = plan.reference.sample(share * plan.reference.duration)
    planner.stand_at(configuration, now=0.0)
    return configuration


def farthest(planner: ReactivePlanner, ticks: int = 40) -> tuple[str, float]:
    """The reason of the first tick, and the most [rad] that a joint is moved in all."""
    plans = [planner.tick(0.01 * number) for number in range(ticks)]
    assert all(plan.verdict.ok for plan in plans), [plan.verdict.reason for plan in plans]
    moved = [np.ptp(plan.reference.positions, axis=0).max() for plan in plans if plan.reference is not None]
    return plans[0].verdict.reason, max(moved)


@pytest.mark.parametrize("name", ["panda_reach_to_grasp", "ur5_reach", "panda_pouring"])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_goal_where_the_arm_stands_is_answered_at_once_without_a_motion(name: str, share: float) -> None:
    planner = ReactivePlanner(Skill.load(name))
    here = standing(planner, share)
    assert planner.set_goal(*planner.robot.forward(here)).ok
    assert farthest(planner) == ("at the goal", 0.0)
    planner.stand_at(here, now=0.0)
    assert planner.set_goal_configuration(here).ok
    assert farthest(planner) == ("at the goal", 0.0)


@pytest.mark.parametrize("name", ["panda_reach_to_grasp", "panda_pouring"])
def test_a_goal_a_millimetre_away_is_moved_to(name: str) -> None:
    """The control: so near is not there."""
    planner = ReactivePlanner(Skill.load(name))
    here = standing(planner, 1.0)
    position, quaternion = planner.robot.forward(here)
    assert planner.set_goal(position + [0.0, 0.0, 1e-3], quaternion).ok
    reason, moved = farthest(planner, 600)
    assert reason == ""
    assert moved > 0.0
    there, _ = planner.robot.forward(planner.commanded_state(5.99)[0])
    np.testing.assert_allclose(there, position + [0.0, 0.0, 1e-3], atol=1e-4)


def test_where_an_obstacle_covers_the_place_the_arm_is_not_said_to_be_at_its_goal() -> None:
    planner = ReactivePlanner(Skill.load("panda_pouring"))
    here = standing(planner, 1.0)
    position, quaternion = planner.robot.forward(here)
    planner.set_obstacles(centres=[position], radii=[0.03])
    assert planner.set_goal(position, quaternion).ok
    verdict = planner.tick(0.0).verdict
    assert verdict.code is VerdictCode.IN_COLLISION
    assert verdict.reason != "at the goal"


def test_the_same_goal_once_more_changes_nothing_at_an_arm_that_has_arrived() -> None:
    planner = ReactivePlanner(Skill.load("panda_reach_to_grasp"))
    standing(planner, 0.0)
    pose = np.split(planner.skill.goal_pose, [3])
    assert planner.set_goal(*pose).ok
    for number in range(800):
        planner.tick(0.01 * number)
    assert planner.set_goal(*pose).ok
    assert planner.tick(8.0).reference is None
