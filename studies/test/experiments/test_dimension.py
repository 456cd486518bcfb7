"""Latent dimensions compared: a small run from data to picture in two and four."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.manifold import sampled_nodes
from geodesic_motion_studies.experiments import dimension
from geodesic_motion_studies.experiments.dimension import Dimension, drawn_queries, length_over_geodesic, shown_reaches

SMALL = replace(
    Dimension.training, hidden=(48, 32), samples=40, steps=300, batch=64, kernels=80, precision_iterations=30
)  # fmt: skip


@pytest.fixture(scope="module")
def shown() -> JointDemonstrations:
    return shown_reaches(per_family=2, samples=40)


def test_reaches_are_of_three_families_and_of_one_arm(shown: JointDemonstrations) -> None:
    assert (len(shown), shown.robot) == (6, "panda")
    starts = np.stack([item.configurations[0] for item in shown])
    within = np.linalg.norm(starts[::2] - starts[1::2], axis=1)
    across = np.linalg.norm(starts[:-2] - starts[2:], axis=1)
    assert within.max() < across.min()


def test_a_row_says_what_was_learned_searched_and_ticked(shown, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(dimension, "shown_reaches", lambda: shown)
    monkeypatch.setattr(sampled_nodes, "MOST_NODES", 1000)
    report = Dimension(seeds=(0,), dimensions=(2, 4), queries=2, motions=1, training=SMALL).measure(tmp_path)
    assert [row.dimension for row in report.rows] == [2, 4]
    for row in report.rows:
        assert row.none == 2 or 1.0 <= row.median <= row.largest
        assert 0.0 < row.tick_p50 <= row.tick_p99
        assert min(row.learned_mm, row.held_out_mm, row.megabytes, row.build_s) > 0.0
    assert report.rows[1].nodes <= 1000
    assert report.table().count("\n") == 4
    report.draw(tmp_path / "dimension.png")
    assert (tmp_path / "dimension.png").read_bytes().startswith(b"\x89PNG")


def test_queries_of_a_seed_are_always_the_same(reach_skill) -> None:
    planner = dimension.ReactivePlanner(reach_skill)
    once, again = (list(drawn_queries(planner, 3, seed=1)) for _ in range(2))
    for one, other in zip(once, again, strict=True):
        np.testing.assert_array_equal(one.start_latent, other.start_latent)
        assert one.goal_node == other.goal_node
    ratio = length_over_geodesic(planner, once[0])
    assert ratio is None or ratio >= 1.0
