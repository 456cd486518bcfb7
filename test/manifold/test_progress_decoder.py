"""Progress decoded beside poses or configurations: its part of the metric."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder
from geodesic_motion_ros.manifold.metric_field import NUDGE
from geodesic_motion_ros.manifold.pose_graph import MetricSettings, PoseGraph, build_pose_graph
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.utils.errors import SkillError

LENGTH, SIGMA_WEIGHT = 0.3, 4.0


def weights(progress: bool) -> dict[str, np.ndarray]:
    random = np.random.default_rng(1)
    outputs = 8 if progress else 7
    arrays = {
        "W1": random.normal(size=(9, 2)), "b1": random.normal(size=9), "W2": random.normal(size=(6, 9)),
        "b2": random.normal(size=6), "W3": random.normal(size=(outputs, 6)), "b3": random.normal(size=outputs),
        "position_offset": np.zeros(3), "position_scale": np.array(0.2), "rbf_centres": random.normal(size=(20, 2)),
        "rbf_rate": np.array(1.5), "sigma_weights": random.uniform(1.0, 50.0, (3, 20)), "sigma_floor": np.full(3, 1.0),
        "kappa_weights": random.uniform(1.0, 500.0, 20), "kappa_floor": np.array(0.1),
    }  # fmt: skip
    if progress:
        arrays |= {"progress_weights": random.uniform(1.0, 20.0, 20), "progress_floor": np.array(1.0)}
    return arrays


def graph(length: float) -> PoseGraph:
    decoder = TaskSpaceDecoder.from_arrays(weights(progress=True))
    codes = np.linspace([-1.0, 0.0], [1.0, 0.0], 30)[None]
    metric = MetricSettings(sigma_weight=SIGMA_WEIGHT, progress_length=length)
    corner = np.array([1.2, 0.8])
    return build_pose_graph(decoder, codes, -corner, corner, metric, np.inf, (12, 12), one_sheet=False)


def test_a_decoder_without_progress_is_read_as_before() -> None:
    decoder = TaskSpaceDecoder.from_arrays(weights(progress=False))
    assert decoder.progress_numbers == 0
    assert "progress_weights" not in decoder.arrays()
    arrays = weights(progress=True)
    del arrays["progress_weights"], arrays["progress_floor"]
    with pytest.raises(SkillError, match="W3 has shape"):
        TaskSpaceDecoder.from_arrays(arrays)


def test_tensors_are_the_pulled_back_features_by_finite_differences() -> None:
    points = np.zeros((1, 3))
    with_it, without = graph(LENGTH), graph(0.0)
    added = with_it.tensors(points)[:, 0] - without.tensors(points)[:, 0]
    spacing, latent = with_it.grid.spacing, with_it.latent
    steps = [
        with_it.decoder.progress_features(latent + side * 0.5 * NUDGE * axis, LENGTH, SIGMA_WEIGHT)
        for axis in np.diag(spacing)
        for side in (1.0, -1.0)
    ]
    slopes = np.stack([steps[0] - steps[1], steps[2] - steps[3]], axis=2) / NUDGE
    expected = slopes.transpose(0, 2, 1) @ slopes
    rows, columns = np.triu_indices(2)
    np.testing.assert_allclose(added, expected[:, rows, columns], rtol=1e-4, atol=1e-4 * np.abs(expected).max())


def test_edges_are_longer_by_progress_which_no_obstacle_stretches() -> None:
    none, point = Offsets.none(0), np.zeros((1, 3))
    with_it, without = graph(LENGTH).transported(none, point), graph(0.0).transported(none, point)
    np.testing.assert_array_equal(with_it.shares, without.shares)
    features = graph(LENGTH).decoder.progress_features(graph(LENGTH).latent, LENGTH, SIGMA_WEIGHT)
    first, second = with_it.edges.T
    moved = np.sum((features[second] - features[first]) ** 2, axis=1)
    np.testing.assert_allclose(with_it.fixed - without.fixed, moved, rtol=1e-9, atol=1e-12)
    assert moved.min() > 0.0
