"""Closed skills measured: rounds that are their own mean are predicted, seams and scenes are counted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.training import train_skill
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.experiments.round_prediction import evaluate_rounds
from geodesic_motion_studies.experiments.rounds import RoundsReport, RoundsStudy, _beside_the_base, wiping


def test_people_wipe_each_a_little_differently_and_come_round() -> None:
    made = wiping(1, people=3)
    assert [item.name for item in made] == ["0", "1", "2"]
    for item in made:
        extent = np.linalg.norm(item.positions - item.positions[0], axis=1).max()
        assert np.linalg.norm(item.positions[-1] - item.positions[0]) < 0.2 * extent
    assert not np.allclose(made[0].positions, made[1].positions)
    np.testing.assert_array_equal(made[0].positions, wiping(1, people=3)[0].positions)


def test_what_crosses_does_not_come_to_the_base() -> None:
    random, place = np.random.default_rng(0), np.array([0.5, 0.1, 0.25])
    for _ in range(50):
        direction = _beside_the_base(random, place)
        at = place + np.linspace(-2.0, 2.0, 400)[:, None] * direction
        assert np.linalg.norm(at[:, :2], axis=1).min() > 0.3 - 1e-2


@pytest.fixture(scope="module")
def skill() -> Skill:
    """Of circles: a skill of rounds after few steps, whatever the processor."""
    return train_skill(circles(), TrainingSettings(closed=True, steps=400, precision_iterations=60), "circles")


def circles() -> Demonstrations:
    """Rounds on circles at 0.35 m, of which each is moved by a little."""
    t = np.linspace(0.0, 1.0, 120)
    around = np.stack([0.08 * np.cos(2.0 * np.pi * t), 0.08 * np.sin(2.0 * np.pi * t), np.zeros(120)], axis=1)
    down = np.tile([0.0, 1.0, 0.0, 0.0], (120, 1))
    shifts = 0.004 * np.random.default_rng(0).normal(size=(5, 3))
    items = (Demonstration(around + [0.5, 0.0, 0.35] + shift, down, 4.0 * t, f"{i}") for i, shift in enumerate(shifts))
    return Demonstrations(tuple(items), frame="panda_link0")


def test_rounds_that_differ_by_where_they_begin_are_predicted_by_their_mean(skill: Skill) -> None:
    report = evaluate_rounds(circles(), [(0, 3), (1,)], (0,), lambda *_: skill, "circles", show_progress=False)
    assert set(report.held_out) == {(0, 0), (3, 0), (1, 0)}
    # Equal circles, sampled at other places: half a chord of 200 apart at most.
    assert report.rows["mean_demonstration"]["dtw_mm"] < 1e3 * np.pi * 0.08 / 200
    assert report.rows["geodesic"]["unanswered"] == 0
    assert [len(row) for row in report.as_dict()["held_out"]] == [6] * 9
    assert "circles, rounds: held out 0,3/1, seeds 0" in report.table()


def test_a_refused_round_is_counted_and_not_averaged(skill: Skill) -> None:
    far = circles()
    moved = Demonstration(far[0].positions + [0.0, 0.4, 0.0], far[0].quaternions, far[0].times, "far")
    report = evaluate_rounds(replace(far, items=(moved, *far[1:])), [(0,), (1,)], (0,), lambda *_: skill, "circles",
                             show_progress=False)  # fmt: skip
    assert report.rows["geodesic"]["unanswered"] == 1
    assert report.rows["geodesic"]["dtw_mm"] == report.as_dict()["held_out"][3]["dtw_mm"]


def test_a_row_says_what_was_predicted_and_played(skill: Skill, tmp_path: Path) -> None:
    row, paths = RoundsStudy(seed=2, played=3).row("wiping", circles(), lambda *_: skill, scenes=1)
    assert row.recording == "wiping"
    assert (row.rounds, row.scenes) == (5, 1)
    assert 0 <= row.touched + row.no_round <= 1
    assert min(row.seam_rms, row.elsewhere_rms) > 0.0
    assert row.seam_largest >= row.seam_rms
    report = RoundsReport((row,), {"wiping": paths})
    report.draw(tmp_path / "rounds.png")
    assert (tmp_path / "rounds.png").stat().st_size > 0
    assert "over mean" in report.table()
