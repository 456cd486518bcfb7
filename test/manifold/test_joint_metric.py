"""The pull-back metric of configurations agrees with the tensors that the planner's graph has at its nodes."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from geodesic_motion_ros.graph.configuration_graph import JointMetricSettings, build_configuration_graph
from geodesic_motion_ros.manifold.body_layer import BodyLayer
from geodesic_motion_ros.manifold.joint_metric import JointPullbackMetric
from geodesic_motion_ros.manifold.joint_space import JointDecoderNetwork
from geodesic_motion_ros.manifold.metric import curve_energy
from geodesic_motion_ros.manifold.networks import RadialBasisNetwork
from geodesic_motion_ros.robot.kinematics import Robot


def small_decoder() -> JointDecoderNetwork:
    """An untrained decoder of Panda's joints, with random weights everywhere."""
    with torch.random.fork_rng():
        torch.manual_seed(3)
        offset = torch.tensor(Robot.panda().ready.copy())
        decoder = JointDecoderNetwork(2, (20, 10), offset, torch.tensor(0.5).double()).double()
        network = RadialBasisNetwork(
            torch.randn(30, 2).double(),
            torch.tensor(2.5).double(),
            torch.ones(7).double(),
            20.0 * torch.ones(7).double(),
        )
        nn.init.normal_(network.raw_weights)
        decoder.inverse_sigma = network
        return decoder.requires_grad_(False)


def test_tensors_are_those_of_the_graph_and_can_be_differentiated() -> None:
    robot, settings, decoder = Robot.panda(), JointMetricSettings(), small_decoder()
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
