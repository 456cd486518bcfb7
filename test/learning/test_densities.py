import math

import mpmath
import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.densities import (
    angular_central_gaussian_log_density,
    antipodal_log_density,
    divergence_from_normal,
    full_gaussian_log_density,
    gaussian_log_density,
    scaled_log_normaliser,
    scaled_log_normaliser_of_directions,
    symmetric_matrix,
    von_mises_fisher_log_density,
    wrapped_log_density,
)

KAPPAS = np.concatenate([np.logspace(-3, 6, 37), [29.999, 30.0, 30.001, 713.0, 714.0]])
mpmath.mp.dps = 40


def exact_log_bessel(kappa):
    return mpmath.log(mpmath.besseli(1, mpmath.mpf(kappa)))


def exact_log_normaliser(kappa):
    return mpmath.log(mpmath.mpf(kappa)) - 2 * mpmath.log(2 * mpmath.pi) - exact_log_bessel(kappa)


def exact_ratio(kappa):
    """I_2 / I_1, the mean resultant length on S^3."""
    kappa = mpmath.mpf(kappa)
    return mpmath.besseli(2, kappa) / mpmath.besseli(1, kappa)


def exact_log_normaliser_of_directions(kappa):
    """log C_3(kappa) + kappa on S^2, C_3(kappa) = kappa / (4 pi sinh kappa)."""
    kappa = mpmath.mpf(kappa)
    return mpmath.log(kappa / (4 * mpmath.pi * mpmath.sinh(kappa))) + kappa


def exact_langevin_rest(kappa):
    """1 - (coth kappa - 1 / kappa), its derivative."""
    kappa = mpmath.mpf(kappa)
    return 1 - (mpmath.coth(kappa) - 1 / kappa)


def value_and_slope(function, kappas):
    argument = torch.tensor(kappas, requires_grad=True)
    value = function(argument)
    value.sum().backward()
    return value.detach().numpy(), argument.grad.numpy()


@pytest.mark.parametrize(
    ("function", "exact_value", "exact_slope"),
    [
        (scaled_log_normaliser, lambda k: exact_log_normaliser(k) + k, lambda k: 1 - exact_ratio(k)),
        (scaled_log_normaliser_of_directions, exact_log_normaliser_of_directions, exact_langevin_rest),
    ],
)
def test_values_and_slopes_agree_with_mpmath_over_nine_decades(function, exact_value, exact_slope):
    value, slope = value_and_slope(function, KAPPAS)
    np.testing.assert_allclose(value, [float(exact_value(k)) for k in KAPPAS], rtol=1e-12)
    np.testing.assert_allclose(slope, [float(exact_slope(k)) for k in KAPPAS], rtol=1e-12)


def test_single_precision_does_not_overflow():
    kappas = torch.tensor([1e-2, 89.0, 1e4, 1e6], dtype=torch.float32, requires_grad=True)
    scaled_log_normaliser(kappas).sum().backward()
    assert torch.isfinite(kappas.grad).all()


@pytest.mark.parametrize("kappa", [0.01, 3.0, 50.0])
def test_densities_integrate_to_one_over_the_sphere(kappa):
    # S^3 in polar angle t from mu: surface element 4 pi sin^2 t dt.
    angle = torch.linspace(0.0, math.pi, 20001, dtype=torch.float64)
    quaternions = torch.stack([torch.cos(angle), torch.sin(angle), 0.0 * angle, 0.0 * angle], dim=-1)
    direction = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64).expand_as(quaternions)
    concentration = torch.full_like(angle, kappa)
    for density in (von_mises_fisher_log_density, antipodal_log_density):
        height = density(quaternions, direction, concentration).exp()
        assert float(torch.trapezoid(4.0 * math.pi * torch.sin(angle) ** 2 * height, angle)) == pytest.approx(1.0)
        # S^2: surface element 2 pi sin t dt.
        height = density(quaternions[:, :3], direction[:, :3], concentration).exp()
        assert float(torch.trapezoid(2.0 * math.pi * torch.sin(angle) * height, angle)) == pytest.approx(1.0)


