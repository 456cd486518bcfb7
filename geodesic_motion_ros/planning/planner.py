"""ReactivePlanner: goal, obstacles and the time -> what the arm plays and the verdict, once per tick. Knows nothing of
ROS.

One planner of configurations for every kind of skill: how a node of the latent graph gets its configuration is for
`configuration_query` (skills of configurations) and `tool_query` (skills of tool poses). The planner owns the stream
(`stream`): it plans from the state of motion in which a new trajectory takes over from the one that is being played. A
trajectory is certified for the whole arm, against obstacles that move on linearly for a while, before it is handed out.

While nothing changes the trajectory stays. Otherwise the search is repeated, and the new path taken where it is a gain.
Where no path is left that can be certified the arm stops along the one that it follows; where something is then coming
to where it stands, it evades (`evasion`). Where its goal is covered it goes as near as it can (`approach`).

A tick works out its `Situation` once, decides without changing anything, and commits the decision in one place.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Real

import numpy as np

from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.approach import approached, still_approaching
from geodesic_motion_ros.planning.attempt_memory import AttemptMemory, Blocked, DetourRequest, DetourSearch
from geodesic_motion_ros.planning.certificate import JudgedTrajectory
from geodesic_motion_ros.planning.configuration_query import ConfigurationQueryBuilder
from geodesic_motion_ros.planning.declared_scene import DeclaredScene, check_demonstrations
from geodesic_motion_ros.planning.detour import Detour, DetourPlanner
from geodesic_motion_ros.planning.detour_worker import DetourWorker, Search
from geodesic_motion_ros.planning.evasion import evaded, still_evading
from geodesic_motion_ros.planning.guarded_arm import GuardedArm, PreparedHold
from geodesic_motion_ros.planning.mission import Goal, GoalRequest, Inputs, Mission, PreparedGoal, Query
from geodesic_motion_ros.planning.mode import Mode
from geodesic_motion_ros.planning.plan import MotionState, Plan
from geodesic_motion_ros.planning.pose_query import Pose, checked_pose
from geodesic_motion_ros.planning.search import KnownPaths, load_search
from geodesic_motion_ros.planning.settings import Attempt, PlannerSettings
from geodesic_motion_ros.planning.situation import TIME_ROUNDING, Followed, Situation, Step
from geodesic_motion_ros.planning.solver import Solver
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.planning.stream import Stream
from geodesic_motion_ros.planning.tool_query import ToolQueryBuilder
from geodesic_motion_ros.planning.tracking import Tracking
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.held_objects import HeldObject, check_held
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.timing import load_references
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.utils.deadline import NEVER, Deadline
from geodesic_motion_ros.utils.errors import PlanningError, RobotError

#: A detour arrives so long after it was requested [s] where no other worker is given.
DETOUR_DELAY = 0.15


@dataclass(frozen=True, eq=False)
class _Decision:
    """What a tick comes to, and what is remembered of it; detour : what one is to be searched for from now on."""

    step: Step
    query: Query | None
    memory: AttemptMemory
    detour: DetourRequest | None = None


class ReactivePlanner:
    """Plans on one skill: set a goal, set obstacles, tick.

    `tick`, `stop`, `stand_at` and what sets, takes or clears the goal are called by one thread. `plan` and what
    prepares a goal answer on their own, from any thread. Obstacles are replaced as a whole. Poses and obstacles are of
    the base frame, all times are of one clock, the caller's.

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
        detours: DetourWorker | None = None,
        scene: DeclaredScene | None = None,
    ) -> None:
        """robot, collision : the arm, and the spheres that obstacles are kept away from; None: those of the skill's.

        detours : what searches detours; None: one whose results take `DETOUR_DELAY`. scene : what always stands
        around the arm; None: that is not known, and no motion leaves what was demonstrated. SkillError where a
        demonstration enters it.
        """
        self.skill = skill
        self.settings = settings or PlannerSettings()
        self.robot = robot or Robot.named(skill.robot)
        guarded = collision or CollisionModel.named(skill.robot)
        if self.settings.avoid == "tool":
            guarded = guarded.guarding_tool(self.robot, self.settings.tool_points, self.settings.tool_radii)
        self.graph: ConfigurationGraph | PoseGraph = skill.graph(self.settings.grid_shape, self.settings.neighbours)
        self.limits = JointLimits.of(self.robot, self.settings.speed_scale, self.settings.acceleration_scale)
        self.may_detour, self.scene = scene is not None, scene or DeclaredScene.empty()
        check_demonstrations(self.scene, skill, self.robot, CollisionModel.named(skill.robot))
        self._arm = GuardedArm.of(
            Solver(skill, self.graph, self.settings, self.robot, guarded, self.limits, self.scene)
        )
        self._worker = detours or DetourWorker(DETOUR_DELAY)
        self._stream = Stream(self._solver.certifier)
        self._inputs = Inputs(
            Obstacles.none(), self.settings.obstacle_position_error, Tracking(), TaskFrame.identity()
        )
        # How far a detour may lead [m]; any thread may set it.
        self._reach = self.settings.detour if self.may_detour else 0.0
        self._mission = Mission()
        self._memory = AttemptMemory()
        # The time of the newest tick [s], and how often the arm was said to stand somewhere, or to hold something.
        self._ticked, self._stands = 0.0, 0
        self._load_kernels()

    @property
    def collision(self) -> CollisionModel:
        """The spheres that obstacles are kept away from, those of held objects among them."""
        return self._arm.collision

    @property
    def held(self) -> tuple[HeldObject, ...]:
        """The objects in the hand."""
        return self._arm.objects

    @property
    def _solver(self) -> Solver:
        return self._arm.solver

    @property
    def _queries(self) -> ConfigurationQueryBuilder | ToolQueryBuilder:
        return self._arm.queries

    @property
    def _detours(self) -> DetourPlanner:
        return self._arm.detours

    def _load_kernels(self) -> None:
        """Load the compiled kernels, or compile them on the first start: no tick of the stream shall wait for that.

        A copy with a stream of its own plays a short one: with an obstacle, a new goal in motion, and a stop.
        """
        trial = copy.copy(self)
        trial._stream = Stream(self._solver.certifier)
        start = self._queries.start_by_pose(Pose(self.skill.start_pose[:3], self.skill.start_pose[3:]))
        trial.stand_at(self.robot.ready if isinstance(start, Verdict) else start, 0.0)
        goal = self.skill.goal_pose[:3], self.skill.goal_pose[3:]
        trial.set_goal(*goal)
        for time in (0.0, 0.1, 0.2):
            trial.take_obstacles(Obstacles.one_of_each(np.array([0.0, 0.0, 3.0 + time]), np.full(3, 1e-3), time))
            trial.tick(time)
        trial.set_goal(goal[0] + 0.003, goal[1])
        trial.tick(0.3)
        query, obstacles = trial._mission.query, trial._inputs.obstacles
        if query is not None:
            load_search(self.graph, query, self.settings)
        if query is not None and self.may_detour:
            self._detours.find(query, obstacles, 0.1)
            assert trial._stream.played is not None
            state = trial._stream.played.state_at_switch(0.3, trial._stream.followed)
            self._solver.evade_displaced(query, state, obstacles, 0.1, 0.1)
        load_references(self.limits, self._solver.tool)
        trial.stop(0.4, Verdict(VerdictCode.NO_GOAL))

    # ---------------------------------------------------------------- inputs

    def set_goal(self, position: np.ndarray, quaternion: np.ndarray, in_task_frame: bool = False) -> Verdict:
        """Request a goal pose of the tool, (3,) [m] and (4,): `take_goal` what was prepared."""
        return self.take_goal(self.prepared_goal(position, quaternion, in_task_frame))

    def set_goal_configuration(self, configuration: np.ndarray) -> Verdict:
        """Request a goal configuration (eta,) [rad]; as `set_goal`. With a skill of tool poses the pose of its tool
        counts: the posture there follows from the start.
        """
        return self.take_goal(self.prepared_configuration(configuration))

    def prepared_goal(
        self, position: np.ndarray, quaternion: np.ndarray, in_task_frame: bool = False
    ) -> PreparedGoal | Verdict:
        """All that takes time of requesting a goal pose: any thread may do it while another one ticks.

        BAD_INPUT, GOAL_OUT_OF_SUPPORT or IN_COLLISION where the goal is refused.

        Parameters
        ----------
        position, quaternion : (3,) [m] and (4,) in the base frame, or in the task frame, with which it then moves.
        """
        pose, reason = checked_pose("goal", position, quaternion)
        if pose is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        return self._prepared(GoalRequest(pose, in_task_frame), self._inputs.frame)

    def prepared_configuration(self, configuration: np.ndarray) -> PreparedGoal | Verdict:
        """`prepared_goal` for a goal configuration (eta,) [rad]."""
        checked, reason = self._checked("goal", configuration)
        if checked is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        return self._prepared(GoalRequest(configuration=checked), self._inputs.frame)

    def prepared_again(self) -> PreparedGoal | Verdict:
        """The requested goal, prepared anew as the task frame has moved; NO_GOAL before the first."""
        requested = self._mission.requested
        if requested is None:
            return Verdict(VerdictCode.NO_GOAL, "no goal has been given")
        return self._prepared(requested.request, self._inputs.frame)

    def _prepared(self, request: GoalRequest, frame: TaskFrame) -> PreparedGoal | Verdict:
        """The goal with the graph carried to it from where the stream is about to be, so that ticks remain short."""
        goal = self._found(request, frame)
        if isinstance(goal, Verdict):
            return goal
        # The thread that ticks may replace these meanwhile.
        stands, played, followed = self._stands, self._stream.played, self._stream.followed
        active = self._mission.active
        prepared = PreparedGoal(request, frame, goal, None, stands)
        if played is None or (active is not None and goal.is_same(active.goal)):
            return prepared
        state = played.state_at_switch(self._ticked + self.settings.latency, followed)
        found = self._next_query(state, followed, goal)
        return prepared if isinstance(found, Verdict) else replace(prepared, query=found)

    def _found(self, request: GoalRequest, frame: TaskFrame) -> Goal | Verdict:
        """What the skill has to go to, or why the request is refused."""
        if request.configuration is not None:
            return self._queries.goal_by_configuration(request.configuration, frame)
        assert request.pose is not None
        pose = request.pose
        if request.in_task_frame:
            pose = Pose(*frame.to_base(pose.position, pose.quaternion))
        if not self.robot.within_reach(pose.position):
            distance = np.linalg.norm(pose.position - self.robot.shoulder)
            return Verdict(
                VerdictCode.GOAL_OUT_OF_SUPPORT,
                f"the goal is {distance:.2f} m from the shoulder; the tool of the {self.skill.robot} reaches "
                f"{self.robot.reach:.2f} m",
            )
        return self._queries.goal_by_pose(pose, frame)

    def take_goal(self, prepared: PreparedGoal | Verdict) -> Verdict:
        """Make a prepared goal the one that ticks plan to: where it is hardly elsewhere, once the arm rests. Where it
        was refused the old goal stays, and the refusal is returned; the reason of an OK verdict states how the
        configuration was chosen.
        """
        if isinstance(prepared, Verdict):
            return prepared
        mission = replace(self._mission, requested=prepared)
        if mission.active is None or mission.query is None or not prepared.goal.is_near(mission.active.goal):
            # What was carried from where the arm no longer is has to be carried anew.
            mission = mission.activated(prepared, prepared.query if prepared.stands == self._stands else None)
        self._mission = mission
        return Verdict(VerdictCode.OK, f"goal: {prepared.goal.stated}")

    def set_task_frame(self, position: np.ndarray, quaternion: np.ndarray) -> Verdict:
        """Say where the frame that the skill was demonstrated in stands now: (3,) [m] and (4,) in the base frame.

        Goals and obstacles that were given in the base frame stay where they are. BAD_INPUT for a pose that is none;
        then the old frame stays. A goal that the frame takes out of the skill's support is dropped, with that verdict.
        """
        verdict = self.move_task_frame(position, quaternion)
        if not verdict.ok or self._mission.requested is None:
            return verdict
        prepared = self.prepared_again()
        if isinstance(prepared, Verdict):
            self.clear_goal()
        return self.take_goal(prepared)

    def move_task_frame(self, position: np.ndarray, quaternion: np.ndarray) -> Verdict:
        """`set_task_frame` that leaves the goal to be `prepared_again`, which takes time, and taken."""
        pose, reason = checked_pose("task frame", position, quaternion)
        if pose is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        frame = TaskFrame(pose.position, pose.quaternion)
        if not (frame.is_identity or isinstance(self._queries, ToolQueryBuilder)):
            reason = "a skill of joint space cannot follow a task frame that is not the base frame"
            return Verdict(VerdictCode.BAD_INPUT, reason)
        self._inputs = replace(self._inputs, frame=frame)
        return Verdict(VerdictCode.OK)

    def clear_goal(self) -> None:
        """Forget the goal; ticks answer NO_GOAL until the next."""
        self._mission = Mission()

    def set_obstacles(
        self, centres: np.ndarray, radii: np.ndarray, velocities: np.ndarray | None = None, time: float = 0.0
    ) -> Verdict:
        """Replace all obstacles by spheres, centres (o, 3), radii (o,) [m] and velocities (o, 3) [m/s] at `time` [s].

        BAD_INPUT names the first obstacle that is not finite or has no positive radius; then the old ones stay.
        """
        centres, radii = np.array(centres, dtype=float).reshape(-1, 3), np.array(radii, dtype=float).reshape(-1)
        velocities = np.zeros_like(centres) if velocities is None else np.array(velocities, dtype=float).reshape(-1, 3)
        if not len(centres) == len(radii) == len(velocities):
            reason = f"{len(centres)} obstacle centres, {len(radii)} radii, {len(velocities)} velocities"
            return Verdict(VerdictCode.BAD_INPUT, f"{reason}: expected as many of each")
        return self.take_obstacles(Obstacles.of_spheres(centres, radii, velocities, time))

    @property
    def obstacles(self) -> Obstacles:
        """Those that were taken last."""
        return self._inputs.obstacles

    def take_obstacles(self, obstacles: Obstacles) -> Verdict:
        """Replace all obstacles by others of every kind, in the base frame.

        BAD_INPUT names the first that is none; then the old ones stay.
        """
        objection = obstacles.objection()
        if objection:
            return Verdict(VerdictCode.BAD_INPUT, objection)
        unchanged = self._inputs.obstacles.is_unchanged(obstacles)
        since = self._inputs.unchanged_since if unchanged else self._ticked
        self._inputs = replace(self._inputs, obstacles=obstacles, unchanged_since=since)
        return Verdict(VerdictCode.OK)

    @property
    def tracking(self) -> Tracking:
        """How the arm follows what it is sent, as it counts."""
        return self._inputs.tracking

    def set_tracking(self, tracking: Tracking) -> None:
        """Say how the arm follows what it is sent: what is played is certified again for an arm that is late by up to
        that lag, and with so much more clearance; both are rounded up, to `LAG_STEP` and `TRACKING_ERROR_STEP`.
        """
        lag = _rounded_up(tracking.lag, constants.LAG_STEP)
        rounded = Tracking(lag, _rounded_up(tracking.error, constants.TRACKING_ERROR_STEP))
        if rounded != self._inputs.tracking:
            self._inputs = replace(self._inputs, tracking=rounded)

    def set_detour(self, reach: float) -> Verdict:
        """Say, from any thread, how far [m] the tool may leave what was demonstrated; a detour being followed stays.

        BAD_INPUT where that is negative, not finite or more than `LARGEST_DETOUR`, or more than 0 where no scene was
        declared; then nothing changes.
        """
        if not 0.0 <= reach <= constants.LARGEST_DETOUR:
            reason = f"detour {reach} m: it must be from 0 to {constants.LARGEST_DETOUR} m"
            return Verdict(VerdictCode.BAD_INPUT, reason)
        if reach > 0.0 and not self.may_detour:
            return Verdict(VerdictCode.BAD_INPUT, f"detour {reach} m: it is not known what stands around the arm")
        self._reach = float(reach)
        return Verdict(VerdictCode.OK)

    def hold(self, objects: Sequence[HeldObject]) -> Verdict:
        """Say what the hand holds from now on, all of it; nothing: (). `take_hold` what was prepared."""
        return self.take_hold(self.prepared_hold(objects))

    def prepared_hold(self, objects: Sequence[HeldObject]) -> PreparedHold | Verdict:
        """All that takes time of holding other objects: any thread may do it while another one ticks.

        BAD_INPUT where two objects have one name, or one is larger than the arm.
        """
        try:
            check_held(objects, self.robot)
        except RobotError as error:
            return Verdict(VerdictCode.BAD_INPUT, str(error))
        arm, before = self._arm.holding(objects), self._mission.query
        query = None if before is None else arm.queries.rebuilt(before)
        return PreparedHold(arm, before, None if isinstance(query, Verdict) else query)

    def take_hold(self, prepared: PreparedHold | Verdict) -> Verdict:
        """Count prepared objects from the next tick on: it judges what is being played anew, with them. What was found
        with those held before is forgotten. Where they were refused nothing changes, and the refusal is returned.
        """
        if isinstance(prepared, Verdict):
            return prepared
        self._arm = prepared.arm
        # What was carried meanwhile counts what was held before.
        self._stands += 1
        query = prepared.query if self._mission.query is prepared.before else None
        self._mission, self._memory = replace(self._mission, query=query), AttemptMemory()
        played, followed = self._stream.played, self._stream.followed
        self._stream.take_certifier(self._solver.certifier)
        if played is not None:
            self._stream.certify_anew(self._judged(played.reference, played.begin))
        if followed is not None:
            carried = query if followed.query is prepared.before and query is not None else followed.query
            self._stream.followed = replace(followed, query=carried, obstacles=None, path=None, rejected=None)
        names = ", ".join(held.name for held in self.held)
        return Verdict(VerdictCode.OK, f"holding {names or 'nothing'}")

    def stand_at(self, configuration: np.ndarray, now: float) -> Plan:
        """The arm stands in a configuration (eta,) [rad] at `now` [s]: what was played is forgotten, the goal is not.

        The plan's reference stays there. BAD_INPUT names the joint that is not finite or outside its limits; then
        nothing changes.
        """
        configuration, reason = self._checked("state", configuration)
        if configuration is None:
            return Plan(None, now, Verdict(VerdictCode.BAD_INPUT, reason))
        standing = JointReference.standing(configuration, np.zeros(self.graph.latent.shape[1]))
        trajectory = self._judged(standing, now)
        self._ticked = now
        self._stands += 1
        self._stream.stand(trajectory, now)
        self._mission, self._memory = replace(self._mission, query=None), AttemptMemory()
        return Plan(trajectory, now, Verdict(VerdictCode.OK))

    def _judged(self, reference: JointReference, begin: float) -> JudgedTrajectory:
        """What the arm does anyway from a time [s] on, with an honest certificate."""
        certifier, prediction = self._solver.certifier, self.settings.prediction
        certificate = certifier.certify(reference, self._inputs.enlarged.at(begin, prediction), prediction)
        return certifier.judged(reference, certificate)

    def _checked(self, what: str, configuration: np.ndarray) -> tuple[np.ndarray | None, str]:
        try:
            return self.robot.checked(configuration), ""
        except RobotError as error:
            return None, f"{what}: {error}"

    # ------------------------------------------------------------- planning

    def commanded(self, time: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Position, velocity and acceleration (eta,) played at `time` [s]; None before the first `stand_at`."""
        return self._stream.commanded(time)

    def playing(self, now: float) -> tuple[JointReference, float] | None:
        """What is being played from its last knot at or before `now` [s] on, and the time of that; None where that is
        not known, or over.
        """
        return self._stream.playing(now)

    def braked(self, reference: JointReference, begin: float, verdict: Verdict) -> None:
        """The arm does not play what it was to play, but a reference that begins at a time [s] and is a stop: say why.

        The next tick plans on from there.
        """
        self._stream.braked(self._judged(reference, begin), begin, verdict)

    def to_goal(self) -> tuple[JointReference, float] | None:
        """What is being played and the time of its first knot [s], where it leads to the goal."""
        return self._stream.to_goal()

    def tick(self, now: float, deadline: Deadline = NEVER, handover_deadline: Deadline = NEVER) -> Plan:
        """One step of the stream at `now` [s]: what is to be played, and the verdict.

        DEADLINE_MISSED where the deadline did not leave time for all that could be tried: then the arm stops along its
        path, and the next ticks go on trying. So too where `handover_deadline` has passed by the time that a trajectory
        is found: it would take over in the past. A path that is still free, to the goal or evading, stays; without one,
        `stop` is to be called.
        """
        if not isinstance(now, Real):
            raise PlanningError("tick(position, quaternion) is no more: stand_at(q, now) once, then tick(now)")
        self._ticked = now
        situation = self._situation(now, handover_deadline, deadline)
        if situation is None:
            verdict = Verdict(VerdictCode.STALE_STATE, "where the arm stands is not known yet")
            return Plan(None, now, verdict, mode=Mode.standing(verdict))
        mission = self._mission
        if situation.at_rest and mission.requested is not None:
            mission = mission.activated(mission.requested, None)
        return self._commit(situation, mission, self._decided(situation, mission))

    def stop(self, now: float, verdict: Verdict, handover_deadline: Deadline = NEVER) -> Plan:
        """Come to rest along the path being followed, for a reason; handover_deadline : as of `tick`."""
        situation = self._situation(now, handover_deadline)
        if situation is None:
            return Plan(None, now, verdict, mode=Mode.standing(verdict))
        mission = self._mission
        return self._commit(situation, mission, _Decision(situation.stopped(verdict), mission.query, self._memory))

    def _situation(
        self, now: float, handover_deadline: Deadline, deadline: Deadline = NEVER
    ) -> Situation | None:
        """None where it is not known where the arm stands."""
        stream, solver = self._stream, self._solver
        if stream.played is None:
            return None
        return Situation(
            self.settings, self.limits, solver.certifier, stream.played, stream.followed, now, self._inputs.enlarged,
            deadline, handover_deadline, self._reach,
        )  # fmt: skip

    def _commit(self, situation: Situation, mission: Mission, decision: _Decision) -> Plan:
        """Play what was decided, and remember it: nothing else in a tick changes the planner."""
        memory = decision.memory
        if decision.detour is not None:
            job = self._worker.start(self._detour_search(situation, decision.detour), situation.now)
            memory = replace(memory, detour=DetourSearch(job, decision.detour))
        self._mission, self._memory = replace(mission, query=decision.query), memory
        mode = situation.mode(decision.step)
        return replace(self._stream.take(decision.step, situation.now), mode=mode)

    def _decided(self, situation: Situation, mission: Mission) -> _Decision:
        """What is to be done, without doing it."""
        memory, query = self._memory, mission.query
        if mission.active is None:
            stop = situation.stopped(Verdict(VerdictCode.NO_GOAL, "no goal has been given"))
            return _Decision(stop, None, replace(memory, blocked_since=math.inf))
        following = situation.following(query)
        if following is not None and self._is_unchanged(following, situation):
            return _Decision(situation.answered(following.verdict), query, memory)
        if query is None:
            found = self._next_query(situation.state, situation.followed, mission.active.goal)
            if isinstance(found, Verdict):
                return _Decision(situation.stopped(found), None, memory)
            query = found
        followed = situation.free_path(query)
        if followed is not None and not followed.is_due(situation.now):
            return _Decision(situation.answered(followed.verdict, followed), query, memory)
        if followed is not None:
            return self._improved(situation, query, followed)
        goal = mission.active.goal
        decision = self._detoured(situation, query, goal) or self._searched_again(situation, query, goal)
        return self._explained(situation, decision, query, goal)

    def _searched_again(self, situation: Situation, query: Query, goal: Goal) -> _Decision:
        """What an arm without a path does: it goes on searching."""
        memory = self._memory
        blocked = memory.still_blocked(query, situation.obstacles)
        chosen, tried = self._query_to_try(situation, query, blocked, goal)
        if chosen is None:
            assert blocked is not None
            return _Decision(situation.stopped(blocked.verdict), query, memory)
        return self._searched(situation, chosen, tried)

    def _detoured(self, situation: Situation, query: Query, goal: Goal) -> _Decision | None:
        """A detour of an arm at rest that has had no path for long enough, or the search of one; None: neither.

        What was found is judged among the obstacles that are there by now; a search is begun again where they are
        others than it was begun with.
        """
        memory, search, now = self._memory, self._memory.detour, situation.now
        if self._reach == 0.0 or not situation.at_rest or math.isinf(memory.blocked_since):
            return None
        request = self._detour_request(situation, query, goal)
        if search is not None and (not search.job.done(now) or search.reason(request, now)):
            return None
        detour = None if search is None else search.found(request)
        if search is not None and detour is not None:
            plan = situation.require_a_stop(self._detours.plan(detour, situation.state, situation.expected))
            if plan.trajectory is not None:
                after = memory.after(plan, detour.query, None, (), situation)
                return self._taken(situation, detour.query, plan, after)
            search = replace(search, refusal=plan.verdict.reason)
        searching = self._searched_again(situation, query, goal)
        if searching.step.plan.trajectory is not None:
            return searching
        if search is not None and search.request.is_same(request):
            return replace(searching, memory=replace(searching.memory, detour=search))
        since = min(memory.blocked_since, self._inputs.unchanged_since)
        if now < since + self.settings.patience - TIME_ROUNDING:
            return searching
        return replace(searching, detour=request)

    def _detour_request(self, situation: Situation, query: Query, goal: Goal) -> DetourRequest:
        origin = self._memory.origin(query)
        return DetourRequest(origin, goal, situation.obstacles, self._reach, situation.state.position)

    def _explained(self, situation: Situation, decision: _Decision, query: Query, goal: Goal) -> _Decision:
        """A decision of an arm without a path, whose verdict says why no detour was found either."""
        search, plan = decision.memory.detour, decision.step.plan
        if search is None or plan.verdict.code is not VerdictCode.NO_FEASIBLE_PATH:
            return decision
        reason = search.reason(self._detour_request(situation, query, goal), situation.now)
        if not reason:
            return decision
        verdict = replace(plan.verdict, reason=self._without_detour(plan.verdict, reason))
        return replace(decision, step=replace(decision.step, plan=replace(plan, verdict=verdict)))

    def _detour_search(self, situation: Situation, request: DetourRequest) -> Search:
        """The search of a detour from where the arm stands."""
        query, latent, obstacles, arm = request.query, situation.state.latent, situation.expected, self._arm

        def search() -> Detour | str:
            here: Query | Verdict | None = query
            if not np.array_equal(query.start, request.position):
                here = None
                if latent is not None:
                    here = arm.queries.redirected(query, request.position, latent, request.goal)
                here = here or arm.queries.build(request.position, request.goal)
            return here.reason if isinstance(here, Verdict) else arm.detour(here, obstacles, request.reach)

        return search

    def _is_unchanged(self, followed: Followed, situation: Situation) -> bool:
        """Whether what is followed is still the best path, as nothing has changed."""
        if not self.settings.avoidance:
            return True
        return followed.obstacles is not None and followed.obstacles.is_unchanged(situation.obstacles)

    def _improved(self, situation: Situation, query: Query, followed: Followed) -> _Decision:
        """What is followed and free, or a new path where that is a gain."""
        attempts = self._solver.attempts[:1]
        plan = self._solved(situation, query, attempts, followed.known, situation.longest_worthwhile(followed))
        if not situation.handover_deadline.passed and situation.gains(plan, followed):
            return self._taken(situation, query, plan, self._memory.after(plan, query, None, attempts, situation))
        updated = replace(followed, obstacles=situation.obstacles, searched=situation.now)
        if plan.trajectory is not None or not plan.verdict.ok:
            updated = replace(updated, rejected=plan.path)
        return _Decision(situation.answered(updated.verdict, updated), query, self._memory)

    def _query_to_try(
        self, situation: Situation, query: Query, blocked: Blocked | None, goal: Goal
    ) -> tuple[Query | None, Blocked | None]:
        """The query that is searched next, and what was tried with that; None where everything was tried in full.

        The first is the one that the arm stopped on; then the same goal from where it stands, in each posture.
        """
        if blocked is None:
            # Another query was for obstacles that stood.
            origin = self._memory.origin(query)
            return (self._queries.first_posture(origin) if situation.at_rest else origin), None
        if not blocked.attempts.issuperset(self._solver.cautious):
            return query, blocked
        other, position = None, situation.state.position
        if query is blocked.origin and not np.array_equal(query.start, position):
            anew = self._queries.build(position, goal)
            other = None if isinstance(anew, Verdict) else anew
        other = other or self._queries.other_posture(query)
        if other is None and blocked.unfinished:
            return self._queries.first_posture(blocked.origin), None
        return other, replace(blocked, attempts=frozenset())

    def _searched(self, situation: Situation, query: Query, blocked: Blocked | None) -> _Decision:
        """A new path, or what an arm without one does; blocked : what was tried already."""
        attempts, memory = self._memory.chosen_attempts(self._solver, query, situation)
        plan = self._solved(situation, query, attempts, refusal=memory.refusal)
        memory = memory.after(plan, query, blocked, attempts, situation)
        if plan.trajectory is not None:
            return self._taken(situation, query, plan, memory)
        step = still_approaching(query, plan.verdict, situation)
        if step is None and (situation.deadline.passed or situation.handover_deadline.passed):
            step = still_evading(situation)
            if step is not None or situation.deadline.passed:
                return _Decision(step or situation.stopped(plan.verdict), query, memory.interrupted(plan.verdict))
        if step is None:
            step, failed = evaded(self._solver, query, plan.verdict, situation, memory.last_failed_evasion)
            memory = replace(memory, last_failed_evasion=failed)
        if (step is None or step.plan.trajectory is None) and memory.origin(query) is query:
            nearer, search = approached(self._solver, query, plan.verdict, situation, memory.approach)
            if search is memory.approach and (situation.deadline.passed or situation.handover_deadline.passed):
                memory = memory.interrupted(plan.verdict)
            memory = memory.after_approach(search, nearer is not None)
            step = nearer or step
        return _Decision(step or situation.stopped(plan.verdict), query, memory)

    def _solved(
        self,
        situation: Situation,
        query: Query,
        attempts: tuple[Attempt, ...],
        known: KnownPaths | None = None,
        longest: float = math.inf,
        refusal: Verdict | None = None,
    ) -> Plan:
        state, obstacles, deadline = situation.state, situation.expected, situation.deadline
        plan = self._solver.solve(query, state, obstacles, attempts, deadline, known, longest, refusal)
        return situation.require_a_stop(plan)

    def _taken(self, situation: Situation, query: Query, plan: Plan, memory: AttemptMemory) -> _Decision:
        """A new path; found too late, the evasion path being played stays where it is free."""
        step = still_evading(situation) if situation.handover_deadline.passed else None
        return _Decision(step or situation.handed_out(plan, Followed.begun(query, plan, situation)), query, memory)

    def plan(
        self,
        start_position: np.ndarray,
        start_quaternion: np.ndarray,
        goal_position: np.ndarray,
        goal_quaternion: np.ndarray,
    ) -> Plan:
        """A reference between two poses under the present obstacles; the stream of `tick` is not disturbed.

        It begins at rest: in the configuration in which the arm stands, where that holds the tool in the start pose;
        else in one near those demonstrated, or near `Robot.ready`.
        """
        ends = []
        for name, position, quaternion in (
            ("start", start_position, start_quaternion),
            ("goal", goal_position, goal_quaternion),
        ):
            pose, reason = checked_pose(name, position, quaternion)
            if pose is None:
                return Plan(None, 0.0, Verdict(VerdictCode.BAD_INPUT, reason))
            ends.append(pose)
        start = self._standing_at(ends[0])
        if start is None:
            start = self._queries.start_by_pose(ends[0])
        goal = self._queries.goal_by_pose(ends[1], self._inputs.frame)
        for found in (start, goal):
            if isinstance(found, Verdict):
                return Plan(None, 0.0, found)
        return self.plan_configurations(start, goal)

    def _standing_at(self, pose: Pose) -> np.ndarray | None:
        """The configuration (eta,) that is commanded, where it holds the tool in a pose."""
        commanded = self._stream.commanded(self._ticked)
        if commanded is None or isinstance(self._queries, ConfigurationQueryBuilder):
            return None
        position, quaternion = self.robot.forward(commanded[0])
        near = np.linalg.norm(position - pose.position) <= constants.SAME_START[0]
        return commanded[0] if near and angle_between(quaternion, pose.quaternion) <= constants.SAME_START[1] else None

    def plan_configurations(self, start: np.ndarray, goal: Goal) -> Plan:
        """A reference from rest in a configuration (eta,) to a goal under the present obstacles."""
        query = self._queries.build(start, goal)
        if isinstance(query, Verdict):
            return Plan(None, 0.0, query)
        still = np.zeros_like(start)
        obstacles = self._inputs.enlarged
        state = MotionState(obstacles.time, start, still, still, query.start_latent)
        plan = self._solver.solve(query, state, obstacles, self._solver.cautious)
        if plan.verdict.code is not VerdictCode.NO_FEASIBLE_PATH or self._reach == 0.0:
            return plan
        detour = self._arm.detour(query, obstacles, self._reach)
        if isinstance(detour, str):
            return replace(plan, verdict=replace(plan.verdict, reason=self._without_detour(plan.verdict, detour)))
        return self._detours.plan(detour, state, obstacles)

    def _without_detour(self, verdict: Verdict, reason: str) -> str:
        """Why there is no path, and no detour either."""
        return f"{verdict.reason}; no detour of up to {100 * self._reach:.0f} cm: {reason}"

    def _next_query(self, state: MotionState, followed: Followed | None, goal: Goal) -> Query | Verdict:
        """From where the stream is on its path, so that it goes on smoothly; anew where it stands at an end of it."""
        if followed is not None and state.latent is not None:
            query = self._queries.redirected(followed.query, state.position, state.latent, goal)
            if query is not None:
                return query
        return self._queries.build(state.position, goal)


def _rounded_up(value: float, step: float) -> float:
    return step * math.ceil(value / step - TIME_ROUNDING)
