"""The copy of a latent graph that belongs to a query: nodes carried to it, and what its edges cost there.

Squared Riemannian lengths are chords of the decoded features: the pull-back metric of f is what makes |f(z + dz) -
f(z)|^2 = dz^T J^T J dz for small dz. An edge is cut into `pieces` chords, so that a thin wall between two cheap nodes
is not stepped over; its squared length is the discrete energy pieces * sum_j |f(z_{j+1}) - f(z_j)|^2, which is at
least the square of its length (Cauchy-Schwarz) and equals it where the decoder moves evenly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.graph.grid import Adjacency
from geodesic_motion_ros.graph.tool_points import place_points
from geodesic_motion_ros.graph.transport import carry
from geodesic_motion_ros.graph.weighted_graph import WeightedGraph


@dataclass(frozen=True)
class EdgeSamples:
    """Decoded poses at the inner cuts of every edge (m, pieces - 1), and what carries them.

    Attributes
    ----------
    positions, quaternions : (m, pieces - 1, 3) and (m, pieces - 1, 4), not carried yet.
    displacements : (m, pieces - 1, 6).
    """

    positions: np.ndarray
    quaternions: np.ndarray
    displacements: np.ndarray


@dataclass(frozen=True)
class TransportedGraph(WeightedGraph):
    """Poses carried to a query; the body points are K points fixed to the tool.

    The sum of the shares, which the obstacle-free length needs, has a closed form.

    Attributes
    ----------
    points : (K, 3) tool points in the tool frame [m].
    positions, quaternions : (n, 3) [m], (n, 4) carried node poses.
    """

    points: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray
    _samples: EdgeSamples
    # Squared length of sigma's part, (m,): stretched by obstacles like the position, the same for all tool points.
    _sigma_energy: np.ndarray

    def fill_shares(self, adjacency: Adjacency, touched: np.ndarray) -> None:
        """Work out the shares of all edges at the touched nodes (mask (n,)) that are not filled yet."""
        _fill_shares(
            adjacency.first, adjacency.edge, touched, self.edges, self.body_points, self.points, self.conformal,
            self._samples.positions, self._samples.quaternions, self._samples.displacements, self._sigma_energy,
            self.shares, self.filled,
        )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def chord_energies(
    edges: np.ndarray,
    positions: np.ndarray,
    quaternions: np.ndarray,
    inner_positions: np.ndarray,
    inner_quaternions: np.ndarray,
    displacements: np.ndarray,
    mean_point: np.ndarray,
    spread: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squared chords along every edge, of the tool points on average and of the quaternion, times the pieces.

    Nodes (n, ...) are given carried; the inner samples (m, pieces - 1, ...) are carried here, to save memory traffic.
    A tool point t moves by dx + dR t. Over points with mean t_m (3,) and second moment about it spread (3, 3),

        mean |dx + dR t|^2 = |dx + dR t_m|^2 + tr(dR spread dR^T).
    """
    pieces = displacements.shape[1] + 1
    moved, turned = np.zeros(len(edges)), np.zeros(len(edges))
    position, quaternion = np.empty(3), np.empty(4)
    position_before, quaternion_before = np.empty(3), np.empty(4)
    rotation, rotation_before = np.empty((3, 3)), np.empty((3, 3))
    rotations = np.empty((len(positions), 3, 3))
    for i in range(len(positions)):
        _rotation_matrix(quaternions[i], rotations[i])
    for e in range(len(edges)):
        position_before[:], quaternion_before[:] = positions[edges[e, 0]], quaternions[edges[e, 0]]
        rotation_before[:] = rotations[edges[e, 0]]
        for j in range(pieces):
            if j < pieces - 1:
                position[:], quaternion[:] = inner_positions[e, j], inner_quaternions[e, j]
                carry(position, quaternion, displacements[e, j])
                _rotation_matrix(quaternion, rotation)
            else:
                position[:], quaternion[:] = positions[edges[e, 1]], quaternions[edges[e, 1]]
                rotation[:] = rotations[edges[e, 1]]
            for a in range(3):
                x = rotation[a, 0] - rotation_before[a, 0]
                y = rotation[a, 1] - rotation_before[a, 1]
                z = rotation[a, 2] - rotation_before[a, 2]
                along = position[a] - position_before[a] + x * mean_point[0] + y * mean_point[1] + z * mean_point[2]
                moved[e] += along * along + x * x * spread[0, 0] + y * y * spread[1, 1] + z * z * spread[2, 2]
                moved[e] += 2.0 * (x * y * spread[0, 1] + x * z * spread[0, 2] + y * z * spread[1, 2])
            for a in range(4):
                turned[e] += (quaternion[a] - quaternion_before[a]) ** 2
            position_before[:], quaternion_before[:] = position, quaternion
            rotation_before[:] = rotation
    return pieces * moved, pieces * turned


@numba.njit(cache=True, nogil=True)
def _rotation_matrix(quaternion: np.ndarray, matrix: np.ndarray) -> None:
    """Write R(q) into matrix (3, 3)."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


@numba.njit(cache=True, nogil=True)
def _fill_shares(
    first: np.ndarray,
    edge_of: np.ndarray,
    touched: np.ndarray,
    edges: np.ndarray,
    body_points: np.ndarray,
    points: np.ndarray,
    conformal: np.ndarray,
    inner_positions: np.ndarray,
    inner_quaternions: np.ndarray,
    displacements: np.ndarray,
    sigma_energy: np.ndarray,
    shares: np.ndarray,
    filled: np.ndarray,
) -> None:
    """In place, for edges at touched nodes.

    a_ek = conformal (pieces sum_j |p_k(j + 1) - p_k(j)|^2 + sigma's part) / K
    """
    count, pieces = len(points), displacements.shape[1] + 1
    position, quaternion = np.empty(3), np.empty(4)
    before, here = np.empty((count, 3)), np.empty((count, 3))
    for node in range(len(touched)):
        if not touched[node]:
            continue
        for slot in range(first[node], first[node + 1]):
            e = edge_of[slot]
            if filled[e]:
                continue
            filled[e] = True
            shares[e] = 0.0
            before[:] = body_points[edges[e, 0]]
            for j in range(pieces):
                if j < pieces - 1:
                    position[:], quaternion[:] = inner_positions[e, j], inner_quaternions[e, j]
                    carry(position, quaternion, displacements[e, j])
                    place_points(position, quaternion, points, here)
                else:
                    here[:] = body_points[edges[e, 1]]
                for k in range(count):
                    for a in range(3):
                        shares[e, k] += (here[k, a] - before[k, a]) ** 2
                before[:] = here
            for k in range(count):
                shares[e, k] = conformal[e] * (pieces * shares[e, k] + sigma_energy[e]) / count