def test_the_uniform_limit():
    assert float(scaled_log_normaliser(torch.tensor(1e-3, dtype=torch.float64)) - 1e-3) == pytest.approx(
        -math.log(2.0 * math.pi**2), rel=1e-6
    )


def test_the_mixture_is_blind_to_sign_and_the_single_density_is_not():
    rng = np.random.default_rng(0)
    quaternions, directions = (
        torch.tensor(v / np.linalg.norm(v, axis=1, keepdims=True)) for v in rng.normal(size=(2, 50, 4))
    )
    kappa = torch.tensor(np.logspace(-2, 5, 50))
    mixture = antipodal_log_density(quaternions, directions, kappa)
    torch.testing.assert_close(mixture, antipodal_log_density(-quaternions, directions, kappa))
    both = torch.stack([von_mises_fisher_log_density(q, directions, kappa) for q in (quaternions, -quaternions)])
    torch.testing.assert_close(mixture, torch.logsumexp(both, 0) - math.log(2.0))
    assert not torch.allclose(both[0], both[1])


def test_gaussian_and_divergence_agree_with_torch_distributions():
    rng = np.random.default_rng(1)
    points, means = torch.tensor(rng.normal(size=(2, 20, 3)))
    sigma = torch.tensor(rng.uniform(0.1, 2.0, (20, 3)))
    expected = torch.distributions.Normal(means, sigma).log_prob(points).sum(-1)
    torch.testing.assert_close(gaussian_log_density(points, means, 1.0 / sigma), expected)
    posterior = torch.distributions.Normal(means, sigma)
    variance = torch.tensor([0.04, 1.0, 2.5], dtype=torch.float64)
    prior = torch.distributions.Normal(points, variance.sqrt())
    expected = torch.distributions.kl_divergence(posterior, prior).sum(-1)
    torch.testing.assert_close(divergence_from_normal(means, 2.0 * sigma.log(), points, variance), expected)


def random_tensor(*shape, seed=0, low=None):
    """Normal numbers, or uniform ones from `low` to 2."""
    rng = np.random.default_rng(seed)
    return torch.tensor(rng.normal(size=shape) if low is None else rng.uniform(low, 2.0, shape))


def test_a_full_covariance_is_that_of_torch_and_a_diagonal_one_without_elements_below():
    points, means, below = random_tensor(20, 3), random_tensor(20, 3, seed=1), 0.2 * random_tensor(20, 3, seed=2)
    diagonal = random_tensor(20, 3, low=0.8)
    root = symmetric_matrix(diagonal, below)
    assert torch.equal(root, root.mT)
    expected = torch.distributions.MultivariateNormal(means, precision_matrix=root @ root).log_prob(points)
    torch.testing.assert_close(full_gaussian_log_density(points, means, diagonal, below), expected)
    plain = full_gaussian_log_density(points, means, diagonal, 0.0 * below)
    torch.testing.assert_close(plain, gaussian_log_density(points, means, diagonal))


@pytest.mark.parametrize("kappas", [(0.5, 8.0, 40.0), (30.0, 30.0, 30.0), (1e-3, 1e-3, 1e-3)])
def test_the_angular_central_gaussian_integrates_to_one_over_the_sphere(kappas):
    """q = (cos e exp(i a), sin e exp(i b)), surface element du da db / 2 with u = sin^2 e."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    angle = 2.0 * np.pi * np.arange(80) / 80
    u, a, b = (grid.ravel() for grid in np.meshgrid(0.5 * (nodes + 1.0), angle, angle, indexing="ij"))
    near, far = np.sqrt(1.0 - u), np.sqrt(u)
    quaternions = torch.tensor(np.stack([near * np.cos(a), near * np.sin(a), far * np.cos(b), far * np.sin(b)], 1))
    mean = torch.nn.functional.normalize(torch.tensor([0.3, -0.5, 0.7, 0.2]).double(), dim=0)
    log_density = angular_central_gaussian_log_density(
        quaternions, mean.expand_as(quaternions), torch.tensor(kappas).double()
    )
    surface = np.repeat(0.5 * weights, len(angle) ** 2) * 0.5 * (2.0 * np.pi / len(angle)) ** 2
    assert float((log_density.exp() * torch.tensor(surface)).sum()) == pytest.approx(1.0, abs=1e-6)


def test_the_angular_central_gaussian_has_its_matrix_about_the_axes_of_the_tool():
    """Tyler's formula, A of the mean and of mean * (0, axis): a turn about an axis of the tool, right of its own."""
    q, mean = (torch.nn.functional.normalize(random_tensor(4, seed=seed), dim=0) for seed in (1, 2))
    kappas = torch.tensor([3.0, 200.0, 9000.0]).double()
    w, x, y, z = mean.tolist()
    axes = torch.tensor([[-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]]).double()
    matrix = torch.outer(mean, mean) + (axes.T / (1.0 + 0.25 * kappas)) @ axes
    expected = -0.5 * torch.logdet(matrix) - 2.0 * torch.log(q @ torch.linalg.inv(matrix) @ q)
    expected = expected - math.log(2.0 * math.pi**2)
    for sign in (1.0, -1.0):
        found = angular_central_gaussian_log_density(sign * q, mean, kappas)
        torch.testing.assert_close(found, expected)


