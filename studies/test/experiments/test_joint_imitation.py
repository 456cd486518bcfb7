"""The held-out table of joint-space skills: what its rows are, and that they say what they should."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.joint_imitation import (
    COLUMNS,
    ROWS,
    JointImitationReport,
    evaluate_joints,
    within_demonstrations,
)

pytest.importorskip("movement_primitives")
HELD_OUT = (3, 7)


def without(skill: Skill, held_out: tuple[int, ...]) -> Skill:
    """The skill as if some demonstrations had not been among those that it knows; its decoder has learned from all."""
    own = ("start_offsets", "goal_offsets", "modes", "configurations", "start_groups", "goal_groups")
    left = {name: np.delete(getattr(skill.canonical, name), held_out, axis=0) for name in own}
    codes = np.delete(skill.codes, held_out, axis=0)
    return replace(skill, codes=codes, canonical=replace(skill.canonical, **left))


@pytest.fixture(scope="module")
def report(reach_skill, reach_demonstrations) -> JointImitationReport:
    known = without(reach_skill, HELD_OUT)
    return evaluate_joints(reach_demonstrations, [HELD_OUT], [0], lambda *_: known, "reach", show_progress=False)


def test_every_row_has_its_figures_for_both_families(report) -> None:
    assert report.families == (0, 0, 0, 0, 1, 1, 1, 1)
    for row in ROWS:
        for family in (0, 1, None):
            means = report.means(row, family)
            assert means["unanswered"] == 0
            assert all(means[column] > 0.0 for column in COLUMNS[:-1]), row
            # Of rows that have times.
            assert means["speed_mm_s"] is None or means["speed_mm_s"] > 0.0, row


def test_the_geodesic_stays_with_its_family_and_straight_lines_leave_it(report) -> None:
    for family in (0, 1):
        geodesic, line = report.means("geodesic", family), report.means("joint_line", family)
        assert geodesic["joint_dtw_rad"] < 0.3 < 1.0 < line["joint_dtw_rad"]
        assert geodesic["joint_dtw_rad"] < report.means("latent_line", family)["joint_dtw_rad"]
    # Whichever family is the cheapest: one of the two is answered by the other.
    taken = [report.means("geodesic_any", family)["joint_dtw_rad"] for family in (0, 1)]
    assert min(taken) < 0.3 < 1.0 < max(taken)


def test_the_mean_of_all_rows_is_that_of_their_measurements(report) -> None:
    values = [item.values["dtw_mm"] for item in report.measurements if item.row == "geodesic"]
    assert len(values) == len(HELD_OUT)
    assert report.means("geodesic")["dtw_mm"] == pytest.approx(np.mean(values))
    assert len([item for item in report.measurements if item.row == "people"]) == 2 * 6


def test_the_table_and_the_file_say_the_same(report, tmp_path) -> None:
    write_json(tmp_path / "deep" / "reach.json", report.as_dict())
    content = json.loads((tmp_path / "deep" / "reach.json").read_text())
    assert content["rows"]["geodesic"]["0"]["dtw_mm"] == pytest.approx(report.means("geodesic", 0)["dtw_mm"])
    assert f"{report.means('geodesic', 0)['dtw_mm']:.3f}" in report.table()
    assert all(row in report.table() for row in ROWS)


def test_a_skill_within_some_demonstrations_has_their_tube_alone(reach_skill) -> None:
    first = np.arange(8) < 4
    graph, whole = within_demonstrations(reach_skill, first).graph((30, 30, 30)), reach_skill.graph((30, 30, 30))
    middle = reach_skill.codes[:, reach_skill.codes.shape[1] // 2]
    reached = [np.linalg.norm(graph.latent - code, axis=1).min() for code in middle]
    assert max(reached[:4]) < np.linalg.norm(graph.grid.spacing) < 2.0 * min(reached[4:])
    assert len(graph.latent) < 0.8 * len(whole.latent)
    # Its own path is connected from end to end.
    ends = [graph.node_near(code, np.ones(len(graph.latent), dtype=bool), 3) for code in reach_skill.codes[0, [0, -1]]]
    assert graph.component[ends[0]] == graph.component[ends[1]]
    assert within_demonstrations(reach_skill, np.ones(8, dtype=bool)) is reach_skill


def test_a_refusal_is_counted_and_reported(reach_skill, reach_demonstrations) -> None:
    """No path has edges of almost no energy."""
    blocked = replace(without(reach_skill, (3,)), energy_per_edge=1e-12)
    report = evaluate_joints(reach_demonstrations, [(3,)], [0], lambda *_: blocked, "reach", show_progress=False)
    assert report.means("geodesic")["unanswered"] == 1
    assert report.means("geodesic")["dtw_mm"] is None
    assert "geodesic: demonstration 3: " in report.table()


@pytest.mark.parametrize(
    ("folds", "seeds", "words"),
    [([], [0], "at least one fold"), ([(0,)], [], "one seed"), ([(0, 1, 2, 3)], [0], "no demonstration of family 0")],
)
def test_folds_that_leave_nothing_are_refused(reach_demonstrations, folds, seeds, words) -> None:
    with pytest.raises(ParameterError, match=words):
        evaluate_joints(reach_demonstrations, folds, seeds, show_progress=False)


def test_offsets_fade_for_the_skill_and_linearly_for_the_mean_demonstration(reach_skill, reach_demonstrations) -> None:
    """A skill of another fade carries its mean otherwise; the peers, which have none, stay as they are."""
    known = without(reach_skill, (3,))
    other = replace(known, canonical=replace(known.canonical, fade=4.0))
    first, second = (
        evaluate_joints(reach_demonstrations, [(3,)], [0], lambda *_, skill=skill: skill, "reach", show_progress=False)
        for skill in (known, other)
    )
    for row in ("mean_demonstration", "promp", "people"):
        assert first.means(row) == second.means(row)
    for row in ("conditional_mean", "geodesic"):
        assert first.means(row)["dtw_mm"] != second.means(row)["dtw_mm"]
