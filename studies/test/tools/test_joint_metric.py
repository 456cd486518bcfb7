"""The pull-back metric of configurations agrees with the tensors that the planner's graph has at its nodes."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.autoencoder import DecoderNetwork
from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.learning.settings import JointTrainingSettings
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings, build_configuration_graph
from geodesic_motion_ros.robot.body_points import end_effector_poses, place_body_points
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.tools.joint_metric import JointPullbackMetric
from geodesic_motion_studies.tools.metric import curve_energy


@pytest.mark.parametrize("orientation_weight", [0.0, 1.0])
def test_tensors_are_those_of_the_graph_and_can_be_differentiated(
    orientation_weight: float, small_decoder: DecoderNetwork
) -> None:
    robot, decoder = Robot.named("panda"), small_decoder
    settings = JointMetricSettings(orientation_weight=orientation_weight)
    body = settings.body_points(robot)
    codes, box = np.zeros((1, 2, 2)), np.ones(2)
    codes[0, 1] = 0.5
    graph = build_configuration_graph(
        decoder.to_numpy(), codes, -box, box, settings, robot, body, sigma_limit=np.inf, shape=(6, 6), neighbours=8
    )
    metric = JointPullbackMetric(decoder, BodyLayer(robot, body), settings)
    latent = torch.tensor(graph.latent)
    first, second = np.triu_indices(2)
    spacing = graph.grid.spacing
    expected = graph.field(None, 1.0).tensors[:, 0] / (spacing[first] * spacing[second])
    np.testing.assert_allclose(metric(latent).numpy()[:, first, second], expected, rtol=2e-5, atol=1e-7)
    curve = latent[:6].clone().requires_grad_(True)
    curve_energy(metric, curve).backward()
    assert torch.isfinite(curve.grad).all()
    assert curve.grad.abs().max() > 0.0


def test_the_literal_metric_is_that_of_finite_differences(small_decoder: DecoderNetwork) -> None:
    """M = J^T J of everything that the metric sees, central differences of body points, quaternion and sigma."""
    robot, decoder = Robot.named("panda"), small_decoder
    settings = JointTrainingSettings.paper().metric
    body = settings.body_points(robot)
    numpy_decoder, latent, step = decoder.to_numpy(), np.random.default_rng(1).uniform(-0.5, 0.5, (20, 2)), 1e-5

    def seen(configurations: np.ndarray) -> np.ndarray:
        """Body points, and the quaternion in the hemisphere of the first configuration, (n, 3 K + 4)."""
        points = place_body_points(configurations, body.frames, body.offsets, robot.chain)
        quaternions = end_effector_poses(configurations, robot.chain)[1]
        sign = np.where(quaternions @ quaternions[0] < 0.0, -1.0, 1.0)
        return np.concatenate([points.reshape(len(points), -1), sign[:, None] * quaternions], axis=1)

    metric = JointPullbackMetric(decoder, BodyLayer(robot, body), settings)(torch.tensor(latent)).numpy()
    for code, tensor in zip(latent, metric, strict=True):
        at = numpy_decoder.configurations(code[None])
        ends = [code + sign * step * axis for axis in np.eye(2) for sign in (1.0, -1.0)]
        moved = seen(np.concatenate([at, numpy_decoder.configurations(np.array(ends))]))[1:]
        sigma = numpy_decoder.uncertainty(np.array(ends))
        along = at + np.concatenate([sigma[::2] - sigma[1::2], sigma[1::2] - sigma[::2]])
        spread = seen(np.concatenate([at, along]))[1:]
        mean_columns = (moved[::2] - moved[1::2]) / (2.0 * step)
        sigma_columns = (spread[:2] - spread[2:]) / (4.0 * step)
        expected = (mean_columns @ mean_columns.T + sigma_columns @ sigma_columns.T) / len(body)
        np.testing.assert_allclose(tensor, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
