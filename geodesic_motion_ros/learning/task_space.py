"""The variational auto-encoder of end-effector poses, R^3 x S^3.

    p(x, q | z) = N(x | mu(z), diag(sigma(z)^2)) p(q | mu_q(z), kappa(z))

mu and mu_q are the seven outputs of one perceptron, 1 / sigma and kappa radial-basis-function networks
(Beik-Mohammadi et al., "Reactive motion generation on learned Riemannian manifolds", IJRR 2023, section 3.1: learning
in task space). The same networks learn its toy, positions in the plane with directions on S^2: p numbers of position
and o of orientation are 3 and 4 where nothing else is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from geodesic_motion_ros.learning.densities import (
    antipodal_log_density,
    gaussian_log_density,
    von_mises_fisher_log_density,
)
from geodesic_motion_ros.learning.networks import MultilayerPerceptron, RadialBasisNetwork, as_array, layer_arrays
from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder

OrientationModel = Literal["two_cluster", "sign_blind"]


class Means(NamedTuple):
    """Mean positions (..., p) [m] and unit mean directions (..., o) of a batch of latent points."""

    positions: Tensor
    quaternions: Tensor


class Precisions(NamedTuple):
    """Reciprocal position deviations (..., p) [1/m] and orientation concentrations (...) of a batch."""

    inverse_sigma: Tensor
    kappa: Tensor


@dataclass(frozen=True)
class FixedPrecisions:
    """Likelihood scales that do not depend on z, for learning the means first.

    Attributes
    ----------
    sigma : standard deviation of every position coordinate [m].
    kappa : concentration of the orientation.
    """

    sigma: float
    kappa: float

    def __call__(self, latent: Tensor) -> Precisions:
        like = latent[..., 0]
        return Precisions(torch.full_like(like, 1.0 / self.sigma)[..., None], torch.full_like(like, self.kappa))


class EncoderNetwork(nn.Module):
    """q(z | x, q) = N(mean, diag(exp(log_variance))): tanh layers, then both outputs from one linear layer.

    Parameters
    ----------
    latent_dimension : d.
    hidden : units of the hidden layers, from the pose inwards.
    offset, scale : positions enter as (x - offset) / scale; offset (p,) [m], scale () [m].
    orientation : o.
    """

    def __init__(
        self, latent_dimension: int, hidden: Sequence[int], offset: Tensor, scale: Tensor, orientation: int = 4
    ) -> None:
        super().__init__()
        self.register_buffer("offset", offset)
        self.register_buffer("scale", scale)
        self.perceptron = MultilayerPerceptron([len(offset) + orientation, *hidden, 2 * latent_dimension])

    def forward(self, positions: Tensor, quaternions: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log variance, both (..., d), of positions (..., p) [m] and unit quaternions (..., o)."""
        inputs = torch.cat([(positions - self.offset) / self.scale, quaternions], dim=-1)
        mean, log_variance = self.perceptron(inputs).chunk(2, dim=-1)
        return mean, log_variance

    def arrays(self) -> dict[str, np.ndarray]:
        """Weights by the names that `manifold.encoder.TaskSpaceEncoder` reads (the mean's rows only)."""
        named = layer_arrays(self.perceptron)
        latent_dimension = len(named["b3"]) // 2
        named["W3"], named["b3"] = named["W3"][:latent_dimension], named["b3"][:latent_dimension]
        return named | {"position_offset": as_array(self.offset), "position_scale": as_array(self.scale)}


