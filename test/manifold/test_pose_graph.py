"""The decoded graph: support, sheets, and edge lengths against the pull-back metric."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.manifold.pose_graph import MetricSettings, build_pose_graph
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.utils.errors import SkillError

ORIGIN = np.zeros((1, 3))


@pytest.fixture(scope="module")
def graph(fan_skill):
    return fan_skill.graph((60, 60))


def test_every_node_and_edge_is_supported_and_on_one_sheet(fan_skill, graph):
    assert graph.sigma.max() <= fan_skill.sigma_limit
    first, second = graph.edges.T
    dots = np.sum(graph.decoded.quaternions[first] * graph.decoded.quaternions[second], axis=1)
    assert dots.min() > 0.0
    assert np.array_equal(graph.component[first], graph.component[second])


def test_without_limits_nothing_is_pruned(fan_skill):
    everything = build_pose_graph(
        fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper,
        fan_skill.metric, np.inf, (20, 20), 8, one_sheet=False,
    )  # fmt: skip
    assert len(everything.latent) == 400
    assert len(everything.edges) == 2 * 20 * 19 + 2 * 19 * 19


def test_no_support_at_all_is_refused(fan_skill):
    with pytest.raises(SkillError, match="no part of the latent box"):
        build_pose_graph(
            fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper, fan_skill.metric, 1e-9
        )


@pytest.mark.parametrize("scale", ["spread", "kappa"])
def test_an_edge_costs_what_the_finite_differences_of_the_features_say(fan_skill, scale):
    """Fine edges against dz^T M dz with the Jacobians of the decoder by finite differences."""
    metric = MetricSettings(orientation_scale=scale)
    graph = build_pose_graph(
        fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper,
        metric, fan_skill.sigma_support, (200, 200), 8,
    )  # fmt: skip
    energies = graph.transported(Offsets.none(), ORIGIN).energies()

    def features(latent: np.ndarray) -> np.ndarray:
        decoded = fan_skill.decoder.decode(latent)
        orientation = metric.orientation_features(decoded)
        return np.hstack([decoded.positions, metric.sigma_weight * decoded.sigma, decoded.quaternions, orientation])

    middle = graph.latent[graph.edges].mean(axis=1)
    step = graph.latent[graph.edges[:, 1]] - graph.latent[graph.edges[:, 0]]
    tiny = 1e-4
    slope = (features(middle + tiny * step) - features(middle - tiny * step)) / (2.0 * tiny)
    ratio = energies / np.sum(slope**2, axis=1)
    assert np.median(np.abs(ratio - 1.0)) < 0.01
    assert np.percentile(np.abs(ratio - 1.0), 90) < 0.1


def test_progress_runs_from_start_to_goal_along_every_demonstration(fan_skill, graph):
    expected = np.linspace(0.0, 1.0, fan_skill.codes.shape[1])
    for codes in fan_skill.codes:
        progress = graph.progress_map(codes)[0]
        assert np.abs(progress - expected).max() < 0.1
        assert np.diff(progress).min() > -0.01


def test_the_nearest_node_to_a_decoded_pose_is_its_own(graph):
    trusted = np.flatnonzero(graph.sigma < 0.5 * graph.sigma_limit)
    for node in np.random.default_rng(0).choice(trusted, 10):
        pose = graph.decoded.positions[node], graph.decoded.quaternions[node]
        found, misfit = graph.nearest_node(*pose, graph.component[node], graph.sigma_limit)
        assert found == node
        assert misfit == pytest.approx(0.0, abs=1e-12)


def test_a_node_near_a_latent_point_is_the_closest_allowed_one(graph):
    random = np.random.default_rng(0)
    for latent in graph.latent[random.integers(len(graph.latent), size=20)] + 0.3 * graph.grid.spacing:
        allowed = random.random(len(graph.latent)) < 0.5
        found = graph.node_near(latent, allowed, 3)
        distance = np.sum(((graph.latent - latent) / graph.grid.spacing) ** 2, axis=1)
        assert found == np.flatnonzero(allowed)[np.argmin(distance[allowed])]
    assert graph.node_near(graph.latent[0], np.zeros(len(graph.latent), dtype=bool), 3) is None


def test_edges_dearer_than_the_limit_are_left_out_and_no_others(fan_skill):
    box = (fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper, fan_skill.metric)
    everything = build_pose_graph(*box, fan_skill.sigma_limit, (40, 40))
    energies = everything.transported(Offsets.none(), ORIGIN).energies()
    # At the widest step between two neighbours near the median, so that rounding moves no edge across it.
    ordered = np.sort(energies)[len(energies) // 2 :][:100]
    step = int(np.argmax(np.diff(ordered)))
    limit = float(ordered[step : step + 2].mean())
    limited = build_pose_graph(*box, fan_skill.sigma_limit, (40, 40), energy_limit=limit)
    np.testing.assert_array_equal(limited.edges, everything.edges[energies <= limit])
    assert limited.energy_limit == limit


def test_the_limit_of_a_skill_grows_with_the_square_of_the_spacing(fan_skill):
    coarse, default, fine = (fan_skill.graph(shape) for shape in ((50, 50), (100, 100), (199, 199)))
    assert default.energy_limit == fine.energy_limit == fan_skill.energy_per_edge
    assert coarse.energy_limit == pytest.approx(fan_skill.energy_per_edge * (99 / 49) ** 2)


def test_no_edge_joins_the_clusters_of_q_and_minus_q_however_wide_the_support(fan_skill):
    box = (fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper, fan_skill.metric)
    joined = build_pose_graph(*box, np.inf, (60, 60), one_sheet=False)
    parted = build_pose_graph(*box, np.inf, (60, 60), one_sheet=False, clusters=2)
    assert joined.component.max() == 0
    distances = [
        np.linalg.norm(parted.latent[:, None] - codes.reshape(-1, 2), axis=-1).min(axis=1)
        for codes in np.split(fan_skill.codes, 2)
    ]
    nearer_to_minus_q = distances[1] < distances[0]
    first, second = parted.edges.T
    assert np.array_equal(nearer_to_minus_q[first], nearer_to_minus_q[second])
    assert len(parted.edges) > 0.9 * len(joined.edges)
