"""The latent space of a task-space skill, decoded once into a graph, and its copy transported to a query.

Squared Riemannian lengths are chords of the decoded features: the pull-back metric of f is what makes |f(z + dz) -
f(z)|^2 = dz^T J^T J dz for small dz. An edge is cut into `pieces` chords, so that a thin wall between two cheap nodes
is not stepped over; its squared length is the discrete energy pieces * sum_j |f(z_{j+1}) - f(z_j)|^2, which is at
least the square of its length (Cauchy-Schwarz) and equals it where the decoder moves evenly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from geodesic_motion_ros.errors import SkillError
from geodesic_motion_ros.graph.decoder import Decoded, TaskSpaceDecoder, rms_sigma
from geodesic_motion_ros.graph.grid import Adjacency, LatentGrid
from geodesic_motion_ros.quaternions import to_rotation


@dataclass(frozen=True)
class MetricSettings:
    """What the pull-back metric sums besides the means.

    M = J_x^T A J_x + sigma_weight^2 J_sigma^T A J_sigma + J_q^T J_q + J_k^T J_k

    Attributes
    ----------
    sigma_weight : weight of the position's standard deviation (the paper: 1; measured better: 10).
    orientation_scale : "spread", k = kappa^(-1/2), an angle like sigma is a length; or "kappa", k = kappa, the
        paper's literal form, whose numbers drown position and orientation.
    """

    sigma_weight: float = 10.0
    orientation_scale: Literal["spread", "kappa"] = "spread"

    def orientation_feature(self, decoded: Decoded) -> np.ndarray:
        """k of the metric, (n,)."""
        return decoded.spread if self.orientation_scale == "spread" else decoded.kappa


@dataclass(frozen=True)
class Offsets:
    """Rigid offsets that carry decoded poses to a query: (1 - tau) start + tau goal, for position and rotation alike.

    Attributes
    ----------
    start, goal : (3,) [m]; start_rotation, goal_rotation : (3,) rotation vectors [rad], base frame.
    start_progress, goal_progress : progress of the latent points that are carried onto start and goal.
    """

    start: np.ndarray
    goal: np.ndarray
    start_rotation: np.ndarray
    goal_rotation: np.ndarray
    start_progress: float
    goal_progress: float

    @classmethod
    def none(cls) -> Offsets:
        return cls(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), 0.0, 1.0)

    def blend(self, progress: np.ndarray) -> np.ndarray:
        """tau (n,) in [0, 1]: 0 at the start's progress, 1 at the goal's, linear between."""
        span = self.goal_progress - self.start_progress
        if abs(span) < 1e-6:
            return np.ones_like(progress)
        return np.clip((progress - self.start_progress) / span, 0.0, 1.0)

    def apply(
        self, positions: np.ndarray, quaternions: np.ndarray, progress: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Carry poses (n, 3), (n, 4) at progress (n,) to the query."""
        tau = self.blend(progress)
        return _carry(
            np.ascontiguousarray(positions), np.ascontiguousarray(quaternions), tau,
            self.start, self.goal, self.start_rotation, self.goal_rotation,
        )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _carry(
    positions: np.ndarray,
    quaternions: np.ndarray,
    tau: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    start_rotation: np.ndarray,
    goal_rotation: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """x + (1 - tau) start + tau goal, and exp((1 - tau) start_rotation + tau goal_rotation) q."""
    moved, turned = np.empty_like(positions), np.empty_like(quaternions)
    for i in range(len(tau)):
        share, rest = tau[i], 1.0 - tau[i]
        for j in range(3):
            moved[i, j] = positions[i, j] + rest * start[j] + share * goal[j]
        x = rest * start_rotation[0] + share * goal_rotation[0]
        y = rest * start_rotation[1] + share * goal_rotation[1]
        z = rest * start_rotation[2] + share * goal_rotation[2]
        angle = np.sqrt(x * x + y * y + z * z)
        scale = 0.5 if angle < 1e-9 else np.sin(0.5 * angle) / angle
        a, b, c, d = np.cos(0.5 * angle), scale * x, scale * y, scale * z
        w, i1, i2, i3 = quaternions[i, 0], quaternions[i, 1], quaternions[i, 2], quaternions[i, 3]
        turned[i, 0] = a * w - b * i1 - c * i2 - d * i3
        turned[i, 1] = a * i1 + b * w + c * i3 - d * i2
        turned[i, 2] = a * i2 - b * i3 + c * w + d * i1
        turned[i, 3] = a * i3 + b * i2 - c * i1 + d * w
    return moved, turned


def tool_points(positions: np.ndarray, quaternions: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (K, 3) fixed in the tool frame [m], seen from the base at tool poses (n, 3), (n, 4): (n, K, 3)."""
    matrices = to_rotation(quaternions).as_matrix()
    return positions[:, None, :] + np.einsum("nij,kj->nki", matrices, points)


class ProgressMap:
    """Progress tau(z) along the demonstrations, 0 at their start and 1 at their end.

    tau(z) = sum w s / sum w, w = exp(-|z - z_i(s)|^2 / (2 h^2)), over the demonstrations' codes z_i(s) with arc length
    s; h is the typical distance between neighbouring demonstrations. Tabulated on a lattice and interpolated linearly.
    """

    def __init__(self, codes: np.ndarray, grid: LatentGrid) -> None:
        """codes (N, T, d) in order of arc length."""
        count, samples, dimension = codes.shape
        self._grid = grid
        flat = codes.reshape(-1, dimension)
        share = np.tile(np.linspace(0.0, 1.0, samples), count)
        rate = 0.5 / _tube_width(codes) ** 2
        nodes = grid.nodes()
        table = np.empty(len(nodes))
        for begin in range(0, len(nodes), 4096):
            block = nodes[begin : begin + 4096]
            squared = np.sum((block[:, None, :] - flat[None]) ** 2, axis=-1)
            weight = np.exp(-rate * (squared - squared.min(axis=1, keepdims=True)))
            table[begin : begin + 4096] = weight @ share / weight.sum(axis=1)
        self._table = table.reshape(grid.shape)

    def __call__(self, latent: np.ndarray) -> np.ndarray:
        """tau (n,) of latent points (n, d)."""
        return map_coordinates(self._table, self._grid.coordinates(latent).T, order=1, mode="nearest")


def _tube_width(codes: np.ndarray) -> float:
    """Median distance from a code to the nearest code of another demonstration; of its own where there is only one."""
    if len(codes) == 1:
        return float(np.median(np.linalg.norm(np.diff(codes[0], axis=0), axis=1))) * 3.0
    distances = []
    for i, own in enumerate(codes):
        others = np.delete(codes, i, axis=0).reshape(-1, codes.shape[-1])
        distances.append(np.sqrt(np.sum((own[:, None] - others[None]) ** 2, axis=-1).min(axis=1)))
    return max(float(np.median(distances)), 1e-6)


@dataclass(frozen=True)
class EdgeEnergies:
    """Squared lengths of every undirected edge, split by what obstacles stretch: w_e^2 = fixed + sum_k m_k shares_k.

    Attributes
    ----------
    fixed : (m,) b_e, the orientation's part; shares : (m, K) a_ek, the part of body point k.
    body_points : (n, K, 3) [m] positions of the body points at the nodes; positions, quaternions : node poses.
    """

    fixed: np.ndarray
    shares: np.ndarray
    body_points: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray

    @property
    def without_obstacles(self) -> np.ndarray:
        """Obstacle-free squared length of every edge, (m,)."""
        return self.fixed + self.shares.sum(axis=1)


@dataclass(frozen=True)
class LatentGraph:
    """Supported nodes of the latent grid, decoded, with the samples along every edge.

    Attributes
    ----------
    grid : the lattice the nodes were taken from.
    latent : (n, d) kept nodes; decoded : their decoded poses and uncertainties; sigma : (n,) rms sigma [m].
    progress : (n,) tau of the nodes; component : (n,) number of the connected piece a node belongs to.
    edges : (m, 2); adjacency : the same in rows.
    """

    decoder: TaskSpaceDecoder
    metric: MetricSettings
    grid: LatentGrid
    sigma_limit: float
    latent: np.ndarray
    decoded: Decoded
    sigma: np.ndarray
    progress: np.ndarray
    component: np.ndarray
    edges: np.ndarray
    adjacency: Adjacency
    progress_map: ProgressMap
    # Decoded features at the inner cuts of every edge, (pieces - 1, m, ...).
    _inner_positions: np.ndarray
    _inner_quaternions: np.ndarray
    _inner_progress: np.ndarray
    # Obstacle-independent squared lengths that no transport changes: of sigma (stretched) and of kappa (not), (m,).
    _sigma_energy: np.ndarray
    _spread_energy: np.ndarray

    def transported(self, offsets: Offsets, points: np.ndarray) -> EdgeEnergies:
        """Edge energies after carrying the decoded nodes to a query, for tool points (K, 3) in the tool frame [m].

        The decoded graph itself stays as it is. With K points each carries 1 / K of the position's share, so that K
        equal points weigh as much as one.
        """
        positions, quaternions = offsets.apply(self.decoded.positions, self.decoded.quaternions, self.progress)
        body = tool_points(positions, quaternions, points)
        pieces, m = len(self._inner_positions) + 1, len(self.edges)
        inner_positions, inner_quaternions = offsets.apply(
            self._inner_positions.reshape(-1, 3),
            self._inner_quaternions.reshape(-1, 4),
            self._inner_progress.reshape(-1),
        )
        inner_body = tool_points(inner_positions, inner_quaternions, points)
        body_chain = _chain(body, self.edges, inner_body.reshape(pieces - 1, m, len(points), 3))
        turn_chain = _chain(quaternions, self.edges, inner_quaternions.reshape(pieces - 1, m, 4))
        shares = pieces * np.sum(np.diff(body_chain, axis=0) ** 2, axis=(0, -1)) + self._sigma_energy[:, None]
        fixed = pieces * np.sum(np.diff(turn_chain, axis=0) ** 2, axis=(0, -1)) + self._spread_energy
        return EdgeEnergies(fixed, shares / len(points), body, positions, quaternions)

    def nearest_node(
        self, position: np.ndarray, quaternion: np.ndarray, component: int, sigma_limit: float
    ) -> tuple[int, float] | None:
        """Node of a connected piece closest to a pose by |dx|^2 + |dq|^2, and that misfit; None where none is trusted.

        Only nodes with rms sigma below `sigma_limit` [m] count: near the rim of the support the decoder guesses.
        """
        candidates = np.flatnonzero((self.component == component) & (self.sigma < sigma_limit))
        if len(candidates) == 0:
            return None
        offset = np.sum((self.decoded.positions[candidates] - position) ** 2, axis=1)
        dot = np.abs(self.decoded.quaternions[candidates] @ quaternion)
        misfit = offset + 2.0 * (1.0 - np.minimum(dot, 1.0))
        best = int(np.argmin(misfit))
        return int(candidates[best]), float(misfit[best])


def _chain(at_nodes: np.ndarray, edges: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Features along every edge from its first end to its second, (pieces + 1, m, ...)."""
    return np.concatenate([at_nodes[edges[:, 0]][None], inner, at_nodes[edges[:, 1]][None]])


def build_latent_graph(
    decoder: TaskSpaceDecoder,
    codes: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    metric: MetricSettings,
    sigma_limit: float,
    shape: tuple[int, ...] = (100, 100),
    neighbours: int = 16,
    pieces: int = 3,
    one_sheet: bool = True,
) -> LatentGraph:
    """Decode the latent box into a graph.

    Parameters
    ----------
    codes : (N, T, d) the demonstrations' codes, in order of arc length.
    lower, upper : (d,) corners of the latent box.
    sigma_limit : nodes and edge samples with a larger rms sigma [m] are pruned; inf keeps the whole box.
    neighbours, pieces : directions per node, and chords per edge.
    one_sheet : leave out edges along which the decoded quaternion changes to the other hemisphere: there q and -q, the
        same orientation, would be joined through orientations nobody showed. False only to measure such crossings.

    Raises
    ------
    SkillError where nothing of the box is supported.
    """
    grid = LatentGrid(np.asarray(lower, dtype=float), np.asarray(upper, dtype=float), tuple(shape))
    lattice = grid.nodes()
    kept = rms_sigma(decoder.uncertainty(lattice)[0]) <= sigma_limit
    if np.count_nonzero(kept) < 2:
        raise SkillError(
            f"no part of the latent box has sigma below {sigma_limit:.4g} m: "
            "the skill's thresholds do not belong to its weights"
        )
    latent = lattice[kept]
    edges = grid.edges(kept, neighbours)
    progress_map = ProgressMap(codes, grid)

    fractions = np.arange(1, pieces) / pieces
    start, step = latent[edges[:, 0]], latent[edges[:, 1]] - latent[edges[:, 0]]
    inner_latent = (start[None] + fractions[:, None, None] * step[None]).reshape(-1, len(grid.shape))
    inner = decoder.decode(inner_latent)
    decoded = decoder.decode(latent)

    def inner_rows(array: np.ndarray) -> np.ndarray:
        return array.reshape(pieces - 1, len(edges), *array.shape[1:])

    quaternion_chain = _chain(decoded.quaternions, edges, inner_rows(inner.quaternions))
    usable = np.all(inner_rows(rms_sigma(inner.sigma)) <= sigma_limit, axis=0)
    if one_sheet:
        usable &= np.all(np.sum(quaternion_chain[1:] * quaternion_chain[:-1], axis=-1) > 0.0, axis=0)

    sigma_chain = _chain(decoded.sigma, edges, inner_rows(inner.sigma))
    spread_chain = _chain(metric.orientation_feature(decoded), edges, inner_rows(metric.orientation_feature(inner)))
    sigma_energy = metric.sigma_weight**2 * pieces * np.sum(np.diff(sigma_chain, axis=0) ** 2, axis=(0, -1))
    spread_energy = pieces * np.sum(np.diff(spread_chain, axis=0) ** 2, axis=0)

    used = edges[usable]
    linked = coo_matrix((np.ones(len(used)), (used[:, 0], used[:, 1])), shape=(len(latent), len(latent)))
    return LatentGraph(
        decoder=decoder,
        metric=metric,
        grid=grid,
        sigma_limit=sigma_limit,
        latent=latent,
        decoded=decoded,
        sigma=rms_sigma(decoded.sigma),
        progress=progress_map(latent),
        component=connected_components(linked, directed=False)[1],
        edges=used,
        adjacency=Adjacency.from_edges(used, len(latent)),
        progress_map=progress_map,
        _inner_positions=inner_rows(inner.positions)[:, usable],
        _inner_quaternions=inner_rows(inner.quaternions)[:, usable],
        _inner_progress=inner_rows(progress_map(inner_latent))[:, usable],
        _sigma_energy=sigma_energy[usable],
        _spread_energy=spread_energy[usable],
    )
