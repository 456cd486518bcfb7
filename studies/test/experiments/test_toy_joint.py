"""The planar arm with two postures, smaller: two clusters, and what is drawn of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.experiments import toy_joint
from geodesic_motion_studies.experiments.toy_joint import (
    LITERAL,
    TRAINING,
    ToyJoint,
    planar_arm,
    planar_configurations,
    planar_tool,
    toy_configurations,
)


def test_both_postures_hold_the_tool_where_it_is_to_be() -> None:
    points = np.random.default_rng(1).uniform([0.2, -0.2], [0.45, 0.2], (50, 2))
    robot = planar_arm()
    for side in (1.0, -1.0):
        configurations = planar_configurations(points, side)
        assert np.all(np.sign(configurations[:, 1]) == side)
        np.testing.assert_allclose(planar_tool(configurations), points, atol=1e-12)
        reached = [robot.forward(configuration)[0] for configuration in configurations]
        np.testing.assert_allclose(reached, np.pad(points, [(0, 0), (0, 1)]), atol=1e-12)


def test_postures_are_clusters_and_a_small_run_leaves_table_and_picture(tmp_path, monkeypatch) -> None:
    for name, value in {"SIDE": 40, "PAIRS": 1}.items():
        monkeypatch.setattr(toy_joint, name, value)
    small = {
        "hidden": (32, 16), "batch": 64, "learning_rate": 1e-2, "samples": 40, "kernels": 60, "bandwidth_factor": 3.0,
        "precision_samples": 1, "precision_iterations": 20,
    }  # fmt: skip
    settings = replace(TRAINING, steps=300, **small), replace(LITERAL, steps=30, **small)
    report = ToyJoint((0,), *settings, toy_configurations(3, 40)).measure(tmp_path)
    ours = report.rows[0]
    assert ours.own_posture > 0.9
    assert min(ours.across, ours.within) > 0.0
    assert ours.crossing.switches % 2 == 1
    assert report.table().count("\n") == 1 + 3
    assert [row["row"] for row in report.as_dict()["rows"]] == ["ours", "ours, sigma once", "literal"]
    report.draw(tmp_path / "toy.png")
    assert (tmp_path / "toy.png").read_bytes().startswith(b"\x89PNG")


def test_the_floor_that_is_requested_is_the_trainings(tmp_path) -> None:
    with pytest.raises(ParameterError, match=r"far_sigma is 0.001; it must be more than fixed_sigma"):
        ToyJoint((0,), far_sigma=0.001).measure(tmp_path)


def test_no_seeds_are_refused() -> None:
    with pytest.raises(ParameterError, match="at least one"):
        ToyJoint(())
