"""What the cycles of all planners have in common, without ROS: judge the inputs, take goals, know where the arm is.

What is commanded never jumps: it moves along certified references or stands still. When the arm is found further than
a tolerance from where it was sent (it was moved, blocked, or restarted), or was unknown for long, or when the clock was
set, the goal is dropped, and nothing is commanded until the arm has rested for a moment: then what is commanded is
where the arm already is, and the next goal sets it moving again.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np

from geodesic_motion_ros.nodes.preparation import Preparation, Prepared
from geodesic_motion_ros.obstacles.tracker import ObstacleSet
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import Deadline

Pose = tuple[np.ndarray, np.ndarray]
#: Where the arm is: a tool pose, or a configuration (eta,) [rad].
Place = TypeVar("Place", Pose, np.ndarray)

#: Share of a period after which a tick begins nothing new: what it has begun then ends within the period.
DEADLINE_SHARE = 0.5
#: What is commanded moves on by at most this [s] of a simulation in one cycle, so that a late one is no step of the
#: arm: 4 mm and 0.016 rad at the default speeds.
LONGEST_ADVANCE = 0.02
#: What is reported where a simulated clock is to be followed and there is none.
NO_CLOCK = "use_sim_time is set, and nothing has been received on /clock"
#: What is reported of a goal while it is being prepared.
PREPARING = "the newest goal is being prepared"
#: An arm that was lost rests when it has stayed this long [s] near one place.
REST_TIME = 0.5


@dataclass(frozen=True)
class CycleInputs(Generic[Place]):
    """The inputs of one cycle, as they are known when it begins.

    Attributes
    ----------
    measured : where the newest joint state says that the arm is: tool pose (position (3,) [m], quaternion (4,)), or
        configuration (eta,) [rad]; None before the first.
    state_age : [s] since that joint state was taken.
    state_fault : what is wrong with the newest joint states; "" where nothing is.
    goal : the newest requested goal, a pose or a configuration, or the verdict with which its message was refused; None
        before the first.
    goal_number : grows with every requested goal.
    obstacles : those that exist now.
    silent_sources : obstacle topics that have fallen silent, with for how long [s]; empty where that does
        not matter.
    late_sources : obstacle topics that tell of what is too long ago, with how long [s]; likewise.
    unusable_sources : obstacle topics of which nothing is known though something should be, with the reason.
    hold : whether a hold was requested.
    task_frame : where the frame that the skill was demonstrated in stands now, position (3,) [m] and quaternion (4,).
    goal_in_task_frame : whether the goal was given in that frame.
    publishers : names of the nodes that publish the commands; more than one and the arm must not move.
    subscribers : names of the nodes that receive them; None: that is not known yet.
    now : time of the clock that trajectories are stamped with, since the node began and without its jumps [s].
    heard : time of the clock that obstacles are heard by [s], which is never set.
    simulated : whether both are of a simulation, which may stand, run slowly or fast.
    has_clock : whether that clock shows a time already.
    set_by : sum of all jumps of that clock so far [s].
    held : the objects in the hand. held_refused : why it is not known what is in it; "" where it is.
    other_arm : why the arm is not that of the skill; "" where it is, or that is not known.
    """

    measured: Place | None
    state_age: float
    goal: Pose | np.ndarray | Verdict | None
    goal_number: int
    obstacles: ObstacleSet
    silent_sources: dict[str, float] = field(default_factory=dict)
    late_sources: dict[str, float] = field(default_factory=dict)
    unusable_sources: dict[str, str] = field(default_factory=dict)
    hold: bool = False
    task_frame: Pose | None = None
    goal_in_task_frame: bool = False
    publishers: tuple[str, ...] = ()
    subscribers: tuple[str, ...] | None = None
    now: float = 0.0
    heard: float = 0.0
    simulated: bool = False
    has_clock: bool = True
    set_by: float = 0.0
    held: tuple[HeldObject, ...] = ()
    held_refused: str = ""
    other_arm: str = ""
    state_fault: str = ""

    @property
    def figures(self) -> dict[str, float]:
        """Ages of the inputs that reasons speak of [s], by name."""
        ages = {"joint_states": self.state_age} if self.measured is not None else {}
        return {f"age_{name}": age for name, age in (ages | self.silent_sources | self.late_sources).items()}

    def without(self, labels: Collection[str]) -> CycleInputs[Place]:
        """Where obstacles of these labels do not count."""
        if not labels:
            return self
        silent, late = (
            {name: age for name, age in sources.items() if name not in labels}
            for sources in (self.silent_sources, self.late_sources)
        )
        return replace(self, obstacles=self.obstacles.without(labels), silent_sources=silent, late_sources=late)


@dataclass(frozen=True)
class CycleOutput:
    """The outputs of one cycle: commands, verdict and figures for the status.

    Attributes
    ----------
    verdict : of this cycle; goal_verdict : of the newest requested goal. When that is a refusal, the motion still
        serves the goal before.
    commanded : pose to be at now; None in joint space, before anything is known, and while an arm that was lost does
        not rest.
    trajectory : joint reference to play in the place of the one before, and the time of its first knot [s]; None in
        task space, and where the one before stays.
    reference : the path to the goal, with an OK verdict only. time_to_goal : until it ends [s], nan without.
    configuration : commanded (eta,) [rad] in joint space.
    speed : of the commanded tool [m/s], in joint space of the fastest joint [rad/s].
    mode : what the arm does (`planning.mode`); "" with the paper's planner.
    """

    verdict: Verdict
    goal_verdict: Verdict
    commanded: Pose | None = None
    trajectory: tuple[JointReference, float] | None = None
    reference: Any = None
    time_to_goal: float = np.nan
    configuration: np.ndarray | None = None
    speed: float = 0.0
    mode: str = ""

    @property
    def goal_refused(self) -> bool:
        """Whether the newest goal was refused."""
        return not (self.goal_verdict.ok or self.goal_verdict.code is VerdictCode.NO_GOAL)


@dataclass(frozen=True)
class Halt:
    """Why nothing is planned in a cycle, and why the goal is dropped besides; "" where it stays."""

    verdict: Verdict
    dropping: str = ""


@dataclass(frozen=True)
class Unsettled:
    """An arm that is to rest before it is commanded again: why, and for how long [s] it has rested near which place."""

    verdict: Verdict
    near: Any
    rested: float = 0.0

    @property
    def rests(self) -> bool:
        """Whether it has rested for long enough."""
        return self.rested >= REST_TIME


class StreamCycle(ABC, Generic[Place, Prepared]):
    """One round of the planner node: judges the inputs, takes goals, knows where the arm is, and asks a planner.

    A subclass knows one kind of planner, and makes the commands of one arm from its answers.

    Parameters
    ----------
    command_topic : where the commands go.
    state_topic : where the arm's state comes from, as messages name it; "joint_states" until it is set.
    state_timeout : [s] a joint state older than this stops the arm.
    resume_timeout : [s] when the state returns after less than this, the motion resumes; after more, the goal is
        dropped.
    clock : tells the time that a cycle takes [s].
    background : prepares goals while cycles go on; None: a cycle does it, and takes longer.
    """

    deadline_share = DEADLINE_SHARE

    def __init__(
        self,
        command_topic: str,
        state_timeout: float,
        resume_timeout: float,
        clock: Callable[[], float] = time.monotonic,
        background: Executor | None = None,
    ) -> None:
        self._command_topic = command_topic
        self.state_topic = "joint_states"
        self._clock = clock
        self._goals: Preparation[Prepared | Verdict] = Preparation(background)
        self.state_timeout = state_timeout
        self.resume_timeout = resume_timeout
        self._goal_number = 0
        self._goal_verdict = Verdict(VerdictCode.NO_GOAL, "no goal has been given")
        self._has_goal = False
        self._missing = False  # whether joint states have been missing for longer than resume_timeout
        self._jump = 0.0  # of the clock [s], since the arm last was where it was sent
        self._set_by = 0.0
        self._simulated = False
        self._began = self._heard = 0.0
        self._step = 0.0  # by which what is commanded moves on in the newest cycle whose inputs are known [s]
        self._lost: Unsettled | None = None
        self._obstacles_version = -1
        # Whether goals are to be prepared later: with what the hand is about to hold; and why that does not count yet.
        # Set by a subclass: whether goals wait for what it prepares, and which held objects do not count yet, for which
        # the arm stands; "": none.
        self._goals_wait, self._uncounted = False, ""

    @property
    def goal_number(self) -> int:
        """Of the newest goal that was received, counted from 1; 0 before the first."""
        return self._goal_number

    def run(self, inputs: CycleInputs[Place], period: float) -> CycleOutput:
        """One cycle of a period [s]; what is commanded moves on by that, or by what has passed of a simulation."""
        self._began = self._clock()
        advance = self._step = self._take_time(inputs, period)
        self._take_task_frame(inputs.task_frame)
        self._take_goal(inputs)
        obstacles_taken = self._take_obstacles(inputs)
        refused = self._take_state(inputs, advance) or self._carry_out(self._rivals(inputs))
        verdict = refused or self._readiness(inputs)
        deadline = Deadline(self._began + self.deadline_share * period, self._clock)
        return self._command(obstacles_taken if verdict.ok else verdict, inputs, advance, deadline)

    def _take_time(self, inputs: CycleInputs[Place], period: float) -> float:
        """By how much what is commanded moves on [s]; a clock that was set drops the goal."""
        passed, self._heard = inputs.heard - self._heard, inputs.heard
        jump, self._set_by = inputs.set_by - self._set_by, inputs.set_by
        was_simulated, self._simulated = self._simulated, inputs.simulated
        if jump != 0.0:
            self._jump = jump
            # A simulation that is reset begins at 0, too.
            no_clock = not inputs.has_clock and not was_simulated
            self._drop_goal(NO_CLOCK if no_clock else f"the clock was set by {jump:+.1f} s")
        return min(passed, LONGEST_ADVANCE) if inputs.simulated else period

    # ------------------------------------------- what differs between the kinds of skill

    @abstractmethod
    def stop(self, verdict: Verdict) -> CycleOutput:
        """The end of a cycle that failed, in `run` or before: come to rest at the pace of a simulation, and say why."""

    @abstractmethod
    def _command(self, verdict: Verdict, inputs: CycleInputs[Place], advance: float, deadline: Deadline) -> CycleOutput:
        """Plan where the verdict is OK, stop otherwise, and move on by `advance` [s]."""

    @abstractmethod
    def _request_goal(self, inputs: CycleInputs[Place]) -> None:
        """Have the inputs' goal prepared, or found why it is refused, by `_goals`: any thread may do that."""

    @abstractmethod
    def _take_prepared(self, prepared: Prepared | Verdict) -> Verdict:
        """Plan to a prepared goal from now on; a refused one leaves the goal before."""

    @abstractmethod
    def _clear_goal(self) -> None: ...

    @abstractmethod
    def _set_obstacles(self, inputs: CycleInputs[Place]) -> Verdict: ...

    @abstractmethod
    def _take_task_frame(self, frame: Pose | None) -> None: ...

    @abstractmethod
    def _knows_where(self) -> bool:
        """Whether something is commanded already."""

    @abstractmethod
    def _stand_at(self, measured: Place, now: float) -> None:
        """Command the measured place, at rest."""

    @abstractmethod
    def _track(self, measured: Place, taken: float) -> None:
        """Count how the arm follows what it is sent, by what was measured at a time [s]."""

    @abstractmethod
    def _deviation(self, measured: Place, taken: float) -> tuple[str, str] | None:
        """How far the arm was from where it was sent when that was measured [s], and what is allowed; None while it
        follows.
        """

    @abstractmethod
    def _moved(self, measured: Place, before: Place) -> bool:
        """Whether an arm that should rest has moved."""

    # ------------------------------------------------------------------------ inputs

    def _take_goal(self, inputs: CycleInputs[Place]) -> None:
        goal = inputs.goal
        if goal is not None and inputs.goal_number != self._goal_number:
            self._goal_number = inputs.goal_number
            if isinstance(goal, Verdict):
                self._goal_verdict = goal
            else:
                self._request_goal(inputs)
                self._goal_verdict = Verdict(VerdictCode.NO_GOAL, PREPARING)
        try:
            prepared = None if self._goals_wait else self._goals.take_settled()
        except Exception:
            self._goal_verdict = Verdict(VerdictCode.BAD_INPUT, "internal error while it was prepared, see the log")
            raise
        if prepared is None:
            return
        verdict = self._take_prepared(prepared)
        self._has_goal = self._has_goal or verdict.ok
        # What is reported is of the newest goal: of one before it nothing.
        if not (isinstance(goal, Verdict) or self._goals.busy):
            self._goal_verdict = verdict

    def _drop_goal(self, why: str) -> None:
        """Forget the goal: where something unexpected has happened, an arm must not set out again by itself."""
        if self._has_goal or self._goals.busy:
            self._has_goal = False
            self._goal_verdict = Verdict(VerdictCode.NO_GOAL, f"goal dropped: {why}; send the goal again")
            self._goals.forget()
            self._clear_goal()

    def _take_obstacles(self, inputs: CycleInputs[Place]) -> Verdict:
        if inputs.obstacles.version == self._obstacles_version:
            return Verdict(VerdictCode.OK)
        verdict = self._set_obstacles(inputs)
        if verdict.ok:
            self._obstacles_version = inputs.obstacles.version
        return verdict

    def _carry_out(self, halt: Halt | None) -> Verdict | None:
        """Carry out what an assessment came to: its verdict, and no goal any more where it drops that."""
        if halt is None:
            return None
        if halt.dropping:
            self._drop_goal(halt.dropping)
        return halt.verdict

    def _take_state(self, inputs: CycleInputs[Place], advance: float) -> Verdict | None:
        """Go by where the arm was measured; why that is not possible, None where it is."""
        stale = self._stale_state(inputs)
        if stale is None:
            return self._follow_measured(inputs, advance)
        self._missing = self._missing or bool(stale.dropping)
        return self._carry_out(stale)

    def _readiness(self, inputs: CycleInputs[Place]) -> Verdict:
        """OK when a plan may be requested of an arm that is known and nobody else's; the reason otherwise, the gravest
        first.
        """
        if inputs.hold:
            return Verdict(VerdictCode.HOLD_REQUESTED, "a hold was requested; release it with ~/hold false")
        if inputs.other_arm:
            return Verdict(VerdictCode.BAD_INPUT, inputs.other_arm)
        if inputs.held_refused:
            reason = f"it is not known what the hand holds: {inputs.held_refused}; send what it holds on ~/held_objects"
            return Verdict(VerdictCode.BAD_INPUT, reason)
        if self._uncounted:
            return Verdict(VerdictCode.BAD_INPUT, self._uncounted)
        stale = _stale_obstacles(inputs)
        if stale:
            return Verdict(VerdictCode.STALE_OBSTACLES, stale)
        if not self._has_goal:
            return self._goal_verdict
        if inputs.subscribers == ():
            reason = f"no node receives {self._command_topic}: start the controller of the arm, or remap the topic"
            return Verdict(VerdictCode.BAD_INPUT, reason)
        return Verdict(VerdictCode.OK)

    def _stale_state(self, inputs: CycleInputs[Place]) -> Halt | None:
        """Why it is not known where the arm is; None where it is. After `resume_timeout` the goal is dropped."""
        if not inputs.has_clock:
            return Halt(Verdict(VerdictCode.STALE_STATE, NO_CLOCK))
        fault = inputs.state_fault
        if inputs.measured is None:
            return Halt(Verdict(VerdictCode.STALE_STATE, f"{self.state_topic}: {fault or 'none has arrived yet'}"))
        if inputs.state_age <= self.state_timeout:
            return None
        missing = f"joint_states were missing for more than {self.resume_timeout:g} s"
        reason = f"{self.state_topic}: the newest state is older than state_timeout, {self.state_timeout:g} s"
        verdict = Verdict(VerdictCode.STALE_STATE, f"{reason}; {fault}" if fault else reason)
        return Halt(verdict, missing if inputs.state_age > self.resume_timeout else "")

    def _follow_measured(self, inputs: CycleInputs[Place], advance: float) -> Verdict | None:
        """Begin at the measured place, and again where an arm that was lost has come to rest."""
        measured = inputs.measured
        assert measured is not None  # _stale_state came first
        if not self._knows_where():
            self._begin_at(measured, inputs.now)
        elif self._lost is not None:
            self._lost = self._settling(self._lost, measured, advance)
            if not self._lost.rests:
                return self._lost.verdict
            self._begin_at(measured, inputs.now)
        else:
            taken = inputs.now - inputs.state_age
            # What was commanded is not known of a time of another clock.
            if not self._jump:
                self._track(measured, taken)
            verdict = self._carry_out(self._loss(None if self._jump else self._deviation(measured, taken)))
            if verdict is not None:
                self._lost = Unsettled(verdict, measured)
                self._stand_at(measured, inputs.now)
                return verdict
        return None

    def _begin_at(self, measured: Place, now: float) -> None:
        self._stand_at(measured, now)
        self._lost, self._missing, self._jump = None, False, 0.0

    def _settling(self, arm: Unsettled, measured: Place, advance: float) -> Unsettled:
        """What is known of an unsettled arm that is measured again after a time [s]."""
        if self._moved(measured, arm.near):
            return replace(arm, near=measured, rested=0.0)
        return replace(arm, rested=arm.rested + advance)

    def _loss(self, deviation: tuple[str, str] | None) -> Halt | None:
        """Why what is commanded is no longer to be trusted; None while the arm follows.

        deviation : how far it is from where it was sent, and what is allowed. It drops the goal.
        """
        dropping = ""
        if self._jump:
            cause = f"the clock was set by {self._jump:+.1f} s"
        elif deviation is not None:
            where, limit = deviation
            dropping = f"the arm was {where} from where it was sent"
            cause = f"joint_states: the arm is {where} from where it was sent (allowed by tracking_tolerance: {limit})"
        elif self._missing:
            cause = "joint_states: the arm is back after a long silence"
        else:
            return None
        reason = f"{cause}: nothing is commanded until the arm has rested for {REST_TIME:g} s"
        return Halt(Verdict(VerdictCode.BAD_INPUT, reason), dropping)

    def _rivals(self, inputs: CycleInputs[Place]) -> Halt | None:
        """More than one node that commands the arm: which of them it followed would be chance, and drops the goal."""
        if len(inputs.publishers) <= 1:
            return None
        names, topic = " and ".join(inputs.publishers), self._command_topic
        verdict = Verdict(VerdictCode.CONFLICT, f"{topic} is published by {names}: only one may command the arm")
        return Halt(verdict, f"{topic} had more than one publisher, {names}")


def _stale_obstacles(inputs: CycleInputs[Place]) -> str:
    """Which obstacle topics are not to be trusted, why, and what would be right; '' when all are."""
    causes = [f"{source}: {why}" for source, why in inputs.unusable_sources.items()]
    if inputs.silent_sources:
        silent = ", ".join(inputs.silent_sources)
        causes.append(
            f"silent: {silent}; publish it again and again, or latched by a node that stays, or declare it in the "
            "scene; call ~/clear_obstacles where nothing is there any more"
        )
    if inputs.late_sources:
        late = ", ".join(inputs.late_sources)
        causes.append(f"stamps lag: {late}; synchronise the clocks, or detect faster")
    return "; ".join(causes)
