"""The experiment with goals that vary, on a small skill: not how well, but that it measures what it says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.simulation.teacher import BOTTLE_REGION, GRASP_HEIGHT
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments import goals
from geodesic_motion_studies.experiments.goals import (
    COLUMNS,
    ROWS,
    Goals,
    GoalsReport,
    drawn,
    requested_ends,
)

SMALL = TrainingSettings(
    steps=500, hidden=(48, 32), samples=80, kernels=80, precision_samples=2, precision_iterations=40
)
SETTINGS = Goals(shown=5, held_out=3, ends=2, seeds=(3,), training=SMALL)


@pytest.fixture(scope="module")
def measured(stored_in, tmp_path_factory) -> tuple[GoalsReport, Skill]:
    """The report, and the skill that was measured."""
    with stored_in(goals) as taken:
        report = SETTINGS.measure(tmp_path_factory.mktemp("goals"))
    (skill,) = taken
    return report, skill


@pytest.fixture(scope="module")
def report(measured) -> GoalsReport:
    return measured[0]


@pytest.fixture(scope="module")
def skill(measured) -> Skill:
    return measured[1]


@pytest.fixture(scope="module")
def everything() -> tuple[Demonstrations, tuple[int, ...]]:
    return drawn(SETTINGS, 3)


def test_held_out_motions_are_others_from_the_same_regions(everything) -> None:
    demonstrations, fold = everything
    assert fold == (5, 6, 7)
    starts = np.array([item.positions[0] for item in demonstrations])
    assert BOTTLE_REGION.contains(starts).all()
    apart = np.linalg.norm(starts[:, None] - starts[None], axis=2)[~np.eye(8, dtype=bool)]
    assert apart.min() > 1e-3


def test_rings_lie_outside_of_the_region_by_their_distance(everything) -> None:
    demonstrations, fold = everything
    held_out = Demonstrations(tuple(demonstrations[index] for index in fold))
    rings = [item for item in requested_ends(held_out, SETTINGS, 3) if item.where == "100 mm beyond"]
    assert len(rings) == SETTINGS.ends
    for item in rings:
        ground = item.start[0][:2]
        outside = ground - np.clip(ground, BOTTLE_REGION.lower, BOTTLE_REGION.upper)
        # The teacher's hand shakes at neither end.
        assert np.linalg.norm(outside) == pytest.approx(0.1, abs=1e-9)
        assert item.start[0][2] == pytest.approx(GRASP_HEIGHT)
        np.testing.assert_array_equal(item.right[0].goal[0], item.goal[0])


def test_every_row_has_its_figures_and_answers_end_where_they_were_asked_to(report) -> None:
    assert tuple(report.rows) == ROWS
    for row in ROWS:
        assert tuple(report.rows[row]) == COLUMNS
        assert report.rows[row]["dtw_mm"] > 1.0
    geodesic = report.rows["geodesic"]
    assert geodesic["unanswered"] == 0
    assert geodesic["endpoint_before_mm"] < 2.0
    assert geodesic["endpoint_after_mm"] < 0.1
    # A method that knows neither the regions nor the laws is further off than a motion carried from another place.
    assert geodesic["dtw_mm"] < 2.0 * report.rows["people"]["dtw_mm"]
    assert report.over_promp() == pytest.approx(geodesic["dtw_mm"] / report.rows["promp"]["dtw_mm"])


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "goals.json", report.as_dict()).read_text())
    assert content["rows"]["geodesic"]["dtw_mm"] == report.rows["geodesic"]["dtw_mm"]
    assert content["over_promp_by_seed"] == {"3": report.over_promp()}
    assert content["ends"]["25 mm beyond"]["geodesic"]["requested"] == 2
    table = report.table()
    assert f"geodesic's DTW over ProMP's: {report.over_promp():.2f}" in table
    assert all(row in table for row in ROWS)
    report.draw(tmp_path / "goals.png")
    assert (tmp_path / "goals.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"shown": 1}, "at least 2"), ({"held_out": 0}, "at least 1"), ({"ends": 0}, "at least 1"),
     ({"seeds": ()}, "at least one"), ({"seeds": (-1,)}, "none negative")],
)  # fmt: skip
def test_impossible_settings_are_refused(wrong, message) -> None:
    with pytest.raises(ParameterError, match=message):
        Goals(**wrong)
