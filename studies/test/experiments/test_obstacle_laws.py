"""The laws compared: on the same scenes, with true figures; what is hard keeps clear, what is soft alone does not."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments.obstacle_law_scenes import BETWEEN
from geodesic_motion_studies.experiments.obstacle_laws import (
    CONTROL,
    LAWS,
    Law,
    LawAnswer,
    LawsReport,
    ObstacleLaws,
)

COARSE = PlannerSettings(grid_shape=(30, 30, 30))
SOFT, HARD = Law("soft alone", 100.0, 0.5), Law("hard alone")
FEW = (SOFT, HARD, Law("soft and hard", 1000.0, 0.5), Law("completed", 1000.0, 0.5))
SCENES = 12


@pytest.fixture(scope="module")
def report(reach_skill: Skill) -> LawsReport:
    return ObstacleLaws(scenes=SCENES, laws=FEW, planner=COARSE).measured(reach_skill)


def test_what_is_hard_answers_with_free_paths_alone(report: LawsReport) -> None:
    for law in FEW:
        answers = report.of(law)
        assert [answer.scene for answer in answers] == list(range(SCENES))
        for answer in answers:
            assert answer.answered == math.isfinite(answer.clearance) == math.isfinite(answer.deviation)
            assert answer.answered >= answer.under_cap
            assert not (law.is_hard and answer.clearance <= 0.0)
            assert not (answer.hits and answer.clearance > 0.0)
    assert any(answer.answered for answer in report.of(HARD))


def test_the_soft_law_alone_never_refuses_and_goes_through(report: LawsReport) -> None:
    assert all(answer.answered for answer in report.of(SOFT))
    refused = {answer.scene for answer in report.of(HARD) if not answer.answered}
    through = {answer.scene for answer in report.of(SOFT) if answer.clearance < 0.0}
    assert refused
    assert refused <= through


def test_the_control_is_the_path_without_obstacles(report: LawsReport) -> None:
    for answer in report.of(CONTROL):
        nearest, farthest = BETWEEN[answer.sphere]
        assert nearest <= answer.clearance <= farthest
        assert answer.deviation == pytest.approx(0.0, abs=1e-12)
        assert answer.length == 1.0


def test_table_and_picture(report: LawsReport, tmp_path: Path) -> None:
    assert report.table().count("\n") == 2 + 1 + len(FEW) + 1
    report.draw(tmp_path / "laws.png")
    assert (tmp_path / "laws.png").stat().st_size > 10_000


def test_strengths_widths_and_laws_reach_the_planner() -> None:
    assert len(LAWS) == len(set(LAWS)) == 1 + 3 * 6
    for law in LAWS:
        settings = law.settings(COARSE)
        if law == HARD:
            assert settings.ambient_law == "hard"
        else:
            assert settings.ambient_law == ("completed" if law.kind == "completed" else "gaussian")
            assert (settings.ambient_strength, settings.ambient_width_ratio) == (law.strength, law.width)


def test_means_are_of_the_scenes_that_always_have_a_path() -> None:
    def answer(law: Law, scene: int, clearance: float, hits: bool = False) -> LawAnswer:
        found = not math.isnan(clearance)
        return LawAnswer(law, scene, "near", found, found and law != SOFT, 0.1, hits, clearance, 0.02, 1.1)

    laws = (SOFT, HARD)
    shared = [answer(law, scene, 0.01 * (scene + 1)) for law in (CONTROL, *laws) for scene in (0, 1)]
    lone = [answer(CONTROL, 2, -0.03, True), answer(SOFT, 2, -0.02, True), answer(HARD, 2, math.nan)]
    report = LawsReport("skill", (*shared, *lone), laws)
    assert report.common == [0, 1]
    control, soft, hard = report.summary()
    assert [row["clearance_mean"] for row in (control, soft, hard)] == pytest.approx([0.015] * 3)
    assert [row["clearance_least"] for row in (control, soft, hard)] == [-0.03, -0.02, 0.01]
    assert [row["infeasible"] for row in (control, soft, hard)] == pytest.approx([0.0, 0.0, 1.0 / 3.0])
    assert (soft["hits"], soft["found"], soft["capped_hits"], soft["capped_found"]) == (1, 3, 0, 0)
    assert (hard["hits"], hard["found"], hard["capped_infeasible"]) == (0, 2, pytest.approx(1.0 / 3.0))


def test_what_cannot_be_compared_is_refused(reach_skill: Skill) -> None:
    with pytest.raises(ParameterError, match="at least 1"):
        ObstacleLaws(scenes=0)
    with pytest.raises(ParameterError, match="task space"):
        ObstacleLaws("panda_pouring").measure(Path())
