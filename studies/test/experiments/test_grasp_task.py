"""Reach to grasp in task space, small: targets are reached as shown, and signs flip where clusters are crossed."""

from __future__ import annotations

import json

import numpy as np
import pytest

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.crossing import measure_crossings
from geodesic_motion_studies.experiments.grasp_task import (
    LITERAL,
    ROWS,
    GraspTask,
    GraspTaskReport,
    arm_along,
    ask_targets,
    path_across,
    requested_ends,
    sign_blind_ratios,
)
from geodesic_motion_studies.experiments.requested_ends import answers_to

SETTINGS = GraspTask(targets=3, ends=2, seeds=(0,))


@pytest.fixture(scope="module")
def report(reach_pose_skill, reach_poses, fan_skill, fan) -> GraspTaskReport:
    ends = requested_ends(reach_poses, reach_poses, SETTINGS, 0)
    literally = PaperPlanner(fan_skill).tool_curve
    return GraspTaskReport(
        SETTINGS,
        tuple(ask_targets({ROWS[0]: reach_pose_skill}, literally, reach_poses, 0, SETTINGS)),
        tuple(answers_to(ends[::2], {ROWS[0]: reach_pose_skill}, reach_poses, 0, {LITERAL: literally})),
        {0: measure_crossings(fan_skill, [item.curve for item in fan[:2]])},
        sign_blind_ratios(reach_pose_skill, reach_poses.split(tuple(range(2, 8)))[0]),
        reach_poses,
        path_across(fan_skill, fan),
    )


def test_targets_are_reached_along_what_was_shown_and_straight_lines_are_not(report) -> None:
    canonical, line = report.summary(ROWS[0]), report.summary(ROWS[2])
    assert canonical["answered"] == canonical["targets"] == line["targets"] == 3
    assert canonical["turn_deg"] == pytest.approx(90.0, abs=8.0)
    assert canonical["farthest_off_mm"] < 0.7 * line["off_mm"]
    assert report.summary(ROWS[1])["off_mm"] is None


def test_our_ends_are_the_requested_ones_and_the_papers_are_where_its_model_decodes_to(report) -> None:
    """The model of this test's literal row was shown another motion: it answers, and its ends are elsewhere."""
    assert report.summary(ROWS[0])["missed_mm"] < 1e-3
    literal = report.summary(LITERAL)
    assert literal["answered"] == literal["targets"] == 3
    assert literal["missed_mm"] > 10.0
    assert {item.method for item in report.answers} == {ROWS[0], LITERAL, ROWS[3]}


def test_the_arm_of_the_picture_follows_the_path_without_a_jump(report) -> None:
    path = next(item.path for item in report.targets if item.path is not None)
    configurations, robot = arm_along(path, 40), Robot.named("panda")
    even = path.resample(40)
    for configuration, position, quaternion in zip(configurations, even.positions, even.quaternions, strict=True):
        reached = robot.forward(configuration)
        np.testing.assert_allclose(reached[0], position, atol=1e-3)
        assert angle_between(reached[1], quaternion) < 0.01
    assert np.abs(np.diff(configurations, axis=0)).max() < 0.5


def test_the_sign_flips_once_across_and_never_within(report) -> None:
    drawn = report.drawn
    assert drawn.quaternions_within[0] @ drawn.quaternions_within[-1] > 0.0
    assert np.all(np.sum(drawn.quaternions_within[1:] * drawn.quaternions_within[:-1], axis=1) > 0.0)
    steps = np.sum(drawn.quaternions_across[1:] * drawn.quaternions_across[:-1], axis=1)
    assert steps[drawn.flip] == np.min(steps)
    assert drawn.quaternions_across[0] @ drawn.quaternions_within[0] > 0.9
    assert drawn.quaternions_across[-1] @ drawn.quaternions_within[-1] < -0.9


def test_crossing_costs_between_clusters_and_nothing_where_signs_are_not_known(report) -> None:
    assert report.crossing_summary(0)["least_ratio"] > 10.0
    assert max(report.sign_blind) < 2.0


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert content["targets"][ROWS[0]]["answered"] == 3
    assert content["crossing"]["0"]["paths"] == 2
    assert content["energy_criterion"]["0"]["whole box"]["across_offered"] == 2
    assert content["ends"]["along"][ROWS[0]]["requested"] == 1
    assert "straight line" in report.table()
    assert "200 mm beyond" in report.table()
    report.draw(tmp_path / "grasp_task.png")
    assert (tmp_path / "grasp_task.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("wrong", [{"targets": 0}, {"ends": 0}, {"seeds": ()}, {"seeds": (-1,)}])
def test_impossible_settings_are_refused(wrong) -> None:
    with pytest.raises(ParameterError):
        GraspTask(**wrong)
