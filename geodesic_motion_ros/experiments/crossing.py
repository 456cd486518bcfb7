"""What it costs to change clusters: a two-cluster skill holds every motion twice, with q and with -q.

A path from the start in one cluster to the goal in the other would turn the tool through orientations nobody
showed. Its energy beside that of the path inside one cluster says how high the wall between them is; the
planner's graph has to offer no such path at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.demonstrations.curves import PoseCurve
from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.graph.encoder import TaskSpaceEncoder
from geodesic_motion_ros.graph.latent_graph import LatentGraph, Offsets, build_latent_graph
from geodesic_motion_ros.graph.shortest_path import cost_field
from geodesic_motion_ros.skill import Skill


@dataclass(frozen=True)
class Crossing:
    """Paths from the start pose with quaternion q to the goal pose, for one motion.

    Attributes
    ----------
    within, across : energy [m^2] of the shortest path to the goal with q, and with -q, on a graph of the
        whole latent box, nothing pruned or forbidden. At constant speed over unit time it is the length
        squared.
    flagged : the planner's own graph has no path across.
    """

    within: float
    across: float
    flagged: bool

    @property
    def ratio(self) -> float:
        """Energy across over energy within."""
        return self.across / self.within


def measure_crossings(skill: Skill, curves: Sequence[PoseCurve]) -> tuple[Crossing, ...]:
    """Measure for every motion, sign-continuous in its quaternions, in the skill's base frame.

    Give motions the skill was trained on: the code of an unseen end may lie off the manifold, where the path
    within its own cluster begins by climbing out of nowhere.

    Raises
    ------
    ParameterError : the skill is sign-blind and has no clusters to cross between.
    """
    if skill.orientation_model != "two_cluster":
        raise ParameterError(f"a {skill.orientation_model} skill has no two clusters to cross between")
    whole_box = build_latent_graph(
        skill.decoder, skill.codes, skill.latent_lower, skill.latent_upper, skill.metric,
        sigma_limit=math.inf, shape=(50,) * skill.decoder.latent_dimension, neighbours=8, one_sheet=False,
    )  # fmt: skip
    supported = skill.graph()
    encoder = TaskSpaceEncoder.from_arrays(skill.encoder_arrays)
    measured = []
    for curve in curves:
        positions, quaternions = curve.positions[[0, -1, -1]], curve.quaternions[[0, -1, -1]].copy()
        quaternions[2] *= -1.0
        codes = encoder.encode(positions, quaternions)
        within, across = _lengths(whole_box, codes)
        _, permitted = _lengths(supported, codes)
        measured.append(Crossing(within**2, across**2, not math.isfinite(permitted)))
    return tuple(measured)


def _lengths(graph: LatentGraph, codes: np.ndarray) -> tuple[float, float]:
    """Riemannian lengths from the node at the first latent point to those at the other two."""
    _, nodes = cKDTree(graph.latent).query(codes)
    energies = graph.transported(Offsets.none(), np.zeros((1, 3)))
    costs = cost_field(graph.adjacency, energies.fixed, energies.shares, int(nodes[0]))
    return float(costs[nodes[1]]), float(costs[nodes[2]])
