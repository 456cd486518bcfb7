"""The variational auto-encoder of an output space, R^3 x S^3, the poses of a tool, or R^eta, configurations of an arm.

    p(x, q | z) = N(x | mu(z), diag(sigma(z)^2)) p(q | mu_q(z), kappa(z))        p(theta | z) = N(theta | mu(z), ...)

The covariance of x may be full, and the density of q have three concentrations: `densities`.

A point of R^p x S^(o-1) has p coordinates and a unit direction of o numbers: p = 3 and o = 4 for poses, p = eta and
o = 0, no direction, for configurations, p = 2 and o = 3 for the toy of the paper. mu and mu_q are the outputs of one
perceptron, 1 / sigma and kappa radial-basis-function networks (Beik-Mohammadi et al., "Reactive motion generation on
learned Riemannian manifolds", IJRR 2023, section 3.1: learning in task space, section 3.2: learning in joint space).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from geodesic_motion_ros.learning.densities import (
    angular_central_gaussian_log_density,
    antipodal_log_density,
    full_gaussian_log_density,
    gaussian_log_density,
    von_mises_fisher_log_density,
)
from geodesic_motion_ros.learning.networks import (
    MultilayerPerceptron,
    RadialBasisNetwork,
    SymmetricBasisNetwork,
    as_array,
    layer_arrays,
)
from geodesic_motion_ros.manifold.decoder import TaskSpaceDecoder
from geodesic_motion_ros.manifold.encoder import PERIOD, PRIOR_REACH
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.manifold.progress_decoder import PROGRESS_SCALES

OrientationModel = Literal["two_cluster", "sign_blind", "none"]
#: Deviation of progress while the means are learned: the other half of a stroke that retraces itself is far from it.
PROGRESS_SIGMA = 0.15
#: Logarithm of the variance that an encoder which reads progress begins with: its root is a hundredth of the strip.
START_LOG_VARIANCE = -6.0


class Means(NamedTuple):
    """Mean coordinates (..., p) [m] or [rad], unit mean directions (..., o), and mean progress (..., 1 or 2) as of
    `progress_numbers`, None of a model that decodes none, of a batch of latent points.
    """

    coordinates: Tensor
    directions: Tensor
    progress: Tensor | None = None


class Precisions(NamedTuple):
    """Reciprocal deviations of coordinates (..., p) [1/m] or [1/rad], concentrations of directions, if any, (...) or,
    about each axis, (..., 3), and reciprocal deviations (...) of progress, if that is decoded.

    below : (..., p (p - 1) / 2) of a full covariance; the inverse of its root has inverse_sigma for its diagonal, and
        these elements below it.
    """

    inverse_sigma: Tensor
    kappa: Tensor | None
    progress: Tensor | None = None
    below: Tensor | None = None


@dataclass(frozen=True)
class FixedPrecisions:
    """Likelihood scales that do not depend on z, for learning the means first.

    Attributes
    ----------
    sigma : standard deviation of every coordinate [m] or [rad].
    kappa : concentration of the directions; None: there are none.
    progress : standard deviation of progress.
    """

    sigma: float
    kappa: float | None
    progress: float = PROGRESS_SIGMA

    def __call__(self, latent: Tensor) -> Precisions:
        like = latent[..., 0]
        kappa = None if self.kappa is None else torch.full_like(like, self.kappa)
        inverse_sigma = torch.full_like(like, 1.0 / self.sigma)[..., None]
        return Precisions(inverse_sigma, kappa, torch.full_like(like, 1.0 / self.progress))


class EncoderNetwork(nn.Module):
    """q(z | x, q) = N(mean, diag(exp(log_variance))): tanh layers, then both outputs from one linear layer.

    Parameters
    ----------
    latent_dimension : d.
    hidden : units of the hidden layers, from the output space inwards.
    offset, scale : coordinates enter as (x - offset) / scale; offset (p,), scale () [m] or [rad].
    direction : o, the numbers of a direction. progress : how many numbers it reads of how far along a demonstration a
        sample is (`progress_numbers`).
    """

    def __init__(
        self,
        latent_dimension: int,
        hidden: Sequence[int],
        offset: Tensor,
        scale: Tensor,
        direction: int = 0,
        progress: int = 0,
    ) -> None:
        super().__init__()
        self.register_buffer("offset", offset)
        self.register_buffer("scale", scale)
        self.direction, self.progress = direction, progress
        self.perceptron = MultilayerPerceptron([len(offset) + direction + progress, *hidden, 2 * latent_dimension])
        if progress:
            # It begins at the prior's mean, and sure of it. From a random start a letter is first learned by where the
            # tool is, across the strip as well, and never unfolded.
            last = self.perceptron.layers[-1]
            nn.init.zeros_(last.weight)
            nn.init.constant_(last.bias, START_LOG_VARIANCE)
            nn.init.zeros_(last.bias[:latent_dimension])

    def forward(
        self, coordinates: Tensor, directions: Tensor | None = None, fractions: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Mean and log variance, both (..., d), of coordinates (..., p) [m] or [rad] and unit directions (..., o).

        fractions : (...) of the arc, which an encoder that knows progress reads; None: these are whole curves
            (..., T, p), equally spaced along their arcs.
        """
        inputs = [(coordinates - self.offset) / self.scale]
        if directions is not None:
            inputs.append(directions)
        if self.progress:
            if fractions is None:
                along = torch.linspace(0.0, 1.0, coordinates.shape[-2], dtype=coordinates.dtype)
                fractions = along.expand(coordinates.shape[:-1])
            inputs.append(progress_numbers(fractions, self.progress))
        mean, log_variance = self.perceptron(torch.cat(inputs, dim=-1)).chunk(2, dim=-1)
        if fractions is None or not self.progress:
            return mean, log_variance
        # From the prior's mean on: where a sample lies along the strip is known before anything is learned.
        along = PRIOR_REACH * (2.0 * fractions[..., None] - 1.0)
        return mean + nn.functional.pad(along, (0, mean.shape[-1] - 1)), log_variance

    def arrays(self) -> dict[str, np.ndarray]:
        """Weights by the names that the encoders of `manifold.encoder` read (the mean's rows only)."""
        named = layer_arrays(self.perceptron)
        latent_dimension = len(named["b3"]) // 2
        named["W3"], named["b3"] = named["W3"][:latent_dimension], named["b3"][:latent_dimension]
        return named | _scaling_arrays(self)


