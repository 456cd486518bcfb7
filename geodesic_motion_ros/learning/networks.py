"""The two kinds of network in the model: a multilayer perceptron and a radial-basis-function network."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor, nn

from geodesic_motion_ros.utils.errors import ParameterError

_LLOYD_ITERATIONS = 20
#: A kernel falls to exp(-2) = 14 % at two bandwidths: weights can still make up for that, hardly for more.
COVERAGE = 0.5


class MultilayerPerceptron(nn.Module):
    """Linear layers with tanh between them and none after the last.

    tanh, not ReLU: the metric is made of derivatives, so the decoder has to be smooth.

    Parameters
    ----------
    widths : number of inputs, of units in each hidden layer, of outputs.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        super().__init__()
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(widths))

    def forward(self, inputs: Tensor) -> Tensor:
        """Map (..., inputs) to (..., outputs)."""
        for layer in self.layers[:-1]:
            inputs = torch.tanh(layer(inputs))
        return self.layers[-1](inputs)


class RadialBasisNetwork(nn.Module):
    """y_j(z) = sum_k W_jk exp(-rate |z - c_k|^2) + floor_j with W_jk = scale_j softplus(raw_jk) > 0.

    Positive weights make y fall to its floor away from the centres: as a precision it says "known here,
    unknown elsewhere", which a perceptron does not (Arvanitidis, Hansen, Hauberg, "Latent space oddity", ICLR
    2018).

    Parameters
    ----------
    centres : (K, d) centres in the latent space, fixed.
    rate : reciprocal of twice the squared bandwidth, fixed.
    floor : (outputs,) value far from every centre, fixed.
    scale : (outputs,) order of magnitude of y, fixed: it keeps the free parameters near one.
    """

    def __init__(self, centres: Tensor, rate: Tensor, floor: Tensor, scale: Tensor) -> None:
        super().__init__()
        self.register_buffer("centres", centres)
        self.register_buffer("rate", rate)
        self.register_buffer("floor", floor)
        self.register_buffer("scale", scale)
        self.raw_weights = nn.Parameter(torch.zeros(len(scale), len(centres), dtype=scale.dtype))

    @property
    def weights(self) -> Tensor:
        """Positive weights (outputs, K)."""
        return self.scale[:, None] * nn.functional.softplus(self.raw_weights)

    @weights.setter
    def weights(self, positive: Tensor) -> None:
        with torch.no_grad():
            self.raw_weights.copy_(_inverse_softplus(positive / self.scale[:, None]))

    def start_level(self, latent: Tensor) -> None:
        """Equal weights by which the values at latent points (n, d) are `scale` on average, however kernels overlap."""
        with torch.no_grad():
            level = (self.scale - self.floor) / self.activations(latent).sum(-1).mean()
            self.weights = level[:, None].expand_as(self.raw_weights)

    def activations(self, latent: Tensor) -> Tensor:
        """exp(-rate |z - c_k|^2), (..., K), at latent points (..., d)."""
        # -|z - c|^2 multiplied out, as one product of matrices: the offsets would be an array of (..., K, d).
        ours = torch.cat([2.0 * latent, -(latent**2).sum(-1, keepdim=True), -torch.ones_like(latent[..., :1])], dim=-1)
        theirs = torch.cat(
            [self.centres, torch.ones_like(self.centres[:, :1]), (self.centres**2).sum(-1, keepdim=True)], dim=-1
        )
        return torch.exp(self.rate * (ours @ theirs.T).clamp(max=0.0))

    def forward(self, latent: Tensor) -> Tensor:
        """Values (..., outputs) at latent points (..., d)."""
        return self.combine(self.activations(latent))

    def combine(self, activations: Tensor) -> Tensor:
        """Values (..., outputs) from kernel activations (..., K)."""
        return activations @ self.rows.T + self.far

    @property
    def rows(self) -> Tensor:
        """What each kernel adds to the values at its centre, (values, K)."""
        return self.weights

    @property
    def far(self) -> Tensor:
        """Values (values,) far from every centre."""
        return self.floor


