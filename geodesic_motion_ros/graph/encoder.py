"""The trained encoder in plain numpy: the latent mean of a pose, for reconstructing demonstrations."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from geodesic_motion_ros.errors import SkillError


@dataclass(frozen=True)
class TaskSpaceEncoder:
    """Mean of q(z | x, q): two tanh layers on y = ((x - position_offset) / position_scale, q).

    h1 = tanh(W1 y + b1), h2 = tanh(W2 h1 + b2), z = W3 h2 + b3. Positions [m] in the skill's base frame; the
    sign of the quaternion matters: in a two-cluster skill q and -q have codes in different clusters.
    """

    W1: np.ndarray
    b1: np.ndarray
    W2: np.ndarray
    b2: np.ndarray
    W3: np.ndarray
    b3: np.ndarray
    position_offset: np.ndarray
    position_scale: np.ndarray

    def encode(self, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
        """Codes (..., d) of positions (..., 3) [m] and unit quaternions (..., 4)."""
        inputs = np.concatenate([(positions - self.position_offset) / self.position_scale, quaternions], axis=-1)
        hidden = np.tanh(inputs @ self.W1.T + self.b1)
        hidden = np.tanh(hidden @ self.W2.T + self.b2)
        return hidden @ self.W3.T + self.b3

    @classmethod
    def from_arrays(cls, arrays: dict[str, np.ndarray]) -> TaskSpaceEncoder:
        """Build from weights by name (a skill's `encoder_arrays`); SkillError names missing or ill-shaped
        ones.
        """
        names = [field.name for field in fields(cls)]
        missing = [name for name in names if name not in arrays]
        if missing:
            raise SkillError(f"encoder weights lack {', '.join(missing)}; they must hold {', '.join(names)}")
        encoder = cls(**{name: np.asarray(arrays[name], dtype=float) for name in names})
        first, second, latent = len(encoder.b1), len(encoder.b2), len(encoder.b3)
        expected = {
            "W1": (first, 7),
            "W2": (second, first),
            "W3": (latent, second),
            "position_offset": (3,),
            "position_scale": (),
        }
        for name, shape in expected.items():
            array = getattr(encoder, name)
            if array.shape != shape:
                raise SkillError(f"encoder weight {name} has shape {array.shape}, expected {shape}")
            if not np.all(np.isfinite(array)):
                raise SkillError(f"encoder weight {name} holds NaN or infinite values")
        return encoder
