"""One cycle of the node with the paper's planner. Knows nothing of ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

from geodesic_motion_ros.contract.status import Figures, Refusal, Verdict, VerdictCode
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.arm_watch import ArmWatch
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput
from geodesic_motion_ros.nodes.cycle_clock import CycleClock
from geodesic_motion_ros.nodes.input_faults import readiness, rivals, stale_state
from geodesic_motion_ros.nodes.newest_goal import NewestGoal
from geodesic_motion_ros.paper.paper_planner import CAUTION, PaperGoal, PaperPlanner
from geodesic_motion_ros.paper.streams import PoseStream, TrajectoryStream
from geodesic_motion_ros.planning.mission import GoalRequest
from geodesic_motion_ros.utils.deadline import Deadline

#: Share of a period after which a search is interrupted: what follows it, the spline and its decoding, takes up to
#: three milliseconds.
DEADLINE_SHARE = 0.6


class PaperCycle:
    """Turns inputs into ticks of the paper's planner, and its paths into commands.

    Parameters
    ----------
    stream : makes the commands.
    state_timeout, resume_timeout, clock, background : as of `PlannerCycle`.
    offsets : largest distance [m] and rotation [rad] of a goal from what the skill knows.

    Attributes
    ----------
    state_topic : where the arm's state comes from, as messages name it; "joint_states" until it is set.
    """

    def __init__(
        self,
        planner: PaperPlanner,
        stream: PoseStream | TrajectoryStream,
        state_timeout: float,
        resume_timeout: float,
        offsets: tuple[float, float],
        clock: Callable[[], float] = time.monotonic,
        background: Executor | None = None,
    ) -> None:
        self.planner, self.stream, self._offsets = planner, stream, offsets
        self.state_topic = "joint_states"
        self.state_timeout, self.resume_timeout = state_timeout, resume_timeout
        self._clock, self._time, self._now = clock, CycleClock(), 0.0
        self._arm = ArmWatch()
        self._goal: NewestGoal[PaperGoal] = NewestGoal(self._take_prepared, planner.clear_goal, background)
        self._obstacles_version = -1
        self._task_frame: Pose | None = None
        self._displaced = False

    @property
    def goal_number(self) -> int:
        """Of the newest goal that was received, counted from 1; 0 before the first."""
        return self._goal.number

    def run(self, inputs: CycleInputs, period: float) -> CycleOutput:
        """One cycle of a period [s]: judge the inputs, take a goal, know where the arm is, and ask the planner."""
        deadline = Deadline(self._clock() + DEADLINE_SHARE * period, self._clock)
        self._now = inputs.now
        if why := self._time.read(inputs, period):
            self._arm.jump = self._time.jump
            self._goal.drop(why)
        self._take_task_frame(inputs.task_frame)
        self._goal.hear(inputs, partial(self._preparing, inputs))
        self._goal.take_prepared()
        obstacles_taken = self._take_obstacles(inputs)
        topic = self.stream.topic
        refused = self._take_state(inputs) or self._goal.heed(rivals(inputs, topic))
        verdict = refused or readiness(inputs, topic, "", None if self._goal.is_set else self._goal.verdict)
        return self._command(obstacles_taken if verdict.ok else verdict, inputs, deadline)

    def stop(self, verdict: Refusal) -> CycleOutput:
        """The end of a cycle that failed, in `run` or before: come to rest at the pace of a simulation, and say why."""
        self.planner.halt()
        return self._follow(verdict)

    def _command(self, verdict: Verdict, inputs: CycleInputs, deadline: Deadline) -> CycleOutput:
        """Plan where the verdict is OK, stop otherwise, and move on."""
        if verdict.ok and self._displaced:
            verdict = Refusal(VerdictCode.BAD_INPUT, "the paper has no task frame: leave it at the base frame")
        if verdict.ok:
            verdict = self.planner.hold(inputs.held)
        if verdict.ok:
            verdict = self.planner.tick(deadline)
        else:
            self.planner.halt()
        self.planner.advance(self._time.step)
        return self._follow(verdict)

    def _follow(self, verdict: Verdict) -> CycleOutput:
        """Have what is commanded follow the leading point, and say on which path."""
        path = self.planner.path if verdict.ok else None
        left = math.nan if path is None else path.duration - self.planner.lead
        silent = self._arm.lost is not None or self._arm.missing
        commanded = self.stream.follow(self._now, self._time.step, silent)
        return CycleOutput(
            verdict, self._goal.verdict, commanded.commanded, commanded.trajectory, path, left,
            commanded.configuration, commanded.speed,
        )  # fmt: skip

    def _preparing(self, inputs: CycleInputs) -> Callable[[], PaperGoal | Refusal]:
        goal = inputs.goal
        assert isinstance(goal, GoalRequest)  # it is new, and no refusal
        pose = goal.pose or Pose(*self.planner.robot.forward(goal.configuration))
        return partial(self.planner.prepare_goal, pose.position, pose.quaternion, *self._offsets)

    def _take_prepared(self, prepared: PaperGoal | Refusal) -> Verdict:
        if isinstance(prepared, Refusal):
            return prepared
        self.planner.take_goal(prepared)
        figures = Figures(goal_offset=prepared.offset, goal_offset_angle=prepared.offset_angle)
        return Verdict(reason=CAUTION, figures=figures)

    def _take_obstacles(self, inputs: CycleInputs) -> Verdict:
        if inputs.obstacles.version == self._obstacles_version:
            return Verdict()
        # Nothing is predicted: obstacles are where they were last seen.
        verdict = self.planner.set_obstacles(inputs.obstacles.moved_on(inputs.heard, 0.0, inputs.heard))
        if verdict.ok:
            self._obstacles_version = inputs.obstacles.version
        return verdict

    def _take_task_frame(self, frame: Pose | None) -> None:
        if frame is None or frame is self._task_frame:
            return
        self._task_frame = frame
        self._displaced = not TaskFrame(*frame).is_identity

    def _take_state(self, inputs: CycleInputs) -> Refusal | None:
        """Go by where the arm was measured; why that is not possible, None where it is."""
        stale = stale_state(inputs, self.state_topic, self.state_timeout, self.resume_timeout)
        if stale is not None:
            self._arm.missing = self._arm.missing or bool(stale.dropping)
            return self._goal.heed(stale)
        measured = inputs.measured
        assert measured is not None  # it is not stale
        if self.stream.stands and self._arm.lost is None:
            # What was commanded is not known of a time of another clock.
            taken = inputs.now - inputs.state_age
            deviation = None if self._arm.jump else self.stream.deviation(measured, taken)
            lost = self._goal.heed(self._arm.lose(measured, deviation))
            if lost is not None:
                self.stream.stand_at(measured, inputs.now)
            return lost
        if self._arm.lost is not None:
            unrest = self._arm.unrest(measured, self._time.step)
            if unrest is not None:
                return unrest
        self.stream.stand_at(measured, inputs.now)
        self._arm.begin()
        return None
