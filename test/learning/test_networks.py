import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.densities import symmetric_matrix
from geodesic_motion_ros.learning.networks import (
    MultilayerPerceptron,
    RadialBasisNetwork,
    SymmetricBasisNetwork,
    kernel_rate,
    place_centres,
)
from geodesic_motion_ros.utils.errors import ParameterError


def test_perceptron_is_linear_tanh_linear():
    network = MultilayerPerceptron([2, 5, 3]).double()
    points = torch.randn(7, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    first, last = network.layers
    expected = torch.tanh(points @ first.weight.T + first.bias) @ last.weight.T + last.bias
    torch.testing.assert_close(network(points), expected)


def basis_network(floor=(0.5, 2.0), scale=(10.0, 1e3)):
    centres = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]], dtype=torch.float64)
    values = (torch.tensor(v, dtype=torch.float64) for v in (8.0, floor, scale))
    return RadialBasisNetwork(centres, *values)


def test_basis_network_computes_its_formula_and_keeps_the_weights_it_is_given():
    network = basis_network()
    weights = torch.tensor([[3.0, 1e-3, 200.0], [1.0, 50.0, 4e4]], dtype=torch.float64)
    network.weights = weights
    torch.testing.assert_close(network.weights, weights, rtol=1e-12, atol=0.0)
    point = torch.tensor([0.3, -0.2], dtype=torch.float64)
    kernels = torch.exp(-8.0 * ((point - network.centres) ** 2).sum(-1))
    torch.testing.assert_close(network(point), weights @ kernels + network.floor)


def test_basis_network_falls_to_its_floor_and_never_below_it():
    network = basis_network()
    with torch.no_grad():
        network.raw_weights.fill_(-30.0)
    points = torch.tensor([[0.0, 0.0], [50.0, 50.0]], dtype=torch.float64)
    assert (network(points) >= network.floor).all()
    torch.testing.assert_close(network(points[1]), network.floor)


def test_a_symmetric_network_is_positive_definite_whatever_its_shears_and_diagonal_without():
    plain = basis_network(floor=(0.5, 0.5, 0.5), scale=(10.0, 1e3, 1.0))
    network = SymmetricBasisNetwork(plain.centres, plain.rate, plain.floor, plain.scale)
    points = torch.randn(200, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    values = network(points)
    torch.testing.assert_close(values[:, :3], plain(points))
    assert torch.equal(values[:, 3:], torch.zeros(200, 3).double())
    torch.nn.init.normal_(network.shears, std=5.0)
    values = network(torch.cat([points, torch.full((1, 2), 50.0).double()]))
    assert values[:-1, 3:].abs().max() > 1.0
    smallest = torch.linalg.eigvalsh(symmetric_matrix(values[:, :3], values[:, 3:]))[:, 0]
    assert (smallest > 0.5 - 1e-9).all()
    torch.testing.assert_close(values[-1], torch.tensor([0.5, 0.5, 0.5, 0.0, 0.0, 0.0]).double())


def test_centres_are_reproducible_and_lie_among_the_codes():
    codes = np.random.default_rng(0).normal(size=(300, 2))
    first, again, other = (place_centres(codes, 40, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert first.shape == (40, 2)
    assert np.all(first >= codes.min(axis=0))
    assert np.all(first <= codes.max(axis=0))


def test_centres_reduce_the_distance_to_the_codes():
    codes = np.random.default_rng(0).normal(size=(300, 2))

    def distortion(centres):
        return np.mean(np.min(np.sum((codes[:, None] - centres) ** 2, axis=-1), axis=1))

    assert distortion(place_centres(codes, 40, 0)) < 0.8 * distortion(codes[:40])


def test_few_codes_give_few_centres():
    assert len(place_centres(np.random.default_rng(0).normal(size=(20, 2)), 500, 0)) == 10


@pytest.mark.parametrize(
    ("codes", "count"), [(np.zeros((2, 2)), 5), (np.full((9, 2), np.nan), 5), (np.ones((9, 2)), 1)]
)
def test_impossible_centres_are_refused(codes, count):
    with pytest.raises(ParameterError, match="needed"):
        place_centres(codes, count, 0)


def square_lattice():
    return np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), axis=-1).reshape(-1, 2) * 0.2


def test_kernel_rate_of_a_square_lattice():
    lattice = square_lattice()
    assert kernel_rate(lattice, lattice, 1.0) == pytest.approx(0.5 / 0.2**2)
    assert kernel_rate(lattice, lattice, 3.0) == pytest.approx(0.5 / 0.6**2)


def test_kernels_reach_codes_far_from_every_centre():
    """Where one code in ten is a metre from its centre, the bandwidth is no longer the centres' distance."""
    lattice = square_lattice()
    codes = np.concatenate([lattice.repeat(9, axis=0), lattice[-5:].repeat(5, axis=0) + [0.0, 1.0]])
    assert kernel_rate(lattice, codes, 1.0) == pytest.approx(0.5 / 0.5**2)
