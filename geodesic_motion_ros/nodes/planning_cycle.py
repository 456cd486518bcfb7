"""One cycle of the planner node on a task-space skill: the stream of tool poses. Knows nothing of ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

import numpy as np

from geodesic_motion_ros.deadline import Deadline
from geodesic_motion_ros.nodes.deviation import pose_deviation, pose_moved
from geodesic_motion_ros.nodes.stream_cycle import CycleInputs, CycleOutput, Pose, StreamCycle
from geodesic_motion_ros.planner import PreparedGoal, ReactivePlanner
from geodesic_motion_ros.reference import ReferenceFollower, TaskSpaceReference
from geodesic_motion_ros.verdict import Verdict


class PlanningCycle(StreamCycle[Pose, PreparedGoal]):
    """The stream of commanded poses of one arm.

    Parameters
    ----------
    state_timeout, resume_timeout, clock, background : as of `StreamCycle`.
    tracking_tolerance, tracking_tolerance_angle : [m], [rad] largest distance between measured and
        commanded pose.
    """

    def __init__(
        self,
        planner: ReactivePlanner,
        state_timeout: float,
        resume_timeout: float,
        tracking_tolerance: float,
        tracking_tolerance_angle: float,
        clock: Callable[[], float] = time.monotonic,
        background: Executor | None = None,
    ) -> None:
        super().__init__("target_pose", state_timeout, resume_timeout, clock, background)
        self.planner = planner
        self.follower = ReferenceFollower(planner.settings.speed)
        self.tracking_tolerance = tracking_tolerance
        self.tracking_tolerance_angle = tracking_tolerance_angle
        self._task_frame: Pose | None = None

    def stop(self, verdict: Verdict) -> CycleOutput:
        try:
            return self._move(verdict, self._braking(), self._step)
        except Exception:
            # What failed is said already. What was certified last is followed to a rest, less gently.
            settings = self.planner.settings
            self.follower.slow_down(settings.speed / settings.acceleration)
            return self._output(verdict, None, self._step)

    def _braking(self) -> TaskSpaceReference | None:
        return self.planner.stop(self.follower.position, self.follower.quaternion, self.follower.speed, self._heard)

    def _command(self, verdict: Verdict, inputs: CycleInputs[Pose], advance: float, deadline: Deadline) -> CycleOutput:
        now = self.follower.position, self.follower.quaternion, self.follower.speed
        if verdict.ok:
            plan = self.planner.tick(*now, deadline, inputs.heard)
            verdict, reference = plan.verdict, plan.reference
        else:
            reference = self._braking()
        return self._move(verdict, reference, advance)

    def _move(self, verdict: Verdict, reference: TaskSpaceReference | None, advance: float) -> CycleOutput:
        if reference is None:
            self.follower.hold()
        else:
            self.follower.accept(reference)
        return self._output(verdict, reference, advance)

    def _output(self, verdict: Verdict, reference: TaskSpaceReference | None, advance: float) -> CycleOutput:
        # An arm that was silent for long may come back anywhere: it must not be drawn to where it was sent before.
        known = self.follower.ready and self._lost is None and not self._missing
        commanded = self.follower.advance(advance) if known else None
        to_goal = reference if verdict.ok else None
        return CycleOutput(
            verdict, self._goal_verdict, commanded, reference=to_goal,
            time_to_goal=math.nan if to_goal is None else to_goal.duration, speed=self.follower.speed,
        )  # fmt: skip

    def _preparation(self, inputs: CycleInputs[Pose]) -> Callable[[], PreparedGoal | Verdict]:
        goal, in_task_frame = inputs.goal, inputs.goal_in_task_frame
        if isinstance(goal, np.ndarray):
            goal, in_task_frame = self.planner.robot.forward(goal), False
        stream, present = self.follower, None
        if stream.ready:
            present = stream.position, stream.quaternion, stream.speed
        elif inputs.measured is not None:
            present = *inputs.measured, 0.0
        return partial(self.planner.prepared_goal, *goal, in_task_frame, present)

    def _take_prepared(self, prepared: PreparedGoal | Verdict) -> Verdict:
        return self.planner.take_goal(prepared)

    def _clear_goal(self) -> None:
        self.planner.clear_goal()

    def _set_obstacles(self, inputs: CycleInputs[Pose]) -> Verdict:
        longest = self.planner.settings.prediction
        return self.planner.take_obstacles(inputs.obstacles.moved_on(inputs.heard, longest, inputs.heard))

    def _take_task_frame(self, frame: Pose | None) -> None:
        if frame is None or frame is self._task_frame:
            return
        self._task_frame = frame
        self.planner.set_task_frame(*frame)

    def _knows_where(self) -> bool:
        return self.follower.ready

    def _stand_at(self, measured: Pose, now: float) -> None:
        self.follower.reset(*measured)

    def _deviation(self, measured: Pose, taken: float) -> tuple[str, str] | None:
        return pose_deviation(
            measured, self.follower.commanded, self.tracking_tolerance, self.tracking_tolerance_angle
        )

    def _moved(self, measured: Pose, before: Pose) -> bool:
        return pose_moved(measured, before)
