"""Cycles of the planner node with the paper's planner: poses streamed, or joint trajectories. Knows nothing of ROS.

What is commanded is a mass that follows the leading point of the path (`paper.follower`): its state is a place
(p,), a pose as x, y, z [m], w, x, y, z or a configuration [rad], and its velocity.
"""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial

import numpy as np

from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.nodes.deviation import joint_deviation, joints_moved, pose_deviation, pose_moved
from geodesic_motion_ros.nodes.stream_cycle import CycleInputs, CycleOutput, Place, Pose, StreamCycle
from geodesic_motion_ros.paper.follower import TimedPath, followed
from geodesic_motion_ros.paper.paper_planner import CAUTION, PaperGoal, PaperPlanner
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.trajectory.trajectory import PERIOD, JointReference, ending_at_rest, interpolated, joined
from geodesic_motion_ros.utils.deadline import Deadline

#: The mass has come to rest so long [s] after the leading point, at the latest.
_SETTLING = 5.0


class PaperCycle(StreamCycle[Place, PaperGoal]):
    """What both cycles of the paper's planner have in common.

    Parameters
    ----------
    command_topic, state_timeout, resume_timeout, clock, background : as of `StreamCycle`.
    offsets : largest distance [m] and rotation [rad] of a goal from what the skill knows.
    """

    # What follows a search, the spline and its decoding, takes up to three milliseconds.
    deadline_share = 0.6

    def __init__(
        self,
        planner: PaperPlanner,
        command_topic: str,
        state_timeout: float,
        resume_timeout: float,
        offsets: tuple[float, float],
        clock: Callable[[], float] = time.monotonic,
        background: Executor | None = None,
    ) -> None:
        super().__init__(command_topic, state_timeout, resume_timeout, clock, background)
        self.planner, self._offsets = planner, offsets
        self._task_frame: Pose | None = None
        self._displaced = False

    def stop(self, verdict: Verdict) -> CycleOutput:
        self.planner.halt()
        return self._follow(verdict, self._step)

    def _command(self, verdict: Verdict, inputs: CycleInputs[Place], advance: float, deadline: Deadline) -> CycleOutput:
        if verdict.ok and self._displaced:
            verdict = Verdict(VerdictCode.BAD_INPUT, "the paper has no task frame: leave it at the base frame")
        if verdict.ok:
            verdict = self.planner.hold(inputs.held)
        if verdict.ok:
            verdict = self.planner.tick(deadline)
        else:
            self.planner.halt()
        self.planner.advance(advance)
        return self._follow(verdict, advance)

    @abstractmethod
    def _follow(self, verdict: Verdict, advance: float) -> CycleOutput:
        """Move what is commanded on by a time [s], after the leading point."""

    def _request_goal(self, inputs: CycleInputs[Place]) -> None:
        goal = inputs.goal
        pose = self.planner.robot.forward(goal) if isinstance(goal, np.ndarray) else goal
        self._goals.ask(partial(self.planner.prepared_goal, *pose, *self._offsets))

    def _take_prepared(self, prepared: PaperGoal | Verdict) -> Verdict:
        if isinstance(prepared, Verdict):
            return prepared
        self.planner.take_goal(prepared)
        return Verdict(VerdictCode.OK, CAUTION, goal_offset=prepared.offset, goal_offset_angle=prepared.offset_angle)

    def _track(self, measured: Place, taken: float) -> None:
        """The paper's planner certifies nothing: how the arm follows does not count."""

    def _clear_goal(self) -> None:
        self.planner.clear_goal()

    def _set_obstacles(self, inputs: CycleInputs[Place]) -> Verdict:
        # Nothing is predicted: obstacles are where they were last seen.
        return self.planner.set_obstacles(inputs.obstacles.moved_on(inputs.heard, 0.0, inputs.heard))

    def _take_task_frame(self, frame: Pose | None) -> None:
        if frame is None or frame is self._task_frame:
            return
        self._task_frame = frame
        self._displaced = not TaskFrame(*frame).is_identity

    def _path_to_goal(self, verdict: Verdict) -> tuple[TimedPath | None, float]:
        """The path that is followed, and the time that it still takes [s]; None and nan without one."""
        path = self.planner.path
        return (None, math.nan) if path is None or not verdict.ok else (path, path.duration - self.planner.lead)


