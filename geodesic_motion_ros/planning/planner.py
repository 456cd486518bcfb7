"""ReactivePlanner: goal, obstacles and the time -> joint reference and verdict, once per tick. Knows nothing of ROS.

One planner of configurations for every kind of skill: how a node of the latent graph gets its configuration is for
`configuration_query` (skills of configurations) and `tool_query` (skills of tool poses). The planner owns the stream
(`stream`): it plans from the state of motion in which a new reference takes over from the one that is being played. A
reference is certified for the whole arm, against obstacles that move on linearly for a while, before it is handed out.

While nothing changes the reference stays. Otherwise the search is repeated, and the new path taken where it is a gain.
Where no path is left that can be certified the arm stops along the one that it follows; where something is then coming
to where it stands, it evades (`evasion`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.errors import RobotError
from geodesic_motion_ros.graph.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.graph.pose_graph import PoseGraph
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_reference import JointReference
from geodesic_motion_ros.joint_timing import load_references
from geodesic_motion_ros.latent_way import load_search
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.planning.configuration_query import (
    ConfigurationGoal,
    ConfigurationQuery,
    ConfigurationQueryBuilder,
)
from geodesic_motion_ros.planning.evasion import Evasion
from geodesic_motion_ros.planning.solver import Attempt, MotionState, Plan, Solver
from geodesic_motion_ros.planning.stream import Followed, Moment, Stream
from geodesic_motion_ros.planning.tool_query import ToolGoal, ToolQuery, ToolQueryBuilder
from geodesic_motion_ros.planning.tracking import Tracking
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.query import Pose, checked_pose
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.task_frame import TaskFrame
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: While a path is free, better ones are looked for so often [s]: with obstacles near it, and without.
_PERIOD_CLOSE, _PERIOD_FAR = 0.05, 0.1
#: Steps in which the tracking error counts [m], and the lag [s].
_ERROR_STEP, _LAG_STEP = 1e-3, 0.01
#: Of times [s], and of shares.
_ROUNDING = 1e-6
#: `plan` begins in the posture in which the arm stands where its tool is this near the requested start [m], [rad].
_SAME_START = 0.005, 0.02

Goal = ConfigurationGoal | ToolGoal
Query = ConfigurationQuery | ToolQuery


@dataclass(frozen=True, eq=False)
class GoalRequest:
    """A goal as it was requested: a pose, in the base frame or the task frame, with which it then moves; or a
    configuration (eta,) [rad].
    """

    pose: Pose | None = None
    in_task_frame: bool = False
    configuration: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class PreparedGoal:
    """A goal that is not refused, the task frame that it is of, and the graph carried to it from where the stream was;
    None: that was not known, or there is no path.

    `stands` tells how often the arm had been said to stand somewhere by then.
    """

    request: GoalRequest
    frame: TaskFrame
    goal: Goal
    query: Query | None
    stands: int


@dataclass(frozen=True)
class _Blocked:
    """What was tried for an arm at rest among obstacles that stand, and found no path: it need not be tried again."""

    query: Query
    obstacles: Obstacles
    attempts: frozenset[Attempt]
    verdict: Verdict


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
    >>> plan = planner.tick(now=0.0)  # plan.reference is played from plan.begin on; plan.verdict tells why it is None
    """

    def __init__(
        self,
        skill: Skill,
        settings: PlannerSettings | None = None,
        robot: Robot | None = None,
        collision: CollisionModel | None = None,
    ) -> None:
        """robot, collision : the arm, and the spheres that obstacles are kept away from; None: those of the skill's."""
        self.skill = skill
        self.settings = settings or PlannerSettings()
        self.robot = robot or Robot.named(skill.robot)
        arm = collision or CollisionModel.named(skill.robot)
        if self.settings.avoid == "tool":
            arm = arm.guarding_tool(self.robot, self.settings.tool_points, self.settings.tool_radii)
        self.collision = arm
        self.graph: ConfigurationGraph | PoseGraph = skill.graph(self.settings.grid_shape, self.settings.neighbours)
        self.limits = JointLimits.of(self.robot, self.settings.speed_scale, self.settings.acceleration_scale)
        self._solver = Solver(skill, self.graph, self.settings, self.robot, self.collision, self.limits)
        self._queries: ConfigurationQueryBuilder | ToolQueryBuilder
        if isinstance(self.graph, PoseGraph):
            self._queries = ToolQueryBuilder(skill, self.graph, self.settings, self.robot, self.collision)
        else:
            self._queries = ConfigurationQueryBuilder(skill, self.graph, self.settings, self.collision)
        # As they were received, and as large as they are taken to be.
        self._received = self._obstacles = Obstacles.none()
        self.tracking = Tracking()
        self._frame = TaskFrame.identity()
        # The time of the newest tick [s].
        self._ticked = 0.0
        self._requested: PreparedGoal | None = None
        # The requested one, but while that is hardly elsewhere and the arm moves.
        self._active: PreparedGoal | None = None
        self._query: Query | None = None
        self._stream = Stream(self.settings, self.limits, self._solver.certifier)
        self._stands = 0
        # The query for which there was no path the last time, and the attempt that was made then.
        self._without_path: Query | None = None
        self._attempted = 0
        self._blocked: _Blocked | None = None
        # When an optimistic attempt last failed [s].
        self._last_failed_optimistic_search = -np.inf
        self._evasion = Evasion(self.settings, self._solver, self._stream)
        self._warm_up()

    def _warm_up(self) -> None:
        """Load the compiled kernels, or compile them on the first start: no tick of the stream shall wait for that.

        A short stream with an obstacle, a new goal in motion and a stop; then all is forgotten.
        """
        start = self._queries.start_by_pose(Pose(self.skill.start_pose[:3], self.skill.start_pose[3:]))
        self.stand_at(self.robot.ready if isinstance(start, Verdict) else start, 0.0)
        goal = self.skill.goal_pose[:3], self.skill.goal_pose[3:]
        self.set_goal(*goal)
        for time in (0.0, 0.1, 0.2):
            self.take_obstacles(Obstacles.one_of_each(np.array([0.0, 0.0, 3.0 + time]), np.full(3, 1e-3), time))
            self.tick(time)
        self.set_goal(goal[0] + 0.003, goal[1])
        self.tick(0.3)
        if self._query is not None:
            load_search(self.graph, self._query, self.settings)
        load_references(self.limits, self._solver.tool)
        self.stop(0.4, Verdict(VerdictCode.NO_GOAL))
        self._received = self._obstacles = Obstacles.none()
        self._requested = self._active = self._query = None
        self._stream.forget()

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
        return self._prepared(GoalRequest(pose, in_task_frame), self._frame)

    def prepared_configuration(self, configuration: np.ndarray) -> PreparedGoal | Verdict:
        """`prepared_goal` for a goal configuration (eta,) [rad]."""
        checked, reason = self._checked("goal", configuration)
        if checked is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        return self._prepared(GoalRequest(configuration=checked), self._frame)

    def prepared_again(self) -> PreparedGoal | Verdict:
        """The requested goal, prepared anew as the task frame has moved; NO_GOAL before the first."""
        requested = self._requested
        if requested is None:
            return Verdict(VerdictCode.NO_GOAL, "no goal has been given")
        return self._prepared(requested.request, self._frame)

    def _prepared(self, request: GoalRequest, frame: TaskFrame) -> PreparedGoal | Verdict:
        """The goal with the graph carried to it from where the stream is about to be, so that ticks remain short."""
        goal = self._found(request, frame)
        if isinstance(goal, Verdict):
            return goal
        # Whoever ticks may replace these meanwhile.
        stands, played, followed, active = self._stands, self._stream.played, self._stream.followed, self._active
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
        self._requested = prepared
        if self._active is None or self._query is None or not prepared.goal.is_near(self._active.goal):
            self._activate(prepared, prepared.query)
        return Verdict(VerdictCode.OK, f"goal: {prepared.goal.stated}")

    def _activate(self, prepared: PreparedGoal, query: Query | None) -> None:
        if self._active is not None and prepared.goal.is_same(self._active.goal):
            return
        # What was carried from where the arm no longer is has to be carried anew.
        self._active, self._query = prepared, query if prepared.stands == self._stands else None

    def set_task_frame(self, position: np.ndarray, quaternion: np.ndarray) -> Verdict:
        """Say where the frame that the skill was demonstrated in stands now: (3,) [m] and (4,) in the base frame.

        Goals and obstacles that were given in the base frame stay where they are. BAD_INPUT for a pose that is none;
        then the old frame stays. A goal that the frame takes out of the skill's support is dropped, with that verdict.
        """
        verdict = self.move_task_frame(position, quaternion)
        if not verdict.ok or self._requested is None:
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
        self._frame = frame
        return Verdict(VerdictCode.OK)

    def clear_goal(self) -> None:
        """Forget the goal; ticks answer NO_GOAL until the next."""
        self._requested = self._active = self._query = None

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

    def take_obstacles(self, obstacles: Obstacles) -> Verdict:
        """Replace all obstacles by others of every kind, in the base frame.

        BAD_INPUT names the first that is none; then the old ones stay.
        """
        objection = obstacles.objection()
        if objection:
            return Verdict(VerdictCode.BAD_INPUT, objection)
        self._received = obstacles
        self._obstacles = self._as_the_arm_meets(obstacles)
        return Verdict(VerdictCode.OK)

    def set_tracking(self, tracking: Tracking) -> None:
        """Say how the arm follows what it is sent: what is played is certified again for an arm that is late by up to
        that lag, and with so much more clearance; both are rounded up, to 10 ms and millimetres.
        """
        rounded = Tracking(_rounded_up(tracking.lag, _LAG_STEP), _rounded_up(tracking.error, _ERROR_STEP))
        if rounded != self.tracking:
            self.tracking = rounded
            self._obstacles = self._as_the_arm_meets(self._received)

    def _as_the_arm_meets(self, obstacles: Obstacles) -> Obstacles:
        """Obstacles as they were received, as large as they are taken to be: larger by how far they may be from there,
        and the arm's links off the path; and, where they move, covering where they are until an arm that lags has come.
        """
        larger = obstacles.enlarged(self.settings.obstacle_position_error + self.tracking.error)
        return larger.throughout(self.tracking.lag)

    def stand_at(self, configuration: np.ndarray, now: float) -> Plan:
        """The arm stands in a configuration (eta,) [rad] at `now` [s]: what was played is forgotten, the goal is not.

        The plan's reference stays there. BAD_INPUT names the joint that is not finite or outside its limits; then
        nothing changes.
        """
        configuration, reason = self._checked("state", configuration)
        if configuration is None:
            return Plan(None, now, Verdict(VerdictCode.BAD_INPUT, reason))
        standing = JointReference.standing(configuration, np.zeros(self.graph.latent.shape[1]))
        self._ticked = now
        self._stands += 1
        self._stream.stand(standing, now)
        self._query = None
        self._last_failed_optimistic_search = -np.inf
        self._evasion.forget()
        self._blocked = None
        return Plan(standing, now, Verdict(VerdictCode.OK))

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
        self._stream.braked(reference, begin, verdict)

    def way(self) -> tuple[JointReference, float] | None:
        """What is being played and the time of its first knot [s], where it leads to the goal."""
        return self._stream.way()

    def tick(self, now: float, deadline: Deadline = NEVER, late: Deadline = NEVER) -> Plan:
        """One step of the stream at `now` [s]: what is to be played, and the verdict.

        DEADLINE_MISSED where the deadline did not leave time for all that could be tried: then the arm stops along its
        way, and the next ticks go on trying. So too where `late` has passed by the time that a reference is found: it
        would take over in the past. A way that is still free, to the goal or aside, is gone on; without one, `stop` is
        to be asked for.
        """
        plan = self._tick(now, deadline, late)
        return replace(plan, mode=self._stream.mode(now, plan.verdict))

    def _tick(self, now: float, deadline: Deadline, late: Deadline) -> Plan:
        """`tick` without the mode."""
        self._ticked = now
        stream, moment = self._stream, Moment(now, self._obstacles, late)
        if stream.played is None:
            return Plan(None, now, Verdict(VerdictCode.STALE_STATE, "where the arm stands is not known yet"))
        if now >= stream.played.end and self._requested is not None:
            self._activate(self._requested, None)
        if self._active is None:
            return stream.stopped(Verdict(VerdictCode.NO_GOAL, "no goal has been given"), moment)
        kept = self._kept(moment)
        if kept is not None:
            return kept
        state = stream.played.state_at_switch(now + self.settings.latency, stream.followed)
        obstacles = moment.obstacles.at(state.time, self.settings.prediction)
        query = self._query or self._next_query(state, stream.followed, self._active.goal)
        if isinstance(query, Verdict):
            return stream.stopped(query, moment)
        self._query = query
        followed = stream.free_way(query, state.time, obstacles)
        if followed is not None:
            period = _PERIOD_CLOSE if followed.close else _PERIOD_FAR
            if now < followed.searched + period - _ROUNDING:
                return stream.continued(followed, moment)
        blocked = self._still_blocked(query)
        if blocked is not None and blocked.attempts.issuperset(self._solver.cautious):
            other = self._queries.other_posture(query)
            if other is None:
                return stream.stopped(blocked.verdict, moment)
            self._query, query, blocked = other, other, None
        elif blocked is None and followed is None and now >= stream.played.end:
            # Another posture was for obstacles that stood.
            self._query = query = self._queries.first_posture(query)
        known = followed.nodes if followed is not None and followed.keeps_off else None
        attempts = self._worthwhile_attempts(followed, now)
        plan = self._solver.solve(query, state, obstacles, attempts, deadline, known)
        plan = stream.stoppable(plan, obstacles)
        if followed is not None and (late.passed or not stream.gains(plan, followed, state.time)):
            found_again = plan.reference is None and plan.verdict.ok
            looked = followed.looked if found_again else followed.verdict.clearance
            return stream.continued(replace(followed, obstacles=moment.obstacles, searched=now, looked=looked), moment)
        self._without_path = query if plan.reference is None else None
        if plan.verdict.code is not VerdictCode.DEADLINE_MISSED:
            self._blocked = None
        if plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH and obstacles.stand and now >= stream.played.end:
            tried = frozenset(attempts) if blocked is None else blocked.attempts.union(attempts)
            self._blocked = _Blocked(query, moment.obstacles, tried, plan.verdict)
        out_of_time = late.passed or (plan.reference is None and deadline.passed)
        gone_on = self._evasion.gone_on(state.time, moment) if out_of_time else None
        if gone_on is not None:
            return gone_on
        if plan.reference is None:
            aside = None if deadline.passed else self._evasion.plan(query, state, plan.verdict, moment, deadline)
            return aside or stream.stopped(plan.verdict, moment)
        return stream.play(plan, Followed.begun(query, plan, moment), moment)

    def stop(self, now: float, verdict: Verdict, late: Deadline = NEVER) -> Plan:
        """Come to rest along the way being gone, for a reason; late : as of `tick`."""
        stream = self._stream
        plan = Plan(None, now, verdict)
        if stream.played is not None:
            plan = stream.stopped(verdict, Moment(now, self._obstacles, late))
        return replace(plan, mode=stream.mode(now, plan.verdict))

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
        goal = self._queries.goal_by_pose(ends[1], self._frame)
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
        near = np.linalg.norm(position - pose.position) <= _SAME_START[0]
        return commanded[0] if near and angle_between(quaternion, pose.quaternion) <= _SAME_START[1] else None

    def plan_configurations(self, start: np.ndarray, goal: Goal) -> Plan:
        """A reference from rest in a configuration (eta,) to a goal under the present obstacles."""
        query = self._queries.build(start, goal)
        if isinstance(query, Verdict):
            return Plan(None, 0.0, query)
        still = np.zeros_like(start)
        state = MotionState(self._obstacles.time, start, still, still, query.start_latent)
        return self._solver.solve(query, state, self._obstacles, self._solver.cautious)

    def _next_query(self, state: MotionState, followed: Followed | None, goal: Goal) -> Query | Verdict:
        """From where the stream is on its way, so that it goes on smoothly; anew where it stands at an end of it."""
        if followed is not None and state.latent is not None:
            query = self._queries.redirected(followed.query, state.position, state.latent, goal)
            if query is not None:
                return query
        return self._queries.build(state.position, goal)

    def _kept(self, moment: Moment) -> Plan | None:
        """What is being played, where nothing has changed: it is still the best way."""
        followed = self._stream.following(self._query)
        if followed is None:
            return None
        unchanged = followed.obstacles.unmoved_in(moment.obstacles)
        return Plan(None, moment.now, followed.verdict) if unchanged or not self.settings.avoidance else None

    def _worthwhile_attempts(self, followed: Followed | None, now: float) -> tuple[Attempt, ...]:
        """All where a way has just been lost, or not been looked for yet. One where it is free, or there was none the
        last time: then another one in every tick, and the first trusting one as often as better ways are looked for."""
        attempts = self._solver.attempts
        if followed is not None:
            return attempts[:1]
        if self._query is not self._without_path:
            self._attempted = 0
            return attempts
        cautious, trusting = self._solver.cautious, self._solver.trusting
        self._attempted = (self._attempted + 1) % len(cautious)
        if now < self._last_failed_optimistic_search + _PERIOD_CLOSE - _ROUNDING:
            return (cautious[self._attempted],)
        self._last_failed_optimistic_search = now
        return (cautious[self._attempted], *trusting[:1])

    def _still_blocked(self, query: Query) -> _Blocked | None:
        """What was tried in vain, where that has not changed."""
        blocked = self._blocked
        if blocked is None or blocked.query is not query or not blocked.obstacles.unmoved_in(self._obstacles):
            return None
        return blocked


def _rounded_up(value: float, step: float) -> float:
    return step * math.ceil(value / step - _ROUNDING)
