"""The latent space of a joint-space skill, decoded once into a graph of configurations.

The squared length of an edge from theta to theta' is measured where the robot's body is, on K body points p_k, with a
small joint-space term, without which motion that leaves all body points in place would cost nothing:

    w_e^2 = 1/K [sum_k m_k (|dp_k|^2 + s^2 |J_k dsigma|^2) + h^2 (|dq|^2 + s^2 |J_q dsigma|^2)]
            + g^2 (|dtheta|^2 + s^2 |dsigma|^2)

with s the sigma_weight, h the orientation_weight of the tool's unit quaternion q, and g the joint_weight. It is the
chord form of the reshaped metric of configurations M = (J_fk J_mu)^T A (J_fk J_mu) + (J_fk J_sigma)^T A (J_fk J_sigma)
of Beik-Mohammadi et al. (IJRR 2023, eq. 32), with J_fk the Jacobian of the body points and of q, J_k and J_q those of
one of them; the paper has no 1/K, which is one unit for all, and no g. Sigma's part, which makes the walls between
tubes, is summed over several pieces of every edge, so that a thin wall between two cheap nodes is not stepped over.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numba
import numpy as np

from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.grid import Adjacency, LatentGrid
from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.manifold.joint_transport import JointOffsets, ToolSteps
from geodesic_motion_ros.manifold.latent_graph import LatentGraph, choose_nodes, connected_pieces, refuse_unsupported
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.metric_field import NUDGE, MetricField, packed_tensors, pulled_back
from geodesic_motion_ros.manifold.progress import Progress, ProgressMap, progress_of
from geodesic_motion_ros.manifold.sampled_nodes import SampledNodes
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.robot.body_points import (
    BodyPoints,
    body_point_jacobians,
    end_effector_poses,
    place_body_points,
    points_along_links,
    tool_orientation_jacobians,
)
from geodesic_motion_ros.robot.kinematics import Robot

#: Arrays of a graph, by their names; of its adjacency likewise.
_ARRAYS = (
    "latent", "sigma", "progress", "mean_path_shares", "component", "edges", "_number", "configurations",
    "sigma_shares", "_sigma_fixed", "_bends", "_tensors",
)  # fmt: skip
#: Chords count as no shorter than this [m].
_SHORTEST_CHORD = 1e-9
_SLOTS = "first", "node", "edge"


@dataclass(frozen=True)
class JointMetricSettings:
    """Weights of the terms of the pull-back metric of a skill of configurations, and its body points.

    Attributes
    ----------
    sigma_weight : weight of the standard deviations beside the means (the paper: 1).
    joint_weight : what a radian of a joint counts beside the body points' motion [m].
    orientation_weight : what the tool's unit quaternion counts beside the motion of one body point [m]; the paper: 1.
    point_spacing : body points are the joints, the tool, and points between on links that are longer than this [m].
    progress_length : what the whole of the progress counts [m], where the model decodes it.
    """

    sigma_weight: float = 10.0
    joint_weight: float = 0.05
    point_spacing: float = 0.2
    orientation_weight: float = 0.0
    progress_length: float = 0.0

    def body_points(self, robot: Robot) -> BodyPoints:
        """The robot's body points that the metric sees."""
        return BodyPoints.of(robot, points_along_links(robot, self.point_spacing))


