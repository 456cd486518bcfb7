"""The latent space of a task-space skill, decoded once into a graph."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.geometry.se3 import carried
from geodesic_motion_ros.manifold.decoder import Decoded, TaskSpaceDecoder, rms_sigma
from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.latent_graph import LatentGraph, choose_nodes, connected_pieces, refuse_unsupported
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.metric_field import NUDGE, MetricField, packed_tensors, pulled_back
from geodesic_motion_ros.manifold.progress import progress_of
from geodesic_motion_ros.manifold.tool_points import tool_points
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.manifold.transported_graph import TransportedGraph, chord_energies


@dataclass(frozen=True)
class MetricSettings:
    """Weights of the terms of the pull-back metric M of a skill of tool poses.

    M = J_x^T A J_x + sigma_weight^2 J_sigma^T A J_sigma + J_q^T J_q + J_k^T J_k
        + progress_length^2 (J_s^T J_s + sigma_weight^2 J_sigma_s^T J_sigma_s)

    Of a full covariance sigma stands for its symmetric root (`Decoded.root`).

    Attributes
    ----------
    sigma_weight : weight of the position's standard deviation (the paper: 1; measured better: 10).
    orientation_scale : "spread", k = kappa^(-1/2), an angle like sigma is a length; or "kappa", k = kappa, the
        paper's literal form, whose numbers drown position and orientation.
    progress_length : what the whole of the progress s counts [m], where the model decodes it; obstacles do not stretch
        it.
    """

    sigma_weight: float = 10.0
    orientation_scale: Literal["spread", "kappa"] = "spread"
    progress_length: float = 0.0

    def orientation_features(self, decoded: Decoded) -> np.ndarray:
        """k of the metric, (n, 1); of three concentrations (n, 3), each over sqrt 3: three equal ones count as one."""
        scaled = decoded.kappas**-0.5 if self.orientation_scale == "spread" else decoded.kappas
        return scaled / math.sqrt(scaled.shape[1])


@dataclass(frozen=True)
class PoseGraph(LatentGraph):
    """The latent graph of a task-space skill: nodes decoded to poses, with the samples along every edge.

    Attributes
    ----------
    decoded : the nodes' poses and uncertainties. Sigma and its limit are in metres.
    """

    decoder: TaskSpaceDecoder
    metric: MetricSettings
    decoded: Decoded
    # Decoded features at the inner cuts of every edge, (m, pieces - 1, ...).
    _inner_positions: np.ndarray
    _inner_quaternions: np.ndarray
    _inner_progress: np.ndarray
    _inner_shares: np.ndarray
    # Squared lengths that no transport changes: of sigma (stretched), and of kappa and progress (not), (m,).
    _sigma_energy: np.ndarray
    _spread_energy: np.ndarray

    def transported(
        self, offsets: Offsets, points: np.ndarray, conformal: np.ndarray | None = None
    ) -> TransportedGraph:
        """Carry nodes and edges to a query, for tool points (K, 3) in the tool frame [m].

        `conformal` (n,) >= 1 multiplies the squared length of an edge by the mean of its ends; None: 1 everywhere. The
        decoded graph itself stays as it is.
        """
        moved = offsets.displacements(self.progress, self.mean_path_shares)
        positions, quaternions = carried(self.decoded.positions, self.decoded.quaternions, moved)
        body_points = tool_points(positions, quaternions, points)
        lengths, turns = chord_energies(
            self.edges, body_points, quaternions, self._inner_positions, self._inner_quaternions,
            offsets.displacements(self._inner_progress, self._inner_shares), points,
        )  # fmt: skip
        first, second = self.edges.T
        factor = np.ones(len(self.edges)) if conformal is None else 0.5 * (conformal[first] + conformal[second])
        fixed = factor * (turns + self._spread_energy)
        shares = factor[:, None] * (lengths + self._sigma_energy[:, None]) / len(points)
        return TransportedGraph(
            edges=self.edges,
            body_points=body_points,
            conformal=factor,
            fixed=fixed,
            shares=shares,
            base=np.sqrt(fixed + shares.sum(axis=1)),
            positions=positions,
            quaternions=quaternions,
        )

    def tensors(self, points: np.ndarray) -> np.ndarray:
        """Metric tensors of the nodes (n, 1 + K, T) for tool points (K, 3) in the tool frame [m], as of `MetricField`:
        those of `transported`'s edges, in the limit of short ones.
        """
        columns = []
        for axis in np.diag(self.grid.spacing):
            ahead, behind = (self.decoder.decode(self.latent + side * NUDGE * axis) for side in (1.0, -1.0))
            sign = np.where(np.sum(ahead.quaternions * behind.quaternions, axis=1) < 0.0, -1.0, 1.0)[:, None]
            parts = [
                np.concatenate(
                    [
                        tool_points(decoded.positions, decoded.quaternions, points).reshape(len(self.latent), -1),
                        self.metric.sigma_weight * decoded.root,
                        quaternions,
                        self.metric.orientation_features(decoded),
                        self._progress_features(self.latent + side * NUDGE * axis),
                    ],
                    axis=1,
                )
                for side, decoded, quaternions in (
                    (1.0, ahead, ahead.quaternions), (-1.0, behind, sign * behind.quaternions),
                )
            ]
            columns.append((parts[0] - parts[1]) / (2.0 * NUDGE))
        slopes, moved = np.stack(columns, axis=2), 3 * len(points)
        fixed = moved + self.decoded.root.shape[1]
        spread = pulled_back(slopes[:, moved:fixed])
        shares = [
            (pulled_back(slopes[:, 3 * k : 3 * k + 3]) + spread) / len(points) for k in range(len(points))
        ]
        return packed_tensors(np.stack(shares, axis=1), pulled_back(slopes[:, fixed:]))

    def _progress_features(self, latent: np.ndarray) -> np.ndarray:
        return self.decoder.progress_features(latent, self.metric.progress_length, self.metric.sigma_weight)

    def field(self, tensors: np.ndarray, mean_paths: MeanPaths | None, strength: float) -> MetricField:
        """The metric between the nodes, with the conformal factor of mean paths, None for 1; tensors : of `tensors`.

        They are those of the nodes where they are: transport moves neighbours by nearly the same.
        """
        return MetricField.of(self.grid, self._number, tensors, mean_paths, strength, sampled=self.sampled)

    def sigma_at(self, latent: np.ndarray) -> np.ndarray:
        """Sigma (n, 3) [m] of the position at latent points (n, d)."""
        return self.decoder.uncertainty(latent)[0]

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
    """Features along every edge from its first end to its second, (m, pieces + 1, ...)."""
    return np.concatenate([at_nodes[edges[:, 0]][:, None], inner, at_nodes[edges[:, 1]][:, None]], axis=1)


def build_pose_graph(
    decoder: TaskSpaceDecoder,
    codes: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    metric: MetricSettings,
    sigma_limit: float,
    shape: tuple[int, ...] | None = (100, 100),
    neighbours: int = 16,
    pieces: int = 3,
    one_sheet: bool = True,
    energy_limit: float = math.inf,
    clusters: int = 1,
    mean_paths: MeanPaths | None = None,
) -> PoseGraph:
    """Decode the latent box into a graph.

    Parameters
    ----------
    codes : (N, T, d) the demonstrations' codes, in order of arc length.
    lower, upper : (d,) corners of the latent box.
    sigma_limit : nodes and edge samples with a larger rms sigma [m] are pruned; inf keeps the whole box.
    shape : lattice points along each axis; None: nodes are sampled.
    neighbours, pieces : directions per node, or nearest nodes of it, and chords per edge.
    one_sheet : leave out edges along which the decoded quaternion changes to the other hemisphere: there q and -q, the
        same orientation, would be joined through orientations nobody showed. False only to measure such crossings.
    energy_limit : largest obstacle-free squared length of an edge; longer ones cross where nobody moved.
    clusters : into how many equal groups, one after the other, the codes fall (2 where q and -q have codes of their
        own). Nodes belong to the group of the nearest code, and no edge joins two groups.
    mean_paths : along which progress is measured; None: along the codes.

    Raises
    ------
    SkillError where nothing of the box is supported.
    """

    def embedded(latent: np.ndarray) -> np.ndarray:
        decoded = decoder.decode(latent)
        progress = metric.progress_length * decoder.mean_progress(latent)
        return np.column_stack([decoded.positions, decoded.quaternions, progress])

    chosen = choose_nodes(
        lower, upper, shape, neighbours, codes, mean_paths, decoder.kernel_deviation,
        lambda latent: rms_sigma(decoder.uncertainty(latent)[0]) <= sigma_limit, embedded,
    )  # fmt: skip
    grid, latent, number, edges = chosen
    refuse_unsupported(len(latent), sigma_limit, "m")
    progress_map = progress_of(codes, mean_paths, grid)

    fractions = np.arange(1, pieces) / pieces
    start, step = latent[edges[:, 0]], latent[edges[:, 1]] - latent[edges[:, 0]]
    inner_latent = (start[:, None] + fractions[None, :, None] * step[:, None]).reshape(-1, latent.shape[1])
    inner = decoder.decode(inner_latent)
    decoded = decoder.decode(latent)

    def inner_rows(array: np.ndarray) -> np.ndarray:
        return array.reshape(len(edges), pieces - 1, *array.shape[1:])

    quaternion_chain = _chain(decoded.quaternions, edges, inner_rows(inner.quaternions))
    usable = np.all(inner_rows(rms_sigma(inner.sigma)) <= sigma_limit, axis=1)
    if one_sheet:
        usable &= np.all(np.sum(quaternion_chain[:, 1:] * quaternion_chain[:, :-1], axis=-1) > 0.0, axis=1)

    sigma_chain = _chain(decoded.root, edges, inner_rows(inner.root))
    spread_chain = _chain(metric.orientation_features(decoded), edges, inner_rows(metric.orientation_features(inner)))
    sigma_energy = metric.sigma_weight**2 * pieces * np.sum(np.diff(sigma_chain, axis=1) ** 2, axis=(1, 2))
    spread_energy = pieces * np.sum(np.diff(spread_chain, axis=1) ** 2, axis=(1, 2))
    spread_energy += decoder.progress_energies(latent, edges, metric.progress_length, metric.sigma_weight)

    if math.isfinite(energy_limit):
        lengths, turns = chord_energies(
            edges, decoded.positions[:, None], decoded.quaternions, inner_rows(inner.positions),
            inner_rows(inner.quaternions), inner_rows(np.zeros((len(inner_latent), 6))), np.zeros((1, 3)),
        )  # fmt: skip
        usable &= lengths[:, 0] + turns + sigma_energy + spread_energy <= energy_limit
    if clusters > 1:
        _, nearest = cKDTree(codes.reshape(-1, codes.shape[-1])).query(latent)
        cluster = nearest // (codes.shape[0] * codes.shape[1] // clusters)
        usable &= cluster[edges[:, 0]] == cluster[edges[:, 1]]
    used = edges[usable]
    progress, mean_path_shares = progress_map(latent)
    inner_progress, inner_shares = (inner_rows(column)[usable] for column in progress_map(inner_latent))
    return PoseGraph(
        decoder=decoder,
        metric=metric,
        grid=grid,
        sigma_limit=sigma_limit,
        energy_limit=energy_limit,
        latent=latent,
        decoded=decoded,
        sigma=rms_sigma(decoded.sigma),
        progress=progress,
        mean_path_shares=mean_path_shares,
        component=connected_pieces(used, len(latent)),
        edges=used,
        adjacency=Adjacency.from_edges(used, len(latent)),
        progress_map=progress_map,
        _number=number,
        _inner_positions=inner_rows(inner.positions)[usable],
        _inner_quaternions=inner_rows(inner.quaternions)[usable],
        _inner_progress=inner_progress,
        _inner_shares=inner_shares,
        _sigma_energy=sigma_energy[usable],
        _spread_energy=spread_energy[usable],
    )
