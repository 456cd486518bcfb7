"""What decoder and encoder share: weights by name, checked where they are read, and two tanh layers."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, TypeVar

import numpy as np

from geodesic_motion_ros.manifold.hyperbolic_tangent import tanh
from geodesic_motion_ros.utils.checked_numbers import LARGEST_WEIGHT, check_range, check_real
from geodesic_motion_ros.utils.errors import SkillError

#: Points evaluated at once.
_BLOCK = 256

Network = TypeVar("Network", bound="Perceptron")


@dataclass(frozen=True)
class Perceptron:
    """h1 = tanh(W1 y + b1), h2 = tanh(W2 h1 + b2), o = W3 h2 + b3; subclasses add how y or o are scaled."""

    #: What error messages call it.
    network: ClassVar[str]
    #: Weights that networks of earlier releases do not have.
    later: ClassVar[tuple[str, ...]] = ()
    #: Smallest values of weights that cannot be any number, by their names.
    lowest: ClassVar[dict[str, float]] = {}

    W1: np.ndarray
    b1: np.ndarray
    W2: np.ndarray
    b2: np.ndarray
    W3: np.ndarray
    b3: np.ndarray

    def outputs(self, inputs: np.ndarray) -> np.ndarray:
        """o (..., outputs) of y (..., inputs); a whole graph's (n, inputs) in blocks, which stay in the processor's
        cache.
        """
        if inputs.ndim == 2 and len(inputs) > _BLOCK:
            blocks = [self.outputs(inputs[begin : begin + _BLOCK]) for begin in range(0, len(inputs), _BLOCK)]
            return np.concatenate(blocks)
        hidden = tanh(inputs @ self.W1.T + self.b1)
        hidden = tanh(hidden @ self.W2.T + self.b2)
        return hidden @ self.W3.T + self.b3

    def arrays(self) -> dict[str, np.ndarray]:
        """The weights by name, float64, as they are stored on disk."""
        named = {field.name: np.asarray(getattr(self, field.name), dtype=float) for field in fields(self)}
        return {name: array for name, array in named.items() if array.size or name not in self.later}

    @classmethod
    def from_arrays(cls: type[Network], arrays: dict[str, np.ndarray]) -> Network:
        """Build from weights by name; SkillError names missing, non-finite, ill-shaped or absurdly large ones."""
        names = [field.name for field in fields(cls) if field.name in arrays or field.name not in cls.later]
        missing = [name for name in names if name not in arrays]
        if missing:
            raise SkillError(f"{cls.network} weights lack {', '.join(missing)}; they must hold {', '.join(names)}")
        for name in names:
            check_real(f"{cls.network} weight {name}", np.asarray(arrays[name]))
        network = cls(**{name: np.asarray(arrays[name], dtype=float) for name in names})
        for name, shape in network.expected_shapes().items():
            if name not in names:
                continue
            array = getattr(network, name)
            if array.shape != shape:
                raise SkillError(f"{cls.network} weight {name} has shape {array.shape}, expected {shape}")
            if array.size == 0:
                raise SkillError(f"{cls.network} weight {name} is empty: shape {array.shape}")
            if not np.all(np.isfinite(array)):
                raise SkillError(f"{cls.network} weight {name} holds NaN or infinite values")
            lowest = cls.lowest.get(name, -LARGEST_WEIGHT)
            check_range(f"{cls.network} weight {name}", array, lowest, LARGEST_WEIGHT)
        return network

    def expected_shapes(self) -> dict[str, tuple[int, ...]]:
        """The shape every weight must have beside the others."""
        first, second, last = self.b1.size, self.b2.size, self.b3.size
        return {
            "W1": (first, *self.W1.shape[-1:]), "b1": (first,), "W2": (second, first), "b2": (second,),
            "W3": (last, second), "b3": (last,),
        }  # fmt: skip