def test_the_curvature_at_the_mode_is_that_of_von_mises_and_fisher_about_each_axis():
    mean = torch.tensor([1.0, 0.0, 0.0, 0.0]).double()
    kappas, angle = torch.tensor([100.0, 400.0, 1600.0]).double(), 1e-4
    for axis in range(3):
        moved = torch.zeros(4).double()
        moved[0], moved[1 + axis] = math.cos(angle), math.sin(angle)
        drop, expected = (
            density(mean, mean, kappa) - density(moved, mean, kappa)
            for density, kappa in (
                (angular_central_gaussian_log_density, kappas), (von_mises_fisher_log_density, kappas[axis]),
            )
        )  # fmt: skip
        assert float(drop) == pytest.approx(float(expected), rel=1e-4)


def test_an_error_of_the_recording_bounds_what_concentrations_gain():
    mean = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).double()
    heights = [
        float(angular_central_gaussian_log_density(mean, mean, torch.full((1, 3), kappa).double(), 0.01))
        for kappa in (1e3, 1e5, 1e7)
    ]
    assert heights[1] > max(heights[0], heights[2])


def test_a_wrapped_normal_integrates_to_one_over_a_turn_and_knows_no_turns():
    angle = torch.linspace(-math.pi, math.pi, 4001, dtype=torch.float64)[:, None]
    for deviation in (0.05, 1.0):
        inverse = torch.full_like(angle, 1.0 / deviation)
        density = wrapped_log_density(angle, torch.full_like(angle, 2.9), inverse)
        assert float(torch.trapezoid(density.exp(), angle[:, 0])) == pytest.approx(1.0, abs=1e-6)
        turned = wrapped_log_density(angle, torch.full_like(angle, 2.9 - 4.0 * math.pi), inverse)
        torch.testing.assert_close(turned, density, rtol=1e-9, atol=1e-9)


def test_a_wrapped_normal_is_gaussian_where_nothing_is_near_half_a_turn():
    points, means = 0.3 * random_tensor(30, 7), 0.3 * random_tensor(30, 7, seed=1)
    inverse = torch.full_like(points, 10.0)
    wrapped = wrapped_log_density(points, means, inverse)
    torch.testing.assert_close(wrapped, gaussian_log_density(points, means, inverse))


def test_gradients_are_the_finite_differences():
    points, means = random_tensor(5, 3), random_tensor(5, 3, seed=1)
    unit = [torch.nn.functional.normalize(random_tensor(5, 4, seed=seed), dim=-1) for seed in (2, 3)]
    positive, below = random_tensor(5, 3, seed=4, low=0.7), 0.2 * random_tensor(5, 3, seed=5)
    for function, arguments in (
        (full_gaussian_log_density, (points, means, positive, below)),
        (wrapped_log_density, (points, means, positive)),
        (angular_central_gaussian_log_density, (*unit, positive)),
    ):
        free = [argument.clone().requires_grad_() for argument in arguments]
        assert torch.autograd.gradcheck(function, free)
