"""GuardedArm: an arm with what it holds, as queries, searches, certificates and detours count it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.configuration_query import ConfigurationQueryBuilder
from geodesic_motion_ros.planning.detour import COVERED_END, Detour, DetourPlanner
from geodesic_motion_ros.planning.mission import Query
from geodesic_motion_ros.planning.solver import Solver
from geodesic_motion_ros.planning.tool_query import ToolQueryBuilder
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject


@dataclass(frozen=True, eq=False)
class GuardedArm:
    """All of a planner that depends on which spheres are kept away from obstacles.

    Attributes
    ----------
    empty : the spheres of the arm whose hand holds nothing. objects : what it holds. collision : the spheres of both.
    """

    empty: CollisionModel
    objects: tuple[HeldObject, ...]
    collision: CollisionModel
    solver: Solver
    queries: ConfigurationQueryBuilder | ToolQueryBuilder
    detours: DetourPlanner

    @classmethod
    def of(cls, solver: Solver) -> GuardedArm:
        """The arm of a solver, which holds nothing."""
        skill, graph, settings, collision = solver.skill, solver.graph, solver.settings, solver.collision
        queries: ConfigurationQueryBuilder | ToolQueryBuilder
        if isinstance(graph, PoseGraph):
            queries = ToolQueryBuilder(skill, graph, settings, solver.robot, collision, solver.scene)
        else:
            queries = ConfigurationQueryBuilder(skill, graph, settings, collision, solver.scene)
        return cls(collision, (), collision, solver, queries, DetourPlanner(solver))

    def holding(self, objects: Sequence[HeldObject]) -> GuardedArm:
        """The arm with these objects in the place of those that it holds."""
        old = self.solver
        collision = self.empty.holding(old.robot, objects)
        solver = Solver(old.skill, old.graph, old.settings, old.robot, collision, old.limits, old.scene)
        return replace(
            self, objects=tuple(objects), collision=collision, solver=solver, queries=self.queries.guarding(collision),
            detours=self.detours.with_solver(solver),
        )  # fmt: skip

    def detour(self, query: Query, obstacles: Obstacles, reach: float) -> Detour | str:
        """The cheapest detour of up to `reach` [m], or why there is none; where an obstacle covers an end, in the first
        of the other postures that has one.
        """
        found = self.detours.find(query, obstacles, reach)
        other = self.queries.other_posture(query) if found == COVERED_END else None
        while other is not None and isinstance(found, str):
            found = self.detours.find(other, obstacles, reach)
            other = self.queries.other_posture(other)
        return found


@dataclass(frozen=True, eq=False)
class PreparedHold:
    """An arm with other objects in its hand, and the query that was being followed with their spheres.

    query : in the place of `before`; None: there was none.
    """

    arm: GuardedArm
    before: Query | None
    query: Query | None
