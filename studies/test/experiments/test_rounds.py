"""Closed skills measured: rounds that are their own mean are predicted, seams and scenes are counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geodesic_motion_studies.experiments.rounds import RoundsStudy, _beside_the_base, wiping


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


def test_a_row_says_what_was_predicted_and_played(tmp_path: Path) -> None:
    """Trained in a few steps: the mean is the sheet's, whatever the network is."""
    report = RoundsStudy(scenes=1, seed=2, steps=150).measure(tmp_path)
    (row,) = report.rows
    assert row.recording == "wiping"
    assert (row.rounds, row.scenes) == (10, 1)
    assert 0 <= row.touched + row.no_round <= 1
    assert row.mean_mm > 0.0
    assert min(row.seam_rms, row.elsewhere_rms) > 0.0
    assert row.seam_largest >= row.seam_rms
    report.draw(tmp_path / "rounds.png")
    assert (tmp_path / "rounds.png").stat().st_size > 0
    assert "over mean" in report.table()
