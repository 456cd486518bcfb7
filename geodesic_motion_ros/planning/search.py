"""The cheapest path through a skill's latent graph under obstacles, and the verdict on it: for every kind of skill."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from geodesic_motion_ros.manifold.bidirectional_astar import load_search_from_both_ends, shortest_path_from_both_ends
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.geodesic_refinement import refined
from geodesic_motion_ros.manifold.latent_graph import LatentGraph
from geodesic_motion_ros.manifold.metric_field import MetricField
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import Reshaping, first_clear
from geodesic_motion_ros.manifold.shortest_path import cost_field
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.settings import CURVE_SIGMA_FACTOR, ENTRY_STEPS, PlannerSettings
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.deadline import NEVER, Deadline


class SearchQuery(Protocol):
    """What the search needs of a `pose_query.Query`, a `ConfigurationQuery` or a `ToolQuery`."""

    graph: WeightedGraph
    body: NodeBody
    to_goal: np.ndarray
    from_start: np.ndarray
    cost_limit: float
    goal_node: int
    misfits: dict[str, float]


class RefinedQuery(SearchQuery, Protocol):
    """What it needs besides to make a path a continuous one: the metric between the nodes."""

    field: MetricField


@dataclass(frozen=True)
class LatentPath:
    """A path through the graph: its nodes (p,), latent polyline (m, d), largest energy of one edge, and the gap.

    gap : as `Verdict.cost_gap`. undisturbed : no obstacle was felt in the search: it is the cheapest without any.
    """

    nodes: np.ndarray
    polyline: np.ndarray
    energy: float
    gap: float
    undisturbed: bool = False


@dataclass(frozen=True)
class KnownPaths:
    """The path being followed, and the last one that was no gain over it."""

    followed: LatentPath
    rejected: LatentPath | None = None

    def include(self, path: LatentPath) -> bool:
        """Whether a path is the one being followed, and need not be judged again.

        Where no obstacle is felt the cheapest path from a point of the cheapest one is the rest of it, but may lead
        over other nodes of the grid: where that has been no gain once it is not judged again. A gain that it becomes as
        less of the path is left is given away.
        """
        undisturbed = self.rejected is not None and all(
            one.undisturbed for one in (self.followed, self.rejected, path)
        )
        return undisturbed or is_same_path(path.nodes, self.followed.nodes)


def demonstrated_cost(graph: LatentGraph, base: np.ndarray, codes: np.ndarray) -> float:
    """What the first demonstration's path costs, for codes (N, T, d) and the edges' lengths base (m,)."""
    everywhere = np.ones(len(graph.latent), dtype=bool)
    start, goal = (graph.node_near(code, everywhere, max(graph.grid.shape)) for code in codes[0, [0, -1]])
    assert start is not None
    assert goal is not None
    return float(cost_field(graph.adjacency, base, goal)[start])


def load_search(graph: LatentGraph, query: SearchQuery, settings: PlannerSettings) -> None:
    """Load the compiled kernels of `cheapest_path`, whatever obstacles there will be."""
    reshaping = Reshaping.of(
        query.body, Obstacles.none(), settings.ambient_strength, settings.ambient_width_ratio,
        settings.obstacle_margin, settings.ambient_law,
    )  # fmt: skip
    load_search_from_both_ends(
        graph.adjacency, query.graph.base, query.graph.fixed, query.graph.shares, reshaping, query.to_goal,
        query.from_start, query.goal_node,
    )  # fmt: skip


def cheapest_path(
    graph: LatentGraph,
    query: SearchQuery,
    start: np.ndarray,
    reshaping: Reshaping,
    margin: float,
    deadline: Deadline = NEVER,
) -> LatentPath | Verdict:
    """The cheapest path from a latent point (d,) to the goal's node that keeps a margin [m], or why there is none.

    Paths that cost more than the query's limit are none: they would lead all along obstacles, or far around them. The
    goal was found free before: its node lies under it but for rounding, and is not evaluated again. Once the deadline
    has passed it is the cheapest path found by then, or DEADLINE_MISSED.
    """
    source = _entry(graph, query, start, reshaping, margin)
    if source is None:
        reason = "obstacles leave no free node near the start"
        return Verdict(VerdictCode.NO_FEASIBLE_PATH, reason, **query.misfits)
    found = shortest_path_from_both_ends(
        graph.adjacency, query.graph.base, query.graph.fixed, query.graph.shares, reshaping, margin,
        query.to_goal, query.from_start, source, query.goal_node, query.cost_limit, deadline,
    )  # fmt: skip
    if not math.isfinite(found.cost):
        if found.bound < query.cost_limit:
            share = found.bound / query.cost_limit
            reason = f"out of time before a path was found: the search had come to {share:.0%} of what one may cost"
            return Verdict(VerdictCode.DEADLINE_MISSED, reason, **query.misfits)
        reason = "obstacles block every path to the goal that was demonstrated"
        return Verdict(VerdictCode.NO_FEASIBLE_PATH, reason, **query.misfits)
    energy = float(np.max(query.graph.energies(found.edges), initial=0.0))
    points = graph.latent[found.nodes]
    # The first node may lie behind the start.
    if len(points) > 1 and (points[1] - points[0]) @ (start - points[0]) > 0.0:
        points = points[1:]
    undisturbed = found.gap == 0.0 and not reshaping.is_felt(margin)
    return LatentPath(found.nodes, np.concatenate([start[None], points]), energy, found.gap, undisturbed)


def is_same_path(nodes: np.ndarray, known: np.ndarray) -> bool:
    """Whether nodes (p,) are the end of a path known before, but for the first few, by which it enters the graph."""
    left = nodes[ENTRY_STEPS:]
    return 0 < len(left) <= len(known) and np.array_equal(left, known[len(known) - len(left) :])


def _entry(
    graph: LatentGraph, query: SearchQuery, start: np.ndarray, reshaping: Reshaping, margin: float
) -> int | None:
    """The nearest free node to the start from which the goal can be reached."""
    near = graph.nodes_near(start, ENTRY_STEPS)
    found = first_clear(near[np.isfinite(query.to_goal[near])], query.goal_node, reshaping, margin)
    return None if found < 0 else found


class MarginSearch:
    """The searches of one solution: the cheapest path with each margin, searched once."""

    def __init__(
        self,
        graph: LatentGraph,
        query: RefinedQuery,
        start: np.ndarray,
        reshaping: Reshaping,
        deadline: Deadline,
        settings: PlannerSettings,
        largest: float,
    ) -> None:
        """largest : no margin that is kept from obstacles is larger than this [m].

        Ends closer to an obstacle than a margin may stay so, but the path must not come closer than they are.
        """
        self._graph, self._query, self._start, self._reshaping = graph, query, start, reshaping
        self._deadline, self._settings, self._largest = deadline, settings, largest
        self._paths: dict[float, LatentPath | Verdict] = {}

    def margin(self, multiple: float) -> float:
        """What is kept from obstacles [m] for a multiple of the margin."""
        return min(multiple * self._settings.obstacle_margin, self._largest)

    def path(self, multiple: float) -> LatentPath | Verdict:
        """The cheapest path that keeps a multiple of the margin."""
        margin = self.margin(multiple)
        if margin not in self._paths:
            self._paths[margin] = cheapest_path(
                self._graph, self._query, self._start, self._reshaping, margin, self._deadline
            )
        return self._paths[margin]

    def refined(self, path: LatentPath, multiple: float) -> LatentPath:
        """A path made a continuous one that keeps the same, where the settings say so."""
        if not self._settings.refine:
            return path
        margin = self.margin(multiple)
        return replace(path, polyline=refined(self._query.field, self._reshaping, margin, path.polyline))


def path_verdict(
    skill: Skill,
    graph: LatentGraph,
    query: SearchQuery,
    sigma: np.ndarray,
    path: LatentPath,
    clearance: float,
    end_correction: float,
    objection: str | None,
) -> Verdict:
    """Judge a path by its sigma (n, D), the largest energy of one edge, and what its certificate objects to.

    clearance, end_correction : as of `Verdict`.
    """
    in_support = float(np.max(rms_sigma(sigma))) <= CURVE_SIGMA_FACTOR * skill.sigma_limit
    if objection is not None:
        reason = objection
    elif not in_support:
        reason = "the best path leaves the part of the latent space that demonstrations support"
    elif path.energy > graph.energy_limit:
        reason = (
            f"the best path has an edge of energy {path.energy:.3g}, demonstrations stay below "
            f"{graph.energy_limit:.3g}: it crosses where nobody moved"
        )
    else:
        reason = ""
    return Verdict(
        VerdictCode.NO_FEASIBLE_PATH if reason else VerdictCode.OK, reason, clearance=clearance,
        energy_per_edge=path.energy, cost_gap=path.gap, in_support=in_support, end_correction=end_correction,
        **query.misfits,
    )  # fmt: skip
