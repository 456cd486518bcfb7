"""StreamingPlanner: what planners of an arm's motion have in common, whatever decides where it goes: the world as it
was received, the stream that is played, its limits, and the steps of a tick. Knows nothing of ROS.

The planner owns its inputs and the stream (`stream`): it plans from the state of motion in which a new trajectory takes
over from the one that is being played. A tick works out its `Situation` once, decides without changing anything, and
commits that in one place.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from geodesic_motion_ros.certification.certificate import JudgedTrajectory
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.mode import Mode
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.motion.motion_judge import MotionJudge
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.played import Step
from geodesic_motion_ros.motion.stream import Stream
from geodesic_motion_ros.motion.tracking import Tracking
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.mission import Inputs
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject, check_held
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.timing import load_references
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.checked_numbers import LARGEST_NUMBER, check_number, check_time
from geodesic_motion_ros.utils.deadline import NEVER, Deadline
from geodesic_motion_ros.utils.errors import PlanningError, RobotError

Arm = TypeVar("Arm", bound="StreamedArm")


class StreamedArm(Protocol):
    """An arm with what it holds, and the solver that counts both."""

    @property
    def objects(self) -> tuple[HeldObject, ...]: ...

    @property
    def collision(self) -> CollisionModel: ...

    @property
    def solver(self) -> MotionJudge: ...

    def with_changes(self: Arm, objects: Sequence[HeldObject], settings: PlannerSettings) -> Arm: ...


@dataclass(frozen=True, eq=False)
class PreparedArm(Generic[Arm]):
    """An arm with other objects in its hand, or other settings, and the query that was being followed with them.

    query : in the place of `before`; None: there was none.
    """

    arm: Arm
    before: Any
    query: Any


class StreamingPlanner(ABC, Generic[Arm]):
    """A planner of certified motions of one arm as a stream: say what is around it, and tick.

    One thread calls `tick`, `stop` and `stand_at`. Obstacles are replaced as a whole. Poses and obstacles are of the
    base frame, all times are of one clock, the caller's.

    robot : the arm. scene : what always stands around it. may_detour : whether that is known. noun : what a person
    calls that which it is asked for.
    """

    noun = "goal"
    robot: Robot
    scene: DeclaredScene
    may_detour: bool

    def __init__(self, arm: Arm, robot: Robot, scene: DeclaredScene | None, latent_dimension: int) -> None:
        """scene : None: it is not known what stands around the arm. latent_dimension : of the points beside knots."""
        self.robot, self.may_detour, self.scene = robot, scene is not None, scene or DeclaredScene.empty()
        self._arm, self._stream, self._latent_dimension = arm, Stream(arm.solver.certifier), latent_dimension
        position_error = arm.solver.settings.obstacle_position_error
        self._inputs = Inputs(Obstacles.none(), position_error, Tracking(), TaskFrame.identity())
        # How far a detour may lead [m]; any thread may set it.
        self._reach = arm.solver.settings.detour if self.may_detour else 0.0
        # Limits that what is being played keeps; None: the present ones.
        self._earlier_limits: JointLimits | None = None
        # All that the last step has changed, as it was before.
        self._before: tuple[Stream, JointLimits | None, Any] = self._stream.kept(), None, None
        # The time of the newest tick [s].
        self._ticked = 0.0
        # It counts up when what was prepared becomes stale: the arm stands elsewhere, holds other objects, or has other
        # settings.
        self._generation = 0

    @property
    def arm(self) -> Arm:
        """The arm with what it holds, as motions and detours count it."""
        return self._arm

    @property
    def settings(self) -> PlannerSettings:
        """The settings of ticks and plans; some of them may change (`change_settings`)."""
        return self._arm.solver.settings

    @property
    def limits(self) -> JointLimits:
        """The limits of the joints that every new motion keeps."""
        return self._arm.solver.limits

    @property
    def played_limits(self) -> JointLimits:
        """The limits that what is being played keeps: for a moment after they were lowered still those from before."""
        return self._earlier_limits or self.limits

    @property
    def latency(self) -> float:
        """A new trajectory takes over so long after the tick that finds it [s]: the setting, and what `set_late` adds.
        """
        return self.settings.latency + self._inputs.late

    @property
    def takeover(self) -> float:
        """When the newest trajectory that was handed out takes over [s]; until then it repeats the one before."""
        return self._stream.takeover

    @property
    def collision(self) -> CollisionModel:
        """The spheres that obstacles are kept away from, those of held objects among them."""
        return self._arm.collision

    @property
    def held(self) -> tuple[HeldObject, ...]:
        """The objects in the hand."""
        return self._arm.objects

    # ---------------------------------------------------------------- inputs

    def set_obstacles(
        self, centres: object, radii: object, velocities: object = None, time: float | None = None
    ) -> Verdict:
        """Replace all obstacles by spheres, centres (o, 3), radii (o,) [m] and velocities (o, 3) [m/s] at `time` [s],
        which those that stand do not need.

        BAD_INPUT names what has another shape, the first obstacle that is not finite or has no positive radius, or a
        time that is none; then the old ones stay.
        """
        try:
            return self.take_obstacles(Obstacles.of_spheres(centres, radii, velocities, time))
        except PlanningError as error:
            return Refusal(VerdictCode.BAD_INPUT, str(error))

    @property
    def obstacles(self) -> Obstacles:
        """The obstacles that were received last."""
        return self._inputs.obstacles

    def take_obstacles(self, obstacles: Obstacles) -> Verdict:
        """Replace all obstacles, of every kind, by others in the base frame.

        BAD_INPUT names the first obstacle that is not valid; then the old ones stay.
        """
        if not isinstance(obstacles, Obstacles):
            return Refusal(VerdictCode.BAD_INPUT, f"obstacles are {obstacles!r:.60}: Obstacles are needed")
        objection = obstacles.objection()
        if objection:
            return Refusal(VerdictCode.BAD_INPUT, objection)
        self._inputs = self._inputs.with_obstacles(obstacles.as_floats(), self._ticked)
        return Verdict()

    @property
    def tracking(self) -> Tracking:
        """The arm's lag and error in following its commands, rounded up as certificates count it."""
        return self._inputs.tracking

    def set_tracking(self, tracking: Tracking) -> None:
        """Say how the arm follows its commands: from now on certificates hold for an arm that is late by up to that
        lag, and off its path by up to that error. Both are rounded up, to `LAG_STEP` and `TRACKING_ERROR_STEP`.

        PlanningError where one of them is not finite.
        """
        check_number("lag [s]", tracking.lag, -LARGEST_NUMBER, LARGEST_NUMBER)
        check_number("tracking error [m]", tracking.error, -LARGEST_NUMBER, LARGEST_NUMBER)
        rounded = tracking.round_up()
        if rounded != self._inputs.tracking:
            self._inputs = replace(self._inputs, tracking=rounded)

    def set_late(self, late: float) -> None:
        """Say how much later [s] than the setting `latency` allows for what is handed out is heard: from now on
        trajectories take over so much later, for until then they repeat what is being played.

        PlanningError where it is negative or not finite.
        """
        check_number("late [s]", late, 0.0, LARGEST_NUMBER)
        if late != self._inputs.late:
            self._inputs = replace(self._inputs, late=late)

    def hold(self, objects: Sequence[HeldObject]) -> Verdict:
        """Say what the hand holds from now on, all of it; nothing: (). Prepares the objects and takes them."""
        return self.take_arm(self.prepare_arm(objects))

    def set_detour(self, reach: float) -> Verdict:
        """Say, from any thread, how far [m] the tool may leave what was demonstrated, or offered; a detour that is
        being followed stays.

        BAD_INPUT where that is negative, not finite or more than `LARGEST_DETOUR`, or more than 0 where no scene was
        declared; then nothing changes.
        """
        try:
            check_number("detour [m]", reach, 0.0, constants.LARGEST_DETOUR)
        except PlanningError as error:
            return Refusal(VerdictCode.BAD_INPUT, str(error))
        if reach > 0.0 and not self.may_detour:
            return Refusal(VerdictCode.BAD_INPUT, f"detour {reach} m: it is not known what stands around the arm")
        self._reach = float(reach)
        return Verdict()

    def change_settings(self, **changes: Any) -> Verdict:
        """Change settings by their names, those of `CHANGEABLE`: prepares the change and takes it."""
        return self.take_arm(self.prepare_arm(None, **changes))

    def prepare_arm(
        self, objects: Sequence[HeldObject] | None = None, **changes: Any
    ) -> PreparedArm[Arm] | Refusal:
        """Do the work that takes time of holding other objects, and of changing settings: any thread may do it while
        another one ticks.

        BAD_INPUT where two objects have one name, or one is larger than the arm; where a setting cannot change, or has
        a value that it must not have.

        Parameters
        ----------
        objects : all that the hand holds from now on; None: as before. changes : settings of `CHANGEABLE`, by name.
        """
        arm = self._arm
        fixed = sorted(changes.keys() - set(constants.CHANGEABLE))
        if fixed:
            reason = f"setting {fixed[0]} cannot be changed any more; those that can: {', '.join(constants.CHANGEABLE)}"
            return Refusal(VerdictCode.BAD_INPUT, reason)
        try:
            settings = replace(arm.solver.settings, **changes)
            held = arm.objects if objects is None else objects
            check_held(held, self.robot)
            changed = arm.with_changes(held, settings)
        except (RobotError, PlanningError) as error:
            return Refusal(VerdictCode.BAD_INPUT, str(error))
        if settings != arm.solver.settings:
            # What limits of the tool need is not loaded where it had none.
            load_references(changed.solver.limits, changed.solver.tool)
        return self._prepared_arm(changed, objects is not None)

    def take_arm(self, prepared: PreparedArm[Arm] | Refusal) -> Verdict:
        """Count prepared objects and settings from the next tick on, which certifies the motion anew with them.

        Attempts and detours with those before are forgotten. Where settings have changed a path that is found anew
        takes the place of the one that is followed; an arm that is too fast slows down on its path first. If the change
        was refused, nothing changes, and the refusal is returned.
        """
        if isinstance(prepared, Refusal):
            return prepared
        before, self._arm = self._arm.solver, prepared.arm
        solver = self._arm.solver
        if solver.limits is not before.limits or solver.tool.limits != before.tool.limits:
            earlier = self._earlier_limits
            self._earlier_limits = before.limits if earlier is None else earlier.covering(before.limits)
        self._inputs = replace(self._inputs, position_error=solver.settings.obstacle_position_error)
        # What is being prepared counts the objects held before.
        self._generation += 1
        query = self._arm_taken(prepared)
        played, followed = self._stream.played, self._stream.followed
        self._stream.take_certifier(solver.certifier)
        if played is not None:
            self._stream.replace_certificate(self._judged(played.reference, played.begin))
        if followed is not None:
            same = query if followed.query is prepared.before and query is not None else followed.query
            outdated = followed.outdated or solver.settings != before.settings
            self._stream.followed = replace(
                followed, query=same, last_search=None, path=None, rejected=None, outdated=outdated
            )
        names = ", ".join(held.name for held in self.held)
        return Verdict(reason=f"holding {names or 'nothing'}")

    def stand_at(self, configuration: np.ndarray, now: float) -> Plan:
        """Begin the stream anew: the arm stands in a configuration (eta,) [rad] at `now` [s]. A goal stays; a filter
        forgets what was offered.

        The plan's reference stays there. BAD_INPUT names the joint that is not finite or outside its limits, or a time
        that is none; then nothing changes.
        """
        refused = self._refused(now)
        if refused is not None:
            return refused
        checked = self._checked("state", configuration)
        if isinstance(checked, Refusal):
            return Plan(None, now, checked)
        standing = JointReference.standing(checked, np.zeros(self._latent_dimension))
        trajectory = self._judged(standing, now)
        self._ticked = now
        self._generation += 1
        self._stream.stand(trajectory, now)
        self._stands_anew()
        return Plan(trajectory, now, Verdict())

    def _judged(self, reference: JointReference, begin: float) -> JudgedTrajectory:
        """A motion that the arm makes anyway, from a time [s] on, with its certificate, whatever that states."""
        certifier, required = self._arm.solver.certifier, self._arm.solver.requirements.stop
        obstacles = self._inputs.enlarged_obstacles.at(begin, self.settings.prediction)
        certificate, _ = certifier.assess(certifier.sweep(reference), obstacles, required)
        return certifier.judge(reference, certificate)

    def _refused(self, now: float, *deadlines: Deadline) -> Plan | None:
        """Refuse a time [s] that is none, and what is no deadline: the arm plays on what it plays."""
        try:
            check_time("now", now)
            for deadline in deadlines:
                if not isinstance(deadline, Deadline):
                    raise PlanningError(f"the deadline is {deadline!r:.60}: a Deadline is needed, or NEVER")
        except PlanningError as error:
            verdict = Refusal(VerdictCode.BAD_INPUT, str(error))
            return Plan(None, self._ticked, verdict, mode=Mode.from_verdict(verdict))
        return None

    def _checked(self, what: str, configuration: np.ndarray) -> np.ndarray | Refusal:
        """A configuration (eta,) [rad], or why the arm cannot be there."""
        try:
            checked = self.robot.checked(configuration)
        except RobotError as error:
            return Refusal(VerdictCode.BAD_INPUT, f"{what}: {error}")
        return self._in_turn(checked)

    # ------------------------------------------------------------------ stream

    def commanded_state(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Return the position, velocity and acceleration (eta,) played at `time` [s]; None before the first `stand_at`.

        PlanningError where that is no time.
        """
        check_time("time", time)
        return self._stream.commanded_state(time)

    def is_moving(self, now: float) -> bool:
        """Tell whether a motion is being played at `now` [s]; PlanningError where that is no time."""
        check_time("now", now)
        return self._stream.is_moving(now)

    def remaining_motion(self, now: float) -> tuple[JointReference, float] | None:
        """Return the rest of the motion that is being played, from its last knot at or before `now` [s] on, and the
        time of that knot; None where no motion is known, or it is over. PlanningError where `now` is no time.
        """
        check_time("now", now)
        return self._stream.remaining_motion(now)

    def motion_to_goal(self) -> tuple[JointReference, float] | None:
        """Return the motion that is being played and the time of its first knot [s]; None where it leads to no goal."""
        return self._stream.motion_to_goal()

    def record_braking(self, reference: JointReference, begin: float, verdict: Refusal) -> None:
        """Record that the arm fell back to the stop at the end of what was sent: a reference that begins at a time [s].

        verdict : why. The next tick plans on from that stop. PlanningError where `begin` is no time.
        """
        check_time("begin", begin)
        self._stream.record_braking(self._judged(reference, begin), begin, verdict)

    def withdraw(self) -> None:
        """Take back what the newest `tick` or `stop` has handed out, which was not sent: the arm plays on what it
        played, and the next tick decides again. To be called before anything else is done.
        """
        self._stream, self._earlier_limits, aim = self._before
        if aim is not None:
            self._take_aim_back(aim)

    def tick(self, now: float, deadline: Deadline = NEVER, handover_deadline: Deadline = NEVER) -> Plan:
        """Make one step of the stream at `now` [s]: return what is to be played from `Plan.begin` on, and the verdict.

        The verdict is DEADLINE_MISSED where

        - `deadline` left no time for every attempt: the arm stops along its path, and the next ticks make the others.
          An arm that evades goes on as long as that is free, with the verdict that it has;
        - `handover_deadline` had passed when a trajectory was found, which would take over in the past: a path that is
          still free, to the goal or evading, stays. Without one the plan has no trajectory, and `stop` is to be called.

        BAD_INPUT names a time that is none, or a deadline; then nothing changes, and the arm plays on what it plays.
        """
        refused = self._refused(now, deadline, handover_deadline)
        if refused is not None:
            return refused
        self._ticked = now
        situation = self._situation(now, handover_deadline, deadline)
        if situation is None:
            verdict = Refusal(VerdictCode.STALE_STATE, "where the arm stands is not known yet")
            return Plan(None, now, verdict, mode=Mode.from_verdict(verdict))
        return self._decide(situation)

    def stop(self, now: float, verdict: Refusal, handover_deadline: Deadline = NEVER) -> Plan:
        """Come to rest along the path that is followed, for a reason; handover_deadline, BAD_INPUT : as of `tick`."""
        refused = self._refused(now, handover_deadline)
        if refused is not None:
            return refused
        situation = self._situation(now, handover_deadline)
        if situation is None:
            return Plan(None, now, verdict, mode=Mode.from_verdict(verdict))
        return self._stop(situation, verdict)

    def _situation(self, now: float, handover_deadline: Deadline, deadline: Deadline = NEVER) -> Situation | None:
        """The situation of a tick at `now` [s]; None where it is not known where the arm stands."""
        stream, inputs = self._stream, self._inputs
        if stream.played is None:
            return None
        certifier = self._arm.solver.certifier
        return Situation(
            self.settings, self.limits, certifier, stream.played, stream.followed, now, inputs.enlarged_obstacles,
            deadline, handover_deadline, self._reach, inputs.unchanged_since, self._earlier_limits,
            self._arm.solver.tool, inputs.late,
        )  # fmt: skip

    def _commit_step(self, situation: Situation, step: Step, aim: Any) -> Plan:
        """Play a step; aim : what the subclass is to get back where the step is withdrawn."""
        self._before = self._stream.kept(), self._earlier_limits, aim
        if not situation.exceeds_limits:
            self._earlier_limits = None
        plan = self._stream.commit(step, situation.now)
        return replace(plan, mode=situation.mode(step))

    # --------------------------------------------------------- what subclasses decide

    @abstractmethod
    def _decide(self, situation: Situation) -> Plan:
        """Decide what is played in a tick, and commit it (`_commit_step`)."""

    @abstractmethod
    def _stop(self, situation: Situation, verdict: Refusal) -> Plan:
        """Begin the soonest stop, and commit it."""

    @abstractmethod
    def _take_aim_back(self, aim: Any) -> None:
        """Take back what the newest step has changed beside the stream; aim : as of `_commit_step`."""

    @abstractmethod
    def _stands_anew(self) -> None:
        """Forget what depends on where the arm was: it stands elsewhere."""

    @abstractmethod
    def _prepared_arm(self, arm: Arm, holds_others: bool) -> PreparedArm[Arm]:
        """Prepare what depends on the arm; holds_others : it may hold other objects than before."""

    @abstractmethod
    def _arm_taken(self, prepared: PreparedArm[Arm]) -> Any:
        """Forget what depends on the arm before; returns what takes the place of `prepared.before`, None: nothing."""

    def _in_turn(self, configuration: np.ndarray) -> np.ndarray:
        """Return a configuration (eta,) [rad] with continuous joints in the turn that is planned in."""
        return configuration
