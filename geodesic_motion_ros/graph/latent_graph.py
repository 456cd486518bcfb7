"""The latent space of a task-space skill, decoded once into a graph, and its copy transported to a query.

Squared Riemannian lengths are chords of the decoded features: the pull-back metric of f is what makes |f(z + dz) -
f(z)|^2 = dz^T J^T J dz for small dz. An edge is cut into `pieces` chords, so that a thin wall between two cheap nodes
is not stepped over; its squared length is the discrete energy pieces * sum_j |f(z_{j+1}) - f(z_j)|^2, which is at
least the square of its length (Cauchy-Schwarz) and equals it where the decoder moves evenly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numba
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from geodesic_motion_ros.errors import SkillError
from geodesic_motion_ros.graph.decoder import Decoded, TaskSpaceDecoder, rms_sigma
from geodesic_motion_ros.graph.grid import Adjacency, LatentGrid


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
        moved = np.array(positions, order="C")
        turned = np.array(quaternions, order="C")
        _carry_all(moved, turned, self.blend(progress), *self.ends)
        return moved, turned

    @property
    def ends(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """start, goal, start_rotation, goal_rotation: the form the kernels take."""
        return self.start, self.goal, self.start_rotation, self.goal_rotation


@numba.njit(cache=True, nogil=True)
def _carry(
    position: np.ndarray,
    quaternion: np.ndarray,
    tau: float,
    start: np.ndarray,
    goal: np.ndarray,
    start_rotation: np.ndarray,
    goal_rotation: np.ndarray,
) -> None:
    """In place: x + (1 - tau) start + tau goal, and exp((1 - tau) start_rotation + tau goal_rotation) q."""
    for j in range(3):
        position[j] += (1.0 - tau) * start[j] + tau * goal[j]
    x = (1.0 - tau) * start_rotation[0] + tau * goal_rotation[0]
    y = (1.0 - tau) * start_rotation[1] + tau * goal_rotation[1]
    z = (1.0 - tau) * start_rotation[2] + tau * goal_rotation[2]
    angle = math.sqrt(x * x + y * y + z * z)
    scale = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    a, b, c, d = math.cos(0.5 * angle), scale * x, scale * y, scale * z
    w, i, j, k = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    quaternion[0] = a * w - b * i - c * j - d * k
    quaternion[1] = a * i + b * w + c * k - d * j
    quaternion[2] = a * j - b * k + c * w + d * i
    quaternion[3] = a * k + b * j - c * i + d * w


@numba.njit(cache=True, nogil=True)
def _carry_all(
    positions: np.ndarray,
    quaternions: np.ndarray,
    tau: np.ndarray,
    start: np.ndarray,
    goal: np.ndarray,
    start_rotation: np.ndarray,
    goal_rotation: np.ndarray,
) -> None:
    """`_carry` for poses (n, 3), (n, 4) at tau (n,), in place."""
    for i in range(len(tau)):
        _carry(positions[i], quaternions[i], tau[i], start, goal, start_rotation, goal_rotation)


@numba.njit(cache=True, nogil=True)
def _tool_points(position: np.ndarray, quaternion: np.ndarray, points: np.ndarray, out: np.ndarray) -> None:
    """Write p + R(q) t for tool points t (K, 3) into out (K, 3): R t = t + 2 w (v x t) + 2 v x (v x t)."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    for k in range(len(points)):
        tx, ty, tz = points[k, 0], points[k, 1], points[k, 2]
        cx, cy, cz = y * tz - z * ty, z * tx - x * tz, x * ty - y * tx
        out[k, 0] = position[0] + tx + 2.0 * (w * cx + y * cz - z * cy)
        out[k, 1] = position[1] + ty + 2.0 * (w * cy + z * cx - x * cz)
        out[k, 2] = position[2] + tz + 2.0 * (w * cz + x * cy - y * cx)