@dataclass(frozen=True)
class ConfigurationGraph(LatentGraph):
    """The latent graph of a joint-space skill. Sigma and its limit are in radians.

    Attributes
    ----------
    configurations : (n, eta) decoded nodes [rad].
    robot, body : whose body points the metric sees.
    sigma_shares : (m, K) sigma's part of the squared lengths of each body point, which no transport changes.
    """

    decoder: JointSpaceDecoder
    metric: JointMetricSettings
    robot: Robot
    body: BodyPoints
    configurations: np.ndarray
    sigma_shares: np.ndarray
    # The same of the joints (m,).
    _sigma_fixed: np.ndarray
    # Squared lengths of the edges' curves over those of their chords, (m,): 1 where edges are short, as on a grid.
    _bends: np.ndarray

    def tool_steps(self, corrections: np.ndarray) -> ToolSteps:
        """How the nodes are moved by offsets with corrections (K, S, eta) [rad]."""
        return ToolSteps.of(self.configurations, self.progress, self.mean_path_shares, corrections, self.robot)

    def transported(self, offsets: JointOffsets, conformal: np.ndarray | None = None) -> CarriedConfigurations:
        """Carry the nodes to a query, with their body points; `conformal` : as of `weighted`."""
        configurations = self.carried(offsets)
        points = place_body_points(configurations, self.body.frames, self.body.offsets, self.robot.chain)
        return self.weighted(configurations, points, conformal)

    def carried(self, offsets: JointOffsets, steps: ToolSteps | None = None) -> np.ndarray:
        """Carry the nodes' configurations (n, eta); steps : those of the offsets' corrections, where they are known."""
        if steps is None:
            return offsets.carried(self.configurations, self.progress, self.mean_path_shares)
        return offsets.carried_by(steps)

    def weighted(
        self, configurations: np.ndarray, points: np.ndarray, conformal: np.ndarray | None = None
    ) -> CarriedConfigurations:
        """Measure the edges between carried configurations (n, eta), their body points at points (n, K, 3) [m].

        conformal : (n,) >= 1, None for 1, as in `PoseGraph.transported`.
        """
        first, second = self.edges.T
        factor = np.ones(len(self.edges)) if conformal is None else 0.5 * (conformal[first] + conformal[second])
        turned, shares, moved = _chord_energies(
            self.edges, configurations, points, self.sigma_shares, factor, self._bends
        )
        tool = self._bends * _tool_energies(self._orientation_scale, self.edges, configurations, self.robot)
        fixed = factor * (self.metric.joint_weight**2 * turned + tool + self._sigma_fixed)
        return CarriedConfigurations(
            edges=self.edges,
            body_points=points,
            conformal=factor,
            fixed=fixed,
            shares=shares,
            base=np.sqrt(fixed + moved),
            configurations=configurations,
        )

    def field(self, mean_paths: MeanPaths | None, strength: float) -> MetricField:
        """The metric between the nodes, with the conformal factor of mean paths, None for 1.

        Its tensors are those of the nodes where they are: transport moves neighbours by nearly the same.
        """
        return MetricField.of(
            self.grid, self._number, self._tensors, mean_paths, strength, sampled=self.sampled
        )

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything of the graph that takes long to work out, by name, as `from_arrays` wants it."""
        slots = {f"adjacency.{name}": getattr(self.adjacency, name) for name in _SLOTS}
        table = {"progress_table": self.progress_map.table} if isinstance(self.progress_map, ProgressMap) else {}
        return {name: getattr(self, name) for name in _ARRAYS} | slots | table | {"spacing": self.grid.spacing}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], recipe: Mapping[str, Any]) -> ConfigurationGraph:
        """The graph of its arrays by name, that `build_configuration_graph` made of a recipe, its arguments by name;
        KeyError: one is missing.
        """
        learned = {name: arrays[name] for name in _ARRAYS}
        tensors, box = learned.pop("_tensors"), (recipe["lower"], recipe["upper"])
        grid: LatentGrid | SampledNodes
        progress_map: Progress
        if recipe["shape"] is None:
            grid = SampledNodes(*box, arrays["spacing"])
            progress_map = progress_of(recipe["codes"], recipe["mean_paths"], grid)
        else:
            grid, table = LatentGrid(*box, recipe["shape"]), arrays["progress_table"]
            progress_map = ProgressMap(table[:, 0], table[:, 1:], grid)
        rest = {name: recipe[name] for name in ("decoder", "metric", "robot", "body", "sigma_limit", "energy_limit")}
        graph = cls(
            grid=grid,
            adjacency=Adjacency(*(arrays[f"adjacency.{name}"] for name in _SLOTS)),
            progress_map=progress_map,
            **learned,
            **rest,
        )
        vars(graph)["_tensors"] = tensors  # a frozen class keeps what it has worked out there
        return graph

    @property
    def _orientation_scale(self) -> float:
        return _orientation_scale(self.metric, self.body)

    @cached_property
    def _tensors(self) -> np.ndarray:
        """Metric tensors of the nodes (n, 1 + K, T), in units of the spacing, as of `MetricField`."""
        turned, spread = [], []
        for axis in np.diag(self.grid.spacing):
            ahead, behind = self.latent + NUDGE * axis, self.latent - NUDGE * axis
            turned.append(self.decoder.configurations(ahead) - self.decoder.configurations(behind))
            spread.append(self.decoder.uncertainty(ahead) - self.decoder.uncertainty(behind))
        slopes = np.stack([*turned, *spread], axis=2) / (2.0 * NUDGE)
        slopes[:, :, len(turned) :] *= self.metric.sigma_weight
        jacobians = body_point_jacobians(self.configurations, self.body.frames, self.body.offsets, self.robot.chain)
        shares = np.stack(
            [_both_pulled_back(jacobians[:, k] @ slopes) / len(self.body) for k in range(len(self.body))], axis=1
        )
        alone = self.metric.joint_weight**2 * _both_pulled_back(slopes)
        alone += pulled_back(self._progress_slopes())
        if self._orientation_scale > 0.0:
            tool = tool_orientation_jacobians(self.configurations, self.robot) @ slopes
            alone += self._orientation_scale * _both_pulled_back(tool)
        return packed_tensors(shares, alone)

    def _progress_slopes(self) -> np.ndarray:
        """Derivatives (n, 2, d) of the features of progress, in units of the spacing; without any (n, 0, d)."""
        given = self.metric.progress_length, self.metric.sigma_weight
        steps = [
            self.decoder.progress_features(self.latent + NUDGE * axis, *given)
            - self.decoder.progress_features(self.latent - NUDGE * axis, *given)
            for axis in np.diag(self.grid.spacing)
        ]
        return np.stack(steps, axis=2) / (2.0 * NUDGE)

    def sigma_at(self, latent: np.ndarray) -> np.ndarray:
        """Sigma (n, eta) [rad] at latent points (n, d)."""
        return self.decoder.uncertainty(latent)

    def nearest_node(self, configuration: np.ndarray, component: int, sigma_limit: float) -> int | None:
        """Node of a connected piece closest to a configuration (eta,); None where none is trusted.

        Only nodes with rms sigma below `sigma_limit` [rad] count: near the rim of the support the decoder guesses.
        """
        candidates = np.flatnonzero((self.component == component) & (self.sigma < sigma_limit))
        if len(candidates) == 0:
            return None
        distance = np.sum((self.configurations[candidates] - configuration) ** 2, axis=1)
        return int(candidates[np.argmin(distance)])


@dataclass(frozen=True)
class CarriedConfigurations(WeightedGraph):
    """The configurations of a latent graph transported to a query.

    Attributes
    ----------
    configurations : (n, eta) [rad].
    """

    configurations: np.ndarray


def build_configuration_graph(
    decoder: JointSpaceDecoder,
    codes: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    metric: JointMetricSettings,
    robot: Robot,
    body: BodyPoints,
    sigma_limit: float,
    shape: tuple[int, ...] | None = (50, 50, 50),
    neighbours: int = 26,
    pieces: int = 3,
    energy_limit: float = math.inf,
    mean_paths: MeanPaths | None = None,
) -> ConfigurationGraph:
    """Decode the latent box into a graph; parameters as of `pose_graph.build_pose_graph`, sigma_limit in radians.

    Raises
    ------
    SkillError where nothing of the box is supported.
    """

    def placed(latent: np.ndarray) -> np.ndarray:
        configurations = decoder.configurations(latent)
        points = place_body_points(configurations, body.frames, body.offsets, robot.chain)
        parts = [points.reshape(len(latent), -1) / math.sqrt(len(body)), metric.joint_weight * configurations]
        return np.concatenate(parts, axis=1)

    def embedded(latent: np.ndarray) -> np.ndarray:
        return np.column_stack([placed(latent), metric.progress_length * decoder.mean_progress(latent)])

    chosen = choose_nodes(
        lower, upper, shape, neighbours, codes, mean_paths, decoder.kernel_deviation,
        lambda latent: rms_sigma(decoder.uncertainty(latent)) <= sigma_limit, embedded,
    )  # fmt: skip
    grid, latent, number, edges = chosen
    refuse_unsupported(len(latent), sigma_limit, "rad")
    sigma = decoder.uncertainty(latent)
    sigma_chain = _along_edges(decoder, latent, sigma, edges, pieces)
    edges, sigma_chain = _supported(edges, sigma_chain, sigma_limit)
    configurations = decoder.configurations(latent)
    steps = math.sqrt(pieces) * metric.sigma_weight * np.diff(sigma_chain, axis=1)
    sigma_fixed = metric.joint_weight**2 * np.sum(steps**2, axis=(1, 2))
    jacobians = body_point_jacobians(configurations, body.frames, body.offsets, robot.chain)
    sigma_shares = _projected_energies(edges, jacobians, steps)
    sigma_fixed += decoder.progress_energies(latent, edges, metric.progress_length, metric.sigma_weight)
    orientation_scale = _orientation_scale(metric, body)
    if orientation_scale > 0.0:
        turning = tool_orientation_jacobians(configurations, robot)[:, None]
        sigma_fixed += orientation_scale * _projected_energies(edges, turning, steps)[:, 0]
    bends = np.ones(len(edges)) if shape is not None else _bends(placed, latent, edges)
    if math.isfinite(energy_limit):
        points = place_body_points(configurations, body.frames, body.offsets, robot.chain)
        turned, _, moved = _chord_energies(edges, configurations, points, sigma_shares, np.ones(len(edges)), bends)
        tool = bends * _tool_energies(orientation_scale, edges, configurations, robot)
        energy = metric.joint_weight**2 * turned + tool + sigma_fixed + moved
        usable = energy <= energy_limit
        edges, sigma_fixed, sigma_shares = edges[usable], sigma_fixed[usable], sigma_shares[usable]
        bends = bends[usable]
    progress_map = progress_of(codes, mean_paths, grid, chosen.kept)
    progress, mean_path_shares = progress_map(latent)
    return ConfigurationGraph(
        grid=grid,
        sigma_limit=sigma_limit,
        energy_limit=energy_limit,
        latent=latent,
        sigma=rms_sigma(sigma),
        progress=progress,
        mean_path_shares=mean_path_shares,
        component=connected_pieces(edges, len(latent)),
        edges=edges,
        adjacency=Adjacency.from_edges(edges, len(latent)),
        progress_map=progress_map,
        _number=number,
        decoder=decoder,
        metric=metric,
        robot=robot,
        body=body,
        configurations=configurations,
        _sigma_fixed=sigma_fixed,
        _bends=bends,
        sigma_shares=sigma_shares,
    )


def _along_edges(
    decoder: JointSpaceDecoder, latent: np.ndarray, sigma: np.ndarray, edges: np.ndarray, pieces: int
) -> np.ndarray:
    """Sigma [rad] at both ends of every edge and at its inner cuts, (m, pieces + 1, eta); `sigma` (n, eta) of nodes."""
    first, second = edges.T
    inner = np.arange(1, pieces)[:, None] / pieces
    cuts = latent[first, None] + inner * (latent[second] - latent[first])[:, None]
    between = decoder.uncertainty(cuts.reshape(-1, latent.shape[1])).reshape(*cuts.shape[:2], sigma.shape[1])
    return np.concatenate([sigma[first, None], between, sigma[second, None]], axis=1)


def _bends(placed: Callable[[np.ndarray], np.ndarray], latent: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Of every edge the squared length of both chords over its middle, where that is `placed`, (n, F), over that of the
    one chord, (m,).
    """
    first, second = edges.T
    nodes, middle = placed(latent), placed(0.5 * (latent[first] + latent[second]))
    along = np.linalg.norm(middle - nodes[first], axis=1) + np.linalg.norm(nodes[second] - middle, axis=1)
    return (along / np.maximum(np.linalg.norm(nodes[second] - nodes[first], axis=1), _SHORTEST_CHORD)) ** 2


