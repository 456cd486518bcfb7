"""Families of grasps, small: two planners are queried alike and judged alike, and what they do is counted."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.paper.paper_planner import PaperPlanner
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.arm_players import Families, LiteralArm, OurArm, settings_table
from geodesic_motion_studies.experiments.grasp_joint import (
    COVERED,
    GraspJoint,
    GraspJointReport,
    SkillReport,
    all_scenes,
    among_blocking,
    answered,
    family_energies,
)
from geodesic_motion_studies.experiments.grasp_joint_scenes import Stage

COARSE = PlannerSettings(grid_shape=(30, 30, 30))
SMALL = JointTrainingSettings(
    steps=700, hidden=(64, 32), samples=80, kernels=100, batch=128, precision_samples=2, precision_iterations=60
)
ROBOT = Robot.named("panda")
BOX = (20, 20, 20)


@pytest.fixture(scope="module")
def report(stored, separated_demonstrations, reach_demonstrations, reach_skill) -> GraspJointReport:
    apart = stored("separated", lambda: train_skill(separated_demonstrations, SMALL))
    sets = {"separated": (apart, separated_demonstrations), "meeting": (reach_skill, reach_demonstrations)}
    skills, drawn, made, again = [], {}, [], {}
    for kind, (skill, shown) in sets.items():
        families = Families.of(shown, 2)
        # Families of the second skill meet at both ends alone.
        stage, planner = Stage(families, connected=kind == "meeting"), ReactivePlanner(skill, COARSE)
        scenes, again[kind] = all_scenes(stage, 3), stage.again
        ours, literal = OurArm(planner, families), LiteralArm(PaperPlanner(skill, shape=BOX), families)
        blocked = among_blocking(literal, stage, planner)
        skills += [
            SkillReport("ours", kind, 0, answered(ours, stage, scenes), family_energies(skill, BOX)),
            SkillReport("literal", kind, 0, answered(literal, stage, scenes), blocked=blocked),
        ]
        drawn |= {("ours", kind): planner, ("literal", kind): planner}
        made += [(f"{player.name}, {kind}", player, SMALL) for player in (ours, literal)]
    return GraspJointReport(GraspJoint(4, (0,), 3, COARSE), tuple(skills), settings_table(made), again, drawn)


def test_ours_never_hits_and_the_paper_s_planner_never_refuses(report) -> None:
    for skill in report.skills:
        kinds = {answer.kind for answer in skill.answers if not answer.scene.covered}
        assert ("hits" if skill.row == "ours" else "refused") not in kinds
        assert all(answer.reason == COVERED for answer in skill.answers if answer.scene.covered)
    for skill in report.skills[::2]:
        for answer in skill.answers:
            if answer.played is not None and len(answer.scene.radii):
                assert answer.played.promised <= answer.clearance + 1e-4


def test_without_a_sphere_every_family_s_own_path_is_taken(report) -> None:
    for skill in report.skills[:2]:
        free = [answer for answer in skill.answers if not len(answer.scene.radii)]
        assert [answer.passed for answer in free] == [(0,), (1,)]


def test_both_rows_are_asked_for_the_same_scenes(report) -> None:
    for ours, literal in (report.skills[:2], report.skills[2:]):
        for mine, other in zip(ours.answers, literal.answers, strict=True):
            assert mine.scene is other.scene


def test_spheres_that_are_put_to_block_make_the_paper_s_path_dearer(report) -> None:
    for skill in report.skills[1::2]:
        of = {}
        for name, answer in skill.blocked:
            of.setdefault(name, []).append(answer.played.cost)
        assert np.all(np.array(of["all blocked"]) > np.array(of["free"]))
        assert np.all(np.array(of["one family blocked"]) >= np.array(of["free"]) - 1e-9)
    across = [answer for name, answer in report.skills[1].blocked if "another" in name]
    assert [answer.scene.goals for answer in across] == [((1,),), ((0,),)]


def test_a_wall_stands_between_families_that_never_meet(report) -> None:
    energies = report.skills[0].energies
    assert np.min(energies.across) > 20.0 * np.max(energies.within)
    assert np.max(np.diag(energies.dearest)) < energies.edge_limit
    # The control: there is none between those that begin and end alike.
    joined = report.skills[2].energies
    assert np.max(joined.across) < 2.0 * np.max(joined.within)


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert [len(skill["scenes"]) for skill in content["skills"]] == [8, 8, 7, 7]
    assert [len(skill["blocked"]) for skill in content["skills"]] == [0, 8, 0, 3]
    table = report.table()
    for text in ("canonical", "whole 20x20x20", "support in 30x30x30", "something left", "one family blocked"):
        assert text in table
    report.draw(tmp_path / "grasp_joint.png")
    assert (tmp_path / "grasp_joint.png").read_bytes().startswith(b"\x89PNG")


def test_settings_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ParameterError, match="at least 2"):
        GraspJoint(shown=1)
    with pytest.raises(ParameterError, match="places"):
        replace(GraspJoint(), places=0)
    with pytest.raises(ParameterError, match="seeds"):
        GraspJoint(seeds=())
