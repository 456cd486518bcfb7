"""The decoded graph: support, sheets, transport, and edge lengths against the pull-back metric."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.errors import SkillError
from geodesic_motion_ros.graph.latent_graph import MetricSettings, Offsets, build_latent_graph, tool_points
from geodesic_motion_ros.quaternions import angle_between, normalise, rotate_by, to_rotation

ORIGIN = np.zeros((1, 3))


@pytest.fixture(scope="module")
def graph(fan_skill):
    return fan_skill.graph((60, 60))


def some_offsets(seed: int = 0) -> Offsets:
    random = np.random.default_rng(seed)
    return Offsets(*random.normal(scale=0.05, size=(2, 3)), *random.normal(scale=0.3, size=(2, 3)), 0.1, 0.9)


def test_every_node_and_edge_is_supported_and_on_one_sheet(fan_skill, graph):
    assert graph.sigma.max() <= fan_skill.sigma_limit
    first, second = graph.edges.T
    dots = np.sum(graph.decoded.quaternions[first] * graph.decoded.quaternions[second], axis=1)
    assert dots.min() > 0.0
    assert np.array_equal(graph.component[first], graph.component[second])


def test_without_limits_nothing_is_pruned(fan_skill):
    everything = build_latent_graph(
        fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper,
        fan_skill.metric, np.inf, (20, 20), 8, one_sheet=False,
    )  # fmt: skip
    assert len(everything.latent) == 400
    assert len(everything.edges) == 2 * 20 * 19 + 2 * 19 * 19


def test_no_support_at_all_is_refused(fan_skill):
    with pytest.raises(SkillError, match="no part of the latent box"):
        build_latent_graph(
            fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper, fan_skill.metric, 1e-9
        )


@pytest.mark.parametrize("scale", ["spread", "kappa"])
def test_an_edge_costs_what_the_finite_differences_of_the_features_say(fan_skill, scale):
    """Fine edges against dz^T M dz with the Jacobians of the decoder by finite differences."""
    metric = MetricSettings(orientation_scale=scale)
    graph = build_latent_graph(
        fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper,
        metric, fan_skill.sigma_support, (400, 400), 8,
    )  # fmt: skip
    energies = graph.transported(Offsets.none(), ORIGIN).without_obstacles

    def features(latent: np.ndarray) -> np.ndarray:
        decoded = fan_skill.decoder.decode(latent)
        orientation = metric.orientation_feature(decoded)[:, None]
        return np.hstack([decoded.positions, metric.sigma_weight * decoded.sigma, decoded.quaternions, orientation])

    middle = graph.latent[graph.edges].mean(axis=1)
    step = graph.latent[graph.edges[:, 1]] - graph.latent[graph.edges[:, 0]]
    tiny = 1e-4
    slope = (features(middle + tiny * step) - features(middle - tiny * step)) / (2.0 * tiny)
    ratio = energies / np.sum(slope**2, axis=1)
    assert np.median(np.abs(ratio - 1.0)) < 0.01
    assert np.percentile(np.abs(ratio - 1.0), 90) < 0.1


def test_transport_carries_both_ends_exactly_and_leaves_the_graph_alone(graph):
    offsets = some_offsets()
    before = graph.decoded.positions.copy()
    positions, quaternions = graph.decoded.positions, graph.decoded.quaternions
    for progress, shift, turn in (
        (0.1, offsets.start, offsets.start_rotation),
        (0.9, offsets.goal, offsets.goal_rotation),
    ):
        at = np.full(len(positions), progress)
        moved, turned = offsets.apply(positions, quaternions, at)
        np.testing.assert_allclose(moved, positions + shift, atol=1e-12)
        expected = rotate_by(np.tile(turn, (len(positions), 1)), quaternions)
        assert angle_between(turned, expected).max() < 1e-7
        np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1.0, atol=1e-12)
    graph.transported(offsets, ORIGIN)
    np.testing.assert_array_equal(graph.decoded.positions, before)


def test_transport_without_offsets_is_the_identity(graph):
    energies = graph.transported(Offsets.none(), ORIGIN)
    np.testing.assert_allclose(energies.positions, graph.decoded.positions, atol=1e-15)
    np.testing.assert_allclose(energies.body_points[:, 0], graph.decoded.positions, atol=1e-15)


def test_transported_edges_are_the_chords_of_the_transported_samples(fan_skill, graph):
    """The kernel against a plain evaluation of the same sum."""
    offsets, points = some_offsets(1), np.array([[0.0, 0.0, 0.0], [0.0, 0.1, -0.05]])
    energies = graph.transported(offsets, points)
    for e in np.random.default_rng(0).integers(len(graph.edges), size=20):
        ends = graph.latent[graph.edges[e]]
        latent = ends[0] + np.linspace(0.0, 1.0, 4)[:, None] * (ends[1] - ends[0])
        decoded = fan_skill.decoder.decode(latent)
        positions, quaternions = offsets.apply(decoded.positions, decoded.quaternions, graph.progress_map(latent))
        body = tool_points(positions, quaternions, points)
        sigma = 3.0 * np.sum((fan_skill.metric.sigma_weight * np.diff(decoded.sigma, axis=0)) ** 2)
        chords = 3.0 * np.sum(np.diff(body, axis=0) ** 2, axis=(0, 2))
        np.testing.assert_allclose(energies.shares[e], (chords + sigma) / 2.0, rtol=1e-6)
        turn = 3.0 * np.sum(np.diff(quaternions, axis=0) ** 2) + 3.0 * np.sum(np.diff(decoded.spread) ** 2)
        assert energies.fixed[e] == pytest.approx(turn, rel=1e-6)


def test_equal_tool_points_weigh_as_much_as_one(graph):
    one = graph.transported(some_offsets(), ORIGIN)
    three = graph.transported(some_offsets(), np.zeros((3, 3)))
    np.testing.assert_allclose(three.without_obstacles, one.without_obstacles, rtol=1e-12)


def test_tool_points_are_rotated_with_the_tool():
    random = np.random.default_rng(0)
    positions, quaternions = random.normal(size=(30, 3)), normalise(random.normal(size=(30, 4)))
    points = random.normal(size=(4, 3))
    expected = positions[:, None] + np.stack([to_rotation(quaternions).apply(point) for point in points], axis=1)
    np.testing.assert_allclose(tool_points(positions, quaternions, points), expected, atol=1e-12)


def test_progress_runs_from_start_to_goal_along_every_demonstration(fan_skill, graph):
    expected = np.linspace(0.0, 1.0, fan_skill.codes.shape[1])
    for codes in fan_skill.codes:
        progress = graph.progress_map(codes)
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
    everything = build_latent_graph(*box, fan_skill.sigma_limit, (40, 40))
    energies = everything.transported(Offsets.none(), ORIGIN).without_obstacles
    limit = float(np.median(energies))
    limited = build_latent_graph(*box, fan_skill.sigma_limit, (40, 40), energy_limit=limit)
    np.testing.assert_array_equal(limited.edges, everything.edges[energies <= limit])
    assert limited.energy_limit == limit


def test_the_limit_of_a_skill_grows_with_the_square_of_the_spacing(fan_skill):
    coarse, default, fine = (fan_skill.graph(shape) for shape in ((50, 50), (100, 100), (199, 199)))
    assert default.energy_limit == fine.energy_limit == fan_skill.energy_per_edge
    assert coarse.energy_limit == pytest.approx(fan_skill.energy_per_edge * (99 / 49) ** 2)


def test_no_edge_joins_the_clusters_of_q_and_minus_q_however_wide_the_support(fan_skill):
    box = (fan_skill.decoder, fan_skill.codes, fan_skill.latent_lower, fan_skill.latent_upper, fan_skill.metric)
    joined = build_latent_graph(*box, np.inf, (60, 60), one_sheet=False)
    parted = build_latent_graph(*box, np.inf, (60, 60), one_sheet=False, clusters=2)
    assert joined.component.max() == 0
    distances = [
        np.linalg.norm(parted.latent[:, None] - codes.reshape(-1, 2), axis=-1).min(axis=1)
        for codes in np.split(fan_skill.codes, 2)
    ]
    nearer_to_minus_q = distances[1] < distances[0]
    first, second = parted.edges.T
    assert np.array_equal(nearer_to_minus_q[first], nearer_to_minus_q[second])
    assert len(parted.edges) > 0.9 * len(joined.edges)