class DecoderNetwork(nn.Module):
    """Decodes latent points z into the output space with its uncertainties: mu(z), mu_q(z), 1 / sigma(z) and kappa(z).

    Parameters
    ----------
    latent_dimension : d.
    hidden : units of the hidden layers, from the latent space outwards.
    offset, scale : mean coordinates are offset (p,) + scale () times the network's first p outputs, [m] or [rad].
    direction : o, the numbers of a direction. progress : how many numbers of progress it decodes besides.

    `precisions` has to be given its radial-basis networks (`set_precisions`) before sigma and kappa are known.
    """

    def __init__(
        self,
        latent_dimension: int,
        hidden: Sequence[int],
        offset: Tensor,
        scale: Tensor,
        direction: int = 0,
        progress: int = 0,
    ) -> None:
        super().__init__()
        self.register_buffer("offset", offset)
        self.register_buffer("scale", scale)
        self.direction, self.progress_count, self.is_closed = direction, progress, progress == 2
        inputs, outputs = latent_dimension + self.is_closed, len(offset) + direction + progress
        self.perceptron = MultilayerPerceptron([inputs, *hidden, outputs])
        self.inverse_sigma: RadialBasisNetwork | None = None
        self.kappa: RadialBasisNetwork | None = None
        self.progress: RadialBasisNetwork | None = None

    def means(self, latent: Tensor) -> Means:
        """Mean coordinates and directions at latent points (..., d)."""
        outputs, p = self.perceptron(self.seen(latent)), len(self.offset)
        directions = nn.functional.normalize(outputs[..., p : p + self.direction], dim=-1)
        count = self.progress_count
        progress = PROGRESS_SCALES[count] * outputs[..., -count:] if count else None
        return Means(self.offset + self.scale * outputs[..., :p], directions, progress)

    def seen(self, latent: Tensor) -> Tensor:
        """What the networks see of latent points (..., d), as of `ProgressDecoder.seen`."""
        if not self.is_closed:
            return latent
        radius = PERIOD / (2.0 * math.pi)
        turned = latent[..., :1] / radius
        return torch.cat([radius * torch.cos(turned), radius * torch.sin(turned), latent[..., 1:]], dim=-1)

    def activations(self, latent: Tensor) -> Tensor:
        """The kernels (..., K) that all precisions share, at latent points (..., d)."""
        return self.inverse_sigma.activations(self.seen(latent))

    def precisions(self, latent: Tensor) -> Precisions:
        """1 / sigma and kappa at latent points (..., d)."""
        return self.combined_precisions(self.activations(latent))

    def combined_precisions(self, activations: Tensor) -> Precisions:
        """1 / sigma and kappa from the activations (..., K) of the kernels that both networks share."""
        networks = [network for network in (self.inverse_sigma, self.kappa, self.progress) if network is not None]
        # One product for all: the activations, which are many, are read once.
        far = [network.far for network in networks]
        values = activations @ torch.cat([network.rows for network in networks]).T + torch.cat(far)
        of_sigma, *others = values.split([len(value) for value in far], dim=-1)
        kappa = None if self.kappa is None else others.pop(0)
        if kappa is not None and kappa.shape[-1] == 1:
            kappa = kappa[..., 0]
        p = len(self.offset)
        below = of_sigma[..., p:] if of_sigma.shape[-1] > p else None
        return Precisions(of_sigma[..., :p], kappa, others[0][..., 0] if others else None, below)

    def set_precisions(
        self,
        inverse_sigma: RadialBasisNetwork,
        kappa: RadialBasisNetwork | None = None,
        progress: RadialBasisNetwork | None = None,
    ) -> None:
        """Install the radial-basis networks, which must have the same centres and rate; kappa for directions alone, and
        one for progress where that is decoded.
        """
        self.inverse_sigma, self.kappa, self.progress = inverse_sigma, kappa, progress

    def to_numpy(self) -> TaskSpaceDecoder | JointSpaceDecoder:
        """The same decoder without torch, as skills store it."""
        arrays = layer_arrays(self.perceptron) | _scaling_arrays(self)
        arrays |= {
            "rbf_centres": as_array(self.inverse_sigma.centres), "rbf_rate": as_array(self.inverse_sigma.rate),
            "sigma_weights": as_array(self.inverse_sigma.weights), "sigma_floor": as_array(self.inverse_sigma.floor),
        }  # fmt: skip
        if self.progress is not None:
            arrays |= {
                "progress_weights": as_array(self.progress.weights[0]),
                "progress_floor": as_array(self.progress.floor[0]),
            }
        if self.is_closed:
            arrays["period"] = np.array(PERIOD)
        if self.kappa is None:
            return JointSpaceDecoder(**arrays)
        if isinstance(self.inverse_sigma, SymmetricBasisNetwork):
            arrays["sigma_shears"] = as_array(self.inverse_sigma.shears)
        kappa_weights, kappa_floor = as_array(self.kappa.weights), as_array(self.kappa.floor[0])
        one = len(kappa_weights) == 1
        return TaskSpaceDecoder(
            **arrays, kappa_weights=kappa_weights[0] if one else kappa_weights, kappa_floor=kappa_floor
        )

    @classmethod
    def from_numpy(cls, decoder: TaskSpaceDecoder) -> DecoderNetwork:
        """The differentiable twin (float64) of a skill's decoder of poses, for metrics and continuous geodesics."""
        tensors = {name: torch.tensor(value) for name, value in decoder.arrays().items()}
        scaling = tensors["position_offset"], tensors["position_scale"]
        hidden = [len(decoder.b1), len(decoder.b2)]
        network = cls(decoder.latent_dimension, hidden, *scaling, 4, decoder.progress_numbers).double()
        with torch.no_grad():
            for layer, number in zip(network.perceptron.layers, "123", strict=True):
                layer.weight.copy_(tensors["W" + number])
                layer.bias.copy_(tensors["b" + number])
        of_kappa = torch.atleast_2d(tensors["kappa_weights"])
        network.set_precisions(
            _basis_network(tensors, tensors["sigma_weights"], tensors["sigma_floor"], tensors.get("sigma_shears")),
            _basis_network(tensors, of_kappa, tensors["kappa_floor"].expand(len(of_kappa))),
            _basis_network(tensors, tensors["progress_weights"][None], tensors["progress_floor"][None])
            if decoder.progress_numbers
            else None,
        )
        return network.requires_grad_(False)


