"""The copy of a latent graph that belongs to a query: nodes transported to it, and what its edges cost there.

Squared Riemannian lengths are chords of the decoded features: the pull-back metric of f is what makes |f(z + dz) -
f(z)|^2 = dz^T J^T J dz for small dz. An edge is cut into `pieces` chords, so that a thin wall between two cheap nodes
is not stepped over; its squared length is the discrete energy pieces * sum_j |f(z_{j+1}) - f(z_j)|^2, which is at
least the square of its length (Cauchy-Schwarz) and equals it where the decoder moves evenly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.geometry.se3 import carry
from geodesic_motion_ros.manifold.tool_points import place_points
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph


@dataclass(frozen=True)
class TransportedGraph(WeightedGraph):
    """Poses transported to a query; the body points are K points fixed to the tool.

    Attributes
    ----------
    positions, quaternions : (n, 3) [m], (n, 4) transported node poses.
    """

    positions: np.ndarray
    quaternions: np.ndarray


@numba.njit(cache=True, nogil=True)
def chord_energies(
    edges: np.ndarray,
    body_points: np.ndarray,
    quaternions: np.ndarray,
    inner_positions: np.ndarray,
    inner_quaternions: np.ndarray,
    displacements: np.ndarray,
    points: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squared chords along every edge, of each of K tool points (m, K) and of the quaternion (m,), times the
    pieces.

    The nodes are transported already, body_points (n, K, 3) and quaternions (n, 4); the inner samples
    (m, pieces - 1, ...) are transported here by displacements (m, pieces - 1, 6), to save memory traffic. points :
    (K, 3) in the tool frame [m].
    """
    count, pieces = len(points), displacements.shape[1] + 1
    moved, turned = np.zeros((len(edges), count)), np.zeros(len(edges))
    position, quaternion, turn_before = np.empty(3), np.empty(4), np.empty(4)
    before, here = np.empty((count, 3)), np.empty((count, 3))
    for e in range(len(edges)):
        for a in range(4):
            turn_before[a] = quaternions[edges[e, 0], a]
        for k in range(count):
            for a in range(3):
                before[k, a] = body_points[edges[e, 0], k, a]
        for j in range(pieces):
            if j < pieces - 1:
                for a in range(4):
                    quaternion[a] = inner_quaternions[e, j, a]
                for a in range(3):
                    position[a] = inner_positions[e, j, a]
                carry(position, quaternion, displacements[e, j])
                place_points(position, quaternion, points, here)
            else:
                for a in range(4):
                    quaternion[a] = quaternions[edges[e, 1], a]
                for k in range(count):
                    for a in range(3):
                        here[k, a] = body_points[edges[e, 1], k, a]
            for k in range(count):
                for a in range(3):
                    moved[e, k] += (here[k, a] - before[k, a]) ** 2
                    before[k, a] = here[k, a]
            for a in range(4):
                turned[e] += (quaternion[a] - turn_before[a]) ** 2
                turn_before[a] = quaternion[a]
    return pieces * moved, pieces * turned
