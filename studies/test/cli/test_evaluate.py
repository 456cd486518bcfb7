from __future__ import annotations

import json
from dataclasses import replace

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
