"""What a skill of the tool does not see, small: solutions are counted right, and the arm's motion alone changes."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import configuration_clearance
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.blocked_arm import hand_alone
from geodesic_motion_studies.experiments.limbs import Limbs, LimbsReport, solved

ROBOT, MODEL = Robot.named("panda"), CollisionModel.named("panda")


@pytest.fixture(scope="module")
def report(reach_pose_skill, reach_skill) -> LimbsReport:
    settings = Limbs(side=15, solutions=20, joint_planner=PlannerSettings(grid_shape=(30, 30, 30)))
    return settings.compared(reach_pose_skill, reach_pose_skill, reach_skill)


def test_solutions_are_counted_and_distinguished() -> None:
    configurations = ROBOT.sample(10, np.random.default_rng(0))
    poses = [ROBOT.forward(configuration) for configuration in configurations]
    positions, quaternions = map(np.array, zip(*poses, strict=True))
    centres, radii = np.array([[0.1, 0.2, 0.5]]), np.array([0.15])
    found = solved(positions, quaternions, centres, radii, 30)
    assert np.all((found.found > 0) & (found.found <= 30))
    assert np.max(found.found) == 30
    assert 0 < found.touched.sum() < found.found.sum()
    for pose, examples in zip(poses, found.examples, strict=True):
        for touched, example in zip((True, False), examples, strict=True):
            if np.all(np.isfinite(example)):
                np.testing.assert_allclose(ROBOT.forward(example)[0], pose[0], atol=1e-9)
                clearance, _ = configuration_clearance(MODEL, ROBOT, example, centres, radii)
                assert (clearance < 0.0) == touched
    # The control: a sphere far away touches nothing.
    assert not solved(positions, quaternions, centres + 5.0, radii, 30).touched.any()


def test_the_tools_path_stays_and_solutions_on_it_are_touched(report) -> None:
    figures = report.summary()
    assert figures["nodes"] == 15 * 15
    assert figures["geodesic_moved_by_the_sphere_mm"] < 1.0
    assert figures["clearance_of_the_tool_mm"] > 50.0
    assert figures["share_touched_on_the_geodesic_most"] > 0.05
    assert figures["supported_nodes_where_some_solution_is_touched"] > 0.0


def test_the_papers_planner_of_the_tool_does_not_see_the_arm_either(report) -> None:
    figures = report.summary()
    assert figures["literal_geodesic_moved_by_the_sphere_mm"] < 1.0
    assert figures["literal_share_touched_on_the_geodesic_most"] > 0.05


def test_where_most_solutions_touch_the_sphere_they_are_more_and_the_hand_is_not_near(report) -> None:
    figures = report.summary()
    assert figures["worst_sphere_share_touched_mean"] > figures["share_touched_on_the_geodesic_mean"]
    # Where the hand is follows from the pose of the tool, so one solution of each pose tells it.
    hand = hand_alone(MODEL)
    some = report.worst.examples[:, 1][np.isfinite(report.worst.examples[:, 1, 0])]
    assert len(some) > 0
    centres = hand.positions(ROBOT, some)
    away = np.linalg.norm(centres - report.worst_centre, axis=-1) - hand.radii - report.radius
    # Between poses at which it was looked for the hand moves on by centimetres.
    assert np.min(away) > 0.05


def test_the_whole_arm_takes_another_path(report) -> None:
    # The control: the motion without the sphere leads through it.
    assert report.nominal_clearance < 0.0
    assert report.avoiding_clearance > 0.0


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert len(content["along"]["found"]) == len(report.path.positions)
    assert "geodesic moved by the sphere mm" in report.table()
    report.draw(tmp_path / "limbs.png")
    assert (tmp_path / "limbs.png").read_bytes().startswith(b"\x89PNG")


def test_skills_and_settings_that_do_not_fit_are_refused(reach_pose_skill, reach_skill) -> None:
    with pytest.raises(ParameterError, match="knows no families"):
        Limbs().compared(reach_pose_skill, reach_pose_skill, replace(reach_skill, canonical=None))
    with pytest.raises(ParameterError, match="at least 2"):
        Limbs(solutions=1)
