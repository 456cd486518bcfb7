"""The graph of configurations: its edges are as long as the pull-back metric says, and shares are shares."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.manifold.configuration_graph import (
    ConfigurationGraph,
    JointMetricSettings,
    build_configuration_graph,
)
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.manifold.joint_transport import JointOffsets
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.utils.errors import SkillError

ROBOT = Robot.named("panda")


def small_graph(skill, code: np.ndarray, reach: float, metric: JointMetricSettings, **options) -> ConfigurationGraph:
    """A fine graph of a small box around a latent point, whatever the support."""
    return build_configuration_graph(
        skill.decoder, skill.codes, code - reach, code + reach, metric, ROBOT, metric.body_points(ROBOT),
        **({"sigma_limit": math.inf, "shape": (5, 5, 5)} | options),
    )  # fmt: skip


def pulled_back_metric(decoder: JointSpaceDecoder, metric: JointMetricSettings, latent: np.ndarray) -> torch.Tensor:
    """M (n, d, d) as in the head of configuration_graph, by automatic differentiation of the decoder's formulas."""
    weights = {name: torch.tensor(np.asarray(array, dtype=float)) for name, array in decoder.arrays().items()}
    points = torch.tensor(latent)

    def means(z: torch.Tensor) -> torch.Tensor:
        hidden = torch.tanh(weights["W2"] @ torch.tanh(weights["W1"] @ z + weights["b1"]) + weights["b2"])
        return weights["joint_offset"] + weights["joint_scale"] * (weights["W3"] @ hidden + weights["b3"])

    def sigma(z: torch.Tensor) -> torch.Tensor:
        kernels = torch.exp(-weights["rbf_rate"] * ((z - weights["rbf_centres"]) ** 2).sum(-1))
        return 1.0 / (weights["sigma_weights"] @ kernels + weights["sigma_floor"])

    kinematics = BodyLayer(ROBOT, metric.body_points(ROBOT))
    configurations = torch.stack([means(z) for z in points])
    body, turning = kinematics.jacobians(configurations), kinematics.orientation_jacobians(configurations)
    tensor = torch.zeros(len(latent), latent.shape[1], latent.shape[1], dtype=torch.double)
    for scale, function in ((1.0, means), (metric.sigma_weight, sigma)):
        columns = scale * torch.stack([torch.func.jacfwd(function)(z) for z in points])
        moved = torch.einsum("nkaj,njd->nkad", body, columns)
        tensor += torch.einsum("nkad,nkae->nde", moved, moved) / body.shape[1]
        tensor += metric.joint_weight**2 * torch.einsum("njd,nje->nde", columns, columns)
        turned = metric.orientation_weight * turning @ columns
        tensor += torch.einsum("nad,nae->nde", turned, turned) / body.shape[1]
    return tensor


@pytest.mark.parametrize(("sigma_weight", "orientation_weight"), [(0.0, 0.0), (10.0, 0.0), (1.0, 1.0)])
def test_squared_lengths_are_those_of_the_pull_back_metric(reach_skill, sigma_weight, orientation_weight) -> None:
    metric = JointMetricSettings(sigma_weight=sigma_weight, orientation_weight=orientation_weight)
    # Beside the demonstrations, where sigma has a slope.
    graph = small_graph(reach_skill, reach_skill.codes[1, 40] + 0.08, 0.01, metric)
    still = graph.transported(JointOffsets.none(ROBOT))
    some = np.random.default_rng(0).choice(len(graph.edges), 30, replace=False)
    ends = graph.latent[graph.edges[some]]
    tensor = pulled_back_metric(reach_skill.decoder, metric, ends.mean(axis=1)).numpy()
    step = ends[:, 1] - ends[:, 0]
    np.testing.assert_allclose(still.energies(some), np.einsum("nd,nde,ne->n", step, tensor, step), rtol=0.03)


