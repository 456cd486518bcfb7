from __future__ import annotations

import json

import pytest

from geodesic_motion_ros.cli import main

COLUMNS = {
    "dtw_mm", "frechet_mm", "orientation_deg", "to_closest_mm",
    "endpoint_before_mm", "endpoint_after_mm", "off_manifold",
}  # fmt: skip
ROWS = {
    "geodesic", "mean_demonstration", "nearest_demonstration", "promp", "dmp_nearest",
    "latent_line", "task_line", "reconstruction", "people",
}  # fmt: skip


def test_the_table_is_printed_and_written_as_json(recording, tmp_path, capsys, monkeypatch) -> None:
    pytest.importorskip("movement_primitives")
    from geodesic_motion_ros.experiments import imitation
    from geodesic_motion_ros.manifold.training import TrainingSettings, train_task_space_skill

    def train_briefly(shown, seed, progress):
        return train_task_space_skill(shown, TrainingSettings(seed=seed, steps=400, kernels=80), progress=progress)

    monkeypatch.setattr(imitation, "train_task_space", train_briefly)
    file = tmp_path / "deep" / "reach.json"
    assert main(["evaluate", "--demos", str(recording), "--units", "cm", "--folds", "0,2", "--json", str(file)]) == 0

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
