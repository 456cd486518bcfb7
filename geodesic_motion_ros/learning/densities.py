"""Densities of coordinates, Gaussian, diagonal or full, or wrapped, and of orientations, von Mises-Fisher on S^3, or on
S^2, or angular central Gaussian on S^3.

Glossary: kappa, concentration (kappa^(-1/2) is about the angular standard deviation on S^3, in radians of the
quaternion, half the rotation angle); I_v, modified Bessel function of the first kind;
C_4(kappa) = kappa / ((2 pi)^2 I_1(kappa)), the normaliser of the von Mises-Fisher density on S^3 in R^4
(Mardia and Jupp, Directional Statistics, section 9.3.2).

I_1 overflows at kappa = 89 in single and 713 in double precision while demonstrations need 1e4, so everything
is written with the scaled function exp(-kappa) I_1(kappa), and the exponential joins the exponent of the
density: log vMF(q) = log kappa - 2 log 2 pi - log(exp(-kappa) I_1(kappa)) - kappa |mu - q|^2 / 2. On S^2 in R^3 the
normaliser is elementary: C_3(kappa) = kappa / (4 pi sinh kappa).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

_LARGE = 30.0
_FRACTION_TERMS = 60
_ASYMPTOTIC_TERMS = 20


def scaled_log_normaliser(kappa: Tensor) -> Tensor:
    """log C_4(kappa) + kappa, any shape: the von Mises-Fisher density on S^3 at its mode; differentiable once.

    C_4(kappa) = kappa / ((2 pi)^2 I_1(kappa)) tends to the uniform density 1 / (2 pi^2) as kappa goes to 0. The sum
    grows like 3/2 log kappa only.
    """
    return _LogRatio.apply(kappa) - 2.0 * math.log(2.0 * math.pi)


def scaled_log_normaliser_of_directions(kappa: Tensor) -> Tensor:
    """log C_3(kappa) + kappa = log kappa - log 2 pi - log(1 - exp(-2 kappa)), the same for S^2; any shape."""
    return torch.log(kappa) - math.log(2.0 * math.pi) - torch.log(-torch.expm1(-2.0 * kappa))


def von_mises_fisher_log_density(quaternions: Tensor, directions: Tensor, kappa: Tensor) -> Tensor:
    """log vMF(q | mu, kappa) on S^3, per unit of surface.

    Parameters
    ----------
    quaternions, directions : (..., 4) unit vectors q and mu; on S^2 (..., 3).
    kappa : (...) positive concentrations.
    """
    return _height(kappa, directions) - 0.5 * kappa * _squared_chord(quaternions, directions)


def antipodal_log_density(quaternions: Tensor, directions: Tensor, kappa: Tensor) -> Tensor:
    """log of the mixture 1/2 vMF(q | mu, kappa) + 1/2 vMF(q | -mu, kappa): the same for q and -q.

    Shapes as in `von_mises_fisher_log_density`.
    """
    near = -0.5 * kappa * _squared_chord(quaternions, directions)
    far = -0.5 * kappa * _squared_chord(quaternions, -directions)
    return _height(kappa, directions) + torch.logaddexp(near, far) - math.log(2.0)


def gaussian_log_density(points: Tensor, means: Tensor, inverse_sigma: Tensor) -> Tensor:
    """log N(x | mu, diag(sigma^2)), summed over the last axis.

    Parameters
    ----------
    points, means : (..., n).
    inverse_sigma : (..., n) reciprocal standard deviations, in the reciprocal unit of the points.
    """
    standardised = (points - means) * inverse_sigma
    terms = torch.log(inverse_sigma) - 0.5 * standardised**2 - 0.5 * math.log(2.0 * math.pi)
    return terms.sum(-1)


def full_gaussian_log_density(points: Tensor, means: Tensor, diagonal: Tensor, below: Tensor) -> Tensor:
    """log N(x | mu, R^-2) (...), with R the inverse of the covariance's symmetric root.

    Parameters
    ----------
    points, means : (..., p).
    diagonal, below : (..., p), (..., p (p - 1) / 2) elements of R, in the reciprocal unit of the points; 0 below the
        diagonal it is `gaussian_log_density`.
    """
    root = symmetric_matrix(diagonal, below)
    standardised = (root @ (points - means)[..., None])[..., 0]
    height = torch.linalg.slogdet(root).logabsdet - 0.5 * points.shape[-1] * math.log(2.0 * math.pi)
    return height - 0.5 * (standardised**2).sum(-1)


def wrapped_log_density(points: Tensor, means: Tensor, inverse_sigma: Tensor) -> Tensor:
    """log of the wrapped normal density of angles, sum_k N(x + 2 pi k | mu, sigma^2), summed over the last axis.

    Arguments as of `gaussian_log_density`, in [rad]. Angles and means that whole turns separate are the same. Of the
    sum the terms of the nearest turn and both of its neighbours are counted: the others are below 1e-19 of it for sigma
    up to 1 rad.

    Equation: Mardia and Jupp, Directional Statistics, section 3.5.7.
    """
    turn = 2.0 * math.pi
    off = torch.remainder(points - means + math.pi, turn) - math.pi
    copies = torch.stack([off - turn, off, off + turn])
    terms = torch.logsumexp(-0.5 * (copies * inverse_sigma) ** 2, 0)
    return (terms + torch.log(inverse_sigma) - 0.5 * math.log(turn)).sum(-1)


def angular_central_gaussian_log_density(
    quaternions: Tensor, directions: Tensor, kappas: Tensor, error: float = 0.0
) -> Tensor:
    """log p(q) (...) of the angular central Gaussian density on S^3, the same for q and -q, per unit of surface:

    p(q) = |A|^(-1/2) (q' A^-1 q)^-2 / (2 pi^2),   q' A^-1 q = 1 + sum_i kappa_i c_i^2 / 4,   |A^-1| = prod_i (1 +
    kappa_i / 4)

    with c the vector part of the turn from the mean to q, in the tool's axes: A has the mean's direction and three
    about these axes (Tyler, Statistical analysis for the angular central Gaussian distribution on the sphere,
    Biometrika 1987). At the mode its curvature is that of a von Mises-Fisher density, kappa_i about axis i.

    Parameters
    ----------
    quaternions, directions : (..., 4) unit vectors q and mu.
    kappas : (..., 3) positive concentrations about the tool's axes.
    error : deviation of q about each axis, in radians of the quaternion, over which the density is expected: c_i^2
        grows by its square, inside the logarithm, which is a lower bound.
    """
    scalar, vector = quaternions[..., :1], quaternions[..., 1:]
    turned = directions[..., :1] * vector - scalar * directions[..., 1:]
    turned = turned - torch.linalg.cross(directions[..., 1:], vector)
    form = 1.0 + 0.25 * (kappas * (turned**2 + error**2)).sum(-1)
    return 0.5 * torch.log1p(0.25 * kappas).sum(-1) - 2.0 * torch.log(form) - math.log(2.0 * math.pi**2)


def symmetric_matrix(diagonal: Tensor, below: Tensor) -> Tensor:
    """Unpack symmetric matrices (..., p, p) from their diagonals (..., p) and the elements below them, by rows."""
    size = diagonal.shape[-1]
    places = torch.zeros(size, size, dtype=torch.long)
    first, second = torch.tril_indices(size, size, -1)
    places[first, second] = places[second, first] = size + torch.arange(below.shape[-1])
    places[range(size), range(size)] = torch.arange(size)
    return torch.cat([diagonal, below], dim=-1)[..., places]


def divergence_from_normal(mean: Tensor, log_variance: Tensor, prior_mean: Tensor, prior_variance: Tensor) -> Tensor:
    """Kullback-Leibler divergence KL(N(mean, diag(exp(log_variance))) || N(prior_mean, diag(prior_variance))).

    Summed over the last axis; all arguments (..., d).
    """
    excess = ((mean - prior_mean) ** 2 + log_variance.exp()) / prior_variance
    return 0.5 * (excess - 1.0 - log_variance + prior_variance.log()).sum(-1)


def _height(kappa: Tensor, directions: Tensor) -> Tensor:
    """log of the density at its mode, on the sphere in the space that directions (..., 3 or 4) have."""
    on_plain_sphere = directions.shape[-1] == 3
    return scaled_log_normaliser_of_directions(kappa) if on_plain_sphere else scaled_log_normaliser(kappa)


def _squared_chord(first: Tensor, second: Tensor) -> Tensor:
    return ((first - second) ** 2).sum(-1)


class _LogRatio(torch.autograd.Function):
    """log kappa - log(exp(-kappa) I_1(kappa)), with derivative 1 - I_2(kappa) / I_1(kappa).

    Differentiating through torch's Bessel functions would subtract nearly equal numbers at both ends: 2 /
    kappa from I_0 / I_1 for small arguments, I_2 / I_1 from 1 for large ones.
    """

    @staticmethod
    def forward(kappa: Tensor) -> Tensor:
        return torch.log(kappa) - torch.log(torch.special.i1e(kappa))

    @staticmethod
    def setup_context(ctx, inputs: tuple[Tensor], output: Tensor) -> None:
        ctx.save_for_backward(inputs[0])

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, gradient: Tensor) -> Tensor:
        (kappa,) = ctx.saved_tensors
        return gradient * _one_minus_bessel_ratio(kappa)


def _one_minus_bessel_ratio(kappa: Tensor) -> Tensor:
    """1 - I_2(kappa) / I_1(kappa) to rounding, for positive kappa."""
    small = kappa <= _LARGE
    fraction = _continued_fraction(torch.where(small, kappa, torch.ones_like(kappa)))
    return torch.where(small, 1.0 - fraction, _asymptotic(torch.where(small, torch.full_like(kappa, _LARGE), kappa)))


def _continued_fraction(kappa: Tensor) -> Tensor:
    """I_2 / I_1 = 1 / (4 / k + 1 / (6 / k + ...)) (Gauss), positive terms only; for moderate arguments."""
    tail = torch.zeros_like(kappa)
    for order in range(_FRACTION_TERMS, 1, -1):
        tail = 1.0 / (2.0 * order / kappa + tail)
    return tail


def _asymptotic(kappa: Tensor) -> Tensor:
    """1 - I_2 / I_1 from Hankel's expansions of both functions, subtracted term by term."""
    first_term, second_term = torch.ones_like(kappa), torch.ones_like(kappa)
    first_sum, difference = torch.ones_like(kappa), torch.zeros_like(kappa)
    for index in range(1, _ASYMPTOTIC_TERMS + 1):
        odd_squared = (2.0 * index - 1.0) ** 2
        first_term = first_term * (odd_squared - 4.0) / (8.0 * index * kappa)
        second_term = second_term * (odd_squared - 16.0) / (8.0 * index * kappa)
        first_sum = first_sum + first_term
        difference = difference + (first_term - second_term)
    return difference / first_sum
