"""The paper's toy, smaller: which models keep the signs apart, and what is drawn of them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments import toy_task
from geodesic_motion_studies.experiments.toy_task import (
    TRAINING,
    ToyTask,
    toy_demonstrations,
)


def test_a_density_keeps_the_signs_apart_and_the_mixture_does_not(tmp_path, monkeypatch) -> None:
    for name, value in {"SIDE": 30, "PAIRS": 1}.items():
        monkeypatch.setattr(toy_task, name, value)
    settings = replace(
        TRAINING, hidden=(48, 24), steps=350, batch=64, learning_rate=1e-2, kernels=60, precision_samples=2,
        precision_iterations=20,
    )  # fmt: skip
    report = ToyTask((0,), settings, toy_demonstrations(4, 40)).measure(tmp_path)
    single, _, papers, mixture = report.rows
    assert single.own_sign > 0.9
    assert min(single.across, single.within) > 0.0
    assert papers.across < 5.0 * papers.within
    assert mixture.own_sign < 0.95
    assert mixture.across < 3.0 * mixture.within
    content = json.loads(write_json(tmp_path / "toy.json", report.as_dict()).read_text())
    assert [row["likelihood"] for row in content["rows"]] == ["single", "single", "single", "mixture"]
    assert report.table().count("\n") == 6
    report.draw(tmp_path / "toy.png")
    assert (tmp_path / "toy.png").read_bytes().startswith(b"\x89PNG")


def test_letters_are_drawn_on_plane_and_sphere_and_measured_between_samples() -> None:
    shown = toy_demonstrations()
    np.testing.assert_allclose(np.linalg.norm(shown.directions, axis=2), 1.0, rtol=1e-12)
    assert 0.25 < np.ptp(shown.positions[..., 1]) < 0.35
    between = 0.5 * (shown.positions[2, :-1] + shown.positions[2, 1:])
    directions = -shown.directions[2, :-1]
    assert np.max(shown.distances(between, directions)) < 0.03
    assert np.min(shown.distances(between + [0.2, 0.0], directions)[:, 0]) > 0.05


def test_the_floor_that_is_requested_is_the_trainings(tmp_path) -> None:
    with pytest.raises(ParameterError, match=r"far_sigma is 0.001; it must be more than fixed_sigma"):
        ToyTask((0,), far_sigma=0.001).measure(tmp_path)


def test_no_seeds_are_refused() -> None:
    with pytest.raises(ParameterError, match="at least one"):
        ToyTask(())
