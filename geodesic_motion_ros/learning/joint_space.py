"""The variational auto-encoder of joint configurations.

    p(theta | z) = N(theta | mu(z), diag(sigma(z)^2))

mu is a perceptron, 1 / sigma a radial-basis-function network. Seen at the robot's body, through its forward kinematics,
the density of a configuration is p(theta | z) / V(theta), V the volume of `body_layer` (Beik-Mohammadi et al.,
"Reactive motion generation on learned Riemannian manifolds", IJRR 2023, section 3.2: learning in joint space).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from geodesic_motion_ros.learning.networks import MultilayerPerceptron, RadialBasisNetwork, as_array, layer_arrays
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder


class JointEncoderNetwork(nn.Module):
    """q(z | theta) = N(mean, diag(exp(log_variance))): tanh layers, then both outputs from one linear layer.

    Configurations enter as (theta - offset) / scale, offset (eta,) [rad], scale () [rad].
    """

    def __init__(self, latent_dimension: int, hidden: Sequence[int], offset: Tensor, scale: Tensor) -> None:
        super().__init__()
        self.register_buffer("offset", offset)
        self.register_buffer("scale", scale)
        self.perceptron = MultilayerPerceptron([len(offset), *hidden, 2 * latent_dimension])

    def forward(self, configurations: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log variance, both (..., d), of configurations (..., eta) [rad]."""
        mean, log_variance = self.perceptron((configurations - self.offset) / self.scale).chunk(2, dim=-1)
        return mean, log_variance

    def arrays(self) -> dict[str, np.ndarray]:
        """Weights by the names that `manifold.encoder.JointSpaceEncoder` reads (the mean's rows only)."""
        named = layer_arrays(self.perceptron)
        latent_dimension = len(named["b3"]) // 2
        named["W3"], named["b3"] = named["W3"][:latent_dimension], named["b3"][:latent_dimension]
        return named | {"joint_offset": as_array(self.offset), "joint_scale": as_array(self.scale)}


class JointDecoderNetwork(nn.Module):
    """Decodes latent points z into joint configurations: mu(z) = offset + scale o(z), with o the perceptron.

    1 / sigma(z) is given later, once the means are trained (`inverse_sigma`).
    """

    def __init__(self, latent_dimension: int, hidden: Sequence[int], offset: Tensor, scale: Tensor) -> None:
        super().__init__()
        self.register_buffer("offset", offset)
        self.register_buffer("scale", scale)
        self.perceptron = MultilayerPerceptron([latent_dimension, *hidden, len(offset)])
        self.inverse_sigma: RadialBasisNetwork | None = None

    def means(self, latent: Tensor) -> Tensor:
        """Mean configurations (..., eta) [rad] at latent points (..., d)."""
        return self.offset + self.scale * self.perceptron(latent)

    def to_numpy(self) -> JointSpaceDecoder:
        """The same decoder without torch, as skills store it."""
        assert self.inverse_sigma is not None
        return JointSpaceDecoder(
            **layer_arrays(self.perceptron),
            joint_offset=as_array(self.offset),
            joint_scale=as_array(self.scale),
            rbf_centres=as_array(self.inverse_sigma.centres),
            rbf_rate=as_array(self.inverse_sigma.rate),
            sigma_weights=as_array(self.inverse_sigma.weights),
            sigma_floor=as_array(self.inverse_sigma.floor),
        )


class JointSpaceVAE(nn.Module):
    """Encoder and decoder of configurations.

    Parameters
    ----------
    latent_dimension : d.
    hidden : units of the encoder's hidden layers; the decoder has them in reverse.
    offset, scale : scaling of configurations, (eta,) and () [rad]: one scalar, so that joints keep their proportions.
    """

    def __init__(self, latent_dimension: int, hidden: Sequence[int], offset: Tensor, scale: Tensor) -> None:
        super().__init__()
        self.encoder = JointEncoderNetwork(latent_dimension, hidden, offset, scale)
        self.decoder = JointDecoderNetwork(latent_dimension, list(reversed(hidden)), offset, scale)

    def sample(self, configurations: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """z ~ q(z | theta), and the mean and log variance of that density, all (..., d).

        The noise comes from the global generator.
        """
        mean, log_variance = self.encoder(configurations)
        return mean + torch.exp(0.5 * log_variance) * torch.randn_like(mean), mean, log_variance
