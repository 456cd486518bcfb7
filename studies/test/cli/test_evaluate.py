from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.cli import main

COLUMNS = {
    "dtw_mm", "frechet_mm", "orientation_deg", "to_closest_mm",
    "endpoint_before_mm", "endpoint_after_mm", "off_manifold",
}  # fmt: skip
ROWS = {
    "geodesic", "geodesic_ridge", "geodesic_canonical", "geodesic_raw", "conditional_mean", "sheet_oracle",
    "mean_demonstration", "nearest_demonstration", "promp", "dmp_nearest",
    "latent_line", "task_line", "reconstruction", "people",
}  # fmt: skip


def test_the_table_is_printed_and_written_as_json(recording, tmp_path, capsys, monkeypatch) -> None:
    pytest.importorskip("movement_primitives")
    from geodesic_motion_studies.experiments import trained

    thoroughly = trained.trained_once

    def briefly(task, shown, settings, folder, progress):
        small = {"steps": 300, "hidden": (48, 32), "samples": 60, "kernels": 80, "precision_iterations": 40}
        return thoroughly(task, shown, replace(settings, **small), folder, progress)

    monkeypatch.setattr(trained, "trained_once", briefly)
    file = tmp_path / "deep" / "reach.json"
    skills = tmp_path / "skills"
    arguments = ["evaluate", "--demos", str(recording), "--units", "cm", "--folds", "0,2", "--json", str(file)]
    assert main([*arguments, "--skills", str(skills)]) == 0
    assert len(list(skills.iterdir())) == 2

    def no_constant(name):
        raise AssertionError(f"{name} is no JSON")

    content = json.loads(file.read_text(), parse_constant=no_constant)
    assert content["task"] == "reach"
    assert content["seeds"] == [0]
    assert content["folds"] == [[0, 2]]
    assert set(content["rows"]) == ROWS
    assert all(set(row) >= COLUMNS for row in content["rows"].values())
    assert content["rows"]["geodesic"]["endpoint_after_mm"] < 1e-6
    assert content["rows"]["people"]["dtw_mm"] > 0.0
    printed = capsys.readouterr().out
    assert all(row in printed for row in ROWS)


def test_rounds_are_predicted_as_rounds_and_have_no_raw_sheet(tmp_path, capsys, monkeypatch) -> None:
    from geodesic_motion_studies.experiments import trained

    thoroughly = trained.trained_once

    def briefly(task, shown, settings, folder):
        assert settings.closed
        return thoroughly(task, shown, replace(settings, steps=400, precision_iterations=60), folder)

    monkeypatch.setattr(trained, "trained_once", briefly)
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    around = np.stack([0.5 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), np.full(100, 0.4)], axis=1)
    down = np.tile([0.0, 1.0, 0.0, 0.0], (100, 1))
    shifts = 0.004 * np.random.default_rng(0).normal(size=(5, 1, 3))
    file = tmp_path / "stirring.npy"
    np.save(file, np.concatenate([around + shifts, np.broadcast_to(down, (5, 100, 4))], axis=2))
    arguments = ["evaluate", "--demos", str(file), "--units", "m", "--folds", "1", "--skills", str(tmp_path / "skills")]
    assert main([*arguments, "--sheets", "raw"]) == 2
    assert "canonical sheet" in capsys.readouterr().err
    assert main([*arguments, "--json", str(tmp_path / "stirring.json")]) == 0
    rows = json.loads((tmp_path / "stirring.json").read_text())["rows"]
    assert set(rows) == {"geodesic", "mean_demonstration", "nearest_demonstration"}
    assert rows["geodesic"]["unanswered"] == 0
    assert "stirring, rounds: held out 1" in capsys.readouterr().out