def test_every_body_point_has_its_share_of_what_moves(reach_skill) -> None:
    graph = reach_skill.graph((30, 30, 30))
    conformal = 1.0 + np.random.default_rng(0).random(len(graph.latent))
    carried = graph.transported(JointOffsets.none(ROBOT, graph.mean_path_count), conformal)
    steps = np.diff(carried.body_points[graph.edges], axis=1)[:, 0]
    factor = conformal[graph.edges].mean(axis=1)[:, None]
    expected = factor * (np.sum(steps**2, axis=-1) + graph.sigma_shares) / len(graph.body)
    np.testing.assert_allclose(carried.shares, expected, rtol=1e-9)
    np.testing.assert_allclose(carried.base**2, carried.fixed + carried.shares.sum(axis=1), rtol=1e-12)


def test_a_conformal_factor_stretches_squared_lengths_and_leaves_energies(reach_skill) -> None:
    graph = reach_skill.graph((30, 30, 30))
    none = JointOffsets.none(ROBOT, graph.mean_path_count)
    plain, twice = graph.transported(none), graph.transported(none, np.full(len(graph.latent), 2.0))
    np.testing.assert_allclose(twice.base**2, 2.0 * plain.base**2)
    np.testing.assert_allclose(twice.energies(), plain.energies())
    np.testing.assert_array_equal(twice.configurations, graph.configurations)


@pytest.mark.parametrize("orientation_weight", [0.0, 1.0])
def test_the_field_between_the_nodes_is_the_pull_back_metric_at_them(reach_skill, orientation_weight) -> None:
    metric = JointMetricSettings(orientation_weight=orientation_weight)
    graph = small_graph(reach_skill, reach_skill.codes[0, 50], 0.02, metric)
    tensors = pulled_back_metric(graph.decoder, metric, graph.latent).numpy()
    field = graph.field(None, 1.0)
    rows, columns = np.triu_indices(3)
    unit = graph.grid.spacing[:, None] * graph.grid.spacing
    np.testing.assert_allclose(
        field.tensors[:, 0], (tensors * unit)[:, rows, columns], rtol=1e-5, atol=1e-6 * np.abs(tensors * unit).max()
    )
    # What no obstacle stretches is left when the body points' shares are taken away: it is a metric too.
    rest = np.empty((len(tensors), 3, 3))
    rest[:, rows, columns] = rest[:, columns, rows] = field.tensors[:, 0] - field.tensors[:, 1:].sum(axis=1)
    assert np.all(np.linalg.eigvalsh(rest) > 0.0)


def test_nodes_and_edges_stay_inside_the_support(reach_skill) -> None:
    graph = reach_skill.graph((30, 30, 30))
    assert graph.sigma.max() <= reach_skill.sigma_limit
    middles = graph.latent[graph.edges].mean(axis=1)
    assert np.mean(rms_sigma(graph.decoder.uncertainty(middles)) <= 1.02 * reach_skill.sigma_limit) == 1.0
    energies = graph.transported(JointOffsets.none(ROBOT, graph.mean_path_count)).energies()
    assert energies.max() <= graph.energy_limit * (1.0 + 1e-9)


def test_finer_pieces_see_walls_that_the_ends_do_not(reach_skill) -> None:
    """An edge that steps over a rise of sigma costs what climbing it costs, not what its ends differ by."""
    wide = {"shape": (4, 4, 4)}
    metric, code = JointMetricSettings(), reach_skill.codes[0, 50]
    none = JointOffsets.none(ROBOT)
    whole = small_graph(reach_skill, code, 0.6, metric, pieces=1, **wide).transported(none)
    cut = small_graph(reach_skill, code, 0.6, metric, pieces=6, **wide).transported(none)
    assert np.all(cut.energies() >= 0.999 * whole.energies())
    assert np.max(cut.energies() / whole.energies()) > 1.5


def test_the_nearest_node_is_near_and_of_the_piece_that_is_asked_for(reach_skill) -> None:
    graph = reach_skill.graph((30, 30, 30))
    piece = int(np.argmax(np.bincount(graph.component)))
    wanted = graph.configurations[np.flatnonzero(graph.component == piece)[7]]
    found = graph.nearest_node(wanted, piece, np.inf)
    np.testing.assert_array_equal(graph.configurations[found], wanted)
    assert graph.nearest_node(wanted, piece, 0.0) is None


def test_a_box_without_support_is_refused(reach_skill) -> None:
    with pytest.raises(SkillError, match="no part of the latent box"):
        small_graph(reach_skill, np.full(3, 40.0), 0.1, JointMetricSettings(), sigma_limit=0.01)
