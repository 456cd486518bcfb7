"""The model of configurations: what is stored without torch computes the same."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.autoencoder import AutoEncoder
from geodesic_motion_ros.learning.networks import RadialBasisNetwork
from geodesic_motion_ros.manifold.encoder import JointSpaceEncoder


@pytest.fixture(scope="module", params=[2, 3])
def vae(request) -> AutoEncoder:
    """An untrained model of seven joints, in double precision."""
    torch.manual_seed(1)
    dimension = request.param
    model = AutoEncoder(dimension, (12, 8), torch.linspace(-1.0, 1.0, 7), torch.tensor(0.7))
    centres = torch.randn(20, dimension, dtype=torch.double)
    floor, at_data = (torch.full((7,), value, dtype=torch.double) for value in (1.0, 40.0))
    model.decoder.inverse_sigma = RadialBasisNetwork(centres, torch.tensor(1.5).double(), floor, at_data)
    return model.double().requires_grad_(False)


def test_the_numpy_decoder_is_the_torch_decoder(vae) -> None:
    latent = 2.0 * np.random.default_rng(0).normal(size=(200, vae.decoder.inverse_sigma.centres.shape[1]))
    decoded = vae.decoder.to_numpy().decode(latent)
    points = torch.tensor(latent)
    np.testing.assert_allclose(decoded.configurations, vae.decoder.means(points).coordinates.numpy(), atol=1e-10)
    inverse = vae.decoder.inverse_sigma
    np.testing.assert_allclose(1.0 / decoded.sigma, inverse.combine(inverse.activations(points)).numpy(), atol=1e-10)


def test_the_numpy_encoder_is_the_torch_encoder(vae) -> None:
    configurations = np.random.default_rng(1).normal(size=(4, 30, 7))
    encoder = JointSpaceEncoder.from_arrays(vae.encoder.arrays())
    expected, _ = vae.encoder(torch.tensor(configurations))
    np.testing.assert_allclose(encoder.encode(configurations), expected.numpy(), atol=1e-10)


def test_samples_have_the_density_they_are_drawn_from(vae) -> None:
    configurations = torch.linspace(-1.0, 1.0, 7, dtype=torch.double).repeat(20000, 1)
    torch.manual_seed(0)
    latent, mean, log_variance = vae.sample(configurations)
    deviation = torch.exp(0.5 * log_variance[0])
    assert torch.allclose(latent.mean(0), mean[0], atol=0.03)
    assert torch.allclose(latent.std(0), deviation, rtol=0.03)
