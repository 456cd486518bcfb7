"""The cheapest way through a skill's latent graph under obstacles, and the verdict on it: for every kind of skill."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from geodesic_motion_ros.graph.decoder import rms_sigma
from geodesic_motion_ros.graph.latent_graph import LatentGraph
from geodesic_motion_ros.graph.shortest_path import shortest_path
from geodesic_motion_ros.graph.weighted_graph import WeightedGraph
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: The smoothed curve may leave the pruned nodes by this factor of sigma before it counts as unsupported.
_CURVE_SIGMA_MULTIPLE = 1.2
#: A path may enter the graph this many grid steps from the start.
_ENTRY_STEPS = 3


class WayQuery(Protocol):
    """What the search needs of a `query.Query` or a `joint_query.JointQuery`."""

    graph: WeightedGraph
    base: np.ndarray
    to_goal: np.ndarray
    goal_node: int
    misfits: dict[str, float]


def cheapest_way(
    graph: LatentGraph,
    query: WayQuery,
    start: np.ndarray,
    factors: np.ndarray,
    touched: np.ndarray,
    blocked: np.ndarray,
) -> tuple[np.ndarray, float] | Verdict:
    """Latent polyline (m, d) from a latent point (d,) to the goal's node and its largest energy per edge, or why none.

    factors, touched, blocked : (n, K), (n,), (n,) as of `graph.shortest_path.shortest_path`.
    """
    source = graph.node_near(start, ~blocked, _ENTRY_STEPS)
    if source is None:
        reason = "obstacles leave no free node near the start"
        return Verdict(VerdictCode.NO_FEASIBLE_PATH, reason, **query.misfits)
    nodes, edges, cost = shortest_path(
        graph.adjacency, query.base, query.graph.fixed, query.graph.shares, factors, touched, blocked,
        query.to_goal, source, query.goal_node,
    )  # fmt: skip
    if not math.isfinite(cost):
        reason = "obstacles block every way to the goal that was demonstrated"
        return Verdict(VerdictCode.NO_FEASIBLE_PATH, reason, **query.misfits)
    energy = float(np.max(query.graph.energies(edges), initial=0.0))
    points = graph.latent[nodes]
    # The first node may lie behind the start.
    if len(points) > 1 and (points[1] - points[0]) @ (start - points[0]) > 0.0:
        points = points[1:]
    return np.concatenate([start[None], points]), energy


def way_verdict(
    skill: Skill,
    graph: LatentGraph,
    query: WayQuery,
    sigma: np.ndarray,
    energy: float,
    clearance: float,
    end_correction: float,
    objection: str | None,
) -> Verdict:
    """Judge a way by its sigma (n, D), its largest energy of one edge, and what its certificate objects to.

    clearance, end_correction : as of `Verdict`.
    """
    in_support = float(np.max(rms_sigma(sigma))) <= _CURVE_SIGMA_MULTIPLE * skill.sigma_limit
    if objection is not None:
        reason = objection
    elif not in_support:
        reason = "the best path leaves the part of the latent space that demonstrations support"
    elif energy > graph.energy_limit:
        reason = (
            f"the best path has an edge of energy {energy:.3g}, demonstrations stay below "
            f"{graph.energy_limit:.3g}: it crosses where nobody moved"
        )
    else:
        reason = ""
    return Verdict(
        VerdictCode.NO_FEASIBLE_PATH if reason else VerdictCode.OK, reason, clearance=clearance,
        energy_per_edge=energy, in_support=in_support, end_correction=end_correction, **query.misfits,
    )  # fmt: skip
