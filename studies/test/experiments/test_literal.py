"""The paper beside ours on held-out demonstrations: both kinds of recordings, and a training that makes no skill."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import SkillError
from geodesic_motion_studies.experiments import literal
from geodesic_motion_studies.experiments.literal import LITERAL, OURS, Literal


@pytest.fixture
def of_shipped_skills(monkeypatch: pytest.MonkeyPatch) -> list[type]:
    """Skills that are shipped in the place of trained ones; returns the requested settings."""
    requested: list[type] = []

    def shipped(name: str, shown: JointDemonstrations, settings: object, *_: object) -> Skill:
        requested.append(settings)
        return Skill.load("paper_reach" if settings.sheet == "raw" else "panda_reach_to_grasp")

    monkeypatch.setattr(literal, "trained_once", shipped)
    return requested


def test_both_planners_predict_what_was_held_out(
    reach_demonstrations: JointDemonstrations, of_shipped_skills: list, tmp_path: Path
) -> None:
    report = Literal({"reach": reach_demonstrations}, "0").measure(tmp_path)
    rows = {row.planner: row for row in report.rows}
    assert list(rows) == [LITERAL, OURS]
    assert [settings.sheet for settings in of_shipped_skills] == ["raw", "canonical"]
    assert [settings.volume_weight for settings in of_shipped_skills] == [1.0, 0.0]
    for row in rows.values():
        assert row.unanswered == 0
        assert 0.0 < row.dtw_mm < 100.0
        assert row.people_mm > 0.0
    # Ours meets the ends that it is given; the paper's begins and ends at nodes of its grid.
    assert rows[OURS].ends_mm < 0.1 < rows[LITERAL].ends_mm
    assert [(one.planner, one.held_out, one.seed, one.answered) for one in report.trainings] == [
        (LITERAL, "0", 0, 1), (OURS, "0", 0, 1),
    ]  # fmt: skip
    assert report.table().count("\n") == 8
    report.draw(tmp_path / "literal.png")
    assert (tmp_path / "literal.png").stat().st_size > 5_000


def test_of_several_seeds_every_training_has_a_row(
    reach_demonstrations: JointDemonstrations, of_shipped_skills: list, tmp_path: Path
) -> None:
    report = Literal({"reach": reach_demonstrations}, "0/1,2", seeds=(3, 4), rows="literal").measure(tmp_path)
    assert [(one.held_out, one.seed, one.answered) for one in report.trainings] == [
        ("0", 3, 1), ("0", 4, 1), ("1,2", 3, 2), ("1,2", 4, 2),
    ]  # fmt: skip
    assert [settings.seed for settings in of_shipped_skills] == [3, 4, 3, 4]
    assert [row.planner for row in report.rows] == [LITERAL]
    assert report.held_out == {"reach": 3}
    report.draw(tmp_path / "literal.png")


def test_a_training_that_makes_no_skill_leaves_its_demonstrations_unanswered(
    reach_demonstrations: JointDemonstrations, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refused(*_: object) -> Skill:
        raise SkillError("no demonstration's start and goal are connected")

    monkeypatch.setattr(literal, "trained_once", refused)
    report = Literal({"reach": reach_demonstrations}, "0,2/1").measure(tmp_path)
    assert [row.unanswered for row in report.rows] == [3, 3]
    assert all(np.isnan(row.dtw_mm) for row in report.rows)
    assert all(np.isnan(one.error_mm) and one.answered == 0 for one in report.trainings)
