"""ReactivePlanner: goal, obstacles and the time -> what the arm plays and the verdict, once per tick. Knows nothing of
ROS.

One planner of configurations serves every kind of skill: a query (`query`) has a configuration at each node of the
latent graph. The planner owns its inputs and the stream (`stream`): it plans from the state of motion in which a new
trajectory takes over from the one that is being played. A trajectory is certified for the whole arm, against obstacles
that move on linearly for the setting `prediction`, before it is handed out.

A tick works out its `Situation` once, decides without changing anything (`arbiter`), and commits that in one place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.certificate import JudgedTrajectory
from geodesic_motion_ros.certification.declared_scene import DeclaredScene, check_demonstrations
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.mode import Mode
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.motion.stream import Stream
from geodesic_motion_ros.motion.tracking import Tracking
from geodesic_motion_ros.motion.worker import Worker
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.arbiter import Arbiter, Decision
from geodesic_motion_ros.planning.guarded_arm import GuardedArm, PreparedArm
from geodesic_motion_ros.planning.memory import AttemptMemory, DetourSearch
from geodesic_motion_ros.planning.mission import GoalRequest, Inputs, Mission, NextRound, PreparedGoal
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.queries.output_space import OutputSpace
from geodesic_motion_ros.queries.pose_query import checked_pose
from geodesic_motion_ros.queries.query import ArmGoal
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject, check_held
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.timing import load_references
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.checked_numbers import LARGEST_NUMBER, check_number, check_time, real_array
from geodesic_motion_ros.utils.deadline import NEVER, Deadline
from geodesic_motion_ros.utils.errors import PlanningError, RobotError

#: The time from the request of a detour to its arrival [s], where no other worker is given.
DETOUR_DELAY = 0.15


class ReactivePlanner:
    """A planner of certified motions of one arm with one skill, as a stream: set a goal, set obstacles, tick.

    One thread calls `tick`, `stop`, `stand_at`, and the methods that set, take or clear a goal. Any thread may call
    `plan`, and the methods that prepare a goal. Obstacles are replaced as a whole. Poses and obstacles are of the base
    frame, all times are of one clock, the caller's.

    The first calls of a process load compiled kernels, or compile them: its first ticks take seconds. Where that would
    be too late call `kernels.loading.load_kernels(planner)` before the stream begins.

    Example
    -------
    >>> planner = ReactivePlanner(Skill.load("panda_pouring"))
    >>> planner.stand_at(q, now=0.0)
    >>> planner.set_goal(position, quaternion)
    >>> planner.set_obstacles(centres, radii, velocities, time=0.0)
    >>> plan = planner.tick(now=0.0)  # plan.reference is played from plan.begin on; plan.verdict states why it is None
    """

    def __init__(
        self,
        skill: Skill,
        settings: PlannerSettings | None = None,
        robot: Robot | None = None,
        collision: CollisionModel | None = None,
        detours: Worker | None = None,
        scene: DeclaredScene | None = None,
    ) -> None:
        """robot, collision : the arm, and the spheres that obstacles are kept away from; None: those of the skill's.

        detours : what searches detours; None: one whose results take `DETOUR_DELAY`. scene : what always stands
        around the arm; None: that is not known, and no motion leaves what was demonstrated. SkillError where a
        demonstration enters it.
        """
        self.skill = skill
        settings = settings or PlannerSettings()
        self.robot = robot or Robot.named(skill.robot)
        OutputSpace.of(skill).check_robot(self.robot)
        of_arm = CollisionModel.named(skill.robot)
        guarded = collision or of_arm
        if settings.avoid == "tool":
            guarded = guarded.guarding_tool(self.robot, settings.tool_points, settings.tool_radii)
        self.graph: ConfigurationGraph | PoseGraph = skill.graph(settings.grid_shape, settings.neighbours)
        limits = JointLimits.of(self.robot, settings.joint_speed_scale, settings.acceleration_scale)
        self.may_detour, self.scene = scene is not None, scene or DeclaredScene.empty()
        solver = Solver(skill, self.graph, settings, self.robot, guarded, limits, self.scene)
        if self.scene.names:
            check_demonstrations(self.scene, skill, *solver.space.demonstrated_spheres(skill, self.robot, of_arm))
        self._arm, self._stream = GuardedArm.of(solver), Stream(solver.certifier)
        self._worker = detours or Worker(DETOUR_DELAY)
        self._inputs = Inputs(Obstacles.none(), settings.obstacle_position_error, Tracking(), TaskFrame.identity())
        # How far a detour may lead [m]; any thread may set it.
        self._reach = settings.detour if self.may_detour else 0.0
        self._mission, self._memory = Mission(), AttemptMemory()
        # Limits that what is being played keeps; None: the present ones.
        self._earlier_limits: JointLimits | None = None
        # All that the last step has changed, as it was before.
        self._before: tuple[Stream, Mission, AttemptMemory, JointLimits | None]
        self._before = self._stream.kept(), self._mission, self._memory, None
        # The time of the newest tick [s].
        self._ticked = 0.0
        # It counts up when prepared goals become stale: the arm stands elsewhere, holds other objects, or has other
        # settings.
        self._generation = 0

    @property
    def arm(self) -> GuardedArm:
        """The arm with what it holds, as queries, motions and detours count it."""
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

    def set_goal(self, position: np.ndarray, quaternion: np.ndarray, in_task_frame: bool = False) -> Verdict:
        """Request a goal pose of the tool, (3,) [m] and (4,): prepare the goal and take it (`take_goal`)."""
        return self.take_goal(self.prepare_goal(position, quaternion, in_task_frame))

    def set_goal_configuration(self, configuration: np.ndarray) -> Verdict:
        """Request a goal configuration (eta,) [rad]; as `set_goal`. With a skill of tool poses only the tool's pose in
        that configuration is the goal: the posture there follows from the start.
        """
        return self.take_goal(self.prepare_configuration(configuration))

    def prepare_goal(
        self, position: np.ndarray, quaternion: np.ndarray, in_task_frame: bool = False
    ) -> PreparedGoal | Refusal:
        """Do the work that takes time of requesting a goal pose: any thread may do it while another one ticks.

        BAD_INPUT, GOAL_OUT_OF_SUPPORT or IN_COLLISION where the goal is refused.

        Parameters
        ----------
        position, quaternion : (3,) [m] and (4,) in the base frame, or in the task frame, with which it then moves.
        """
        pose = checked_pose("goal", position, quaternion)
        if isinstance(pose, Refusal):
            return pose
        return self._prepared(GoalRequest(pose, in_task_frame), self._inputs.frame)

    def prepare_configuration(self, configuration: np.ndarray) -> PreparedGoal | Refusal:
        """Prepare, as `prepare_goal` does, a goal configuration (eta,) [rad]."""
        checked = self._checked("goal", configuration)
        if isinstance(checked, Refusal):
            return checked
        return self._prepared(GoalRequest(configuration=checked), self._inputs.frame)

    def prepare(self, request: GoalRequest) -> PreparedGoal | Refusal:
        """Prepare a requested goal: a pose, as `prepare_goal`, or a configuration, as `prepare_configuration`."""
        if request.configuration is not None:
            return self.prepare_configuration(request.configuration)
        assert request.pose is not None
        return self.prepare_goal(request.pose.position, request.pose.quaternion, request.in_task_frame)

    def prepare_again(self) -> PreparedGoal | Refusal:
        """Prepare the requested goal anew, as the task frame has moved; NO_GOAL before the first."""
        requested = self._mission.requested
        if requested is None:
            return Refusal(VerdictCode.NO_GOAL, "no goal has been given")
        return self._prepared(requested.request, self._inputs.frame)

    def _prepared(self, request: GoalRequest, frame: TaskFrame) -> PreparedGoal | Refusal:
        """The goal with its query from where the stream is about to be, so that ticks remain short."""
        goal = self._arm.goal(request, frame)
        # The thread that ticks may replace these meanwhile.
        generation, played, followed = self._generation, self._stream.played, self._stream.followed
        kept = not isinstance(goal, Refusal) and self._mission.needs_no_query(goal)
        begin = self._ticked + self.latency
        state = None if kept or played is None else played.state_at_switch(begin, followed)
        if state is not None and not np.any(state.velocity) and request.pose is not None:
            goal = self._arm.queries.goal_in_place(request.pose, frame, state.position) or goal
        if isinstance(goal, Refusal):
            return goal
        prepared = PreparedGoal(request, frame, goal, None, generation)
        if state is None:
            return prepared
        found = self._arm.query_from(state, followed, goal, self._mission.rounds_to(request, goal))
        return prepared if isinstance(found, Refusal) else replace(prepared, query=found)

    def take_goal(self, prepared: PreparedGoal | Refusal) -> Verdict:
        """Make a prepared goal the one that ticks plan to.

        If it differs from the present goal by less than `NEAR_GOAL`, 2 mm and 0.01 rad, the switch waits until the arm
        rests. If it was refused, the present goal stays, and the refusal is returned. The reason of an OK verdict
        states how the goal configuration was chosen.
        """
        if isinstance(prepared, Refusal):
            return prepared
        mission = replace(self._mission, requested=prepared)
        if not mission.defers(prepared.goal):
            # A stale query begins where the arm is no more.
            mission = mission.activate(prepared, prepared.query if prepared.generation == self._generation else None)
        self._mission = mission
        return Verdict(reason=f"goal: {prepared.goal.stated}")

    def set_task_frame(self, position: np.ndarray, quaternion: np.ndarray) -> Verdict:
        """Say where the frame that the skill was demonstrated in stands now: (3,) [m] and (4,) in the base frame.

        Goals and obstacles that were given in the base frame stay where they are. BAD_INPUT for a pose that is none;
        then the old frame stays. A goal that the frame takes out of the skill's support is dropped, with that verdict.
        """
        verdict = self.move_task_frame(position, quaternion)
        if not verdict.ok or self._mission.requested is None:
            return verdict
        prepared = self.prepare_again()
        if isinstance(prepared, Refusal):
            self.clear_goal()
        return self.take_goal(prepared)

    def move_task_frame(self, position: np.ndarray, quaternion: np.ndarray) -> Verdict:
        """Move the task frame as `set_task_frame` does, without the goal: the caller prepares it again
        (`prepare_again`), which takes time, and takes it.
        """
        pose = checked_pose("task frame", position, quaternion)
        if isinstance(pose, Refusal):
            return pose
        frame = TaskFrame(pose.position, pose.quaternion)
        if not (frame.is_identity or self._arm.queries.follows_task_frame):
            reason = "a skill of joint space cannot follow a task frame that is not the base frame"
            return Refusal(VerdictCode.BAD_INPUT, reason)
        self._inputs = replace(self._inputs, frame=frame)
        return Verdict()

    def clear_goal(self) -> None:
        """Forget the goal; ticks answer NO_GOAL until the next."""
        self._mission = Mission()

    def set_obstacles(
        self, centres: np.ndarray, radii: np.ndarray, velocities: np.ndarray | None = None, time: float = 0.0
    ) -> Verdict:
        """Replace all obstacles by spheres, centres (o, 3), radii (o,) [m] and velocities (o, 3) [m/s] at `time` [s].

        BAD_INPUT names what has another shape, the first obstacle that is not finite or has no positive radius, or a
        time that is none; then the old ones stay.
        """
        try:
            centres, radii = real_array("obstacle centres", centres, ("o", 3)), real_array("radii", radii, ("o",))
            velocities = None if velocities is None else real_array("obstacle velocities", velocities, ("o", 3))
        except PlanningError as error:
            return Refusal(VerdictCode.BAD_INPUT, str(error))
        return self.take_obstacles(Obstacles.of_spheres(centres, radii, velocities, time))

    @property
    def obstacles(self) -> Obstacles:
        """The obstacles that were received last."""
        return self._inputs.obstacles

    def take_obstacles(self, obstacles: Obstacles) -> Verdict:
        """Replace all obstacles, of every kind, by others in the base frame.

        BAD_INPUT names the first obstacle that is not valid; then the old ones stay.
        """
        objection = obstacles.objection()
        if objection:
            return Refusal(VerdictCode.BAD_INPUT, objection)
        self._inputs = self._inputs.with_obstacles(obstacles, self._ticked)
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

    def set_detour(self, reach: float) -> Verdict:
        """Say, from any thread, how far [m] the tool may leave what was demonstrated; a detour being followed stays.

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

    def hold(self, objects: Sequence[HeldObject]) -> Verdict:
        """Say what the hand holds from now on, all of it; nothing: (). Prepares the objects and takes them."""
        return self.take_arm(self.prepare_arm(objects))

    def change_settings(self, **changes: Any) -> Verdict:
        """Change settings by their names, those of `CHANGEABLE`: prepares the change and takes it."""
        return self.take_arm(self.prepare_arm(None, **changes))

    def prepare_arm(self, objects: Sequence[HeldObject] | None = None, **changes: Any) -> PreparedArm | Refusal:
        """Do the work that takes time of holding other objects, and of changing settings: any thread may do it while
        another one ticks.

        BAD_INPUT where two objects have one name, or one is larger than the arm; where a setting cannot change, or has
        a value that it must not have.

        Parameters
        ----------
        objects : all that the hand holds from now on; None: as before. changes : settings of `CHANGEABLE`, by name.
        """
        arm, before = self._arm, self._mission.query
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
        query = before
        if before is not None and (objects is not None or settings.obstacle_margin != self.settings.obstacle_margin):
            rebuilt = changed.queries.rebuild(before)
            query = None if isinstance(rebuilt, Refusal) else rebuilt
        return PreparedArm(changed, before, query)

    def take_arm(self, prepared: PreparedArm | Refusal) -> Verdict:
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
        # A query that is being prepared counts the objects held before.
        self._generation += 1
        query = prepared.query if self._mission.query is prepared.before else None
        self._mission, self._memory = replace(self._mission, query=query), AttemptMemory()
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
        """Begin the stream anew: the arm stands in a configuration (eta,) [rad] at `now` [s]. The goal stays.

        The plan's reference stays there. BAD_INPUT names the joint that is not finite or outside its limits, or a time
        that is none; then nothing changes.
        """
        refused = self._refused(now)
        if refused is not None:
            return refused
        checked = self._checked("state", configuration)
        if isinstance(checked, Refusal):
            return Plan(None, now, checked)
        standing = JointReference.standing(checked, np.zeros(self.graph.latent.shape[1]))
        trajectory = self._judged(standing, now)
        self._ticked = now
        self._generation += 1
        self._stream.stand(trajectory, now)
        self._mission, self._memory = replace(self._mission, query=None), AttemptMemory()
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
        try:
            checked = self.robot.checked(configuration)
        except RobotError as error:
            return Refusal(VerdictCode.BAD_INPUT, f"{what}: {error}")
        return self._arm.queries.in_turn(checked)

    # ------------------------------------------------------------- planning

    def commanded_state(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Return the position, velocity and acceleration (eta,) played at `time` [s]; None before the first `stand_at`.

        PlanningError where that is no time.
        """
        check_time("time", time)
        return self._stream.commanded_state(time)

    def remaining_motion(self, now: float) -> tuple[JointReference, float] | None:
        """Return the rest of the motion that is being played, from its last knot at or before `now` [s] on, and the
        time of that knot; None where no motion is known, or it is over. PlanningError where `now` is no time.
        """
        check_time("now", now)
        return self._stream.remaining_motion(now)

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
        self._stream, self._mission, memory, self._earlier_limits = self._before
        # A search of a detour that was begun is not begun again.
        self._memory = replace(memory, detour=self._memory.detour or memory.detour)

    def motion_to_goal(self) -> tuple[JointReference, float] | None:
        """Return the motion that is being played and the time of its first knot [s]; None where it leads to no goal."""
        return self._stream.motion_to_goal()

    @property
    def round(self) -> int:
        """Number of the round to the goal in which a closed skill is, from 1 on; 0 before it sets out."""
        return 0 if self.skill.period is None else self._mission.round

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
        mission = self._mission
        if situation.at_rest and mission.requested is not None:
            mission = mission.activate(mission.requested, None)
        mission = self._with_next_round(situation, mission)
        return self._commit(situation, mission, Arbiter(self._arm, situation, mission, self._memory).decide())

    def stop(self, now: float, verdict: Refusal, handover_deadline: Deadline = NEVER) -> Plan:
        """Come to rest along the path that is followed, for a reason; handover_deadline, BAD_INPUT : as of `tick`."""
        refused = self._refused(now, handover_deadline)
        if refused is not None:
            return refused
        situation = self._situation(now, handover_deadline)
        if situation is None:
            return Plan(None, now, verdict, mode=Mode.from_verdict(verdict))
        mission = self._mission
        return self._commit(situation, mission, Decision(situation.begin_stop(verdict), mission.query, self._memory))

    def _with_next_round(self, situation: Situation, mission: Mission) -> Mission:
        """Begin to prepare the next round of a periodic motion, once half of the present one is left: the mission."""
        query, coming, settings = mission.query, mission.next_round, self.settings
        wanted = settings.periodic and (settings.rounds == 0 or mission.round < settings.rounds)
        following = situation.followed_to(query)
        if not wanted or query is None or query.round_frame is None or following is None:
            return replace(mission, next_round=None)
        if coming is not None and coming.after is query and not coming.has_failed(situation.now):
            return mission
        assert mission.active is not None
        if query.rounds_left(situation.state.latent_on(query)) > 0.5:
            return replace(mission, next_round=None)
        search = partial(self._arm.query_from, situation.state, following, mission.active.goal, rounds=1)
        return replace(mission, next_round=NextRound(query, self._worker.start(search, situation.now)))

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

    def _commit(self, situation: Situation, mission: Mission, decision: Decision) -> Plan:
        """Play a decision, and remember it: nothing else in a tick changes the planner."""
        self._before = self._stream.kept(), mission, self._memory, self._earlier_limits
        memory = decision.memory
        if decision.detour is not None:
            state, obstacles = situation.state, situation.expected_obstacles
            latent = None if state.latent is None else state.latent_on(decision.detour.query)
            search = partial(self._arm.find_requested_detour, decision.detour, latent, obstacles)
            memory = replace(memory, detour=DetourSearch(self._worker.start(search, situation.now), decision.detour))
        self._mission, self._memory = mission.after(decision.query, decision.step, situation.now), memory
        if not situation.exceeds_limits:
            self._earlier_limits = None
        plan = self._stream.commit(decision.step, situation.now)
        if plan.verdict.ok and self.round > 0:
            of = f" of {self.settings.rounds}" if self.settings.periodic and self.settings.rounds else ""
            plan = replace(plan, verdict=plan.verdict.with_remark(f"round {self.round}{of}"))
        return replace(plan, mode=situation.mode(decision.step))

    def plan(
        self,
        start_position: np.ndarray,
        start_quaternion: np.ndarray,
        goal_position: np.ndarray,
        goal_quaternion: np.ndarray,
    ) -> Plan:
        """Plan a reference between two poses under the present obstacles; the stream of `tick` is not disturbed.

        It begins at rest: in the configuration in which the arm stands, where that holds the tool in the start pose;
        else in one near those demonstrated, or near `Robot.ready`.
        """
        ends = []
        for name, *given in (("start", start_position, start_quaternion), ("goal", goal_position, goal_quaternion)):
            pose = checked_pose(name, *given)
            if isinstance(pose, Refusal):
                return Plan(None, 0.0, pose)
            ends.append(pose)
        commanded = self._stream.commanded_state(self._ticked)
        start = self._arm.queries.start_by_pose(ends[0], None if commanded is None else commanded[0])
        if isinstance(start, Refusal):
            return Plan(None, 0.0, start)
        goal = self._arm.queries.goal_by_pose(ends[1], self._inputs.frame)
        if isinstance(goal, Refusal):
            return Plan(None, 0.0, goal)
        return self.plan_configurations(start, goal)

    def plan_configurations(self, start: np.ndarray, goal: ArmGoal) -> Plan:
        """Plan a reference from rest in a configuration (eta,) to a goal under the present obstacles."""
        return self._arm.plan_from_rest(start, goal, self._inputs.enlarged_obstacles, self._reach)
