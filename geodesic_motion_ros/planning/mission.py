"""What a planner plans for: where the arm is to go (`Mission`), and what was received (`Inputs`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.configuration_query import ConfigurationGoal, ConfigurationQuery
from geodesic_motion_ros.planning.pose_query import Pose
from geodesic_motion_ros.planning.tool_query import ToolGoal, ToolQuery
from geodesic_motion_ros.planning.tracking import Tracking

Goal = ConfigurationGoal | ToolGoal
Query = ConfigurationQuery | ToolQuery


@dataclass(frozen=True, eq=False)
class GoalRequest:
    """A goal as it was requested: a pose, in the base frame or the task frame, with which it then moves; or a
    configuration (eta,) [rad].
    """

    pose: Pose | None = None
    in_task_frame: bool = False
    configuration: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class PreparedGoal:
    """A goal that is not refused, the task frame that it is of, and the graph carried to it from where the stream was;
    None: that was not known, or there is no path.

    `stands` tells how often the arm had been said to stand somewhere by then.
    """

    request: GoalRequest
    frame: TaskFrame
    goal: Goal
    query: Query | None
    stands: int


@dataclass(frozen=True, eq=False)
class Mission:
    """Where the arm is to go.

    Attributes
    ----------
    requested : the newest goal. active : the same, or the one before while the newest is hardly elsewhere and the arm
        moves. query : the graph carried to the active one; None: not yet.
    """

    requested: PreparedGoal | None = None
    active: PreparedGoal | None = None
    query: Query | None = None

    def activated(self, prepared: PreparedGoal, query: Query | None) -> Mission:
        """With a goal as the active one."""
        if self.active is not None and prepared.goal.is_same(self.active.goal):
            return self
        return replace(self, active=prepared, query=query)


@dataclass(frozen=True, eq=False)
class Inputs:
    """What was received: obstacles, and how far [m] they may be from there; how the arm follows; the task frame.

    unchanged_since : since when the obstacles have been the same, at the same places [s].
    """

    obstacles: Obstacles
    position_error: float
    tracking: Tracking
    frame: TaskFrame
    unchanged_since: float = 0.0

    def with_obstacles(self, obstacles: Obstacles, now: float) -> Inputs:
        """With those that are received at a time [s] in the place of the ones before."""
        since = self.unchanged_since if self.obstacles.is_unchanged(obstacles) else now
        return replace(self, obstacles=obstacles, unchanged_since=since)

    @cached_property
    def enlarged(self) -> Obstacles:
        """The obstacles as large as they are taken to be: larger by how far they may be from where they were received
        and the arm's links off the path; and, where they move, covering where they are until an arm that lags has come.
        """
        larger = self.obstacles.enlarged(self.position_error + self.tracking.error)
        return larger.throughout(self.tracking.lag)
