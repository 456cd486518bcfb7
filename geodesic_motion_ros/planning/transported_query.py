"""The common part of queries of poses and of configurations: a graph transported to a start and a goal.

Decoded nodes are transported by the offsets of both ends. Start and goal may choose between the demonstrations: then
the corrections along the mean paths, and how near to them paths stay, are those of demonstrations with such ends.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.metric_field import MetricField
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.shortest_path import cost_field
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.planning.status import Figures, VerdictCode
from geodesic_motion_ros.skill.skill import Skill

End = Literal["start", "goal"]

AlongMeanPaths = tuple[np.ndarray, np.ndarray | None, MeanPaths | None]
"""Corrections (K, S, k) of the decoder along a query's mean paths, the nodes' conformal factors (n,), and these paths:
None and None where they are not used.
"""


@dataclass(frozen=True)
class TransportedQuery:
    """A start and a goal, with the graph transported to them and the costs that its searches need.

    Attributes
    ----------
    start, goal : the requested ends; start_latent : (d,) latent point that is transported onto the start.
    goal_node : the node that is transported onto the goal.
    body : the tool, or the arm, at every node.
    offsets, graph : by how much the decoded graph was moved, and the result. field : the metric between the nodes.
    to_goal, from_start : (n,) obstacle-free cost to the goal's node, and from the start's: the search's heuristics.
    cost_limit : paths that cost more count as blocked.
    misfits : the endpoint errors, how far both ends are moved, under their names in `Figures`.
    task_start, task_goal : (k,) offsets of the task's start and goal from the demonstrated means, wherever on the path
        the query begins.
    along_mean_paths : corrections and conformal factors for these offsets.
    displaced : how far the tool was from the graph of the query before this one, as this one began [m]; 0: there was
        none.
    """

    start: Any
    goal: Any
    start_latent: np.ndarray
    goal_node: int
    body: NodeBody
    offsets: Any
    graph: Any
    field: MetricField
    to_goal: np.ndarray
    from_start: np.ndarray
    cost_limit: float
    misfits: Figures
    task_start: np.ndarray
    task_goal: np.ndarray
    along_mean_paths: AlongMeanPaths
    displaced: float = dataclasses.field(default=0.0, kw_only=True)

    def displaced_at(self, progress: np.ndarray) -> float:
        """The rest of `displaced` [m] at a progress (1,): it fades towards the goal, as the offset of the start."""
        return self.displaced * (1.0 - float(self.offsets.blended(progress)[0]))


def edges_in_scene(
    scene: DeclaredScene, graph: WeightedGraph, body: NodeBody, start_node: int, goal_node: int, margin: float
) -> np.ndarray:
    """Mask (m,) of the edges at nodes where a body is nearer to a scene than a margin [m], or where that is less, than
    half of what it keeps at both ends; or deeper in it than at the goal, where that is inside: to be approached.
    """
    clearances = scene.clearances(body.spheres, body.sphere_radii)
    at_goal = float(clearances[goal_node])
    kept = min(margin, 0.5 * float(clearances[start_node]), 0.5 * at_goal if at_goal > 0.0 else at_goal)
    return ~np.all((clearances >= kept)[graph.edges], axis=1)


class TransportedQueryBuilder:
    """The common part of the builders of these queries: mean paths and costs of a transported graph."""

    #: The cost of the first demonstration's path.
    _demonstrated_cost: float

    def __init__(
        self, skill: Skill, graph: Any, settings: PlannerSettings, size: int, scene: DeclaredScene | None = None
    ) -> None:
        """graph : decoded from the skill; size : numbers of an offset; scene : what nodes must be out of."""
        self._skill, self._graph, self._settings = skill, graph, settings
        self._scene = scene or DeclaredScene.empty()
        self._mean_paths = skill.mean_paths if settings.ridge_strength > 0.0 else None
        self._unconditioned = self._along_mean_paths(np.zeros(size), np.zeros(size), conditioned=False)

    def _chosen_mean_paths(self, task_start: np.ndarray, task_goal: np.ndarray) -> AlongMeanPaths:
        """Those of start and goal where the skill found that they choose between demonstrations; of the mean else."""
        sheet = self._skill.canonical
        if self._mean_paths is None or sheet is None or not (self._settings.query_conditioning and sheet.regresses):
            return self._unconditioned
        return self._along_mean_paths(task_start, task_goal, conditioned=True)

    def _along_mean_paths(self, start_offset: np.ndarray, goal_offset: np.ndarray, conditioned: bool) -> AlongMeanPaths:
        sheet = self._skill.canonical
        if self._mean_paths is None or sheet is None:
            # No mean path is used, but the graph counts the shares of the skill's.
            return np.zeros((self._graph.mean_path_count, 2, len(start_offset))), None, None
        weights = sheet.weights(start_offset, goal_offset, conditioned)
        mean_paths = self._mean_paths.moved_to(np.einsum("kn,nsd->ksd", weights, self._skill.codes))
        corrections = sheet.corrections(self._graph.decoder, mean_paths, weights)
        return corrections, mean_paths.conformal_factors(self._graph.latent, self._settings.ridge_strength), mean_paths

    def _costs(self, graph: WeightedGraph, start_node: int, goal_node: int) -> dict[str, Any]:
        """The heuristics and the limit of a query, under their names in it."""
        adjacency = self._graph.adjacency
        to_goal = cost_field(adjacency, graph.base, goal_node)
        return {
            "to_goal": to_goal,
            "from_start": cost_field(adjacency, graph.base, start_node),
            "cost_limit": self._settings.cost_cap * max(self._demonstrated_cost, float(to_goal[start_node])),
        }

    def _pole_node(self, latent: np.ndarray) -> int:
        """The node nearest to where all demonstrations of a mode start or end, a latent point (d,)."""
        everywhere = np.ones(len(self._graph.latent), dtype=bool)
        node = self._graph.node_near(latent, everywhere, steps=max(self._graph.grid.shape))
        assert node is not None
        return node

    @staticmethod
    def _out_of_support(end: End) -> VerdictCode:
        """The code of an end that is too far from what was demonstrated."""
        return VerdictCode.START_OUT_OF_SUPPORT if end == "start" else VerdictCode.GOAL_OUT_OF_SUPPORT

    @staticmethod
    def _misfit(end: Any) -> float:
        """The size of the part of an end's offset that no demonstration shows; a radian of a pose counts as a metre."""
        return float(np.linalg.norm(end.beyond))