class DecoderNetwork(nn.Module):
    """Decodes latent points z into tool poses with their uncertainties: mu(z), mu_q(z), 1 / sigma(z) and kappa(z).

    Parameters
    ----------
    latent_dimension : d.
    hidden : units of the hidden layers, from the latent space outwards.
    offset, scale : the mean position is offset (p,) [m] + scale () [m] times the network's first p outputs.
    orientation : o.

    `precisions` has to be given its radial-basis networks (`set_precisions`) before sigma and kappa are
    known.
    """

    def __init__(
        self, latent_dimension: int, hidden: Sequence[int], offset: Tensor, scale: Tensor, orientation: int = 4
    ) -> None:
        super().__init__()
        self.register_buffer("offset", offset)
        self.register_buffer("scale", scale)
        self.perceptron = MultilayerPerceptron([latent_dimension, *hidden, len(offset) + orientation])
        self.inverse_sigma: RadialBasisNetwork | None = None
        self.kappa: RadialBasisNetwork | None = None

    def means(self, latent: Tensor) -> Means:
        """Mean positions and directions at latent points (..., d)."""
        outputs, p = self.perceptron(latent), len(self.offset)
        return Means(self.offset + self.scale * outputs[..., :p], nn.functional.normalize(outputs[..., p:], dim=-1))

    def precisions(self, latent: Tensor) -> Precisions:
        """1 / sigma and kappa at latent points (..., d). Both networks share their kernels, evaluated
        once.
        """
        activations = self.inverse_sigma.activations(latent)
        return Precisions(self.inverse_sigma.combine(activations), self.kappa.combine(activations)[..., 0])

    def set_precisions(self, inverse_sigma: RadialBasisNetwork, kappa: RadialBasisNetwork) -> None:
        """Install the two radial-basis networks, which must have the same centres and rate."""
        self.inverse_sigma, self.kappa = inverse_sigma, kappa

    def to_numpy(self) -> TaskSpaceDecoder:
        """The same decoder without torch, as skills store it."""
        return TaskSpaceDecoder(
            **layer_arrays(self.perceptron),
            position_offset=as_array(self.offset),
            position_scale=as_array(self.scale),
            rbf_centres=as_array(self.inverse_sigma.centres),
            rbf_rate=as_array(self.inverse_sigma.rate),
            sigma_weights=as_array(self.inverse_sigma.weights),
            sigma_floor=as_array(self.inverse_sigma.floor),
            kappa_weights=as_array(self.kappa.weights[0]),
            kappa_floor=as_array(self.kappa.floor[0]),
        )

    @classmethod
    def from_numpy(cls, decoder: TaskSpaceDecoder) -> DecoderNetwork:
        """The differentiable twin (float64) of a skill's decoder, for metrics and continuous geodesics."""
        tensors = {name: torch.tensor(value) for name, value in decoder.arrays().items()}
        network = cls(
            decoder.latent_dimension,
            [len(decoder.b1), len(decoder.b2)],
            tensors["position_offset"],
            tensors["position_scale"],
        ).double()
        with torch.no_grad():
            for layer, number in zip(network.perceptron.layers, "123", strict=True):
                layer.weight.copy_(tensors["W" + number])
                layer.bias.copy_(tensors["b" + number])
        network.set_precisions(
            _basis_network(tensors, tensors["sigma_weights"], tensors["sigma_floor"]),
            _basis_network(tensors, tensors["kappa_weights"][None], tensors["kappa_floor"][None]),
        )
        return network.requires_grad_(False)


class TaskSpaceVAE(nn.Module):
    """Encoder and decoder of poses with their evidence lower bound.

    Parameters
    ----------
    latent_dimension : d.
    hidden : units of the encoder's hidden layers; the decoder has them in reverse.
    offset, scale : scaling of positions, (p,) and () [m]: one scalar, so that distances keep their
        proportions.
    orientation_model : "two_cluster": p(q | z) is one von Mises-Fisher density, so q and -q, both in the
        data, lie in two separate clusters. "sign_blind": the mixture 1/2 vMF(mu_q) + 1/2 vMF(-mu_q), under
        which q and -q are the same observation.
    orientation : o.
    """

    def __init__(
        self,
        latent_dimension: int,
        hidden: Sequence[int],
        offset: Tensor,
        scale: Tensor,
        orientation_model: OrientationModel,
        orientation: int = 4,
    ) -> None:
        super().__init__()
        self.encoder = EncoderNetwork(latent_dimension, hidden, offset, scale, orientation)
        self.decoder = DecoderNetwork(latent_dimension, list(reversed(hidden)), offset, scale, orientation)
        self.orientation_model = orientation_model

    def position_log_density(self, positions: Tensor, means: Means, precisions: Precisions) -> Tensor:
        """log p(x | z) (...)."""
        return gaussian_log_density(positions, means.positions, precisions.inverse_sigma.expand_as(positions))

    def orientation_log_density(self, quaternions: Tensor, means: Means, precisions: Precisions) -> Tensor:
        """log p(q | z) (...) under the model's orientation density."""
        density = antipodal_log_density if self.orientation_model == "sign_blind" else von_mises_fisher_log_density
        return density(quaternions, means.quaternions, precisions.kappa)

    def sample(self, positions: Tensor, quaternions: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """z ~ q(z | x, q), and the mean and log variance of that density, all (..., d).

        The noise comes from the global generator.
        """
        mean, log_variance = self.encoder(positions, quaternions)
        return mean + torch.exp(0.5 * log_variance) * torch.randn_like(mean), mean, log_variance


def _basis_network(tensors: dict[str, Tensor], weights: Tensor, floor: Tensor) -> RadialBasisNetwork:
    network = RadialBasisNetwork(tensors["rbf_centres"], tensors["rbf_rate"], floor, torch.ones_like(floor))
    network.weights = weights
    return network
