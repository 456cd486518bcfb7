"""The cheapest path through a skill's latent graph under obstacles, and its figures: for every kind of skill."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geodesic_motion_ros.contract.settings import CURVE_SIGMA_FACTOR, ENTRY_STEPS, PlannerSettings
from geodesic_motion_ros.contract.status import Figures, Refusal, VerdictCode
from geodesic_motion_ros.manifold.bidirectional_astar import load_search_from_both_ends, shortest_path_from_both_ends
from geodesic_motion_ros.manifold.decoder import rms_sigma
from geodesic_motion_ros.manifold.geodesic_refinement import refined
from geodesic_motion_ros.manifold.latent_graph import LatentGraph
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, first_clear
from geodesic_motion_ros.manifold.shortest_path import shortest_free_path
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.query import Query
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: The margin [m] with which obstacles remove no node: no clearance is less.
NO_NODE_REMOVED = -math.inf


@dataclass(frozen=True)
class LatentPath:
    """A path through the latent graph: its nodes (p,), latent polyline (m, d), and the largest energy of one edge.

    gap : as `Figures.cost_gap`. undisturbed : no obstacle affected a node that the search evaluated: the path is the
        cheapest without any.
    """

    nodes: np.ndarray
    polyline: np.ndarray
    energy: float
    gap: float
    undisturbed: bool = False


@dataclass(frozen=True)
class KnownPaths:
    """The paths that need no certificate where the search finds them again.

    followed : the path that is being followed. rejected : the last path that was no gain over it.
    """

    followed: LatentPath
    rejected: LatentPath | None = None

    def include(self, path: LatentPath) -> bool:
        """Whether a path is the one that is followed, and needs no certificate: the same nodes, or all undisturbed.

        Without obstacles the cheapest path from a point of the cheapest path is the rest of that path, but may lead
        over other nodes of the grid. Where such a path has been no gain once, it is not timed and certified again.
        Later, on the rest of the path, it may become a gain, which this rule misses: that is accepted.
        """
        undisturbed = self.rejected is not None and all(one.undisturbed for one in (self.followed, self.rejected, path))
        return undisturbed or is_same_path(path.nodes, self.followed.nodes)


def load_search(graph: LatentGraph, query: Query[Any], settings: PlannerSettings) -> None:
    """Load the compiled kernels of `cheapest_path`, whatever obstacles there will be, and of paths without any."""
    evaluation = NodeEvaluation.of(
        query.body, Obstacles.none(), settings.ambient_strength, settings.ambient_width_ratio,
        settings.obstacle_margin, settings.ambient_law,
    )  # fmt: skip
    shortest_free_path(graph.adjacency, query.graph.base, query.to_goal, query.goal_node, query.goal_node)
    load_search_from_both_ends(
        graph.adjacency, query.graph.base, query.graph.fixed, query.graph.shares, evaluation, query.to_goal,
        query.from_start, query.goal_node,
    )  # fmt: skip


def cheapest_path(
    graph: LatentGraph,
    query: Query[Any],
    start: np.ndarray,
    evaluation: NodeEvaluation,
    margin: float,
    deadline: Deadline = NEVER,
) -> LatentPath | Refusal:
    """Return the cheapest path from a latent point (d,) to the goal's node that keeps a margin [m], or why there is
    none.

    Paths that cost more than the query's limit are none: they would lead all along obstacles, or far around them. The
    goal's node is not evaluated: the caller has found the goal itself free, and the node is at the goal but for
    rounding. Once the deadline has passed the answer is the cheapest path found by then, or DEADLINE_MISSED.

    margin : nodes with less clearance are removed; `NO_NODE_REMOVED`: none is, and obstacles only make nodes dearer.
    """
    source = _entry(graph, query, start, evaluation, margin)
    if source is None:
        reason = "obstacles leave no free node near the start"
        return Refusal(VerdictCode.NO_FEASIBLE_PATH, reason, query.misfits)
    found = shortest_path_from_both_ends(
        graph.adjacency, query.graph.base, query.graph.fixed, query.graph.shares, evaluation, margin,
        query.to_goal, query.from_start, source, query.goal_node, query.cost_limit, deadline,
    )  # fmt: skip
    if not math.isfinite(found.cost):
        if found.bound < query.cost_limit:
            share = found.bound / query.cost_limit
            reason = f"out of time before a path was found: the search had come to {share:.0%} of what one may cost"
            return Refusal(VerdictCode.DEADLINE_MISSED, reason, query.misfits)
        reason = "obstacles block every path to the goal that was demonstrated"
        return Refusal(VerdictCode.NO_FEASIBLE_PATH, reason, query.misfits)
    energy = float(np.max(query.graph.energies(found.edges), initial=0.0))
    points = graph.latent[found.nodes]
    # The first node may lie behind the start.
    if len(points) > 1 and (points[1] - points[0]) @ (start - points[0]) > 0.0:
        points = points[1:]
    if query.round_frame is not None:
        # The goal lies between nodes.
        points = np.concatenate([points[:-1], query.ends[1].latent[None]])
    undisturbed = found.gap == 0.0 and not evaluation.is_felt(margin)
    return LatentPath(found.nodes, np.concatenate([start[None], points]), energy, found.gap, undisturbed)


def is_same_path(nodes: np.ndarray, known: np.ndarray) -> bool:
    """Whether nodes (p,) are the end of a path known before, but for the first few, by which it enters the graph."""
    left = nodes[ENTRY_STEPS:]
    return 0 < len(left) <= len(known) and np.array_equal(left, known[len(known) - len(left) :])


def _entry(
    graph: LatentGraph, query: Query[Any], start: np.ndarray, evaluation: NodeEvaluation, margin: float
) -> int | None:
    """The nearest free node to the start from which the goal can be reached."""
    near = graph.nodes_near(start, ENTRY_STEPS)
    found = first_clear(near[np.isfinite(query.to_goal[near])], query.goal_node, evaluation, margin)
    return None if found < 0 else found


@dataclass(frozen=True, eq=False)
class BegunSearch:
    """The evaluation that a search has made of a graph's nodes, among which obstacles, which stand.

    unfinished : whether a search with it was out of time: the next one among the same obstacles goes on with it.
    """

    evaluation: NodeEvaluation
    obstacles: Obstacles
    unfinished: bool = False

    def is_of(self, body: NodeBody, obstacles: Obstacles) -> bool:
        """Whether the evaluation is of a body among obstacles."""
        return self.evaluation.body is body and self.obstacles.is_static_and_unchanged(obstacles)

    def copy(self) -> BegunSearch:
        """Return the same, for another search to go on with: what that evaluates is not written here."""
        return replace(self, evaluation=self.evaluation.copied())


class MarginSearch:
    """A search of the cheapest path with several margins, each of which is made once."""

    def __init__(
        self,
        graph: LatentGraph,
        query: Query[Any],
        start: np.ndarray,
        begun: BegunSearch,
        deadline: Deadline,
        settings: PlannerSettings,
        largest: float,
    ) -> None:
        """largest : no margin that is kept from obstacles is larger than this [m].

        Ends closer to an obstacle than a margin may stay so, but the path must not come closer than they are.
        """
        self._graph, self._query, self._start, self.begun = graph, query, start, begun
        self._deadline, self._settings, self._largest = deadline, settings, largest
        self._paths: dict[float, LatentPath | Refusal] = {}

    def margin(self, multiple: float) -> float:
        """Return the clearance that is kept from obstacles [m], for a multiple of the setting `obstacle_margin`."""
        return min(multiple * self._settings.obstacle_margin, self._largest)

    def path(self, multiple: float) -> LatentPath | Refusal:
        """Return the cheapest path that keeps a multiple of the setting `obstacle_margin`, or why there is none."""
        margin = self.margin(multiple)
        if margin not in self._paths:
            self._paths[margin] = cheapest_path(
                self._graph, self._query, self._start, self.begun.evaluation, margin, self._deadline
            )
        return self._paths[margin]

    def refine(self, path: LatentPath, multiple: float) -> LatentPath:
        """Refine a path to a continuous one with the same margin; return it as it is, where the setting `refine` is
        off.
        """
        if not self._settings.refine:
            return path
        margin = self.margin(multiple)
        return replace(path, polyline=refined(self._query.field, self.begun.evaluation, margin, path.polyline))


def judge_path(
    skill: Skill,
    graph: LatentGraph,
    query: Query[Any],
    sigma: np.ndarray,
    path: LatentPath,
    clearance: float,
    end_correction: float,
    objection: str = "",
) -> Figures | Refusal:
    """Judge a path by its sigma (n, D), the largest energy of one edge, and what its certificate objects to: return its
    figures, or why it is not followed.

    clearance, end_correction : as of `Figures`.
    """
    in_support = float(np.max(rms_sigma(sigma))) <= CURVE_SIGMA_FACTOR * skill.sigma_limit
    if objection:
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
    figures = replace(
        query.misfits, clearance=clearance, energy_per_edge=path.energy, cost_gap=path.gap, in_support=in_support,
        end_correction=end_correction,
    )  # fmt: skip
    return Refusal(VerdictCode.NO_FEASIBLE_PATH, reason, figures) if reason else figures
