"""A full covariance out of positive kernels: where a decoder knows more in one direction than in another, in any axes.

The inverse of the covariance's symmetric root is R(z) = sum_k v_k(z) U_k diag(w_k) U_k' + diag(floor), with the
kernels' activations v_k, positive weights w_k, and constant unit lower triangular matrices U_k, whose free elements are
the kernels' *shears*. It is positive definite whatever the shears are, diag(floor) far away, and without shears
1 / sigma of a diagonal covariance. Symmetric matrices are packed: the diagonal, then the elements below it by rows.
"""

from __future__ import annotations

import numpy as np


def kernel_rows(weights: np.ndarray, shears: np.ndarray) -> np.ndarray:
    """Pack U_k diag(w_k) U_k' of all kernels, (p + q, K), for weights (p, K) and shears (q, K), q = p (p - 1) / 2."""
    p = len(weights)
    below = np.tril_indices(p, -1)
    triangles = np.tile(np.eye(p), (weights.shape[1], 1, 1))
    triangles[:, below[0], below[1]] = shears.T
    products = np.einsum("kab,kb,kcb->kac", triangles, weights.T, triangles)
    return np.concatenate([np.diagonal(products, axis1=1, axis2=2), products[:, below[0], below[1]]], axis=1).T


def covariance_root(packed: np.ndarray) -> np.ndarray:
    """Make the features (n, p + q) of the covariance's symmetric root R^-1 of packed R (n, p + q).

    The root is packed as well, its elements below the diagonal times sqrt 2: squared distances of features are those of
    Frobenius. For x = mu(z) + R^-1(z) e with standard normal e, E |dx|^2 = |dmu|^2 + |dR^-1|^2: what the metric
    J_mu' J_mu + J_sigma' J_sigma of diagonal covariances measures.
    """
    p = int(np.sqrt(2.0 * packed.shape[1]))
    below = np.tril_indices(p, -1)
    matrices = np.zeros((len(packed), p, p))
    matrices[:, range(p), range(p)] = packed[:, :p]
    matrices[:, below[0], below[1]] = matrices[:, below[1], below[0]] = packed[:, p:]
    roots = np.linalg.inv(matrices)
    return np.concatenate([np.diagonal(roots, axis1=1, axis2=2), np.sqrt(2.0) * roots[:, below[0], below[1]]], axis=1)


def standard_deviations(root: np.ndarray) -> np.ndarray:
    """Find the coordinates' own standard deviations (n, 3): of features (n, 6) of a root, or of a diagonal one (n, 3),
    which are these.
    """
    if root.shape[1] == 3:
        return root
    mixed = 0.5 * root[:, 3:] ** 2
    return np.sqrt(root[:, :3] ** 2 + mixed[:, [0, 0, 1]] + mixed[:, [1, 2, 2]])
