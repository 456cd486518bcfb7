"""One cycle of the planner node, without ROS: judge the inputs, tick the planner, move the commanded pose on.

What is commanded never jumps. The commanded pose moves only along a certified reference or stands still. When the
measured pose is further than a tolerance from it (the arm was moved, blocked, or restarted) or was unknown for long,
the goal is dropped, and nothing is commanded until the arm has rested for a moment: then the commanded pose is where
the arm already is, and the next goal sets it moving again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from geodesic_motion_ros.nodes.obstacle_tracker import ObstacleSet
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.reference import ReferenceFollower, TaskSpaceReference
from geodesic_motion_ros.verdict import Verdict, VerdictCode

Pose = tuple[np.ndarray, np.ndarray]

#: An arm that was lost rests when it has stayed this long [s] within this distance [m] and angle [rad].
REST_TIME, REST_DISTANCE, REST_ANGLE = 0.5, 0.005, 0.02


@dataclass(frozen=True)
class CycleInputs:
    """What is known when a cycle begins.

    Attributes
    ----------
    measured : tool pose (position (3,) [m], quaternion (4,)) of the newest joint state, None before the
        first.
    state_age : [s] since that joint state was taken.
    goal : the newest goal asked for, or the verdict with which its message was refused; None before the
        first.
    goal_number : grows with every goal asked for.
    task_frame : where the frame that the skill was shown in stands now, position (3,) [m] and quaternion (4,).
    goal_in_task_frame : whether the goal was given in that frame.
    obstacles : the spheres that exist now.
    silent_sources : obstacle topics that have fallen silent, with their ages [s]; empty where that does
        not matter.
    hold : whether a hold was asked for.
    publishers : names of the nodes that publish `target_pose`; more than one and the arm must not move.
    """

    measured: Pose | None
    state_age: float
    goal: Pose | Verdict | None
    goal_number: int
    obstacles: ObstacleSet
    silent_sources: dict[str, float] = field(default_factory=dict)
    hold: bool = False
    task_frame: Pose | None = None
    goal_in_task_frame: bool = False
    publishers: tuple[str, ...] = ()


@dataclass(frozen=True)
class CycleOutput:
    """What to say after a cycle.

    Attributes
    ----------
    commanded : pose to be at now; None before anything is known, and while an arm that was lost does not rest.
    verdict : of this cycle; goal_verdict : of the newest goal asked for. When that is a refusal, the motion still
        serves the goal before.
    reference : the way to the goal, with an OK verdict only.
    speed : of the commanded pose [m/s].
    """

    commanded: Pose | None
    verdict: Verdict
    goal_verdict: Verdict
    reference: TaskSpaceReference | None
    speed: float


@dataclass
class _Lost:
    """An arm that was found elsewhere than commanded: why, and since when [s] it has rested near which pose."""

    verdict: Verdict
    near: Pose
    rested: float = 0.0

    def rests(self, measured: Pose, period: float) -> bool:
        """Look at the arm a period [s] later; whether it has rested for long enough."""
        moved = float(np.linalg.norm(measured[0] - self.near[0]))
        if moved > REST_DISTANCE or float(angle_between(measured[1], self.near[1])) > REST_ANGLE:
            self.near, self.rested = measured, 0.0
        else:
            self.rested += period
        return self.rested >= REST_TIME


class PlanningCycle:
    """The stream of commanded poses of one arm.

    Parameters
    ----------
    state_timeout : [s] a joint state older than this stops the arm.
    resume_timeout : [s] when the state returns after less than this, the motion resumes; after more, the goal is
        dropped.
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
    ) -> None:
        self.planner = planner
        self.follower = ReferenceFollower(planner.settings.speed)
        self.state_timeout = state_timeout
        self.resume_timeout = resume_timeout
        self.tracking_tolerance = tracking_tolerance
        self.tracking_tolerance_angle = tracking_tolerance_angle
        self._goal_number = 0
        self._goal_verdict = Verdict(VerdictCode.NO_GOAL, "no goal has been given")
        self._has_goal = False
        self._missing = False  # whether joint states have been missing for longer than resume_timeout
        self._lost: _Lost | None = None
        self._obstacles_version = -1
        self._task_frame: Pose | None = None

    def run(self, inputs: CycleInputs, period: float) -> CycleOutput:
        """One cycle; the commanded pose moves on by `period` [s]."""
        self._take_task_frame(inputs.task_frame)
        self._take_goal(inputs)
        obstacles_taken = self._take_obstacles(inputs.obstacles)
        verdict = self._ready(inputs, period)
        if verdict.ok:
            verdict = obstacles_taken
        now = self.follower.position, self.follower.quaternion, self.follower.speed
        if verdict.ok:
            plan = self.planner.tick(*now)
            verdict, reference = plan.verdict, plan.reference
        else:
            reference = self.planner.stop(*now)
        return self._move(verdict, reference, period)

    def stop(self, verdict: Verdict) -> CycleOutput:
        """A cycle in which nothing may be trusted: stay at the commanded pose, and say why."""
        return self._move(verdict, None, 0.0)

    def _move(self, verdict: Verdict, reference: TaskSpaceReference | None, period: float) -> CycleOutput:
        if reference is None:
            self.follower.hold()
        else:
            self.follower.accept(reference)
        known = self.follower.ready and self._lost is None
        commanded = self.follower.advance(period) if known else None
        to_goal = reference if verdict.ok else None
        return CycleOutput(commanded, verdict, self._goal_verdict, to_goal, self.follower.speed)

    def _take_task_frame(self, frame: Pose | None) -> None:
        if frame is None or frame is self._task_frame:
            return
        self._task_frame = frame
        self.planner.set_task_frame(*frame)

    def _take_goal(self, inputs: CycleInputs) -> None:
        if inputs.goal is None or inputs.goal_number == self._goal_number:
            return
        self._goal_number = inputs.goal_number
        refused = isinstance(inputs.goal, Verdict)
        self._goal_verdict = inputs.goal if refused else self.planner.set_goal(*inputs.goal, inputs.goal_in_task_frame)
        self._has_goal = self._has_goal or self._goal_verdict.ok

    def _drop_goal(self, why: str) -> None:
        """Forget the goal: where something unexpected has happened, an arm must not set out again by itself."""
        if self._has_goal:
            self._has_goal = False
            self._goal_verdict = Verdict(VerdictCode.NO_GOAL, f"goal dropped: {why}; send the goal again")
            self.planner.clear_goal()

    def _ready(self, inputs: CycleInputs, period: float) -> Verdict:
        """OK when a plan may be asked for; the reason otherwise, the gravest first."""
        judged = self._stale_state(inputs) or self._follow_measured(inputs.measured, period) or self._rivals(inputs)
        if judged is not None:
            return judged
        if inputs.hold:
            return Verdict(VerdictCode.HOLD_REQUESTED, "a hold was requested; release it with ~/hold false")
        if inputs.silent_sources:
            silent = ", ".join(f"{source} for {age:.2f} s" for source, age in inputs.silent_sources.items())
            return Verdict(VerdictCode.STALE_OBSTACLES, f"silent: {silent}")
        if not self._has_goal:
            return self._goal_verdict
        return Verdict(VerdictCode.OK)

    def _stale_state(self, inputs: CycleInputs) -> Verdict | None:
        if inputs.measured is None:
            return Verdict(VerdictCode.STALE_STATE, "joint_states: none has arrived yet")
        age, allowed = inputs.state_age, self.state_timeout
        if age <= allowed:
            return None
        if age > self.resume_timeout:
            self._missing = True
            self._drop_goal(f"joint_states were missing for more than {self.resume_timeout:g} s")
        return Verdict(
            VerdictCode.STALE_STATE, f"joint_states: the newest is {age:.3f} s old, allowed are {allowed:g} s"
        )

    def _follow_measured(self, measured: Pose | None, period: float) -> Verdict | None:
        """Begin at the measured pose, and again where an arm that was lost has come to rest."""
        assert measured is not None  # _stale_state came first
        if not self.follower.ready:
            self._begin_at(measured)
        elif self._lost is not None:
            if not self._lost.rests(measured, period):
                return self._lost.verdict
            self._begin_at(measured)
        else:
            self._lost = self._loss(measured)
            if self._lost is not None:
                self.follower.hold()
                return self._lost.verdict
        return None

    def _begin_at(self, measured: Pose) -> None:
        self.follower.reset(*measured)
        self._lost, self._missing = None, False

    def _loss(self, measured: Pose) -> _Lost | None:
        """Why the commanded pose is no longer to be trusted, and drop the goal; None while the arm follows."""
        distance = float(np.linalg.norm(measured[0] - self.follower.position))
        angle = float(angle_between(measured[1], self.follower.quaternion))
        if distance > self.tracking_tolerance or angle > self.tracking_tolerance_angle:
            where = f"{1000 * distance:.0f} mm and {math.degrees(angle):.1f} deg from where it was sent"
            limit, limit_angle = 1000 * self.tracking_tolerance, math.degrees(self.tracking_tolerance_angle)
            self._drop_goal(f"the arm was {where}")
            said = f"the arm is {where} (allowed by tracking_tolerance: {limit:.0f} mm, {limit_angle:.1f} deg)"
        elif self._missing:
            said = "the arm is back after a long silence"
        else:
            return None
        reason = f"joint_states: {said}: nothing is commanded until it has rested for {REST_TIME:g} s"
        return _Lost(Verdict(VerdictCode.BAD_INPUT, reason), measured)

    def _rivals(self, inputs: CycleInputs) -> Verdict | None:
        """More than one node that commands the arm: which of them it followed would be chance."""
        if len(inputs.publishers) <= 1:
            return None
        names = " and ".join(inputs.publishers)
        self._drop_goal(f"target_pose had more than one publisher, {names}")
        return Verdict(VerdictCode.BAD_INPUT, f"target_pose is published by {names}: only one may command the arm")

    def _take_obstacles(self, obstacles: ObstacleSet) -> Verdict:
        if obstacles.version == self._obstacles_version:
            return Verdict(VerdictCode.OK)
        verdict = self.planner.set_obstacles(obstacles.centres, obstacles.radii)
        if verdict.ok:
            self._obstacles_version = obstacles.version
        return verdict