def _supported(edges: np.ndarray, sigma_chain: np.ndarray, sigma_limit: float) -> tuple[np.ndarray, np.ndarray]:
    usable = np.all(rms_sigma(sigma_chain) <= sigma_limit, axis=1)
    return edges[usable], sigma_chain[usable]


def _orientation_scale(metric: JointMetricSettings, body: BodyPoints) -> float:
    """h^2 / K, what |dq|^2 counts; 0 where the tool's orientation does not."""
    return metric.orientation_weight**2 / len(body)


def _tool_energies(scale: float, edges: np.ndarray, configurations: np.ndarray, robot: Robot) -> np.ndarray | float:
    """scale |dq|^2 (m,) of the tool's unit quaternion between the ends of every edge, whatever its sign."""
    if scale == 0.0:
        return 0.0
    first, second = end_effector_poses(configurations, robot.chain)[1][edges.T]
    sign = np.where(np.sum(first * second, axis=1) < 0.0, -1.0, 1.0)
    return scale * np.sum((second - sign[:, None] * first) ** 2, axis=1)


def _both_pulled_back(slopes: np.ndarray) -> np.ndarray:
    """J^T J + S^T S (n, d, d) of derivatives (n, r, 2 d) of what is decoded, J, and of its sigma, S."""
    d = slopes.shape[2] // 2
    return pulled_back(slopes[:, :, :d]) + pulled_back(slopes[:, :, d:])


