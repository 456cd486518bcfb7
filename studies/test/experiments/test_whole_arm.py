"""Whole-arm avoidance, small: another path is taken, a blocked task refused, and PyBullet counts no contact."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import configuration_clearance
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.arm_queries import draw_query
from geodesic_motion_studies.experiments.blocked_arm import FREE_HAND, KINDS, BlockedPaths, hand_alone
from geodesic_motion_studies.experiments.moving_arm import MovingArmRun, MovingArmStage, nominal_arm
from geodesic_motion_studies.experiments.moving_spheres import DISTANCE_AT_REST, MovingSphere, draw_spheres
from geodesic_motion_studies.experiments.tubes import tube_path
from geodesic_motion_studies.experiments.whole_arm import (
    WholeArm,
    WholeArmReport,
    switch_strip,
)

COARSE = PlannerSettings(grid_shape=(30, 30, 30))


@pytest.fixture(scope="module")
def paths(reach_skill: Skill) -> BlockedPaths:
    return BlockedPaths(reach_skill, COARSE)


@pytest.fixture(scope="module")
def stage(reach_skill: Skill) -> MovingArmStage:
    return MovingArmStage(reach_skill, COARSE, seed=0)


@pytest.fixture(scope="module")
def report(paths: BlockedPaths, stage: MovingArmStage) -> WholeArmReport:
    settings = WholeArm(scenes=2, moving_scenes=1, planner=COARSE)
    blocked = {kind: [paths.scene(kind, number, 0) for number in range(2)] for kind in KINDS}
    tubes = [tube_path(stage.planner, number, 0) for number in range(4)]
    return WholeArmReport(settings, tubes, blocked, [stage.scene(0)])


def test_paths_keep_to_one_tube_whose_it_is(report) -> None:
    assert [path.family for path in report.tubes] == [0, 1, 0, 1]
    assert all(path.kept and not path.reason for path in report.tubes)
    # Both families share starts and goals, and one of them is cheaper: the control that paths of others are found.
    assert {path.own for path in report.tubes} == {True, False}
    assert report.tube_summary() == {"pairs": 4, "in_their_own_familys_tube": 2, "in_one_tube": 4, "no_path": 0}


def test_another_family_is_taken_where_one_is_blocked(report, paths) -> None:
    for scene in report.blocked["one path"]:
        # The control: without avoidance the arm would be in the sphere.
        assert paths.clearance(scene.nominal.positions, scene.centres, scene.radii) < 0.0
        assert scene.answer.switched
        assert scene.answer.clearance > 0.0
        assert scene.answer.certified <= scene.answer.clearance + 1e-4


def test_what_is_answered_where_all_paths_are_blocked_is_clear(report, paths) -> None:
    for scene in report.blocked["all paths"]:
        assert all(paths.clearance(path, scene.centres, scene.radii) < 0.0 for path in scene.query.mean_paths)
        assert not scene.answer.hits
        assert scene.answer.answered or scene.answer.reason


def test_an_elbow_is_hit_by_who_knows_the_hand_alone(report) -> None:
    model, robot = hand_alone(CollisionModel.named("panda")), Robot.named("panda")
    for scene in report.blocked["elbow"]:
        for configuration in scene.nominal.positions[::10]:
            distance, _ = configuration_clearance(model, robot, configuration, scene.centres, scene.radii)
            assert distance > FREE_HAND - 0.01
        assert scene.hand_only.hits
        assert not scene.answer.hits


def test_the_same_seed_makes_the_same_scene(report, paths) -> None:
    again = paths.scene("one path", 1, 0)
    np.testing.assert_array_equal(again.centres, report.blocked["one path"][1].centres)
    assert again.answer == report.blocked["one path"][1].answer
    assert not np.array_equal(paths.scene("one path", 1, 1).centres, again.centres)


def test_moving_spheres_touch_no_moving_arm_and_the_command_is_smooth(report) -> None:
    (scene,) = report.moving
    assert scene.replans > 0
    assert scene.contacts.count("moving") == 0
    assert scene.control > 0
    assert scene.excess == 0
    assert max(scene.strains) < 1.0
    assert scene.step < 1e-6


def test_spheres_begin_clear_of_the_arm(stage) -> None:
    random = np.random.default_rng(3)
    _, nominal = draw_query(stage.planner, random)
    model, robot = CollisionModel.named("panda"), Robot.named("panda")
    for sphere in draw_spheres(nominal_arm(stage.planner, nominal), random):
        posture = nominal.sample(sphere.appears)[0]
        distance, _ = configuration_clearance(
            model, robot, posture, sphere.begin[None], np.array([sphere.radius])
        )
        assert distance >= DISTANCE_AT_REST


def test_who_is_to_blame_for_a_contact_is_judged(stage) -> None:
    query, nominal = draw_query(stage.planner, np.random.default_rng(0))
    elbow = elbow_position(stage.planner.robot, query.start)
    # Into an arm that cannot leave, for its goal is covered; and out of nothing in front of one that moves.
    hand, _ = stage.planner.robot.forward(query.goal)
    blocking = MovingSphere(0.06, 0.0, 30.0, hand, np.zeros(3), False)
    driven = MovingSphere(0.04, 0.0, 30.0, elbow + [0.0, 0.0, 0.3], np.array([0.0, 0.0, -0.4]), False)
    scene = MovingArmRun(stage.planner, stage.world, stage.geometry, query, [blocking, driven]).play(0, longest=1.5)
    assert scene.contacts == ("standing",)
    assert not scene.reached
    sudden = MovingSphere(
        0.05, 2.0, 2.2, elbow_position(stage.planner.robot, nominal.sample(2.0)[0]), np.zeros(3), False
    )
    scene = MovingArmRun(stage.planner, stage.world, stage.geometry, query, [sudden]).play(0, longest=2.3)
    assert scene.contacts == ("no room",)


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "whole_arm.json", report.as_dict()).read_text())
    assert content["tubes"]["summary"]["pairs"] == len(content["tubes"]["pairs"]) == 4
    assert content["one path"]["summary"]["switched"] == 2
    assert content["elbow"]["summary"]["hand_only_hits"] == 2
    assert content["moving"]["summary"]["contacts_moving"] == 0
    assert "hand alone hits" in report.table()
    replace(report, blocked={"all paths": report.blocked["all paths"]}).draw(tmp_path / "whole_arm.png")
    assert (tmp_path / "whole_arm.png").read_bytes().startswith(b"\x89PNG")


def test_the_picture_shows_the_sphere_in_its_lower_row_alone(report) -> None:
    picture = switch_strip(report.blocked["elbow"][0], width=64, height=48).astype(int)
    assert picture.shape == (2 * 48, 5 * 64, 3)
    red = (picture[..., 0] > 150) & (picture[..., 1] < 100) & (picture[..., 2] < 100)
    assert not np.any(red[:48])
    assert np.any(red[48:])


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [({"parts": ("all",)}, "choose from tubes"), ({"parts": ()}, "choose from"), ({"seed": -1}, "at least 0"),
     ({"scenes": 0}, "at least 1")],
)  # fmt: skip
def test_impossible_settings_are_refused(wrong, reason) -> None:
    with pytest.raises(ParameterError, match=reason):
        WholeArm(**wrong)


def test_skills_of_task_space_are_refused(reach_skill) -> None:
    with pytest.raises(ParameterError, match="task space"):
        WholeArm().measured(replace(reach_skill, space="task"))