class AutoEncoder(nn.Module):
    """Encoder and decoder of an output space, with the densities of the evidence lower bound.

    Parameters
    ----------
    latent_dimension : d.
    hidden : units of the encoder's hidden layers; the decoder has them in reverse.
    offset, scale : scaling of coordinates, (p,) and () [m] or [rad]: one scalar, so that they keep their proportions.
    sign_blind : whether p(q | z) is the mixture 1/2 vMF(mu_q) + 1/2 vMF(-mu_q), under which q and -q are the same
        observation; else one von Mises-Fisher density: q and -q, if both are in the data, lie in two separate clusters.
    direction : o, the numbers of a direction.
    progress : how many numbers the encoder reads, and the decoder decodes, of how far along its demonstration a sample
        is: 0, 1, or 2 where demonstrations are rounds.
    """

    def __init__(
        self,
        latent_dimension: int,
        hidden: Sequence[int],
        offset: Tensor,
        scale: Tensor,
        sign_blind: bool = False,
        direction: int = 0,
        progress: int = 0,
    ) -> None:
        super().__init__()
        self.encoder = EncoderNetwork(latent_dimension, hidden, offset, scale, direction, progress)
        self.decoder = DecoderNetwork(latent_dimension, list(reversed(hidden)), offset, scale, direction, progress)
        self.sign_blind, self.progress = sign_blind, progress

    def coordinate_log_density(self, coordinates: Tensor, means: Means, precisions: Precisions) -> Tensor:
        """log p(x | z) (...)."""
        if precisions.below is not None:
            return full_gaussian_log_density(
                coordinates, means.coordinates, precisions.inverse_sigma, precisions.below
            )
        return gaussian_log_density(coordinates, means.coordinates, precisions.inverse_sigma.expand_as(coordinates))

    def progress_log_density(self, fractions: Tensor, means: Means, precisions: Precisions) -> Tensor | float:
        """log p(s | z) (...); 0 of a model that decodes no progress."""
        if means.progress is None:
            return 0.0
        shown = PROGRESS_SCALES[self.progress] * progress_numbers(fractions, self.progress)
        return gaussian_log_density(shown, means.progress, precisions.progress[..., None].expand_as(shown))

    def direction_log_density(
        self, directions: Tensor, means: Means, precisions: Precisions, error: float = 0.0
    ) -> Tensor:
        """log p(q | z) (...) under the model's density of directions: angular central Gaussian, where there is a
        concentration about each axis.

        error : deviation of q about each axis [rad of the direction], over which it is expected.
        """
        kappa = precisions.kappa
        if kappa.ndim == directions.ndim:
            return angular_central_gaussian_log_density(directions, means.directions, kappa, error)
        density = antipodal_log_density if self.sign_blind else von_mises_fisher_log_density
        axes = directions.shape[-1] - 1
        return density(directions, means.directions, kappa) - 0.5 * axes * error**2 * kappa

    def sample(
        self, coordinates: Tensor, directions: Tensor | None = None, fractions: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """z ~ q(z | x, q), and the mean and log variance of that density, all (..., d).

        The noise comes from the global generator.
        """
        mean, log_variance = self.encoder(coordinates, directions, fractions)
        return mean + torch.exp(0.5 * log_variance) * torch.randn_like(mean), mean, log_variance


def progress_numbers(fractions: Tensor, count: int) -> Tensor:
    """How far along its arc a sample is, as networks read and decode it: 2 s - 1 (..., 1) of fractions s (...), or of
    rounds, count 2, (cos 2 pi s, sin 2 pi s) (..., 2). Times `PROGRESS_SCALES` a step is as long as one of s.
    """
    if count == 1:
        return 2.0 * fractions[..., None] - 1.0
    turned = 2.0 * math.pi * fractions
    return torch.stack([torch.cos(turned), torch.sin(turned)], dim=-1)


def _scaling_arrays(network: EncoderNetwork | DecoderNetwork) -> dict[str, np.ndarray]:
    """Offset and scale by the names that skills have for them."""
    scaled = "position" if network.direction else "joint"
    return {f"{scaled}_offset": as_array(network.offset), f"{scaled}_scale": as_array(network.scale)}


def _basis_network(
    tensors: dict[str, Tensor], weights: Tensor, floor: Tensor, shears: Tensor | None = None
) -> RadialBasisNetwork:
    kind = RadialBasisNetwork if shears is None else SymmetricBasisNetwork
    network = kind(tensors["rbf_centres"], tensors["rbf_rate"], floor, torch.ones_like(floor))
    network.weights = weights
    if shears is not None:
        network.shears = nn.Parameter(shears)
    return network
