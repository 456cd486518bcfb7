"""From a trained model to a skill: codes, latent box, support and the energy that a feasible path may
have.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.errors import SkillError
from geodesic_motion_ros.graph.decoder import rms_sigma
from geodesic_motion_ros.graph.latent_graph import LatentGraph, MetricSettings, Offsets
from geodesic_motion_ros.manifold.task_space import TaskSpaceVAE
from geodesic_motion_ros.quaternions import angle_between, normalise
from geodesic_motion_ros.skill import Skill

#: Samples of a demonstration whose codes a skill keeps, equally spaced in arc length of the positions.
CODE_SAMPLES = 100
#: The support is measured by this percentile of rms sigma on the codes: a few bad samples do not widen it.
SUPPORT_PERCENTILE = 99.0
#: Share of that percentile below which the support is not narrowed to keep clusters apart.
SMALLEST_SUPPORT = 0.4
#: An edge may cost this multiple of the dearest edge on the shortest paths between the demonstrations' own
#: ends: a detour runs across the tube and near its rim, where edges cost ten times more; walls cost thousands
#: of times more.
ENERGY_MULTIPLE = 100.0


def assemble_skill(
    vae: TaskSpaceVAE,
    demonstrations: Demonstrations,
    name: str,
    metric: MetricSettings,
    margin: float,
    provenance: dict[str, Any],
) -> Skill:
    """Put a trained float64 model and the demonstrations it was trained on together into a calibrated skill.

    Parameters
    ----------
    demonstrations : all on one sign sheet, as they were trained on.
    margin : free border of the latent box around the codes, as a fraction of its size.

    Raises
    ------
    SkillError : no demonstration's ends are connected inside the support.
    """
    even = demonstrations.resampled(CODE_SAMPLES)
    positions, quaternions = even.positions_array(), even.quaternions_array()
    codes = _encode(vae, positions, quaternions)
    quality = _reconstruction_quality(vae, codes, positions, quaternions)
    if demonstrations.has_orientation:
        codes = np.concatenate([codes, _encode(vae, positions, -quaternions)])
    flat = codes.reshape(-1, codes.shape[-1])
    border = margin * np.ptp(flat, axis=0)
    decoder = vae.decoder.to_numpy()
    skill = Skill(
        name=name,
        decoder=decoder,
        codes=codes,
        latent_lower=flat.min(axis=0) - border,
        latent_upper=flat.max(axis=0) + border,
        sigma_support=float(np.percentile(rms_sigma(decoder.uncertainty(flat)[0]), SUPPORT_PERCENTILE)),
        energy_per_edge=math.inf,
        start_pose=_mean_pose(positions[:, 0], quaternions[:, 0]),
        goal_pose=_mean_pose(positions[:, -1], quaternions[:, -1]),
        metric=metric,
        orientation_model=vae.orientation_model,
        encoder_arrays=vae.encoder.arrays(),
        quality=quality,
        provenance=provenance,
    )
    if demonstrations.has_orientation and vae.orientation_model == "two_cluster":
        skill = with_separate_sheets(skill)
    return replace(skill, energy_per_edge=calibrated_energy_per_edge(skill.graph(), codes))


def with_separate_sheets(skill: Skill) -> Skill:
    """Narrow the support of a two-cluster skill, as little as it takes, until q and -q lie in pieces of their own.

    Where the tubes of both clusters pass close to each other their supports can touch, and a path from q to -q through
    orientations nobody showed opens. A skill whose sheets stay joined down to SMALLEST_SUPPORT comes back as it was.
    """
    share = 1.0
    while share >= SMALLEST_SUPPORT:
        narrowed = replace(skill, sigma_support=share * skill.sigma_support)
        if not sheets_are_joined(narrowed.graph(), skill.codes):
            return narrowed
        share *= 0.9
    return skill


def sheets_are_joined(graph: LatentGraph, codes: np.ndarray) -> bool:
    """Whether most codes of q, the first half of codes (2N, T, d), and most of -q lie in one piece of the graph."""
    _, nodes = cKDTree(graph.latent).query(codes.reshape(2, -1, codes.shape[-1]))
    first, second = (int(np.argmax(np.bincount(pieces))) for pieces in graph.component[nodes])
    return first == second


def calibrated_energy_per_edge(graph: LatentGraph, codes: np.ndarray) -> float:
    """Largest squared length of one edge that a feasible path may have.

    ENERGY_MULTIPLE times the dearest edge of the shortest obstacle-free paths between the first and last code
    of every demonstration, codes (N, T, d).

    Raises
    ------
    SkillError : no demonstration's ends are connected in the graph.
    """
    untouched = graph.transported(Offsets.none(), np.zeros((1, 3)))
    energies = untouched.fixed + untouched.shares.sum(axis=1)
    count = len(graph.latent)
    first, second = graph.edges.T
    lengths = coo_matrix((np.sqrt(energies), (first, second)), shape=(count, count)).tocsr()
    _, ends = cKDTree(graph.latent).query(codes[:, [0, -1]])
    distances, before = dijkstra(lengths, directed=False, indices=ends[:, 0], return_predecessors=True)
    joined = [row for row, goal in enumerate(ends[:, 1]) if np.isfinite(distances[row, goal])]
    dearest = max((_dearest_step(distances[row], before[row], ends[row]) for row in joined), default=0.0)
    if dearest == 0.0:
        raise SkillError(
            "no demonstration's start and goal are connected inside the support of the learned model: "
            "train with more steps, more kernels or a wider kernel bandwidth"
        )
    return ENERGY_MULTIPLE * dearest**2


def _dearest_step(distances: np.ndarray, before: np.ndarray, ends: np.ndarray) -> float:
    """Longest edge of the shortest path from ends[0] to ends[1], from Dijkstra's distances and
    predecessors.
    """
    node, dearest = ends[1], 0.0
    while node != ends[0]:
        dearest = max(dearest, distances[node] - distances[before[node]])
        node = before[node]
    return float(dearest)


def _encode(vae: TaskSpaceVAE, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    with torch.no_grad():
        return vae.encoder(torch.tensor(positions), torch.tensor(quaternions))[0].numpy()


def _reconstruction_quality(
    vae: TaskSpaceVAE, codes: np.ndarray, positions: np.ndarray, quaternions: np.ndarray
) -> dict[str, float]:
    """How well the training demonstrations come back from their codes."""
    with torch.no_grad():
        means = vae.decoder.means(torch.tensor(codes))
    distance = np.linalg.norm(means.positions.numpy() - positions, axis=-1)
    angle = angle_between(means.quaternions.numpy(), quaternions)
    return {
        "training_position_error_mm": float(1e3 * distance.mean()),
        "training_orientation_error_deg": float(np.degrees(angle.mean())),
    }


def _mean_pose(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Mean position and normalised mean quaternion (7,) of poses (N, 3), (N, 4), on the first one's
    hemisphere.
    """
    signs = np.where(quaternions @ quaternions[0] < 0.0, -1.0, 1.0)
    return np.concatenate([positions.mean(axis=0), normalise((signs[:, None] * quaternions).mean(axis=0))])
