import numpy as np
import pytest
import torch

from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.learning.autoencoder import AutoEncoder, FixedPrecisions, Precisions
from geodesic_motion_ros.learning.densities import antipodal_log_density, von_mises_fisher_log_density
from geodesic_motion_ros.learning.networks import RadialBasisNetwork
from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder
from geodesic_motion_ros.manifold.encoder import TaskSpaceEncoder


@pytest.fixture(params=[0, 1, 2])
def vae(request):
    """An untrained model with random weights everywhere, without progress, with it, and of rounds."""
    with torch.random.fork_rng():
        torch.manual_seed(5)
        scaling = torch.tensor([0.4, -0.1, 0.3]), torch.tensor(0.21)
        vae = AutoEncoder(2, (20, 10), *scaling, False, 4, request.param).double()
        centres = torch.randn(30, 3 if request.param == 2 else 2).double()
        rate = torch.tensor(2.5).double()
        networks = [
            RadialBasisNetwork(centres, rate, torch.full((n,), floor).double(), torch.full((n,), scale).double())
            for n, floor, scale in ((3, 1.0, 200.0), (1, 0.01, 1600.0), (1, 1.0, 20.0))[: 2 + min(request.param, 1)]
        ]
        torch.nn.init.normal_(vae.encoder.perceptron.layers[-1].weight)
        for network in networks:
            torch.nn.init.normal_(network.raw_weights)
        vae.decoder.set_precisions(*networks)
        return vae.requires_grad_(False)


@pytest.fixture
def poses():
    rng = np.random.default_rng(2)
    return rng.normal(size=(50, 3)), normalise(rng.normal(size=(50, 4)))


def test_decoder_agrees_with_its_numpy_twin(vae):
    latent = np.random.default_rng(0).normal(0.0, 2.0, (200, 2))
    exported = TaskSpaceDecoder.from_arrays(vae.decoder.to_numpy().arrays()).decode(latent)
    means = vae.decoder.means(torch.tensor(latent))
    precisions = vae.decoder.precisions(torch.tensor(latent))
    np.testing.assert_allclose(exported.positions, means.coordinates, rtol=1e-10)
    np.testing.assert_allclose(exported.quaternions, means.directions, rtol=1e-10)
    np.testing.assert_allclose(exported.sigma, 1.0 / precisions.inverse_sigma, rtol=1e-10)
    np.testing.assert_allclose(exported.kappa, precisions.kappa, rtol=1e-10)
    decoder = vae.decoder.to_numpy()
    assert decoder.progress_numbers == vae.decoder.progress_count
    features = decoder.progress_features(latent, 0.2, 10.0)
    if not decoder.progress_numbers:
        assert features.shape == (200, 0)
        return
    np.testing.assert_allclose(features[:, :-1], 0.2 * means.progress, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(features[:, -1], 2.0 / precisions.progress, rtol=1e-10)


def test_decoder_survives_the_conversion_to_numpy_and_back(vae):
    exported = vae.decoder.to_numpy()
    again = type(vae.decoder).from_numpy(exported).to_numpy()
    for name, array in exported.arrays().items():
        np.testing.assert_allclose(again.arrays()[name], array, rtol=1e-9, err_msg=name)


def test_encoder_agrees_with_its_numpy_twin(vae, poses):
    exported = TaskSpaceEncoder.from_arrays(vae.encoder.arrays())
    mean, _ = vae.encoder(*map(torch.tensor, poses))
    np.testing.assert_allclose(exported.encode(*poses), mean, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize(
    ("blind", "density"),
    [(False, von_mises_fisher_log_density), (True, antipodal_log_density)],
)
def test_a_density_may_be_blind_to_the_sign(vae, poses, blind, density):
    vae.sign_blind = blind
    latent = torch.randn(50, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    means, precisions = vae.decoder.means(latent), vae.decoder.precisions(latent)
    quaternions = torch.tensor(poses[1])
    expected = density(quaternions, means.directions, precisions.kappa)
    torch.testing.assert_close(vae.direction_log_density(quaternions, means, precisions), expected)


def test_position_density_counts_every_coordinate_with_its_own_sigma(vae):
    latent = torch.zeros(1, 2, dtype=torch.float64)
    means = vae.decoder.means(latent)
    inverse_sigma = torch.tensor([[100.0, 200.0, 400.0]], dtype=torch.float64)
    precisions = Precisions(inverse_sigma, torch.ones(1, dtype=torch.float64))
    at_mean = vae.coordinate_log_density(means.coordinates, means, precisions)
    for axis in range(3):
        moved = means.coordinates.clone()
        moved[0, axis] += 0.01
        drop = at_mean - vae.coordinate_log_density(moved, means, precisions)
        assert float(drop) == pytest.approx(0.5 * (0.01 * float(inverse_sigma[0, axis])) ** 2)


def test_samples_scatter_as_the_posterior_says(vae, poses):
    one = [*(torch.tensor(values[:1]).repeat(20000, 1) for values in poses), torch.full((20000,), 0.3).double()]
    mean, log_variance = vae.encoder(*one)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        latent, *posterior = vae.sample(*one)
    deviation = torch.exp(0.5 * log_variance[0])
    torch.testing.assert_close(latent.mean(0), mean[0], rtol=0.0, atol=float(4.0 * deviation.max() / 20000**0.5))
    torch.testing.assert_close(latent.std(0), deviation, rtol=0.03, atol=0.0)
    torch.testing.assert_close(posterior, [mean, log_variance])


def test_fixed_precisions_are_the_same_everywhere():
    precisions = FixedPrecisions(0.005, 1600.0)(torch.randn(4, 2))
    torch.testing.assert_close(precisions.inverse_sigma, torch.full((4, 1), 200.0))
    torch.testing.assert_close(precisions.kappa, torch.full((4,), 1600.0))
