"""The search of one tick, as the planner makes it: the only place here that calls the package's own search engine."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.manifold.bidirectional_astar import shortest_path_from_both_ends
from geodesic_motion_ros.manifold.grid import Adjacency
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.obstacle_weights import NodeEvaluation, evaluate_nodes
from geodesic_motion_ros.manifold.shortest_path import cost_field, shortest_path
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.utils.deadline import NEVER, Deadline


@dataclass(frozen=True)
class SearchProblem:
    """From one node of a weighted graph to another, again and again, among obstacles that change.

    Attributes
    ----------
    name : of the graph, for a person.
    body : what feels obstacles at the nodes, and must stay clear of them; its body point number `tool` is the tool's.
    to_goal, from_start : (n,) obstacle-free costs to the target and from the source.
    cost_limit : paths that cost more count as blocked.
    settings : of the ambient metric, and the margin that nodes keep from obstacles.
    """

    name: str
    adjacency: Adjacency
    graph: WeightedGraph
    body: NodeBody
    tool: int
    source: int
    target: int
    to_goal: np.ndarray
    from_start: np.ndarray
    cost_limit: float
    settings: PlannerSettings

    @classmethod
    def between(
        cls,
        name: str,
        adjacency: Adjacency,
        graph: WeightedGraph,
        body: NodeBody,
        tool: int,
        source: int,
        target: int,
        settings: PlannerSettings,
        cost_limit: float | None = None,
    ) -> SearchProblem:
        """cost_limit : None: what the settings make of the obstacle-free cost."""
        to_goal, from_start = (cost_field(adjacency, graph.base, end) for end in (target, source))
        limit = settings.cost_cap * float(to_goal[source]) if cost_limit is None else cost_limit
        return cls(name, adjacency, graph, body, tool, source, target, to_goal, from_start, limit, settings)

    @property
    def nodes(self) -> int:
        return len(self.to_goal)


@dataclass(frozen=True)
class Answer:
    """The cheapest path's nodes (p,) and cost; no nodes and inf without one.

    Attributes
    ----------
    bound : no path costs less; where time ran out, less than the cost and the limit. nan where that was not asked for.
    """

    nodes: np.ndarray
    cost: float
    bound: float = math.nan


def mark(problem: SearchProblem, obstacles: Obstacles) -> NodeEvaluation:
    """What the search needs to know of obstacles where they are."""
    settings = problem.settings
    within = 4.0 * settings.obstacle_margin
    return NodeEvaluation.of(
        problem.body, obstacles, settings.ambient_strength, settings.ambient_width_ratio, within, settings.ambient_law
    )


def search(
    problem: SearchProblem, evaluation: NodeEvaluation, limited: bool = True, deadline: Deadline = NEVER
) -> Answer:
    """The cheapest path; with `limited`, as the planner searches, none that costs more than the limit."""
    graph = problem.graph
    found = shortest_path_from_both_ends(
        problem.adjacency, graph.base, graph.fixed, graph.shares, evaluation, problem.settings.obstacle_margin,
        problem.to_goal, problem.from_start, problem.source, problem.target,
        problem.cost_limit if limited else math.inf, deadline,
    )  # fmt: skip
    return Answer(found.nodes, found.cost, found.bound)


def search_from_source(problem: SearchProblem, obstacles: Obstacles) -> Answer:
    """A* from the source, with the obstacle-free field as heuristic and without a limit."""
    graph, evaluation = problem.graph, mark(problem, obstacles)
    nodes, _, cost = shortest_path(
        problem.adjacency, graph.base, graph.fixed, graph.shares, evaluation, problem.settings.obstacle_margin,
        problem.to_goal, problem.source, problem.target,
    )  # fmt: skip
    return Answer(nodes, cost)


def search_plainly(problem: SearchProblem, obstacles: Obstacles) -> Answer:
    """Dijkstra's algorithm, ended at the target, with what obstacles do worked out at every node before."""
    graph, evaluation = problem.graph, mark(problem, obstacles)
    evaluate_nodes(np.arange(problem.nodes), evaluation)
    nodes, _, cost = shortest_path(
        problem.adjacency, graph.base, graph.fixed, graph.shares, evaluation, problem.settings.obstacle_margin,
        np.zeros(problem.nodes), problem.source, problem.target,
    )  # fmt: skip
    return Answer(nodes, cost)


def looked_at(evaluation: NodeEvaluation) -> int:
    """Nodes for which a search had to know what obstacles do."""
    return int(np.count_nonzero(evaluation.evaluated))


def free_path(problem: SearchProblem) -> np.ndarray:
    """Nodes (p,) of the cheapest path without obstacles."""
    return search(problem, mark(problem, Obstacles.none())).nodes