class SymmetricBasisNetwork(RadialBasisNetwork):
    """R(z) = sum_k U_k diag(W_k) U_k' exp(-rate |z - c_k|^2) + diag(floor): positive definite matrices, packed, with
    unit lower triangular U_k whose other elements are free (`manifold.full_covariance`); they begin at 0, as diagonal.
    """

    def __init__(self, centres: Tensor, rate: Tensor, floor: Tensor, scale: Tensor) -> None:
        super().__init__(centres, rate, floor, scale)
        self.shears = nn.Parameter(torch.zeros(math.comb(len(scale), 2), len(centres), dtype=scale.dtype))

    @property
    def rows(self) -> Tensor:
        weights, size = self.weights, len(self.scale)
        below = torch.tril_indices(size, size, -1).unbind()
        triangles = torch.eye(size, dtype=weights.dtype).repeat(weights.shape[1], 1, 1)
        triangles = triangles.index_put((torch.arange(len(triangles))[:, None], *below), self.shears.T)
        products = (triangles * weights.T[:, None]) @ triangles.mT
        return torch.cat([products.diagonal(dim1=1, dim2=2), products[:, below[0], below[1]]], dim=1).T

    @property
    def far(self) -> Tensor:
        return nn.functional.pad(self.floor, (0, len(self.shears)))


def place_centres(codes: np.ndarray, count: int, seed: int) -> np.ndarray:
    """k-means centres (at most `count`, d) of latent codes (n, d), reproducible from the seed.

    Fewer centres than requested come back when there are not two codes for each; clusters that ran empty are
    dropped.

    Raises
    ------
    ParameterError : no finite codes, or a count below two.
    """
    if count < 2:
        raise ParameterError(f"{count} radial-basis centres; at least 2 are needed to have a bandwidth")
    if len(codes) < 4 or not np.all(np.isfinite(codes)):
        raise ParameterError(f"cannot place centres on {len(codes)} codes: at least 4, all finite, are needed")
    rng = np.random.default_rng(seed)
    centres = rng.permutation(codes)[: min(count, len(codes) // 2)]
    for _ in range(_LLOYD_ITERATIONS):
        centres = _lloyd_step(codes, centres)
    return centres


def kernel_rate(centres: np.ndarray, codes: np.ndarray, bandwidth_factor: float) -> float:
    """1 / (2 h^2) for the common bandwidth h of kernels at centres (K, d) placed on codes (n, d).

    h = bandwidth_factor times the median distance of a centre to its nearest neighbour. At three times that distance
    the walls between tubes blur and geodesics cut corners; at half of it the support has holes. Codes that crowd in
    places make the median too small to reach the sparse ones, so h is at least COVERAGE times the 99th percentile of
    the distance from a code to its centre.
    """
    tree = cKDTree(centres)
    between, _ = tree.query(centres, k=2)
    within, _ = tree.query(codes)
    bandwidth = max(bandwidth_factor * float(np.median(between[:, 1])), COVERAGE * float(np.percentile(within, 99.0)))
    return 0.5 / bandwidth**2


def layer_arrays(perceptron: MultilayerPerceptron) -> dict[str, np.ndarray]:
    """Weights and biases by the names that `manifold.perceptron.Perceptron` reads."""
    named = {}
    for number, layer in enumerate(perceptron.layers, start=1):
        named[f"W{number}"], named[f"b{number}"] = as_array(layer.weight), as_array(layer.bias)
    return named


def as_array(tensor: Tensor) -> np.ndarray:
    """A tensor's values, float64."""
    return tensor.detach().numpy().astype(float)


def _lloyd_step(codes: np.ndarray, centres: np.ndarray) -> np.ndarray:
    _, labels = cKDTree(centres).query(codes)
    sizes = np.bincount(labels, minlength=len(centres))
    sums = np.stack([np.bincount(labels, weights=column, minlength=len(centres)) for column in codes.T], axis=1)
    return sums[sizes > 0] / sizes[sizes > 0, None]


def _inverse_softplus(values: Tensor) -> Tensor:
    return values + torch.log(-torch.expm1(-values))
