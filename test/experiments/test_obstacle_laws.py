"""The laws compared: on the same scenes, which the way without obstacles hits, and with figures that are true."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.experiments import obstacle_laws
from geodesic_motion_ros.experiments.arm_queries import body_spheres, distances
from geodesic_motion_ros.experiments.obstacle_laws import LawAnswer, LawsReport, compare_laws, draw_laws
from geodesic_motion_ros.graph.ambient import LAWS
from geodesic_motion_ros.joint_planner import JointSpacePlanner
from geodesic_motion_ros.planner_settings import JointPlannerSettings
from geodesic_motion_ros.skill import Skill

COARSE = JointPlannerSettings(grid_shape=(30, 30, 30))
SCENES = 6


@pytest.fixture(scope="module")
def report(reach_skill: Skill) -> LawsReport:
    return compare_laws(reach_skill, SCENES, settings=COARSE)


def test_every_law_answers_every_scene_and_what_it_answers_is_clear(report: LawsReport, tmp_path: Path) -> None:
    for law in LAWS:
        answers = report.of(law)
        assert [answer.scene for answer in answers] == list(range(SCENES))
        for answer in answers:
            assert answer.answered == math.isfinite(answer.clearance) == math.isfinite(answer.length)
            assert not answer.clearance <= 0.0
    assert any(answer.answered for answer in report.answers)
    assert report.table().count("\n") == 2 + len(LAWS) + 1
    draw_laws(report, tmp_path / "laws.png")
    assert (tmp_path / "laws.png").stat().st_size > 10_000


def test_the_way_without_obstacles_comes_near_every_sphere_and_its_ends_do_not(reach_skill: Skill) -> None:
    planner = JointSpacePlanner(reach_skill, COARSE)
    for number in range(3):
        query, nominal, centres, radii = obstacle_laws._scene(planner, np.random.default_rng([0, number]), number)
        assert len(radii) == 1 + number % 2
        way = body_spheres(planner, obstacle_laws._postures(nominal))
        ends = body_spheres(planner, np.stack([query.start, query.goal]))
        for centre, radius in zip(centres, radii, strict=True):
            assert distances(planner, way, centre, radius).min() < obstacle_laws.NEAR
            assert distances(planner, ends, centre, radius).min() >= obstacle_laws.FREE_END


def test_clearance_and_length_are_of_the_scenes_that_all_laws_solve() -> None:
    def answer(law, scene, clearance, length):
        return LawAnswer(law, scene, 1, not math.isnan(clearance), clearance, length, 0.1)

    shared = [answer(law, 0, 0.01 * (1 + number), 1.1) for number, law in enumerate(LAWS)]
    lone = [answer(law, 1, 0.5 if law == "hard" else math.nan, 9.0) for law in LAWS]
    report = LawsReport("skill", (*shared, *lone))
    assert report.common == [0]
    rows = report.summary()
    assert [rows[law]["clearance_median"] for law in LAWS] == pytest.approx([0.01, 0.02, 0.03])
    assert [rows[law]["infeasible"] for law in LAWS] == [0.5, 0.5, 0.0]
    assert {rows[law]["length_median"] for law in LAWS} == {1.1}


def test_what_cannot_be_compared_is_refused(reach_skill: Skill) -> None:
    with pytest.raises(ParameterError, match="at least 1"):
        compare_laws(reach_skill, 0)
    with pytest.raises(ParameterError, match="task space"):
        compare_laws(Skill.load("panda_pouring"), 1)
