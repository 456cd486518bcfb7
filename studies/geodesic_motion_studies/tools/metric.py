"""The pull-back metric of a decoder, what it says of curves, and how obstacles change it.

Glossary: J_f, Jacobian of f with respect to z; A, ambient metric; M(z), metric tensor on the latent space;
log sqrt det M, magnification factor; length, integral of sqrt(dz^T M dz); energy, integral of dz^T M dz over
a curve run through in unit time, never less than the squared length and equal to it at constant speed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from geodesic_motion_ros.learning.autoencoder import DecoderNetwork, Precisions
from geodesic_motion_ros.learning.densities import symmetric_matrix
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_ros.manifold.pose_graph import MetricSettings

#: A Riemannian metric: latent points (n, d) to symmetric positive definite tensors (n, d, d), differentiable.
Metric = Callable[[Tensor], Tensor]


@dataclass(frozen=True)
class AmbientFactor:
    """m(p) = 1 + strength sum_o exp(-|p - o|^2 / (2 r_o^2)): how obstacles stretch the space around a point.

    The paper's form, for continuous geodesics. (`manifold.ambient` cuts the Gaussian off where the tick cannot
    afford it.)

    Attributes
    ----------
    centres : (o, 3) obstacles [m]; widths : (o,) r_o [m], the paper: the obstacle's radius; strength : zeta.
    """

    centres: Tensor
    widths: Tensor
    strength: float

    def __call__(self, positions: Tensor) -> Tensor:
        """m (n,) >= 1 at positions (n, 3) [m]."""
        squared = ((positions[:, None, :] - self.centres) ** 2).sum(-1)
        return 1.0 + self.strength * torch.exp(-0.5 * squared / self.widths**2).sum(-1)


@dataclass(frozen=True)
class PullbackMetric:
    """M = J_x^T A J_x + w^2 J_sigma^T A J_sigma + J_q^T J_q + J_k^T J_k + l^2 (J_s^T J_s + w^2 J_sigma_s^T J_sigma_s)
    of a task-space decoder, the last term where it decodes progress s.

    A = m(x) I_3, with m the ambient factor at the decoded position x, 1 without obstacles; w, k (kappa^(-1/2), or
    kappa as the paper has it) and l come from the settings. Jacobians in forward mode: d is 2 or 3, features are 11, or
    13.

    Attributes
    ----------
    decoder : differentiable decoder, float64 for a float64 metric.
    settings : weights of the metric.
    ambient : positions (n, 3) to factors (n,); None without obstacles.
    """

    decoder: DecoderNetwork
    settings: MetricSettings = field(default_factory=MetricSettings)
    ambient: Callable[[Tensor], Tensor] | None = None

    def features(self, latent: Tensor) -> Tensor:
        """(x, sigma, q, k), (..., 11), and l (s, w sigma_s) at latent points (..., d); fewer of a model with fewer
        coordinates, more of one with a full covariance (`Decoded.root`) or with three concentrations.
        """
        means, precisions = self.decoder.means(latent), self.decoder.precisions(latent)
        kappas = precisions.kappa if precisions.kappa.ndim == latent.ndim else precisions.kappa[..., None]
        scaled = kappas**-0.5 if self.settings.orientation_scale == "spread" else kappas
        parts = (means.coordinates, _root(precisions), means.directions, scaled / kappas.shape[-1] ** 0.5)
        return torch.cat([*parts, *progress_features(self.decoder, latent, self.settings)], dim=-1)

    def jacobian(self, latent: Tensor) -> Tensor:
        """Jacobian (n, 11 or 13, d) of the features at latent points (n, d)."""
        return torch.func.vmap(torch.func.jacfwd(self.features))(latent)

    def __call__(self, latent: Tensor) -> Tensor:
        """Metric tensors (n, d, d) at latent points (n, d)."""
        jacobian = self.jacobian(latent)
        weights = torch.ones_like(jacobian[..., 0])
        coordinates = len(self.decoder.offset)
        stretched = coordinates + len(self.decoder.inverse_sigma.far)
        weights[:, coordinates:stretched] = self.settings.sigma_weight**2
        if self.ambient is not None:
            factor = self.ambient(self.decoder.means(latent).coordinates)[:, None]
            weights = torch.cat([weights[:, :stretched] * factor, weights[:, stretched:]], dim=-1)
        return torch.einsum("nfi,nf,nfj->nij", jacobian, weights, jacobian)


def _root(precisions: Precisions) -> Tensor:
    """Features of the root of the covariance of coordinates, as of `manifold.full_covariance`."""
    if precisions.below is None:
        return 1.0 / precisions.inverse_sigma
    root = torch.linalg.inv(symmetric_matrix(precisions.inverse_sigma, precisions.below))
    first, second = torch.tril_indices(*root.shape[-2:], -1)
    return torch.cat([root.diagonal(dim1=-2, dim2=-1), 2.0**0.5 * root[..., first, second]], dim=-1)


def progress_features(
    decoder: DecoderNetwork, latent: Tensor, settings: MetricSettings | JointMetricSettings
) -> tuple[Tensor, ...]:
    """Make the features l s (..., 1 or 2) and l w sigma_s (..., 1) of a decoder that decodes progress; none of another.
    """
    means, precisions = decoder.means(latent), decoder.precisions(latent)
    if means.progress is None:
        return ()
    features = means.progress, settings.sigma_weight / precisions.progress[..., None]
    return tuple(settings.progress_length * feature for feature in features)


def magnification_factor(metric: Metric, latent: Tensor) -> Tensor:
    """log sqrt det M (n,) at latent points (n, d): how much volume the decoder makes of a latent cell."""
    return 0.5 * torch.logdet(metric(latent))


def curve_length(metric: Metric, curve: Tensor) -> Tensor:
    """Riemannian length () of a polyline (T, d), the metric taken in the middle of each piece."""
    return _squared_pieces(metric, curve).clamp_min(0.0).sqrt().sum()


def curve_energy(metric: Metric, curve: Tensor) -> Tensor:
    """Energy () of a polyline (T, d) run through in unit time, equal times for its pieces."""
    return (len(curve) - 1) * _squared_pieces(metric, curve).sum()


def _squared_pieces(metric: Metric, curve: Tensor) -> Tensor:
    steps = curve[1:] - curve[:-1]
    tensors = metric(0.5 * (curve[1:] + curve[:-1]))
    return torch.einsum("ni,nij,nj->n", steps, tensors, steps)
