"""One cycle of the planner node: the stream of configurations that the arm is to pass. Knows nothing of ROS.

What is commanded never jumps: it moves along certified references or stands still. It begins where the arm's drive
commands it (`drive_watch`), or where it is measured where that is not known. When the arm is found further than
a tolerance from where it was sent (it was moved, blocked, or restarted), or was unknown for long, or when the clock was
set, the goal is dropped, and nothing is commanded until the arm has rested for a moment: then what is commanded is
where the arm already is, and the next goal sets it moving again.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.contract.mode import Mode
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.geometry.distance_field import DistanceField
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.tracking import COUNTED, TrackingMonitor
from geodesic_motion_ros.nodes.arm_watch import REST_TIME, ArmWatch, UnsettledArm
from geodesic_motion_ros.nodes.cycle import CycleInputs, CycleOutput, PoseArrays
from geodesic_motion_ros.nodes.cycle_clock import CycleClock
from geodesic_motion_ros.nodes.delivery import Lately, takeover_delay
from geodesic_motion_ros.nodes.deviation import joint_deviation, pose_deviation
from geodesic_motion_ros.nodes.drive_watch import DriveWatch
from geodesic_motion_ros.nodes.input_faults import Halt, readiness, rivals, stale_state
from geodesic_motion_ros.nodes.newest_goal import NewestGoal
from geodesic_motion_ros.nodes.preparation import Preparation
from geodesic_motion_ros.nodes.sent_trajectories import SentTrajectories
from geodesic_motion_ros.nodes.shown_plan import ShownPlan
from geodesic_motion_ros.nodes.steady_error import SteadyError
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.streaming_planner import PreparedArm
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.trajectory.receding_horizon import Horizon
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import Deadline
from geodesic_motion_ros.utils.errors import ParameterError, PlanningError

#: Share of a period after which a tick begins nothing new: what it has begun then ends within the period.
DEADLINE_SHARE = 0.5
#: From the planner's answer to the arm that plays it, at most [s].
TRANSIT = 0.005
#: A joint state may be this old [s] before its age counts as lag: what two periods of a driver of 40 Hz take.
FRESH = 0.05
#: Topics whose obstacles have names that an object in the hand may have, too.
_NAMED = ("obstacles", "obstacle_marker", "planning_scene")
#: Two stops because of the posture have no progress between them where the tool is within this distance [m].
_NO_PROGRESS = 0.01


#: What goes to goals with a skill, or plays trajectories that are offered.
GoalPlanner = ReactivePlanner | MotionFilter


class PlannerCycle:
    """The cycle of a node that commands a whole arm, which turns inputs into ticks and plans into commands.

    Parameters
    ----------
    state_timeout : [s] a joint state older than this stops the arm.
    resume_timeout : [s] when the state returns after less than this, the motion resumes; after more, the goal is
        dropped.
    command_topic : where the commands go.
    clock : tells the time that a cycle takes [s].
    background : prepares goals while cycles go on; None: a cycle does it, and takes longer.
    tracking_tolerance : [rad] largest distance of a joint from where it was sent.
    tool_tolerance : [m], [rad] largest distance of the tool from where it was sent, where poses command the arm.
    horizon : [s] what is sent leads so far ahead, and then to rest (`trajectory/receding_horizon.py`).

    Attributes
    ----------
    state_topic : where the arm's state comes from, as messages name it; "joint_states" until it is set.
    commands : where the commands go, as messages name it; that of `command_topic` until it is set.
    steady : how far the arm rests from where it is commanded.
    paused : why the arm is to rest on its path, and to go on once that is over; "" where it is not. Any thread may set
        it, after `changes` that are to count as the arm goes on.
    withheld : how many trajectories were found too late to be sent. not_taken : how often the drive went on with
        what was sent before.

    Raises
    ------
    ParameterError : a horizon shorter than the planner's prediction, for which its certificates do not hold.
    """

    def __init__(
        self,
        planner: GoalPlanner,
        state_timeout: float,
        resume_timeout: float,
        tracking_tolerance: float,
        horizon: float,
        command_topic: str = "joint_trajectory",
        clock: Callable[[], float] = time.monotonic,
        background: Executor | None = None,
        tool_tolerance: tuple[float, float] = (0.05, 0.35),
    ) -> None:
        if horizon < planner.settings.prediction:
            raise ParameterError(
                f"parameter horizon = {horizon:g}: must not be less than prediction, {planner.settings.prediction:g} s"
            )
        self.planner = planner
        self.state_topic, self.commands, self._command_topic = "joint_states", command_topic, command_topic
        self.state_timeout, self.resume_timeout = state_timeout, resume_timeout
        self._clock, self._time = clock, CycleClock()
        self._began = 0.0
        self._arm = ArmWatch()
        self._goal: NewestGoal[Any] = NewestGoal(self._take_prepared, planner.clear_goal, background, planner.noun)
        # Whether goals are to be prepared later, with what the hand is about to hold; and which held objects do not
        # count yet, for which the arm stands; "": none.
        self._goals_wait, self._uncounted = False, ""
        self._obstacles_version = -1
        self.paused = self._rests = ""
        self._horizon = Horizon(horizon)
        self._sent = SentTrajectories()
        # By how much more than is measured of messages trajectories were too late to be sent [s].
        self._lacking = Lately()
        self.withheld = self.not_taken = 0
        # The time of the cycle [s], and whether it stands while the cycle lasts.
        self._started, self._simulated = 0.0, False
        self.tracking_tolerance, self.tool_tolerance = tracking_tolerance, tool_tolerance
        # An arm that does not hold the posture it was sent, and where its tool was when it last did not (3,) [m].
        self._astray: UnsettledArm | None = None
        self._astray_at: np.ndarray | None = None
        self._now = 0.0
        self._stood = False
        self._standing: Plan | None = None
        self._tracking = TrackingMonitor(planner.robot, planner.collision)
        self._drive = DriveWatch(planner.robot.joint_names)
        self.steady = SteadyError(planner.robot.joint_names)
        # Since when what is played has been over [s, heard]; inf while it is not.
        self._over_since = math.inf
        # What the log is to say of this cycle, and what has happened that disarms.
        self._news = self._disarms = ""
        # Whether the planner was armed in the last cycle, and whether it only shows what it would do.
        self._armed, self._shows = True, False
        self._shown = ShownPlan(planner)
        self._task_frame: PoseArrays | None = None
        self._frame_verdict = Verdict()
        # Whether the goal that is being prepared is the old one, in a task frame that has moved.
        self._again = False
        # Settings that are to change, by name; any thread may replace them.
        self.changes: Mapping[str, float | None] = {}
        # What the hand is to hold, and settings, prepared as goals are; None: that is to be prepared once more.
        self._arms: Preparation[PreparedArm | Refusal] = Preparation(background)
        self._held: tuple[HeldObject, ...] | None = ()
        self._changes = self.changes
        # Where objects that were released have been left, by name, as long as the arm has not left them.
        self._released: dict[str, Obstacles] = {}
        # The names of obstacles that do not count.
        self._not_counted: list[str] = []
        # When it was looked at, and how old the joint state was then [s], in the last second.
        self._ages: deque[tuple[float, float]] = deque()
        # Where the arm was measured (eta,) [rad], continuous joints in the turn of what is commanded, and by how many
        # whole turns the driver has them elsewhere [rad].
        self._near: np.ndarray | None = None
        self._turned_by = np.zeros(len(planner.robot.joint_names))

    @property
    def goal_number(self) -> int:
        """The number of the newest goal that was received, counted from 1; 0 before the first."""
        return self._goal.number

    def run(self, inputs: CycleInputs, period: float) -> CycleOutput:
        """Run one cycle of a period [s]: judge the inputs, take a goal, know where the arm is, and ask the planner.

        The steps before that, whose order matters:

        1. If no cycle came for so long that the arm brakes by itself, on the stop at the end of the trajectory that was
           sent last (`Horizon.overrun`), the planner records that, and plans on from the stop.
        2. Changed settings, and the objects in the hand, are counted once they are prepared. Until then `_uncounted`
           names the objects that do not count yet, for which the arm stands, and `_goals_wait` defers goals.
        3. The places of released objects are forgotten where the arm has left them.
        4. Obstacles that have the name of an object in the hand are that object, and do not count while it is held, nor
           where it was released, until the arm has left it. Where these names change, the obstacles are set anew.
        """
        self._news = self._disarms = ""
        self._take_delivery(inputs)
        braking = self._horizon.overrun(inputs.now + self.planner.latency)
        if braking is not None:
            reason = f"no cycle for {self._horizon.length:g} s: the arm came to rest by itself"
            self.planner.record_braking(braking.reference, braking.begin, Refusal(VerdictCode.DEADLINE_MISSED, reason))
            self._horizon.forget()
        paused = self.paused
        self._take_arm(inputs)
        if paused or not self._goals_wait:
            self._rests = paused
        self._released = self._not_left(inputs)
        in_place = (name for name, place in self._released.items() if _overlapping(_own(inputs, name), place))
        names = [*(held.name for held in self.planner.held), *in_place]
        if names != self._not_counted:
            self._not_counted, self._obstacles_version = names, -1
        return self._run(self._in_turn(inputs).without(_labels(names)), period)

    def _take_delivery(self, inputs: CycleInputs) -> None:
        """Have trajectories take over as late as they are heard."""
        self._began, self._started, self._simulated = self._clock(), inputs.now, inputs.simulated
        if self._command_topic == "joint_trajectory":
            late = max(inputs.transit - TRANSIT, self._lacking.largest(self._began))
            self.planner.set_late(takeover_delay(late))

    def _follow_drive(self, inputs: CycleInputs) -> None:
        """Plan on from the trajectory that the drive goes on with, where it has not taken a later one."""
        if inputs.drive is None or inputs.drive_age > self.state_timeout or self._arm.lost is not None:
            return
        if (fallen_back := self._sent.fall_back(inputs.drive, inputs.now - inputs.drive_age)) is None:
            return
        sent, waited = fallen_back
        self.not_taken += 1
        self._news = (
            f"the drive goes on with an earlier trajectory than that which should have taken over {waited:.2f} s ago: "
            "that came too late, or was refused; another one is planned from where the drive is"
        )
        self._horizon.fall_back(sent)
        self.planner.record_braking(
            sent.reference, sent.begin, Refusal(VerdictCode.DEADLINE_MISSED, "the drive has not taken what was sent")
        )

    def _run(self, inputs: CycleInputs, period: float) -> CycleOutput:
        self._follow_drive(inputs)
        if why := self._time.read(inputs, period):
            self._arm.jump = self._time.jump
            self._heed(Halt(Refusal(VerdictCode.BAD_INPUT, why), why))
        self._take_arming(inputs)
        self._take_task_frame(inputs.task_frame)
        self._take_goal(inputs)
        obstacles_taken = self._take_obstacles(inputs)
        if self._shows:
            return self._show(obstacles_taken, inputs)
        refused = self._take_state(inputs) or self._heed(rivals(inputs, self.commands))
        without_goal = None if self._goal.is_set else self._goal.verdict
        verdict = refused or readiness(inputs, self.commands, self._uncounted, without_goal)
        if held := inputs.unarmed or (self._rests if verdict.ok else ""):
            verdict = Refusal(VerdictCode.HOLD_REQUESTED, held)
        deadline = Deadline(self._began + DEADLINE_SHARE * period, self._clock)
        return self._command(obstacles_taken if verdict.ok else verdict, inputs, deadline)

    def _take_arming(self, inputs: CycleInputs) -> None:
        """Drop the goal as the planner is armed or disarmed; while it is not, once the arm rests, only show."""
        was_armed, self._armed = self._armed, not inputs.unarmed
        if was_armed != self._armed:
            self._goal.drop(inputs.unarmed.partition(";")[0] or "~/arm was called with true")
        if not self._armed and not self._shows:
            commanded = self.planner.commanded_state(inputs.now) if self._stood else None
            self._shows = commanded is None or self._sent_to_stand(inputs) is not None
        elif self._armed and self._shows:
            # What is shown was never played.
            self._shows = self._stood = False
            self._shown.forget()
            self._arm.begin()
        if self._shows:
            self._horizon.forget()
            self._sent.forget()

    def _show(self, verdict: Verdict, inputs: CycleInputs) -> CycleOutput:
        """Plan from where the arm rests, and command nothing."""
        self._now = inputs.now
        self._take_drive(inputs)
        stale = stale_state(inputs, self.state_topic, self.state_timeout, self.resume_timeout)
        without_goal = None if self._goal.is_set else self._goal.verdict
        judged: list[Verdict] = [] if stale is None else [stale.refusal]
        judged += [verdict, readiness(inputs, self.commands, self._uncounted, without_goal), self._frame_verdict]
        refused = next((one for one in judged if not one.ok), None)
        if refused is not None:
            self._shown.forget()
            mode = Mode.from_verdict(refused).value
            return CycleOutput(refused, self._goal.verdict, mode=mode, goal_served=self._goal.served)
        assert inputs.measured is not None  # it is not stale
        plan = self._shown.make(inputs.measured, inputs.goal_number, inputs.now, inputs.heard)
        shown = plan.verdict
        if plan.reference is not None and shown.ok:
            shown = Refusal(VerdictCode.HOLD_REQUESTED, inputs.unarmed, shown.figures)
        reference = plan.reference if plan.verdict.ok else None
        mode = Mode.from_verdict(shown).value
        return CycleOutput(
            shown, self._goal.verdict, reference=reference, mode=mode, goal_served=self._goal.served
        )  # fmt: skip

    def _in_turn(self, inputs: CycleInputs) -> CycleInputs:
        """The inputs with continuous joints measured in the turn that is commanded, however the driver counts turns."""
        measured = inputs.measured
        if measured is None or not np.any(self.planner.robot.is_continuous):
            return inputs
        commanded = self.planner.commanded_state(inputs.now) if self._arm.lost is None else None
        near = self._near if commanded is None else commanded[0]
        self._near = measured if near is None else self.planner.robot.nearest_turn(measured, near)
        self._turned_by = measured - self._near
        drive = None if inputs.drive is None else self.planner.robot.nearest_turn(inputs.drive, self._near)
        return replace(inputs, measured=self._near, drive=drive)

    def _take_arm(self, inputs: CycleInputs) -> None:
        """Have what the hand holds, and settings, prepared where they are new, and count them once that is done."""
        changes = self.changes
        if inputs.held != self._held or changes != self._changes:
            self._held, self._changes = inputs.held, changes
            self._arms.ask(partial(self.planner.prepare_arm, inputs.held, **changes))
        before = self.planner.held
        self._uncounted = _uncounted(inputs.held, before)
        try:
            prepared = self._arms.take_settled()
            self._goals_wait = self._arms.busy
            if prepared is None:
                return
            verdict = self.planner.take_arm(prepared)
            if not verdict.ok:
                raise PlanningError(verdict.reason)
        except Exception:
            self._held = None
            raise
        self._uncounted = _uncounted(inputs.held, self.planner.held)
        self._obstacles_version = -1
        self._tracking.take_collision(self.planner.collision)
        names = {held.name for held in self.planner.held}
        commanded = self.planner.commanded_state(inputs.now)
        if commanded is not None:
            tool = TaskFrame(*self.planner.robot.forward(commanded[0]))
            left = (held for held in before if held.name not in names)
            self._released |= {held.name: _placed(held, tool) for held in left}
        self._released = {name: place for name, place in self._released.items() if name not in names}

    def _not_left(self, inputs: CycleInputs) -> dict[str, Obstacles]:
        """Of the places of released objects those near which the arm is, or near the obstacle that is still there."""
        planner, commanded = self.planner, self.planner.commanded_state(inputs.now) if self._released else None
        if commanded is None:
            return self._released
        uncertain = planner.settings.obstacle_position_error + planner.tracking.error

        def is_near(obstacles: Obstacles) -> bool:
            larger = obstacles.enlarged(uncertain)
            clearance, _ = obstacle_clearance(planner.collision, planner.robot, commanded[0], larger)
            return clearance <= planner.settings.obstacle_margin

        return {
            name: place
            for name, place in self._released.items()
            if is_near(place) or (_overlapping(own := _own(inputs, name), place) and is_near(own))
        }

    def stop(self, verdict: Refusal) -> CycleOutput:
        """End a cycle that failed, in `run` or before: come to rest, and say why."""
        self._began, self._started, self._news = self._clock(), self._now, ""
        return self._output(self.planner.stop(self._now, verdict, self._handover_deadline()))

    def _handover_deadline(self) -> Deadline:
        """What is planned from now on must have been found by then."""
        return Deadline(self._clock() + self.planner.settings.latency - TRANSIT, self._clock)

    def _command(self, verdict: Verdict, inputs: CycleInputs, deadline: Deadline) -> CycleOutput:
        """Plan where the verdict is OK, stop otherwise."""
        # Taking a goal may have cost time, and what is planned begins a moment from now.
        self._now = inputs.now + (0.0 if inputs.simulated else self._clock() - self._began)
        verdict = self._frame_verdict if verdict.ok else verdict
        if not verdict.ok:
            return self._output(self.planner.stop(self._now, verdict, self._handover_deadline()))
        began = self._clock()
        plan = self.planner.tick(self._now, deadline, self._handover_deadline())
        if plan.verdict.code is VerdictCode.DEADLINE_MISSED and plan.reference is None:
            # What is being played is not certified any more: a stop from the present on, which takes no search.
            self._now += 0.0 if inputs.simulated else self._clock() - began
            plan = self.planner.stop(self._now, plan.verdict, self._handover_deadline())
        return self._output(plan)

    def _withhold_late(self, plan: Plan) -> Plan:
        """Withhold the trajectory of a plan that would be heard after it takes over, and so be a step: what is played
        goes on, and the next cycle plans again, for a later time. Returns the plan, without it.
        """
        if plan.reference is None or self._simulated or self._command_topic != "joint_trajectory":
            return plan
        late = self.planner.latency - self.planner.settings.latency
        heard = self._started + self._clock() - self._began + TRANSIT + late
        takeover = self.planner.takeover
        if heard <= takeover:
            return plan
        self.planner.withdraw()
        self.withheld += 1
        self._lacking.add(late + heard - takeover, self._began)
        reason = (
            f"what was found would be heard {1e3 * (heard - takeover):.0f} ms after it takes over, a step: the next "
            "cycles plan for later"
        )
        return Plan(None, self._now, Refusal(VerdictCode.DEADLINE_MISSED, reason), mode=plan.mode)

    def _output(self, plan: Plan) -> CycleOutput:
        plan = self._withhold_late(plan)
        trajectory = self._hand_over(plan)
        commanded = self.planner.commanded_state(self._now)
        path = self.planner.motion_to_goal() if plan.verdict.ok else None
        if trajectory is not None and np.any(self._turned_by):
            reference, begin = trajectory
            trajectory = replace(reference, positions=reference.positions + self._turned_by), begin
        verdict = plan.verdict
        if verdict.ok and self.steady.reason:
            verdict = replace(verdict, reason="; ".join(filter(None, (verdict.reason, self.steady.reason))))
        return CycleOutput(
            verdict,
            self._goal.verdict,
            trajectory=trajectory,
            reference=None if path is None else path[0],
            time_to_goal=math.nan if path is None else max(0.0, path[1] + path[0].duration - self._now),
            configuration=None if commanded is None or self._arm.lost or self._arm.missing else commanded[0],
            speed=0.0 if commanded is None else float(np.max(np.abs(commanded[1]))),
            mode=plan.mode.value,
            news="; ".join(filter(None, (self._news, self.steady.take_news()))),
            disarms=self._disarms,
            goal_served=self._goal.served,
        )

    def _hand_over(self, plan: Plan) -> tuple[JointReference, float] | None:
        """Bound what this cycle sends of a plan: the trajectory, and when it begins [s]; None where nothing is sent."""
        standing, self._standing = self._standing, None
        if self._arm.lost is not None and standing is not None and standing.reference is not None:
            # The arm was found elsewhere: what was being played must not go on. And a trajectory that has ended when
            # it arrives would be refused.
            self._horizon.forget()
            self._sent.forget()
            return standing.reference, standing.begin + self.planner.latency
        limits = self.planner.played_limits
        if plan.reference is not None:
            sent = self._horizon.bound(plan.reference, plan.begin, self._now, limits)
            self._sent.add(sent, self.planner.takeover)
        elif plan.verdict.code is VerdictCode.DEADLINE_MISSED:
            # What is being played is a stop already, or a path that this cycle found no time to certify, or to stop on:
            # the arm brakes where what was sent ends.
            return None
        elif self._horizon.must_renew(self._now) and (playing := self.planner.remaining_motion(self._now)) is not None:
            sent = self._horizon.bound(*playing, self._now, limits)
            self._sent.add(sent, self._now)
        else:
            return None
        return sent.reference, sent.begin

    def _take_goal(self, inputs: CycleInputs) -> None:
        self._goal.hear(inputs, partial(self._preparing, inputs))
        self._goal.withdraw(*inputs.withdrawn)
        if not self._goals_wait:
            self._goal.take_prepared()

    def _preparing(self, inputs: CycleInputs) -> Callable[[], Any]:
        self._again = False
        return partial(self.planner.prepare, inputs.goal)

    def _take_prepared(self, prepared: Any) -> Verdict:
        """Plan to a prepared goal from now on; a refused one leaves the goal before."""
        if self._again and isinstance(prepared, Refusal):
            self._goal.is_set = False
            self.planner.clear_goal()
        self._astray_at = None
        verdict = self.planner.take_goal(prepared)
        if verdict.ok and not self._again:
            self._tracking.take_goal()
        return verdict

    def _take_obstacles(self, inputs: CycleInputs) -> Verdict:
        if inputs.obstacles.version == self._obstacles_version:
            return Verdict()
        # Trajectories are stamped with another clock than they are heard by.
        longest = self.planner.settings.prediction
        verdict = self.planner.take_obstacles(inputs.obstacles.moved_on(inputs.heard, longest, inputs.now))
        if verdict.ok:
            self._obstacles_version = inputs.obstacles.version
        return verdict

    def _take_task_frame(self, frame: PoseArrays | None) -> None:
        if frame is None or frame is self._task_frame:
            return
        assert isinstance(self.planner, ReactivePlanner)  # nobody else hears of a task frame
        self._task_frame = frame
        self._frame_verdict = self.planner.move_task_frame(*frame)
        if self._goal.is_set and self._frame_verdict.ok and self._goal.is_prepared:
            self._again = True
            self._goal.prepare(self.planner.prepare_again)

    def _heed(self, halt: Halt | None) -> Refusal | None:
        if halt is not None and halt.dropping:
            self._disarms = halt.dropping
        return self._goal.heed(halt)

    def _take_state(self, inputs: CycleInputs) -> Refusal | None:
        """Go by where the arm was measured; why that is not possible, None where it is."""
        stale = stale_state(inputs, self.state_topic, self.state_timeout, self.resume_timeout)
        if stale is None:
            return self._follow_measured(inputs)
        self._arm.missing = self._arm.missing or bool(stale.dropping)
        return self._heed(stale)

    def _begin(self, inputs: CycleInputs, measured: np.ndarray) -> Refusal | None:
        """Begin where the arm is commanded to stand (`DriveWatch.start`); why that is not possible, None where it is.
        """
        if self._command_topic != "joint_trajectory":
            self._begin_at(measured, inputs.now)
            return None
        # An arm that was lost was sent to stand where it was found, which a node that commands another arm never heard.
        sent = None if self._arm.jump or not self._stood or self._arm.strayed else self._sent_to_stand(inputs)
        start = self._drive.start(measured, sent, self.tracking_tolerance, inputs.heard - self.state_timeout)
        if isinstance(start, Refusal):
            return start
        self._begin_at(start.configuration, inputs.now)
        if start.configuration is not measured:
            self._track(measured, self._sent_at(inputs.now), inputs.now)
        self._news = start.news
        return None

    def _sent_to_stand(self, inputs: CycleInputs) -> np.ndarray | None:
        """Where the arm was sent to rest (eta,) [rad]; None while it is sent to move."""
        commanded = self.planner.commanded_state(inputs.now)
        if commanded is None or self.planner.is_moving(inputs.now) or np.any(commanded[1]):
            return None
        return commanded[0]

    def _begin_at(self, configuration: np.ndarray, now: float) -> None:
        self._stand_at(configuration, now)
        self._arm.begin()

    def _stand_at(self, configuration: np.ndarray, now: float) -> None:
        self._tracking.forget()
        self.steady.forget()
        self._standing = self.planner.stand_at(configuration, now)
        self._stood = self._stood or self._standing.verdict.ok

    def _sent_at(self, time: float) -> np.ndarray:
        """Where an arm that has begun was sent to be (eta,) [rad]."""
        commanded = self.planner.commanded_state(time)
        assert commanded is not None
        return commanded[0]

    def _track(self, measured: np.ndarray, sent: np.ndarray, taken: float) -> None:
        tracking = self._tracking.add(measured, sent, taken)
        # Since then the arm may have stood.
        unseen = max(0.0, max((age for _, age in self._ages), default=0.0) - FRESH)
        self.planner.set_tracking(replace(tracking, lag=tracking.lag + unseen))

    def _deviation(self, measured: np.ndarray, sent: np.ndarray) -> tuple[str, str] | None:
        robot = self.planner.robot
        if self._command_topic == "target_pose":
            return pose_deviation(robot.forward(measured), robot.forward(sent), *self.tool_tolerance)
        return joint_deviation(measured, sent, robot.joint_names, self.tracking_tolerance)

    def _follow_measured(self, inputs: CycleInputs) -> Refusal | None:
        """Begin at the measured place, and again where an arm that was lost has come to rest; why nothing is planned,
        None where it may be.

        An arm whose tool is where it was sent, but not its posture, stops; from where it rests it goes on: the
        certificate is of the posture that was sent.
        """
        self._ages.append((inputs.heard, inputs.state_age))
        while self._ages[0][0] < inputs.heard - COUNTED:
            self._ages.popleft()
        measured = inputs.measured
        assert measured is not None  # it is not stale
        refusal = self._found(inputs, measured)
        if refusal is not None or self._command_topic == "joint_trajectory":
            self._astray = None
            return refusal
        if self._astray is None:
            sent, names = self._sent_at(inputs.now - inputs.state_age), self.planner.robot.joint_names
            deviation = joint_deviation(measured, sent, names, self.tracking_tolerance)
            if deviation is None:
                return None
            tool = self.planner.robot.forward(measured)[0]
            stray = self._stray(tool, *deviation)
            self._astray, self._astray_at = UnsettledArm(stray.refusal, measured), tool
            return self._heed(stray)
        self._astray = self._astray.after_measurement(measured, self._time.step)
        if not self._astray.is_at_rest:
            return self._astray.refusal
        self._begin_at(measured, inputs.now)
        self._astray = None
        return None

    def _found(self, inputs: CycleInputs, measured: np.ndarray) -> Refusal | None:
        """Why the arm is not to be commanded where it was found; None where it may be."""
        self._take_drive(inputs)
        if not self._stood:
            return self._begin(inputs, measured)
        if self._arm.lost is not None:
            return self._arm.unrest(measured, self._time.step) or self._begin(inputs, measured)
        taken, deviation = inputs.now - inputs.state_age, None
        # What was commanded is not known of a time of another clock.
        if not self._arm.jump:
            sent = self._sent_at(taken)
            self._track(measured, sent, taken)
            deviation = self._deviation(measured, sent)
        resting = self._sent_to_stand(inputs)
        self._drive.compare(self._sent_to_move(inputs) if resting is None else None)
        lost = self._heed(self._arm.lose(measured, deviation, self._drive.stalled))
        if lost is None:
            return self._watch_rest(inputs, measured, resting)
        self.steady.forget()
        if not self._can_brake(inputs):
            self._stand_at(measured, inputs.now)
        return lost

    def _take_drive(self, inputs: CycleInputs) -> None:
        if inputs.drive is not None:
            self._drive.take(inputs.drive, inputs.heard - inputs.drive_age)

    def _sent_to_move(self, inputs: CycleInputs) -> np.ndarray | None:
        """Where the arm was sent to be in motion (eta,) [rad], when its drive was heard; None where it is not known."""
        silent = inputs.drive is None or inputs.drive_age > self.state_timeout
        if silent or self._arm.jump or self._command_topic != "joint_trajectory":
            return None
        sent = self.planner.commanded_state(inputs.now - inputs.drive_age)
        return None if sent is None else sent[0]

    def _can_brake(self, inputs: CycleInputs) -> bool:
        """Whether an arm that was just lost can be braked by what is played: its drive still follows that, or nothing
        has moved it. To be commanded to stand where it was found would be a step.
        """
        if self._command_topic != "joint_trajectory" or self._arm.jump:
            return False
        if not self._arm.strayed:
            return True
        drive, taken = self._drive.commanded, inputs.now - inputs.drive_age
        played = self.planner.commanded_state(taken)
        if drive is None or played is None or inputs.drive_age > self.state_timeout:
            return False
        return joint_deviation(drive, played[0], self.planner.robot.joint_names, self.tracking_tolerance) is None

    def _watch_rest(self, inputs: CycleInputs, measured: np.ndarray, sent: np.ndarray | None) -> Refusal | None:
        """See how far an arm at rest is from where it was sent (eta,) [rad], None in motion, and begin anew where its
        drive has left that; why that is not possible, None where it is.
        """
        self._over_since = math.inf if sent is None else min(self._over_since, inputs.heard)
        if sent is None:
            self.steady.forget()
            return None
        taken = inputs.heard - inputs.state_age
        if taken >= self._over_since:
            self.steady.add(measured, sent, taken)
        left = inputs.heard - self._over_since >= REST_TIME and self._drive.has_left(
            sent, inputs.heard - self.state_timeout
        )
        return self._begin(inputs, measured) if left and self._command_topic == "joint_trajectory" else None

    def _stray(self, tool: np.ndarray, where: str, limit: str) -> Halt:
        """Why an arm stops whose tool (3,) [m] is where it was sent, but not its posture.

        The second time at one place the goal is dropped.
        """
        before = self._astray_at
        reason = f"the arm was {where} from target_posture (allowed by {limit})"
        if before is not None and np.linalg.norm(tool - before) < _NO_PROGRESS:
            reason = f"the controller does not follow the posture: {reason}"
            return Halt(Refusal(VerdictCode.BAD_INPUT, reason), reason)
        return Halt(Refusal(VerdictCode.BAD_INPUT, f"{reason}: it stops, and plans again from where it rests"))


def _labels(names: Sequence[str]) -> list[str]:
    """Those of the obstacles that have the names of objects."""
    return [f"{topic}/{name}" for topic in _NAMED for name in names]


def _own(inputs: CycleInputs, name: str) -> Obstacles:
    """The obstacles that have the name of an object."""
    others = [label for label in inputs.obstacles.labels if label not in _labels([name])]
    own = inputs.obstacles.without(others).moved_on(inputs.heard, 0.0, inputs.now)
    return replace(own, cloud=DistanceField.none())


def _overlapping(own: Obstacles, place: Obstacles) -> bool:
    """Whether any of an object's own obstacles is where the object was left."""
    elsewhere = own.leaving_free(place.centres, place.radii, 0.0)
    return len(elsewhere.radii) + len(elsewhere.solids) < len(own.radii) + len(own.solids)


def _uncounted(wanted: Sequence[HeldObject], held: Sequence[HeldObject]) -> str:
    """Why an arm stands that is to hold some objects; "" where it does."""
    names = ", ".join(sorted(one.name for one in wanted if one not in held))
    return f"the hand is to hold {names}, which does not count yet: the arm stands until it does" if names else ""


def _placed(held: HeldObject, tool: TaskFrame) -> Obstacles:
    """The spheres of an object in the base frame, in which the tool stands so."""
    centres, radii = held.spheres
    return Obstacles.of_spheres(tool.points_to_base(centres), radii)
