"""From a trained model to a skill: codes, latent box, support and the energy that a feasible path may have."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.learning.autoencoder import AutoEncoder
from geodesic_motion_ros.learning.shown_task import Curves, ShownTask
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.encoder import PERIOD
from geodesic_motion_ros.manifold.latent_graph import LatentGraph
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.skill.sheet import unrolled
from geodesic_motion_ros.skill.skill import ROUND_SHAPES, LearnedModel, Skill
from geodesic_motion_ros.utils.errors import SkillError

#: The support is measured by this percentile of rms sigma on the codes: a few bad samples do not widen it.
SUPPORT_PERCENTILE = 99.0
#: An edge may cost this multiple of the dearest edge on the shortest paths between the demonstrations' own
#: ends: a detour runs across the tube and near its rim, where edges cost ten times more; walls cost thousands
#: of times more.
ENERGY_MULTIPLE = 100.0


def assemble_skill(vae: AutoEncoder, shown: ShownTask, name: str, provenance: dict[str, Any]) -> Skill:
    """Put a trained float64 model and the demonstrations it was trained on together into a calibrated skill.

    Raises
    ------
    SkillError : no demonstration's ends are connected inside the support; of a literal model no two of its nodes.
    RobotError : there is no such robot.
    """
    described, settings = RobotDescription.named(shown.robot), shown.settings
    curves, canonical = shown.coded_curves()
    start, goal = shown.ends(curves)
    codes = _encode(vae, curves)
    quality = _reconstruction_quality(vae, codes, curves, shown)
    if (opposite := shown.opposite(curves)) is not None:
        codes = np.concatenate([codes, _encode(vae, opposite)])
    decoder = vae.decoder.to_numpy()
    border = settings.margin * np.ptp(codes.reshape(-1, codes.shape[-1]), axis=0)
    if settings.closed:
        codes = unrolled(codes, np.eye(codes.shape[-1])[0] * PERIOD)
        # Whole steps of the grid, so that nodes a round apart decode to the same.
        step, along = PERIOD / ROUND_SHAPES[codes.shape[-1]][0], np.ptp(codes[..., 0])
        border[0] = 0.5 * (math.ceil(along / step) * step - along)
    flat = codes.reshape(-1, codes.shape[-1])
    model = LearnedModel(
        name=name,
        robot=shown.robot,
        space=shown.space,
        decoder=decoder,
        codes=codes,
        latent_lower=flat.min(axis=0) - border,
        latent_upper=flat.max(axis=0) + border,
        sigma_support=float(np.percentile(rms_sigma(decoder.decode(flat).sigma), SUPPORT_PERCENTILE)),
        metric=replace(settings.metric, progress_length=shown.progress_length(curves)),
        canonical=canonical,
        orientation_model=shown.orientation_model,
    )
    graph = model.graph()
    return Skill.of(
        model,
        dearest_energy(graph, shown.energies(graph), codes, whole=settings.schedule != "joint"),
        start_pose=start,
        goal_pose=goal,
        base_frame=described.base_link,
        tool_frame=described.tool_link,
        encoder_arrays=vae.encoder.arrays(),
        quality=quality,
        provenance=provenance,
    )


def dearest_energy(graph: LatentGraph, energies: np.ndarray, codes: np.ndarray, whole: bool = True) -> float:
    """Choose the largest squared length of one edge that a feasible path may have.

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
    dearest = 0.0
    # Many demonstrations begin at one node.
    for start in np.unique(ends[:, 0]):
        distances, before = dijkstra(lengths, directed=False, indices=start, return_predecessors=True)
        goals = np.unique(ends[ends[:, 0] == start, 1])
        steps = [_dearest_step(distances, before, start, goal) for goal in goals if np.isfinite(distances[goal])]
        dearest = max(dearest, *steps, 0.0)
    if dearest == 0.0:
        raise SkillError(
            "no demonstration's start and goal are connected inside the support of the learned model: "
            "train with more steps, more kernels or a wider kernel bandwidth"
        )
    return ENERGY_MULTIPLE * dearest**2


def _joined_ends(nodes: np.ndarray, components: np.ndarray) -> np.ndarray:
    """First and last of a demonstration's nodes (T,) in the component (T,) that most of them are of."""
    return nodes[components == np.bincount(components).argmax()][[0, -1]]


def _dearest_step(distances: np.ndarray, before: np.ndarray, start: int, goal: int) -> float:
    """Longest edge of the shortest path from a start to a goal, from Dijkstra's distances and predecessors."""
    node, dearest = goal, 0.0
    while node != start:
        dearest = max(dearest, distances[node] - distances[before[node]])
        node = before[node]
    return float(dearest)


def _encode(vae: AutoEncoder, curves: Curves) -> np.ndarray:
    with torch.no_grad():
        return vae.encoder(*map(torch.tensor, curves))[0].numpy()


def _reconstruction_quality(vae: AutoEncoder, codes: np.ndarray, curves: Curves, shown: ShownTask) -> dict[str, float]:
    """How well the tool's poses in the training demonstrations come back from their codes."""
    with torch.no_grad():
        means = vae.decoder.means(torch.tensor(codes))
    positions, quaternions = shown.tool_poses(curves)
    found, turned = shown.tool_poses(means)
    distance, angle = np.linalg.norm(found - positions, axis=-1), angle_between(turned, quaternions)
    return {
        "training_position_error_mm": float(1e3 * distance.mean()),
        "training_orientation_error_deg": float(np.degrees(angle.mean())),
    }
