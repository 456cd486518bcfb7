"""One skill of the tool on three arms, small: where each is placed, what it plays, and what it says of refusals."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.arm_placement import FORWARD, UP, Placement
from geodesic_motion_studies.experiments.transfer import ARMS, CONTROL, LITERAL, OURS, Transfer, TransferReport
from geodesic_motion_studies.experiments.transferred_motions import PlayedMotion

SETTINGS = Transfer(seeds=(0,), literal_shape=(40, 40))


@pytest.fixture(scope="module")
def report(reach_pose_skill, reach_poses) -> TransferReport:
    """Asked are a demonstration, and one whose start is two metres away."""
    near = reach_poses[0].curve
    far = PoseCurve(near.positions + [0.0, 2.0, 0.0], near.quaternions)
    return SETTINGS.played(
        {0: {OURS: reach_pose_skill, LITERAL: reach_pose_skill}}, [item.curve for item in reach_poses][:2], [near, far]
    )


def motion_of(report: TransferReport, method: str, row: str) -> PlayedMotion:
    (found,) = [
        item.motion for item in report.motions if (item.method, item.row, item.number) == (method, row, 0)
    ]
    assert isinstance(found, PlayedMotion)
    return found


def test_every_arm_is_placed_by_one_rule_and_the_control_where_it_was_shown(report) -> None:
    control, *others = report.placements
    assert control.row == CONTROL
    np.testing.assert_array_equal(control.move, 0.0)
    for placement in others:
        assert placement.move[0] in FORWARD
        assert placement.move[2] in UP
        assert placement.held == 2
        assert 1 <= placement.places <= len(FORWARD) * len(UP)
    # Standing where it was shown is one of the moves of the lattice.
    assert others[ARMS.index("panda")].dexterity >= control.dexterity


def test_what_is_out_of_reach_is_not_held(reach_poses) -> None:
    curves = [item.curve for item in reach_poses][:2]
    placement = Placement.at("far away", "ur5", np.array([5.0, 0.0, 0.0]), curves)
    assert (placement.held, placement.dexterity) == (0, 0.0)


@pytest.mark.parametrize("row", [CONTROL, *ARMS])
def test_our_motion_meets_both_ends_where_the_arm_stands(report, row) -> None:
    motion = motion_of(report, OURS, row)
    (placement,) = [item for item in report.placements if item.row == row]
    robot, shown = Robot.named(placement.arm), report.held_out[0]
    ends = zip(motion.configurations[[0, -1]], (shown.start, shown.goal), strict=True)
    for configuration, (position, quaternion) in ends:
        reached = robot.forward(configuration)
        np.testing.assert_allclose(reached[0], position + placement.move, atol=2e-3)
        assert angle_between(reached[1], quaternion) < 0.02
    assert math.isfinite(motion.lag)
    # Between path and demonstration, the played tool is off by no more than it lags behind the planned one.
    assert abs(motion.played.frechet - motion.planned.frechet) < motion.lag + 2e-3


def test_the_literal_path_is_the_same_for_every_arm(report) -> None:
    errors = [motion_of(report, LITERAL, row).planned for row in (CONTROL, *ARMS)]
    assert all(error == errors[0] for error in errors)


def test_the_planner_refuses_what_no_arm_reaches_and_says_why(report) -> None:
    for row in (CONTROL, *ARMS):
        assert report.summary(OURS, row)["asked"] == 2
        assert report.summary(OURS, row)["answered"] == 1
        (reason,) = report.refusals(OURS, row)
        assert "OUT_OF_SUPPORT" in reason
        assert reason in report.table()


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert set(content["figures"][OURS]) == {CONTROL, *ARMS}
    assert content["figures_of_seeds"][LITERAL]["ur5"]["0"]["asked"] == 2
    assert content["placements"]["iiwa14"]["held"] == 2
    report.draw(tmp_path / "transfer.png")
    assert (tmp_path / "transfer.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("wrong", [{"shown": 0}, {"held_out": 0}, {"seeds": ()}, {"seeds": (-1,)}])
def test_impossible_settings_are_refused(wrong) -> None:
    with pytest.raises(ParameterError):
        Transfer(**wrong)
