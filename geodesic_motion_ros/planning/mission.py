"""The inputs of a planner: where the arm is to go (`Mission`), and the world as it was received (`Inputs`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geodesic_motion_ros.contract.mode import Purpose
from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.motion.played import Step
from geodesic_motion_ros.motion.tracking import Tracking
from geodesic_motion_ros.motion.worker import Job
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.query import ArmGoal, ArmQuery


@dataclass(frozen=True, eq=False)
class GoalRequest:
    """A goal as it was requested: a tool pose, or a configuration (eta,) [rad].

    in_task_frame : the pose is given in the task frame, and moves with it; else in the base frame.
    """

    pose: Pose | None = None
    in_task_frame: bool = False
    configuration: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class PreparedGoal:
    """A goal that was accepted, with the work done that takes time: any thread prepares one, a tick only takes it.

    Attributes
    ----------
    frame : the task frame for which the goal was prepared.
    query : the query to it from where the stream was; None: that was not known, or there is none.
    generation : of the planner when the query was made; with another one the query is stale.
    """

    request: GoalRequest
    frame: TaskFrame
    goal: ArmGoal
    query: ArmQuery | None
    generation: int


@dataclass(frozen=True, eq=False)
class NextRound:
    """The next round of a periodic motion, which is being prepared.

    after : the query of the round before. job : its result is the query of this one.
    """

    after: ArmQuery
    job: Job[ArmQuery | Refusal]

    def has_failed(self, now: float) -> bool:
        """Whether there is no such round, as is known at `now` [s]: it is prepared again."""
        return self.job.is_done(now) and isinstance(self.job.result, Refusal)

    def query(self, now: float) -> ArmQuery | None:
        """Return the query of the round; None where it is not there at `now` [s]."""
        result = self.job.result if self.job.is_done(now) else None
        return None if isinstance(result, Refusal) else result


@dataclass(frozen=True, eq=False)
class Mission:
    """The aim of the arm: the goal that was requested, and the goal that ticks plan to.

    Attributes
    ----------
    requested : the newest goal.
    active : the goal that ticks plan to: the newest, or the one before, while the arm moves and the newest is less than
        `NEAR_GOAL` from it.
    query : to the active goal; None: it has none yet.
    round : how many rounds to that goal were begun: 0 before the arm has set out, 1 where the motion is not periodic.
    next_round : the one after the present one, of a periodic motion; None: none is near, or wanted.
    """

    requested: PreparedGoal | None = None
    active: PreparedGoal | None = None
    query: ArmQuery | None = None
    round: int = 0
    next_round: NextRound | None = None

    def defers(self, goal: ArmGoal) -> bool:
        """Whether a goal is so near the active one, to which there is a query, that it waits until the arm rests."""
        return self.active is not None and self.query is not None and goal.is_near(self.active.goal)

    def needs_no_query(self, goal: ArmGoal) -> bool:
        """Whether no query is needed as a goal is taken: it waits, or it is the active one."""
        return self.defers(goal) or (self.active is not None and goal.is_same(self.active.goal))

    def rounds_to(self, request: GoalRequest, goal: ArmGoal) -> int | None:
        """Return how a query to a goal counts rounds, as of `QueryBuilder.build`: 0 where the arm has set out to it
        before, though it is a little elsewhere by now, or the task frame has moved; None where it is new.
        """
        if self.active is None or self.round == 0:
            return None
        return 0 if request is self.active.request or goal.is_near(self.active.goal) else None

    def activate(self, prepared: PreparedGoal, query: ArmQuery | None) -> Mission:
        """Return the mission with a prepared goal, and its query, as the active one."""
        if self.active is not None and prepared.goal.is_same(self.active.goal):
            return self
        begun = 0 if self.rounds_to(prepared.request, prepared.goal) is None else self.round
        return replace(self, active=prepared, query=query, round=begun, next_round=None)

    def after(self, query: ArmQuery | None, step: Step, now: float) -> Mission:
        """Return the mission after a step at `now` [s], with the query that was decided on."""
        coming = None if self.next_round is None else self.next_round.query(now)
        if coming is not None and query is coming:
            return replace(self, query=query, round=self.round + 1, next_round=None)
        followed = None if step.plan.trajectory is None else step.followed
        sets_out = followed is not None and followed.purpose is Purpose.GOAL
        return replace(self, query=query, round=1 if self.round == 0 and sets_out else self.round)


@dataclass(frozen=True, eq=False)
class Inputs:
    """The world as it was received: obstacles, the errors of their positions, the arm's tracking, the task frame.

    position_error : the setting `obstacle_position_error` [m].
    unchanged_since : since when the obstacles have been the same, at the same places [s].
    late : what is handed out arrives so much later than the setting `latency` allows for [s].
    """

    obstacles: Obstacles
    position_error: float
    tracking: Tracking
    frame: TaskFrame
    unchanged_since: float = 0.0
    late: float = 0.0

    def with_obstacles(self, obstacles: Obstacles, now: float) -> Inputs:
        """Return the inputs with the obstacles that are received at `now` [s], in the place of those before."""
        since = self.unchanged_since if self.obstacles.is_static_and_unchanged(obstacles) else now
        return replace(self, obstacles=obstacles, unchanged_since=since)

    @cached_property
    def enlarged_obstacles(self) -> Obstacles:
        """The obstacles as every search and certificate counts them.

        Each is larger by its position error and by the arm's tracking error. A moving one also covers all places where
        it is within the arm's lag: an arm that is late passes there later.
        """
        larger = self.obstacles.enlarged(self.position_error + self.tracking.error)
        return larger.throughout(self.tracking.lag)