class PaperPoseCycle(PaperCycle[Pose]):
    """The stream of tool poses.

    Parameters
    ----------
    tracking_tolerance, tracking_tolerance_angle : [m], [rad] largest distance between measured and commanded pose.
    """

    def __init__(
        self, planner: PaperPlanner, *common: float, tracking_tolerance: float, tracking_tolerance_angle: float,
        offsets: tuple[float, float], clock: Callable[[], float] = time.monotonic, background: Executor | None = None,
    ) -> None:  # fmt: skip
        super().__init__(planner, "target_pose", *common, offsets, clock, background)
        self.tracking_tolerance, self.tracking_tolerance_angle = tracking_tolerance, tracking_tolerance_angle
        self._place: np.ndarray | None = None
        self._velocity = np.zeros(7)

    def _follow(self, verdict: Verdict, advance: float) -> CycleOutput:
        path, left = self._path_to_goal(verdict)
        commanded, speed = None, 0.0
        if self._place is not None and self._lost is None and not self._missing:
            leading = self.planner.path
            assert leading is not None
            places = leading.places
            if places[0, 3:] @ self._place[3:] < 0.0:  # the same rotations as -q, near to what is commanded
                places = places * np.repeat([1.0, -1.0], [3, 4])
            # The leading point has moved on by `advance` already.
            before = self.planner.lead - advance
            found, rates, _ = followed(leading.times, places, before, self._place, self._velocity, advance, 1)
            self._place, self._velocity = found[-1], rates[-1]
            commanded, speed = self._commanded(), float(np.linalg.norm(self._velocity[:3]))
        return CycleOutput(verdict, self._goal_verdict, commanded, reference=path, time_to_goal=left, speed=speed)

    def _commanded(self) -> Pose:
        assert self._place is not None
        return self._place[:3].copy(), normalise(self._place[3:])

    def _knows_where(self) -> bool:
        return self._place is not None

    def _stand_at(self, measured: Pose, now: float) -> None:
        self._place, self._velocity = np.concatenate(measured), np.zeros(7)
        self.planner.stand_at(self._place, *measured)

    def _deviation(self, measured: Pose, taken: float) -> tuple[str, str] | None:
        return pose_deviation(
            measured, self._commanded(), self.tracking_tolerance, self.tracking_tolerance_angle
        )

    def _moved(self, measured: Pose, before: Pose) -> bool:
        return pose_moved(measured, before)


class PaperJointCycle(PaperCycle[np.ndarray]):
    """The stream of joint trajectories: one for every path, from what is commanded `latency` [s] later until rest.

    Parameters
    ----------
    latency : a new trajectory takes over so long after its planning began [s].
    tracking_tolerance : [rad] largest distance of a joint from where it was sent.
    """

    def __init__(
        self, planner: PaperPlanner, *common: float, latency: float, tracking_tolerance: float,
        offsets: tuple[float, float], clock: Callable[[], float] = time.monotonic, background: Executor | None = None,
    ) -> None:  # fmt: skip
        super().__init__(planner, "joint_trajectory", *common, offsets, clock, background)
        self.latency, self.tracking_tolerance = latency, tracking_tolerance
        self._now = 0.0
        # What the arm plays, as sent, and since when [s]; and the path that what was sent last follows.
        self._playing: tuple[JointReference, float] | None = None
        self._sent: TimedPath | None = None

    def _command(
        self, verdict: Verdict, inputs: CycleInputs[np.ndarray], advance: float, deadline: Deadline
    ) -> CycleOutput:
        self._now = inputs.now
        return super()._command(verdict, inputs, advance, deadline)

    def _follow(self, verdict: Verdict, advance: float) -> CycleOutput:
        path, left = self._path_to_goal(verdict)
        trajectory, leading = None, self.planner.path
        if self._playing is not None and leading is not None and leading is not self._sent:
            old, since = self._playing
            new = self._reference(leading, *self._commanded(self._now + self.latency)[:2])
            self._playing = joined(old.rest(self._now - since), 0.0, new, self.latency), self._now
            self._sent, trajectory = leading, (new, self._now + self.latency)
        commanded = None if self._playing is None else self._commanded(self._now)
        return CycleOutput(
            verdict, self._goal_verdict, trajectory=trajectory, reference=path, time_to_goal=left,
            configuration=None if commanded is None else commanded[0],
            speed=0.0 if commanded is None else float(np.max(np.abs(commanded[1]))),
        )  # fmt: skip

    def _reference(self, path: TimedPath, position: np.ndarray, velocity: np.ndarray) -> JointReference:
        lead = self.planner.lead
        most = math.ceil((path.duration - lead + _SETTLING) / PERIOD)
        knots = followed(path.times, path.places, lead, position, velocity, PERIOD, most)
        times = PERIOD * np.arange(len(knots[0]))
        return ending_at_rest(times, *knots, interpolated(lead + times, path.times, path.latent))

    def _commanded(self, now: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        assert self._playing is not None
        reference, since = self._playing
        return reference.sample(now - since)

    def _knows_where(self) -> bool:
        return self._playing is not None

    def _stand_at(self, measured: np.ndarray, now: float) -> None:
        self.planner.stand_at(measured, *self.planner.robot.forward(measured))
        assert self.planner.path is not None
        self._playing = JointReference.standing(measured, self.planner.path.latent[0]), now
        # It is to be sent, too: what the arm may still be playing must not go on.
        self._sent = None

    def _deviation(self, measured: np.ndarray, taken: float) -> tuple[str, str] | None:
        names = self.planner.robot.joint_names
        return joint_deviation(measured, self._commanded(taken)[0], names, self.tracking_tolerance)

    def _moved(self, measured: np.ndarray, before: np.ndarray) -> bool:
        return joints_moved(measured, before)