@numba.njit(cache=True, nogil=True)
def _projected_energies(edges: np.ndarray, jacobians: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """sum_j |J_k steps_j|^2 (m, K) for steps (m, P, eta), J_k the mean of the Jacobians (n, K, r, eta) at both ends."""
    count, joints = jacobians.shape[1], jacobians.shape[3]
    energies = np.zeros((len(edges), count))
    for e in range(len(edges)):
        u, v = edges[e, 0], edges[e, 1]
        for k in range(count):
            for a in range(3):
                for piece in range(steps.shape[1]):
                    along = 0.0
                    for j in range(joints):
                        along += 0.5 * (jacobians[u, k, a, j] + jacobians[v, k, a, j]) * steps[e, piece, j]
                    energies[e, k] += along * along
    return energies


@numba.njit(cache=True, nogil=True)
def _chord_energies(
    edges: np.ndarray, configurations: np.ndarray, points: np.ndarray, sigma_shares: np.ndarray, conformal: np.ndarray,
    bends: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """b |dtheta|^2 (m,), a_ek = conformal (b |dp_k|^2 + sigma's part) / K (m, K), and their sum (m,), of every edge, b
    its bend (m,).
    """
    count = points.shape[1]
    turned, shares, moved = np.zeros(len(edges)), np.empty((len(edges), count)), np.zeros(len(edges))
    for e in range(len(edges)):
        u, v = edges[e, 0], edges[e, 1]
        for j in range(configurations.shape[1]):
            turned[e] += bends[e] * (configurations[v, j] - configurations[u, j]) ** 2
        for k in range(count):
            squared = sigma_shares[e, k]
            for a in range(3):
                squared += bends[e] * (points[v, k, a] - points[u, k, a]) ** 2
            shares[e, k] = conformal[e] * squared / count
            moved[e] += shares[e, k]
    return turned, shares, moved
