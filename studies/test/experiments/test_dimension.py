"""Latent dimensions compared: a small run from data to picture in two and four, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_studies.experiments import dimension
from geodesic_motion_studies.experiments.dimension import (
    TRAINING,
    Dimension,
    Reaches,
    shown_reaches,
)


@pytest.fixture(scope="module")
def shown() -> Reaches:
    return shown_reaches(per_family=2, samples=30)


def test_one_demonstration_of_each_family_is_held_out(shown) -> None:
    assert shown.shown.shape == (3, 30, 7)
    np.testing.assert_array_equal(shown.held_out[1], shown.configurations[1, 1])
    np.testing.assert_array_equal(shown.shown[2], shown.configurations[2, 0])


def test_both_graphs_are_measured_in_every_dimension(shown, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(dimension, "SIDES", {2: 30, 4: 8})
    settings = replace(TRAINING, hidden=(32, 16), steps=40, batch=64, kernels=40, precision_iterations=10)
    report = Dimension((0,), (2, 4), settings, shown).measure(tmp_path)
    assert [(row.dimension, row.graph) for row in report.rows] == [
        (2, "grid"), (2, "neighbours"), (4, "grid"), (4, "neighbours"),
    ]  # fmt: skip
    for row in report.rows:
        assert row.none <= 3
        assert not row.length < 1.0 - 1e-9
        assert (row.nodes > 0) == (row.megabytes > 0.0)
    assert [row.lattice for row in report.rows if row.graph == "grid"] == [900, 4096]
    assert report.table().count("\n") == 5
    report.draw(tmp_path / "dimension.png")
    assert (tmp_path / "dimension.png").read_bytes().startswith(b"\x89PNG")
