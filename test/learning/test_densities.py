import math

import mpmath
import numpy as np
import pytest
import torch

from geodesic_motion_ros.learning.densities import (
    antipodal_log_density,
    divergence_from_normal,
    gaussian_log_density,
    scaled_log_normaliser,
    scaled_log_normaliser_of_directions,
    von_mises_fisher_log_density,
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
