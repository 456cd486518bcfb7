"""Query: a start and a goal, with the latent graph of a skill transported to them, held by an arm.

The decoded nodes are *transported* by the offsets of both ends, so that paths begin and end where it was requested, and
obstacles are met where the robot will really be. Then an arm *holds* the graph: each node gets a configuration
(`Lift`). Configurations are their own; poses of the tool are held in a posture that follows from where the arm stands.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, NamedTuple, Protocol, TypeVar

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.status import Figures, Refusal
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.manifold.metric_field import MetricField
from geodesic_motion_ros.manifold.node_body import NodeBody
from geodesic_motion_ros.manifold.weighted_graph import WeightedGraph
from geodesic_motion_ros.queries.round_frame import RoundFrame

EndName = Literal["start", "goal"]
Output = TypeVar("Output")
"""An element of the space that a skill was learned in: a `Pose` of the tool, or a configuration (eta,) [rad]."""


class AlongMeanPaths(NamedTuple):
    """The mean paths of a query, and what they change.

    Attributes
    ----------
    corrections : (K, S, k) of the decoder along them; zeros where they are not used.
    conformal, mean_paths : (n,) factors of the nodes, and the paths themselves; None where they are not used.
    """

    corrections: np.ndarray
    conformal: np.ndarray | None
    mean_paths: MeanPaths | None


@dataclass(frozen=True)
class End(Generic[Output]):
    """A requested start or goal, and the latent point that is transported onto it.

    Attributes
    ----------
    node : the graph's node at, or nearest to, the latent point (d,).
    decoded, requested : the output that the latent point decodes to, and the one it is transported onto.
    offset : (k,) from the one to the other. beyond : (k,) the part of it that no demonstration has.
    task_offset : (k,) from the pole of the demonstrations; zeros where the latent point is no pole.
    """

    latent: np.ndarray
    node: int
    decoded: Output
    requested: Output
    offset: np.ndarray
    beyond: np.ndarray
    task_offset: np.ndarray

    @property
    def misfit(self) -> float:
        """The size of the part of the offset that no demonstration has; a radian of a pose counts as a metre."""
        return float(np.linalg.norm(self.beyond))


@dataclass(frozen=True)
class Pole(Generic[Output]):
    """A latent point where demonstrations of a group start, or where they end.

    Attributes
    ----------
    node, decoded : as of `End`. mean : of these starts or ends. demonstrated : (N, k) their offsets from it.
    """

    latent: np.ndarray
    node: int
    decoded: Output
    mean: Output
    demonstrated: np.ndarray


class Lift(Protocol):
    """What gives a transported graph its configurations."""

    def configurations_along(self, query: Any, latent: np.ndarray, start: np.ndarray) -> np.ndarray | Refusal:
        """As of `Query`."""
        ...

    def turn_to_base(self, covariances: np.ndarray) -> np.ndarray:
        """As of `Query`."""
        ...


@dataclass(frozen=True)
class Query(Generic[Output]):
    """A start and a goal, with the graph transported to them and the costs that its searches need.

    Attributes
    ----------
    start, goal : the requested ends; configurations (eta,) [rad] where an arm holds the graph.
    ends : the same in the space of the skill, with the latent points that are transported onto them.
    decoded : the skill's graph, before it was transported.
    offsets, graph : by how much it was moved, and the result; edges that the arm cannot follow cost infinitely much.
    field : the metric between the nodes.
    body : the tool, or the arm, at every node.
    to_goal, from_start : (n,) obstacle-free cost to the goal's node, and from the start's: the search's heuristics.
    cost_limit : paths that cost more count as blocked.
    misfits : the endpoint errors, how far both ends are moved, under their names in `Figures`.
    task_start : (k,) offset of the task's start from the demonstrated mean, wherever on the path the query begins.
    along_mean_paths : corrections and conformal factors for `task_start` and the offset of the task's goal.
    lift : what gives it its configurations; None: no arm holds it.
    displaced : how far the tool was from the graph of the query before this one, as this one began [m]; 0: there was
        none.
    round_frame : of a closed skill; None: it is not closed.
    """

    start: Output
    goal: Output
    ends: tuple[End[Any], End[Any]]
    decoded: Any
    offsets: Any
    graph: WeightedGraph
    field: MetricField
    body: NodeBody
    to_goal: np.ndarray
    from_start: np.ndarray
    cost_limit: float
    misfits: Figures
    task_start: np.ndarray
    along_mean_paths: AlongMeanPaths
    lift: Lift | None = None
    displaced: float = 0.0
    round_frame: RoundFrame | None = None

    @property
    def start_latent(self) -> np.ndarray:
        """Latent point (d,) that is transported onto the start."""
        return self.ends[0].latent

    @property
    def goal_node(self) -> int:
        """The node that is transported onto the goal."""
        return self.ends[1].node

    def rounds_left(self, latent: np.ndarray) -> float:
        """Return how many rounds of a closed skill lie between a latent point (d,) and the goal; 0 of another skill."""
        return 0.0 if self.round_frame is None else self.round_frame.rounds_to(latent, self.ends[1].latent)

    def displaced_at(self, progress: np.ndarray) -> float:
        """Return the rest of `displaced` [m] at a progress (1,): it fades towards the goal, as the offset of the start.
        """
        return self.displaced * (1.0 - float(self.offsets.blended(progress)[0]))

    def configurations_along(self, latent: np.ndarray, start: np.ndarray) -> np.ndarray | Refusal:
        """Return configurations (m, eta) of a latent curve (m, d), the first of them near a configuration (eta,); or
        where and why the arm cannot hold it.
        """
        assert self.lift is not None
        return self.lift.configurations_along(self, latent, start)

    def turn_to_base(self, covariances: np.ndarray) -> np.ndarray:
        """Return covariances (m, 3, 3) of positions in the frame of the skill, in the base frame."""
        assert self.lift is not None
        return self.lift.turn_to_base(covariances)


#: The query that a solver plans for: start, goal and nodes are configurations of an arm.
ArmQuery = Query[np.ndarray]
#: The query of a tool that no arm holds.
PoseQuery = Query[Pose]


class PathEnds(Protocol):
    """The configurations (eta,) [rad] between which a path leads; misfits : as of `Query`."""

    @property
    def start(self) -> np.ndarray: ...
    @property
    def goal(self) -> np.ndarray: ...
    @property
    def misfits(self) -> Figures: ...


class Goal(ABC, Generic[Output]):
    """A goal that was accepted; those of one space are compared among themselves.

    Attributes
    ----------
    frame : where the frame that the skill was demonstrated in stands.
    stated : how the goal was found, for a person.
    """

    frame: TaskFrame
    stated: str

    @property
    @abstractmethod
    def outputs(self) -> Sequence[Output]:
        """What would meet it, in the space and the frame of the skill: the query goes to the one that serves best."""

    @abstractmethod
    def is_same(self, other: Any) -> bool:
        """Whether the same is meant, received again."""

    @abstractmethod
    def is_near(self, other: Any) -> bool:
        """Whether it is hardly elsewhere, and may wait until the arm rests."""


ArmGoal = Goal[Any]


def edges_in_scene(
    scene: DeclaredScene, graph: WeightedGraph, body: NodeBody, start_node: int, goal_node: int, margin: float
) -> np.ndarray:
    """Return a mask (m,) of the edges at nodes where a body is nearer to a scene than a margin [m], or where that is
    less, than half of what it keeps at both ends; or deeper in it than at the goal, where that is inside: to be
    approached.
    """
    if not scene.names:
        return np.zeros(len(graph.edges), dtype=bool)
    clearances = scene.clearances(body.spheres, body.sphere_radii)
    at_goal = float(clearances[goal_node])
    kept = min(margin, 0.5 * float(clearances[start_node]), 0.5 * at_goal if at_goal > 0.0 else at_goal)
    near = clearances < kept
    return near[graph.edges[:, 0]] | near[graph.edges[:, 1]]
