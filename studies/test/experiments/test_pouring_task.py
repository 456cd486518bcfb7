"""Three pairs shown, small: poses of the tool are learned, pairs planned, and the bottle kept clear of spheres."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.pose_path import PosePathPlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.pouring_motions import past_a_moving_sphere, pour_all_cups
from geodesic_motion_studies.experiments.pouring_scene import at_bottle, at_cup, bottle_settings
from geodesic_motion_studies.experiments.pouring_task import (
    LITERAL,
    PouringTask,
    PouringTaskReport,
    all_pairs,
    blocked_pairs,
    literal,
    ours,
)
from geodesic_motion_studies.experiments.reshaped_metric import reshape_metric


@pytest.fixture(scope="module")
def report(pouring_poses: Demonstrations, pouring_pose_skill: Skill) -> PouringTaskReport:
    planner = PosePathPlanner(pouring_pose_skill, bottle_settings())
    return PouringTaskReport(
        PouringTask(3, (0,)),
        tuple(all_pairs(ours(planner), pouring_poses, "raw sheet", 0)),
        tuple(blocked_pairs(ours(planner), ours(PosePathPlanner(pouring_pose_skill)), "raw sheet", 0, (0,))),
        (pour_all_cups(planner, 0),),
        past_a_moving_sphere(ReactivePlanner(pouring_pose_skill, replace(bottle_settings(), avoid="tool"))),
        reshape_metric(pouring_pose_skill, pairs=3),
        pouring_poses,
        pouring_pose_skill,
    )


def test_all_nine_pairs_are_reached_along_what_was_shown(report: PouringTaskReport) -> None:
    assert [(item.bottle, item.cup) for item in report.pairs] == [(b, c) for b in range(3) for c in range(3)]
    assert all(item.path is not None for item in report.pairs)
    assert max(item.off for item in report.pairs) < 0.1


def test_a_known_bottle_is_kept_clear_and_an_unknown_one_hits(report: PouringTaskReport) -> None:
    known = [item.with_bottle for item in report.blocked if np.isfinite(item.with_bottle)]
    assert known
    assert min(known) > 0.0
    hand_alone = [item.hand_alone for item in report.blocked if np.isfinite(item.hand_alone)]
    assert len(hand_alone) == 9
    assert max(hand_alone) < 0.0


def test_the_papers_planner_refuses_nothing_and_the_bottle_counts_among_obstacles_alone(
    pouring_poses: Demonstrations, pouring_pose_skill: Skill
) -> None:
    with_bottle, hand_alone = literal(pouring_pose_skill, True), literal(pouring_pose_skill, False)
    pairs = all_pairs(hand_alone, pouring_poses, LITERAL, 0)
    assert all(item.path is not None and item.missed < 0.1 for item in pairs)
    ends = at_bottle(0), at_cup(0), np.empty((0, 3))
    np.testing.assert_array_equal(with_bottle(*ends).positions, hand_alone(*ends).positions)
    blocked = blocked_pairs(with_bottle, hand_alone, LITERAL, 0, (0,))
    assert np.all(np.isfinite([(item.with_bottle, item.hand_alone) for item in blocked]))
    assert any(item.with_bottle != item.hand_alone for item in blocked)


def test_what_is_handed_over_is_complete(report: PouringTaskReport, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert [len(content[part]) for part in ("pairs", "blocked", "chains")] == [9, 9, 1]
    assert content["moving"]["reached"] is True
    assert content["reshaped"]["random_geodesics"]["pairs"] == 3
    assert "9 of 9" in report.table()
    report.draw(tmp_path / "pouring_task.png")
    for name in ("pouring_task.png", "pouring_task_metric.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("wrong", [{"shown": 0}, {"seeds": ()}])
def test_impossible_settings_are_refused(wrong) -> None:
    with pytest.raises(ParameterError):
        PouringTask(**wrong)
