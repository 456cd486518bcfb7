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

from geodesic_motion_ros.demonstrations.canonical import CanonicalDemonstrations, canonical_form, mean_pose
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.modes import cluster_modes
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.learning.task_space import TaskSpaceVAE
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.latent_graph import LatentGraph
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.manifold.transport import Offsets
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT, RobotDescription
from geodesic_motion_ros.skill.regression import regression_penalty
from geodesic_motion_ros.skill.sheet import CanonicalSheet
from geodesic_motion_ros.skill.skill import LearnedModel, Skill
from geodesic_motion_ros.utils.errors import SkillError

#: Samples of a demonstration whose codes a skill keeps, equally spaced in arc length of the positions.
CODE_SAMPLES = 100
#: The support is measured by this percentile of rms sigma on the codes: a few bad samples do not widen it.
SUPPORT_PERCENTILE = 99.0
#: An edge may cost this multiple of the dearest edge on the shortest paths between the demonstrations' own
#: ends: a detour runs across the tube and near its rim, where edges cost ten times more; walls cost thousands
#: of times more.
ENERGY_MULTIPLE = 100.0


def assemble_skill(
    vae: TaskSpaceVAE,
    demonstrations: Demonstrations,
    name: str,
    settings: TrainingSettings,
    provenance: dict[str, Any],
    robot: str = DEFAULT_ROBOT,
) -> Skill:
    """Put a trained float64 model and the demonstrations it was trained on together into a calibrated skill.

    Parameters
    ----------
    demonstrations : all on one sign sheet, as they were trained on; settings : of the training.
    robot : that is to do it: the name of a shipped one, or the path of a folder.

    Raises
    ------
    SkillError : no demonstration's ends are connected inside the support; of a literal model no two of its nodes.
    RobotError : there is no such robot.
    """
    described = RobotDescription.named(robot)
    canonical = None
    if settings.sheet == "canonical":
        form = canonical_form(demonstrations, CODE_SAMPLES, settings.rotation_length)
        canonical, start, goal = canonical_sheet(form), form.start, form.goal
        positions, quaternions = form.positions, form.quaternions
    else:
        even = demonstrations.resampled(CODE_SAMPLES)
        positions, quaternions = even.positions_array(), even.quaternions_array()
        start, goal = (mean_pose(positions[:, end], quaternions[:, end]) for end in (0, -1))
    codes = _encode(vae, positions, quaternions)
    quality = _reconstruction_quality(vae, codes, positions, quaternions)
    if demonstrations.has_orientation and canonical is None:
        codes = np.concatenate([codes, _encode(vae, positions, -quaternions)])
    flat = codes.reshape(-1, codes.shape[-1])
    border = settings.margin * np.ptp(flat, axis=0)
    decoder = vae.decoder.to_numpy()
    model = LearnedModel(
        name=name,
        robot=robot,
        decoder=decoder,
        codes=codes,
        latent_lower=flat.min(axis=0) - border,
        latent_upper=flat.max(axis=0) + border,
        sigma_support=float(np.percentile(rms_sigma(decoder.uncertainty(flat)[0]), SUPPORT_PERCENTILE)),
        metric=settings.metric,
        canonical=canonical,
        # Recordings without orientation are learned with one sign only: there are no two clusters.
        orientation_model=vae.orientation_model if demonstrations.has_orientation else "sign_blind",
    )
    return Skill.of(
        model,
        calibrated_energy_per_edge(model.graph(), codes, whole=settings.schedule != "joint"),
        start_pose=start,
        goal_pose=goal,
        base_frame=described.base_link,
        tool_frame=described.tool_link,
        encoder_arrays=vae.encoder.arrays(),
        quality=quality,
        provenance=provenance,
    )


def canonical_sheet(form: CanonicalDemonstrations) -> CanonicalSheet:
    """What a skill keeps of canonical demonstrations, with their modes and the regression they speak for."""
    modes = cluster_modes(form.positions)
    sheet = CanonicalSheet(
        form.start_offsets, form.goal_offsets, modes, math.inf, form.positions, form.quaternions, fade=form.fade
    )
    # Between modes there is nothing to regress: a mean never averages two modes.
    return sheet if np.any(modes) else replace(sheet, penalty=regression_penalty(sheet.features(), form.positions))


def calibrated_energy_per_edge(graph: PoseGraph, codes: np.ndarray, whole: bool = True) -> float:
    """Largest squared length of one edge that a feasible path may have; see `dearest_energy`."""
    still = graph.transported(Offsets.none(graph.mean_path_count), np.zeros((1, 3)))
    return dearest_energy(graph, still.energies(), codes, whole)


def dearest_energy(graph: LatentGraph, energies: np.ndarray, codes: np.ndarray, whole: bool = True) -> float:
    """Largest squared length of one edge that a feasible path may have.

    ENERGY_MULTIPLE times the dearest edge of the shortest obstacle-free paths between the first and last code
    of every demonstration, for squared lengths (m,) and codes (N, T, d).

    whole : whether such a path has to be there; else of each demonstration the part counts that lies in the piece of
        the graph which holds most of it. The paper's planner has the whole box: a gap in the support stops it nowhere.

    Raises
    ------
    SkillError : no demonstration's ends are connected in the graph.
    """
    count = len(graph.latent)
    first, second = graph.edges.T
    lengths = coo_matrix((np.sqrt(energies), (first, second)), shape=(count, count)).tocsr()
    nodes = cKDTree(graph.latent).query(codes)[1]
    ends = nodes[:, [0, -1]] if whole else np.array([_joined_ends(row, graph.component[row]) for row in nodes])
    distances, before = dijkstra(lengths, directed=False, indices=ends[:, 0], return_predecessors=True)
    joined = [row for row, goal in enumerate(ends[:, 1]) if np.isfinite(distances[row, goal])]
    dearest = max((_dearest_step(distances[row], before[row], ends[row]) for row in joined), default=0.0)
    if dearest == 0.0:
        raise SkillError(
            "no demonstration's start and goal are connected inside the support of the learned model: "
            "train with more steps, more kernels or a wider kernel bandwidth"
        )
    return ENERGY_MULTIPLE * dearest**2


def _joined_ends(nodes: np.ndarray, components: np.ndarray) -> np.ndarray:
    """First and last of a demonstration's nodes (T,) in the component (T,) that most of them are of."""
    return nodes[components == np.bincount(components).argmax()][[0, -1]]


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
