"""Paths of a hand run along what a skill was learned from, each a little differently."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.simulation.hand_paths import END_SPREAD, HandPath, hand_paths
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError


@pytest.mark.parametrize("name", ["panda_pouring", "panda_reach_to_grasp", "paper_reach"])
def test_paths_lead_from_where_a_skill_starts_to_its_goal(name: str) -> None:
    skill = Skill.load(name)
    paths = hand_paths(skill, 3, seed=0, duration=5.0)
    for path in paths:
        for pose, position in ((skill.start_pose, path.positions[0]), (skill.goal_pose, path.positions[-1])):
            assert np.linalg.norm(position - pose[:3]) < 0.15
        assert np.linalg.norm(np.diff(path.positions, axis=0), axis=1).max() < 0.02
        assert 3.5 < path.times[-1] < 7.0
    first, second = (np.stack([path.positions[0], path.positions[-1]]) for path in paths[:2])
    assert np.linalg.norm(first - second, axis=1).min() > 1e-3


def test_the_same_seed_gives_the_same_paths_and_the_next_round_other_ones(fan_skill: Skill) -> None:
    count = len(fan_skill.codes)
    paths, again = (hand_paths(fan_skill, count + 1, seed=1, duration=2.0) for _ in range(2))
    np.testing.assert_array_equal(paths[0].positions, again[0].positions)
    apart = np.linalg.norm(paths[0].positions[0] - paths[count].positions[0])
    assert 1e-4 < apart < 4.0 * END_SPREAD


def test_a_path_leads_back_along_itself(fan_skill: Skill) -> None:
    (path,) = hand_paths(fan_skill, 1, seed=0, duration=2.0)
    back = path.back()
    for time in (0.0, 0.7, 2.0):
        forth = path.at(path.times[-1] - time)
        np.testing.assert_allclose(back.at(time)[0], forth[0], atol=1e-9)
    np.testing.assert_allclose(path.at(100.0)[0], path.positions[-1])


def test_a_lead_is_straight_and_turns_the_shorter_side() -> None:
    start = np.array([0.4, 0.0, 0.3]), np.array([0.0, 1.0, 0.0, 0.0])
    goal = np.array([0.4, 0.3, 0.3]), -np.array([0.0, 1.0, 0.0, 0.0])
    lead = HandPath.between(start, goal)
    assert lead.times[-1] == pytest.approx(2.0)
    assert np.ptp(lead.positions[:, [0, 2]], axis=0).max() < 1e-12
    assert max(angle_between(start[1], turned) for turned in lead.quaternions) < 1e-6


@pytest.mark.parametrize(("count", "duration"), [(0, 5.0), (1, 0.0), (1, np.nan)])
def test_what_makes_no_path_is_refused(fan_skill: Skill, count: int, duration: float) -> None:
    with pytest.raises(ParameterError):
        hand_paths(fan_skill, count, 0, duration)