@numba.njit(cache=True, nogil=True)
def tool_points(positions: np.ndarray, quaternions: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (K, 3) fixed in the tool frame [m], seen from the base at tool poses (n, 3), (n, 4): (n, K, 3)."""
    out = np.empty((len(positions), len(points), 3))
    for i in range(len(positions)):
        _tool_points(positions[i], quaternions[i], points, out[i])
    return out


@numba.njit(cache=True, nogil=True)
def _chord_energies(
    edges: np.ndarray,
    body_points: np.ndarray,
    quaternions: np.ndarray,
    inner_positions: np.ndarray,
    inner_quaternions: np.ndarray,
    inner_tau: np.ndarray,
    ends: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    points: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squared chords along every edge, of each body point (m, K) and of the quaternion (m,), times the pieces.

    Nodes are given carried; the inner samples (m, pieces - 1, ...) are carried here, to save the memory traffic.
    """
    pieces, count = inner_tau.shape[1] + 1, len(points)
    shares, turns = np.zeros((len(edges), count)), np.zeros(len(edges))
    before, here = np.empty((count, 3)), np.empty((count, 3))
    turned_before, turned, position = np.empty(4), np.empty(4), np.empty(3)
    for e in range(len(edges)):
        before[:], turned_before[:] = body_points[edges[e, 0]], quaternions[edges[e, 0]]
        for j in range(pieces):
            if j < pieces - 1:
                position[:], turned[:] = inner_positions[e, j], inner_quaternions[e, j]
                _carry(position, turned, inner_tau[e, j], ends[0], ends[1], ends[2], ends[3])
                _tool_points(position, turned, points, here)
            else:
                here[:], turned[:] = body_points[edges[e, 1]], quaternions[edges[e, 1]]
            for k in range(count):
                for axis in range(3):
                    shares[e, k] += (here[k, axis] - before[k, axis]) ** 2
            for axis in range(4):
                turns[e] += (turned[axis] - turned_before[axis]) ** 2
            before[:], turned_before[:] = here, turned
    return pieces * shares, pieces * turns


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
        for begin in range(0, len(nodes), 512):
            block = nodes[begin : begin + 512]
            squared = np.sum((block[:, None, :] - flat[None]) ** 2, axis=-1)
            weight = np.exp(-rate * (squared - squared.min(axis=1, keepdims=True)))
            table[begin : begin + 512] = weight @ share / weight.sum(axis=1)
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
        return self.along(slice(None))

    def along(self, edges: np.ndarray | slice) -> np.ndarray:
        """Obstacle-free squared lengths of some edges."""
        return self.fixed[edges] + self.shares[edges].sum(axis=1)


@dataclass(frozen=True)
class LatentGraph:
    """Supported nodes of the latent grid, decoded, with the samples along every edge.

    Attributes
    ----------
    grid : the lattice the nodes were taken from.
    sigma_limit, energy_limit : largest rms sigma [m] of a node, and squared length of an edge, that were kept.
    latent : (n, d) kept nodes; decoded : their decoded poses and uncertainties; sigma : (n,) rms sigma [m].
    progress : (n,) tau of the nodes; component : (n,) number of the connected piece a node belongs to.
    edges : (m, 2); adjacency : the same in rows.
    """

    decoder: TaskSpaceDecoder
    metric: MetricSettings
    grid: LatentGrid
    sigma_limit: float
    energy_limit: float
    latent: np.ndarray
    decoded: Decoded
    sigma: np.ndarray
    progress: np.ndarray
    component: np.ndarray
    edges: np.ndarray
    adjacency: Adjacency
    progress_map: ProgressMap
    # Number of the kept node at every lattice point, -1 where it was pruned.
    _number: np.ndarray
    # Decoded features at the inner cuts of every edge, (m, pieces - 1, ...).
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
        shares, turns = _chord_energies(
            self.edges, body, quaternions, self._inner_positions, self._inner_quaternions,
            offsets.blend(self._inner_progress), offsets.ends, points,
        )  # fmt: skip
        shares = (shares + self._sigma_energy[:, None]) / len(points)
        return EdgeEnergies(turns + self._spread_energy, shares, body, positions, quaternions)

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

    def node_near(self, latent: np.ndarray, allowed: np.ndarray, steps: int) -> int | None:
        """Allowed node (mask (n,)) closest to a latent point (d,), within a number of grid steps; None without one."""
        centre = np.rint(self.grid.coordinates(latent)).astype(int)
        window = tuple(slice(max(0, c - steps), c + steps + 1) for c in centre)
        candidates = self._number[window].reshape(-1)
        candidates = candidates[candidates >= 0]
        candidates = candidates[allowed[candidates]]
        if len(candidates) == 0:
            return None
        distance = np.sum(((self.latent[candidates] - latent) / self.grid.spacing) ** 2, axis=1)
        return int(candidates[np.argmin(distance)])


def _chain(at_nodes: np.ndarray, edges: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Features along every edge from its first end to its second, (m, pieces + 1, ...)."""
    return np.concatenate([at_nodes[edges[:, 0]][:, None], inner, at_nodes[edges[:, 1]][:, None]], axis=1)


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
    energy_limit: float = math.inf,
    clusters: int = 1,
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
    energy_limit : largest obstacle-free squared length of an edge; longer ones cross where nobody moved.
    clusters : into how many equal groups, one after the other, the codes fall (2 where q and -q have codes of their
        own). Nodes belong to the group of the nearest code, and no edge joins two groups.

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
    number = grid.numbering(kept)
    edges = grid.edges(number, neighbours)
    progress_map = ProgressMap(codes, grid)

    fractions = np.arange(1, pieces) / pieces
    start, step = latent[edges[:, 0]], latent[edges[:, 1]] - latent[edges[:, 0]]
    inner_latent = (start[:, None] + fractions[None, :, None] * step[:, None]).reshape(-1, len(grid.shape))
    inner = decoder.decode(inner_latent)
    decoded = decoder.decode(latent)

    def inner_rows(array: np.ndarray) -> np.ndarray:
        return array.reshape(len(edges), pieces - 1, *array.shape[1:])

    quaternion_chain = _chain(decoded.quaternions, edges, inner_rows(inner.quaternions))
    usable = np.all(inner_rows(rms_sigma(inner.sigma)) <= sigma_limit, axis=1)
    if one_sheet:
        usable &= np.all(np.sum(quaternion_chain[:, 1:] * quaternion_chain[:, :-1], axis=-1) > 0.0, axis=1)

    sigma_chain = _chain(decoded.sigma, edges, inner_rows(inner.sigma))
    spread_chain = _chain(metric.orientation_feature(decoded), edges, inner_rows(metric.orientation_feature(inner)))
    sigma_energy = metric.sigma_weight**2 * pieces * np.sum(np.diff(sigma_chain, axis=1) ** 2, axis=(1, 2))
    spread_energy = pieces * np.sum(np.diff(spread_chain, axis=1) ** 2, axis=1)

    if math.isfinite(energy_limit):
        none = Offsets.none()
        chords, turns = _chord_energies(
            edges, decoded.positions[:, None], decoded.quaternions, inner_rows(inner.positions),
            inner_rows(inner.quaternions), inner_rows(np.zeros(len(inner_latent))), none.ends, np.zeros((1, 3)),
        )  # fmt: skip
        usable &= chords[:, 0] + turns + sigma_energy + spread_energy <= energy_limit
    if clusters > 1:
        _, nearest = cKDTree(codes.reshape(-1, codes.shape[-1])).query(latent)
        cluster = nearest // (codes.shape[0] * codes.shape[1] // clusters)
        usable &= cluster[edges[:, 0]] == cluster[edges[:, 1]]
    used = edges[usable]
    linked = coo_matrix((np.ones(len(used)), (used[:, 0], used[:, 1])), shape=(len(latent), len(latent)))
    return LatentGraph(
        decoder=decoder,
        metric=metric,
        grid=grid,
        sigma_limit=sigma_limit,
        energy_limit=energy_limit,
        latent=latent,
        decoded=decoded,
        sigma=rms_sigma(decoded.sigma),
        progress=progress_map(latent),
        component=connected_components(linked, directed=False)[1],
        edges=used,
        adjacency=Adjacency.from_edges(used, len(latent)),
        progress_map=progress_map,
        _number=number,
        _inner_positions=inner_rows(inner.positions)[usable],
        _inner_quaternions=inner_rows(inner.quaternions)[usable],
        _inner_progress=inner_rows(progress_map(inner_latent))[usable],
        _sigma_energy=sigma_energy[usable],
        _spread_energy=spread_energy[usable],
    )
