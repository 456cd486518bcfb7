from __future__ import annotations

import pytest
import torch
from torch import nn

from geodesic_motion_ros.learning.autoencoder import DecoderNetwork
from geodesic_motion_ros.learning.networks import RadialBasisNetwork
from geodesic_motion_ros.robot.kinematics import Robot


@pytest.fixture(scope="session")
def small_decoder() -> DecoderNetwork:
    """An untrained decoder of Panda's joints, with random weights everywhere."""
    with torch.random.fork_rng():
        torch.manual_seed(3)
        offset = torch.tensor(Robot.named("panda").ready.copy())
        decoder = DecoderNetwork(2, (20, 10), offset, torch.tensor(0.5).double()).double()
        network = RadialBasisNetwork(
            torch.randn(30, 2).double(),
            torch.tensor(2.5).double(),
            torch.ones(7).double(),
            20.0 * torch.ones(7).double(),
        )
        nn.init.normal_(network.raw_weights)
        decoder.inverse_sigma = network
        return decoder.requires_grad_(False)
