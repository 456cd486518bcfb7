"""Action `move_to_goal`: a goal whose client hears how it goes, may cancel it, and learns how it ended.

A thread looks at the newest cycle ten times a second while there are goals: the control loop does nothing for them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from geodesic_motion_ros.contract.status import Verdict, VerdictCode
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.action_server import LastingActions
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput
from geodesic_motion_ros.nodes.newest_goal import PREPARING
from geodesic_motion_ros.nodes.planner_inputs import PlannerInputs
from geodesic_motion_ros.nodes.view_thread import ViewThread
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.robot.kinematics import Robot

NAME = "move_to_goal"
#: Between two feedbacks [s].
_PERIOD = 0.1


@dataclass
class _Goal:
    """A goal that lasts: its number, 0 until it has one; where the tool is to be (3,) [m], once that is known; since
    when the arm stands before it [s], and why.
    """

    handle: ServerGoalHandle
    number: int = 0
    target: np.ndarray | None = None
    stands_since: float = math.inf
    block: Verdict | None = None

    def take_number(self, number: int) -> None:
        self.number = number


class GoalAction:
    """The action server of a planner's goals."""

    def __init__(
        self,
        node: Node,
        kind: type,
        inputs: PlannerInputs,
        robot: Robot,
        newest: Callable[[], tuple[CycleInputs, CycleOutput] | None],
        patience: float,
        failed: Callable[[BaseException], None],
    ) -> None:
        """kind : MoveToGoal. newest : the newest cycle. patience : a goal ends that the arm has stood before for so
        long [s]. failed : called with an exception that ends the thread.
        """
        self._kind, self._inputs, self._robot, self._newest, self._patience = kind, inputs, robot, newest, patience
        self._goals: list[_Goal] = []
        self._server = LastingActions(node, kind, NAME, self._begin)
        self._thread = ViewThread(self._look, lambda: bool(self._goals), _PERIOD, failed, NAME)

    def start(self) -> None:
        """Begin to look how the goals go."""
        self._thread.start()

    def stop(self) -> None:
        """End the goals, and the thread; harmless when they have ended."""
        self._thread.stop()
        for goal in tuple(self._goals):
            self._end(goal, goal.handle.abort, self._kind.Result.ENDED, "the planner ends")

    def _begin(self, handle: ServerGoalHandle) -> None:
        goal, request = _Goal(handle), handle.request
        self._goals.append(goal)
        # A late transform is waited for.
        if request.joints.name:
            self._inputs.request_goal("goal_joints", request.joints, goal.take_number)
        else:
            self._inputs.request_goal("goal_pose", request.pose, goal.take_number)

    def _look(self) -> None:
        newest = self._newest()
        if newest is None:
            return
        inputs, output = newest
        for goal in tuple(self._goals):
            # A message that still waits for its transform has no number.
            if 0 < goal.number <= inputs.goal_number:
                with self._inputs.refusals.guard(NAME):
                    if not self._settle(goal, inputs, output):
                        self._tell(goal, inputs, output)

    def _settle(self, goal: _Goal, inputs: CycleInputs, output: CycleOutput) -> bool:
        """End a goal that has come to an end; False where it has not."""
        served, verdict, newest = output.goal_served, output.goal_verdict, inputs.goal_number
        if goal.handle.is_cancel_requested:
            self._inputs.withdraw_goal(goal.number, "its client cancelled it")
            if goal.number == served or output.speed > 0.0:
                return False
            self._end(goal, goal.handle.canceled, self._kind.Result.CANCELLED, "the arm rests")
        elif goal.number == served:
            return self._settle_served(goal, inputs, output)
        elif goal.number < served:
            reason = "a newer goal has taken its place"
            self._end(goal, goal.handle.abort, self._kind.Result.SUPERSEDED, reason)
        elif goal.number < newest:
            self._end(goal, goal.handle.abort, self._kind.Result.SUPERSEDED, "a newer goal was requested meanwhile")
        elif verdict.ok or verdict.reason == PREPARING:
            return False
        else:
            self._abort(goal, verdict)
        return True

    def _settle_served(self, goal: _Goal, inputs: CycleInputs, output: CycleOutput) -> bool:
        verdict = output.verdict
        if verdict.ok and output.time_to_goal == 0.0 and output.speed == 0.0:
            self._end(goal, goal.handle.succeed, VerdictCode.OK.name, verdict.reason)
            return True
        # Who asks the arm to stand knows why it does.
        waits = not verdict.ok and verdict.code is not VerdictCode.HOLD_REQUESTED and output.speed == 0.0
        goal.stands_since = min(goal.stands_since, inputs.now) if waits else math.inf
        # A cycle whose time was over does not know why the arm stands.
        if not waits:
            goal.block = None
        elif goal.block is None or verdict.code is not VerdictCode.DEADLINE_MISSED:
            goal.block = verdict
        if inputs.now - goal.stands_since < self._patience:
            return False
        self._inputs.withdraw_goal(goal.number, f"the arm has stood before it for {self._patience:g} s")
        self._abort(goal, goal.block or verdict)
        return True

    def _abort(self, goal: _Goal, verdict: Verdict) -> None:
        self._end(goal, goal.handle.abort, verdict.code.name, verdict.reason)

    def _end(self, goal: _Goal, settle: Callable[[], None], code: str, reason: str) -> None:
        self._goals.remove(goal)
        self._server.end(goal.handle, settle, self._kind.Result(code=code, reason=reason))

    def _tell(self, goal: _Goal, inputs: CycleInputs, output: CycleOutput) -> None:
        if goal.number == inputs.goal_number and isinstance(inputs.goal, GoalRequest):
            goal.target = self._place(inputs.goal, inputs)
        said: Any = self._kind.Feedback(code=output.verdict.code.name, reason=output.verdict.reason)
        said.clearance = float(output.verdict.figures.clearance)
        said.distance = math.nan
        if goal.target is not None and output.configuration is not None:
            said.distance = float(np.linalg.norm(self._robot.forward(output.configuration)[0] - goal.target))
        goal.handle.publish_feedback(said)

    def _place(self, request: GoalRequest, inputs: CycleInputs) -> np.ndarray:
        """Where the tool (3,) [m] is to be."""
        if request.configuration is not None:
            return self._robot.forward(request.configuration)[0]
        assert request.pose is not None
        if request.in_task_frame and inputs.task_frame is not None:
            return TaskFrame(*inputs.task_frame).points_to_base(request.pose.position)
        return request.pose.position
