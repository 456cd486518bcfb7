"""GuardedArm: an arm with what it holds, as queries, searches, certificates and detours count it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.motion.detour import COVERED_END, Detour, DetourPlanner, DetourRequest, without_detour
from geodesic_motion_ros.motion.motion_judge import changed_limits
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.played import FollowedPlan
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.queries.query import ArmGoal, ArmQuery, Query
from geodesic_motion_ros.queries.query_builder import QueryBuilder
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject


@dataclass(frozen=True, eq=False)
class GuardedArm:
    """The parts of a planner that depend on the arm's collision spheres: what the hand holds replaces them all.

    Attributes
    ----------
    empty : the spheres of the arm alone. objects : what its hand holds. collision : the spheres of both together.
    """

    empty: CollisionModel
    objects: tuple[HeldObject, ...]
    collision: CollisionModel
    solver: Solver
    queries: QueryBuilder[Any]
    detours: DetourPlanner

    @classmethod
    def of(cls, solver: Solver) -> GuardedArm:
        """Return the arm of a solver, which holds nothing."""
        collision = solver.collision
        queries = solver.space.queries(
            solver.skill, solver.graph, solver.settings, solver.robot, collision, solver.scene
        )  # fmt: skip
        return cls(collision, (), collision, solver, queries, DetourPlanner(solver))

    def with_changes(self, objects: Sequence[HeldObject], settings: PlannerSettings) -> GuardedArm:
        """Return the arm with these objects in the place of those that it holds, and with other settings.

        Raises
        ------
        RobotError : a scale of the settings is not in (0, 1].
        """
        old = self.solver
        collision = self.empty.holding(old.robot, objects)
        limits = changed_limits(old, settings)
        solver = Solver(old.skill, old.graph, settings, old.robot, collision, limits, old.scene)
        return replace(
            self, objects=tuple(objects), collision=collision, solver=solver,
            queries=self.queries.guard(collision, settings), detours=self.detours.with_solver(solver),
        )  # fmt: skip

    def goal(self, request: GoalRequest, frame: TaskFrame) -> ArmGoal | Refusal:
        """Return the goal of a request, or why the request is refused; frame : the task frame."""
        if request.configuration is not None:
            return self.queries.goal_by_configuration(request.configuration, frame)
        assert request.pose is not None
        pose, robot = request.pose, self.solver.robot
        if request.in_task_frame:
            pose = Pose(*frame.to_base(pose.position, pose.quaternion))
        if not robot.within_reach(pose.position):
            distance = np.linalg.norm(pose.position - robot.shoulder)
            return Refusal(
                VerdictCode.GOAL_OUT_OF_SUPPORT,
                f"the goal is {distance:.2f} m from the shoulder; the tool of the {self.solver.skill.robot} reaches "
                f"{robot.reach:.2f} m",
            )
        return self.queries.goal_by_pose(pose, frame)

    def query_from(
        self,
        state: MotionState,
        followed: FollowedPlan | None,
        goal: ArmGoal,
        rounds: int | None = None,
    ) -> ArmQuery | Refusal:
        """Return the query to a goal from where the stream is: the followed one redirected, so that the motion goes on
        smoothly; a new one where the arm is at an end of its path.

        rounds : as of `QueryBuilder.redirect`.
        """
        if followed is not None and isinstance(followed.query, Query) and state.latent is not None:
            query = self.queries.redirect(followed.query, state.position, state.latent, goal, rounds)
            if query is not None:
                return query
        return self.queries.build(state.position, goal, rounds)

    def plan_from_rest(self, start: np.ndarray, goal: ArmGoal, obstacles: Obstacles, reach: float) -> Plan:
        """Return the plan from rest in a configuration (eta,) [rad] to a goal; where there is no path, along a detour
        of up to a reach [m].
        """
        query = self.queries.build(start, goal)
        if isinstance(query, Refusal):
            return Plan(None, 0.0, query)
        still = np.zeros_like(start)
        state = MotionState(obstacles.time, start, still, still, query.start_latent)
        plan = self.solver.solve(query, state, obstacles, self.solver.cautious_attempts)
        if query.round_frame is not None and plan.verdict.ok:
            rounds = query.rounds_left(query.start_latent)
            plan = replace(plan, verdict=plan.verdict.with_remark(f"{rounds:.2f} rounds"))
        if plan.verdict.code is not VerdictCode.NO_FEASIBLE_PATH or reach == 0.0:
            return plan
        detour = self.find_detour(query, obstacles, reach)
        if isinstance(detour, Refusal):
            return without_detour(plan, reach, detour)
        return self.detours.plan(detour, state, obstacles)

    def find_detour(self, query: ArmQuery, obstacles: Obstacles, reach: float) -> Detour | Refusal:
        """Return the cheapest detour of up to `reach` [m], or why there is none; where an obstacle covers an end, in
        the first of the other postures that has one.
        """
        found = self.detours.find(query, obstacles, reach)
        other = self.queries.other_posture(query) if found is COVERED_END else None
        while other is not None and isinstance(found, Refusal):
            found = self.detours.find(other, obstacles, reach)
            other = self.queries.other_posture(other)
        return found

    def find_requested_detour(
        self, request: DetourRequest, latent: np.ndarray | None, obstacles: Obstacles
    ) -> Detour | Refusal:
        """Return the detour that is requested, from where the arm stands, at a latent point (d,), among expected
        obstacles.
        """
        query = request.query
        if np.array_equal(query.start, request.position):
            return self.find_detour(query, obstacles, request.reach)
        here = None
        if latent is not None:
            here = self.queries.redirect(query, request.position, latent, request.goal, 0)
        here = here or self.queries.build(request.position, request.goal, 0)
        return here if isinstance(here, Refusal) else self.find_detour(here, obstacles, request.reach)
