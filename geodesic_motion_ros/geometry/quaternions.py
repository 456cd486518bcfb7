"""Unit quaternions, scalar first (w, x, y, z), as arrays of shape (..., 4).

A rotation is stored twice in S^3, as q and -q; functions that compare rotations are blind to that sign.
Rotation vectors are axis times angle [rad], expressed in the base frame (they act from the left).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation


def normalise(quaternions: np.ndarray) -> np.ndarray:
    """Scale quaternions (..., 4) to unit length; a zero quaternion stays what it is: not finite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)


def continuous_signs(quaternions: np.ndarray) -> np.ndarray:
    """Flip signs along a curve (T, 4) so that neighbours lie in one hemisphere; the first keeps its sign."""
    dots = np.sum(quaternions[1:] * quaternions[:-1], axis=-1)
    signs = np.concatenate([[1.0], np.cumprod(np.where(dots < 0.0, -1.0, 1.0))])
    return quaternions * signs[:, None]


def angle_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Angle [rad] of the rotation between unit quaternions (..., 4), in [0, pi], blind to sign.

    Uses 4 asin(|p -+ q| / 2), which stays exact for small angles where acos of the dot product does not.
    """
    chord = np.minimum(np.linalg.norm(first - second, axis=-1), np.linalg.norm(first + second, axis=-1))
    return 4.0 * np.arcsin(np.clip(0.5 * chord, 0.0, np.sqrt(0.5)))


def to_rotation(quaternions: np.ndarray) -> Rotation:
    """scipy Rotation of quaternions (..., 4); scipy itself stores them scalar last."""
    return Rotation.from_quat(np.roll(quaternions, -1, axis=-1))


def from_rotation(rotation: Rotation) -> np.ndarray:
    """Unit quaternions (..., 4), scalar first, of a scipy Rotation."""
    return np.roll(rotation.as_quat(), 1, axis=-1)


def rotation_vector_between(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Shortest rotation vector r (..., 3) [rad] in the base frame with exp(r) first = second up to sign."""
    between = multiply(second, inverse(first))
    between = np.where(between[..., :1] < 0.0, -between, between)
    sine = np.linalg.norm(between[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, between[..., :1])
    return np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0.0) * between[..., 1:]


def rotate_by(rotation_vectors: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """exp(r) q for rotation vectors (..., 3) [rad, base frame] and quaternions (..., 4), keeping q's hemisphere."""
    half = 0.5 * np.linalg.norm(rotation_vectors, axis=-1, keepdims=True)
    # sin(x) / x, 1 at 0; numpy's sinc is that of pi x.
    turn = np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotation_vectors], axis=-1)
    rotated = multiply(turn, quaternions)
    flip = np.sum(rotated * quaternions, axis=-1, keepdims=True) < 0.0
    return np.where(flip, -rotated, rotated)


def inverse(quaternion: np.ndarray) -> np.ndarray:
    """Inverse rotation of a unit quaternion (..., 4)."""
    return quaternion * np.array([1.0, -1.0, -1.0, -1.0])


def multiply(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Hamilton product p q (..., 4): first q, then p. Continuous in both: no sign is chosen."""
    a, b, c, d = np.moveaxis(first, -1, 0)
    w, x, y, z = np.moveaxis(second, -1, 0)
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=-1,
    )


def rotate(quaternion: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """R(q) v for a unit quaternion (4,) and vectors (..., 3)."""
    axis = np.broadcast_to(quaternion[1:], vectors.shape)
    once = 2.0 * np.cross(axis, vectors)
    return vectors + quaternion[0] * once + np.cross(axis, once)


def slerp(first: np.ndarray, second: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Great-circle interpolation from first (4,) to second (4,) along the shorter arc; (n, 4) for fractions (n,)."""
    vector = rotation_vector_between(first, second)
    return rotate_by(np.asarray(fractions)[:, None] * vector, np.broadcast_to(first, (len(fractions), 4)))


def mean_rotation(quaternions: np.ndarray) -> np.ndarray:
    """Chordal mean over the first axis of unit quaternions (N, ..., 4), blind to their signs; (..., 4).

    Eigenvector of sum_i q_i q_i^T with the largest eigenvalue: F. L. Markley et al., "Averaging quaternions",
    Journal of Guidance, Control, and Dynamics, 2007.
    """
    scatter = np.einsum("i...a,i...b->...ab", quaternions, quaternions)
    return np.linalg.eigh(scatter)[1][..., :, -1]
