"""The pull-back metric of a decoder of configurations, seen at the robot's body, for continuous geodesics."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from geodesic_motion_ros.learning.autoencoder import DecoderNetwork
from geodesic_motion_ros.learning.body_layer import BodyLayer
from geodesic_motion_ros.manifold.configuration_graph import JointMetricSettings
from geodesic_motion_studies.tools.metric import progress_features


@dataclass(frozen=True)
class JointPullbackMetric:
    """M = 1/K [sum_k (|J_k J_mu|^2 + s^2 |J_k J_sigma|^2) + h^2 (|J_q J_mu|^2 + s^2 |J_q J_sigma|^2)]
    + g^2 (|J_mu|^2 + s^2 |J_sigma|^2), with |J|^2 = J^T J; and what progress adds (`progress_features`).

    J_k is the Jacobian of body point k at mu(z), J_q that of the tool's unit quaternion, s the sigma_weight, h the
    orientation_weight and g the joint_weight: the metric tensor of `manifold.configuration_graph`, without obstacles,
    for a decoder that can be differentiated.

    Attributes
    ----------
    decoder : with its sigma fitted, float64 for a float64 metric.
    body : the robot's body points that count.
    settings : weights of the metric.
    """

    decoder: DecoderNetwork
    body: BodyLayer
    settings: JointMetricSettings = field(default_factory=JointMetricSettings)

    def features(self, latent: Tensor) -> Tensor:
        """(mu, s sigma), (..., 2 eta) [rad], at latent points (..., d)."""
        sigma = 1.0 / self.decoder.precisions(latent).inverse_sigma
        return torch.cat([self.decoder.means(latent).coordinates, self.settings.sigma_weight * sigma], dim=-1)

    def __call__(self, latent: Tensor) -> Tensor:
        """Metric tensors (n, d, d) at latent points (n, d)."""
        slopes = torch.func.vmap(torch.func.jacfwd(self.features))(latent)
        slopes = slopes.unflatten(1, (2, -1))
        means = self.decoder.means(latent).coordinates
        jacobians = self.body.jacobians(means)
        moved = torch.einsum("nkaj,npjd->nkpad", jacobians, slopes) / jacobians.shape[1] ** 0.5
        tool = torch.einsum("naj,npjd->npad", self.body.orientation_jacobians(means), slopes)
        tool = self.settings.orientation_weight / jacobians.shape[1] ** 0.5 * tool
        parts = [moved, tool, self.settings.joint_weight * slopes]
        if self.decoder.progress_count:
            parts.append(torch.func.vmap(torch.func.jacfwd(self._progress))(latent))
        return sum(torch.einsum("nrd,nre->nde", part.flatten(1, -2), part.flatten(1, -2)) for part in parts)

    def _progress(self, latent: Tensor) -> Tensor:
        return torch.cat(progress_features(self.decoder, latent, self.settings), dim=-1)
