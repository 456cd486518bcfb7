"""JointSpacePlanner: goal, obstacles and the time -> joint reference and verdict, once per tick. Knows nothing of ROS.

The planner owns the stream (`joint_stream`): it plans from the state of motion in which a new reference takes over from
the one that is being played. A reference is certified for the whole arm, against obstacles that move on linearly for a
while, before it is handed out.

While nothing changes the reference stays. Otherwise the search is repeated, and the new way taken where it is a gain.
Where no way is left that can be certified the arm stops along the way it was going; where something is then coming to
where it stands, it gives way to it (`giving_way`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.errors import RobotError
from geodesic_motion_ros.giving_way import GivingWay
from geodesic_motion_ros.graph.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.graph.pose_graph import PoseGraph
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_query import GoalChoice, JointQuery, JointQueryBuilder
from geodesic_motion_ros.joint_reference import JointReference
from geodesic_motion_ros.joint_solver import Attempt, JointPlan, JointSolver, MotionState
from geodesic_motion_ros.joint_stream import Followed, JointStream, Moment
from geodesic_motion_ros.joint_timing import load_references
from geodesic_motion_ros.latent_way import load_search
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import JointPlannerSettings, PlannerSettings
from geodesic_motion_ros.planning.tool_query import ToolGoal, ToolQuery, ToolQueryBuilder
from geodesic_motion_ros.query import Pose, checked_pose
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: While a way is free, better ones are looked for so often [s]: with obstacles near it, and without.
_PERIOD_CLOSE, _PERIOD_FAR = 0.05, 0.1
#: Of times [s].
_ROUNDING = 1e-6


@dataclass(frozen=True)
class PreparedGoal:
    """A goal that is not refused, and the graph carried to it from where the stream was; None: that was not known.

    `stands` tells how often the arm had been said to stand somewhere by then.
    """

    choice: GoalChoice | ToolGoal
    query: JointQuery | ToolQuery | None
    stands: int


@dataclass(frozen=True)
class _Blocked:
    """What was tried in vain for an arm at rest among obstacles that stand: it need not be tried again."""

    query: JointQuery | ToolQuery
    obstacles: Obstacles
    attempts: frozenset[Attempt]
    verdict: Verdict


class JointSpacePlanner:
    """Plans on one joint-space skill: set a goal, set obstacles, tick.

    `tick`, `stop`, `stand_at` and what sets, takes or clears the goal are called by one thread. `plan` and what
    prepares a goal answer on their own, from any thread. Obstacles are replaced as a whole. All times are of one clock,
    the caller's.
    """

    def __init__(
        self,
        skill: Skill,
        settings: JointPlannerSettings | None = None,
        collision: CollisionModel | None = None,
        tool: PlannerSettings | None = None,
    ) -> None:
        """collision : the spheres that obstacles are kept away from; None: those of the skill's robot."""
        self.skill = skill
        self.settings = settings or JointPlannerSettings()
        self.robot = Robot.named(skill.robot)
        self.collision = collision or CollisionModel.named(skill.robot)
        self.graph: ConfigurationGraph | PoseGraph = skill.graph(self.settings.grid_shape, self.settings.neighbours)
        self.limits = JointLimits.of(self.robot, self.settings.speed_scale, self.settings.acceleration_scale)
        self._solver = JointSolver(skill, self.graph, self.settings, self.robot, self.collision, self.limits)
        self._queries: JointQueryBuilder | ToolQueryBuilder
        if isinstance(self.graph, PoseGraph):
            self._queries = ToolQueryBuilder(
                skill, self.graph, tool or PlannerSettings(), self.robot, self.collision
            )
        else:
            self._queries = JointQueryBuilder(skill, self.graph, self.settings, self.collision)
        self._obstacles = Obstacles.none()
        # The time of the newest tick [s].
        self._ticked = 0.0
        self._goal: GoalChoice | ToolGoal | None = None
        self._query: JointQuery | ToolQuery | None = None
        self._stream = JointStream(self.settings, self.limits, self._solver.certifier)
        self._stands = 0
        # The query for which there was no way the last time, and the attempt that was made then.
        self._without_way: JointQuery | ToolQuery | None = None
        self._attempted = 0
        self._blocked: _Blocked | None = None
        # When a trusting attempt was last made in vain [s].
        self._trusted = -np.inf
        self._giving_way = GivingWay(self.settings, self._solver, self._stream)
        self._warm_up()

    def _warm_up(self) -> None:
        """Load the compiled kernels, or compile them on the first start: no tick of the stream shall wait for that.

        A short stream with an obstacle, a new goal in motion and a stop; then all is forgotten.
        """
        start = self._queries.start_by_pose(Pose(self.skill.start_pose[:3], self.skill.start_pose[3:]))
        if isinstance(start, Verdict):
            start = self.robot.ready
        self.stand_at(start, 0.0)
        self.set_goal(self.skill.goal_pose[:3], self.skill.goal_pose[3:])
        for time in (0.0, 0.1, 0.2):
            self.take_obstacles(Obstacles.one_of_each(np.array([0.0, 0.0, 3.0 + time]), np.full(3, 1e-3), time))
            self.tick(time)
        self.set_goal(self.skill.goal_pose[:3], self.skill.goal_pose[3:])
        self.tick(0.3)
        if self._query is not None:
            load_search(self.graph, self._query, self.settings)
        load_references(self.limits)
        self.stop(0.4, Verdict(VerdictCode.NO_GOAL))
        self._obstacles = Obstacles.none()
        self._goal = self._query = None
        self._stream.forget()

    # ---------------------------------------------------------------- inputs

    def set_goal(self, position: np.ndarray, quaternion: np.ndarray) -> Verdict:
        """Ask for a goal pose of the tool, (3,) [m] and (4,) in the base frame: `take_goal` what was prepared."""
        return self.take_goal(self.prepared_goal(position, quaternion))

    def set_goal_configuration(self, configuration: np.ndarray) -> Verdict:
        """Ask for a goal configuration (eta,) [rad]; as `set_goal`."""
        return self.take_goal(self.prepared_configuration(configuration))

    def prepared_goal(self, position: np.ndarray, quaternion: np.ndarray) -> PreparedGoal | Verdict:
        """All that takes time of asking for a goal pose: any thread may do it while another one ticks.

        BAD_INPUT, GOAL_OUT_OF_SUPPORT or IN_COLLISION where the goal is refused.
        """
        pose, reason = checked_pose("goal", position, quaternion)
        if pose is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        if not self.robot.within_reach(pose.position):
            distance = np.linalg.norm(pose.position - self.robot.shoulder)
            return Verdict(
                VerdictCode.GOAL_OUT_OF_SUPPORT,
                f"the goal is {distance:.2f} m from the shoulder; the tool of the {self.skill.robot} reaches "
                f"{self.robot.reach:.2f} m",
            )
        return self._prepared(self._queries.goal_by_pose(pose))

    def prepared_configuration(self, configuration: np.ndarray) -> PreparedGoal | Verdict:
        """`prepared_goal` for a goal configuration (eta,) [rad]."""
        configuration, reason = self._checked("goal", configuration)
        if configuration is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        return self._prepared(self._queries.goal_by_configuration(configuration))

    def _prepared(self, choice: GoalChoice | ToolGoal | Verdict) -> PreparedGoal | Verdict:
        """The goal with the graph carried to it from where the stream is about to be, so that ticks remain short."""
        if isinstance(choice, Verdict):
            return choice
        # Whoever ticks may replace these meanwhile.
        stands, played, followed = self._stands, self._stream.played, self._stream.followed
        if played is None:
            return PreparedGoal(choice, None, stands)
        state = played.state_at_switch(self._ticked + self.settings.latency, followed)
        found = self._next_query(state, followed, choice)
        return PreparedGoal(choice, None if isinstance(found, Verdict) else found, stands)

    def take_goal(self, prepared: PreparedGoal | Verdict) -> Verdict:
        """Make a prepared goal the one that ticks plan to. Where it was refused the old goal stays, and the refusal is
        returned; the reason of an OK verdict states how the configuration was chosen.
        """
        if isinstance(prepared, Verdict):
            return prepared
        # What was carried from where the arm no longer is has to be carried anew.
        self._goal, self._query = prepared.choice, prepared.query if prepared.stands == self._stands else None
        return Verdict(VerdictCode.OK, f"goal: {prepared.choice.stated}")

    def clear_goal(self) -> None:
        """Forget the goal; ticks answer NO_GOAL until the next."""
        self._goal = self._query = None

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
        self._obstacles = obstacles
        return Verdict(VerdictCode.OK)

    def stand_at(self, configuration: np.ndarray, now: float) -> JointPlan:
        """The arm stands in a configuration (eta,) [rad] at `now` [s]: what was played is forgotten, the goal is not.

        The plan's reference stays there. BAD_INPUT names the joint that is not finite or outside its limits; then
        nothing changes.
        """
        configuration, reason = self._checked("state", configuration)
        if configuration is None:
            return JointPlan(None, now, Verdict(VerdictCode.BAD_INPUT, reason))
        standing = JointReference.standing(configuration, np.zeros(self.graph.latent.shape[1]))
        self._ticked = now
        self._stands += 1
        self._stream.stand(standing, now)
        self._query = None
        self._trusted = -np.inf
        self._giving_way.forget()
        self._blocked = None
        return JointPlan(standing, now, Verdict(VerdictCode.OK))

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

    def tick(self, now: float, deadline: Deadline = NEVER, late: Deadline = NEVER) -> JointPlan:
        """One step of the stream at `now` [s]: what is to be played, and the verdict.

        DEADLINE_MISSED where the deadline did not leave time for all that could be tried: then the arm stops along its
        way, and the next ticks go on trying. So too where `late` has passed by the time that a reference is found: it
        would take over in the past. A way that is still free, to the goal or aside, is gone on; without one, `stop` is
        to be asked for.
        """
        self._ticked = now
        stream, moment = self._stream, Moment(now, self._obstacles, late)
        if stream.played is None:
            return JointPlan(None, now, Verdict(VerdictCode.STALE_STATE, "where the arm stands is not known yet"))
        if self._goal is None:
            return stream.stopped(Verdict(VerdictCode.NO_GOAL, "no goal has been given"), moment)
        kept = self._kept(moment)
        if kept is not None:
            return kept
        state = stream.played.state_at_switch(now + self.settings.latency, stream.followed)
        obstacles = moment.obstacles.at(state.time, self.settings.prediction)
        query = self._query or self._next_query(state, stream.followed, self._goal)
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
            return stream.stopped(blocked.verdict, moment)
        known = followed.nodes if followed is not None and followed.keeps_off else None
        attempts = self._worthwhile_attempts(followed, now)
        plan = self._solver.solve(query, state, obstacles, attempts, deadline, known)
        plan = stream.stoppable(plan, obstacles)
        if followed is not None and (late.passed or not stream.gains(plan, followed, state.time)):
            found_again = plan.reference is None and plan.verdict.ok
            looked = followed.looked if found_again else followed.verdict.clearance
            return stream.continued(replace(followed, obstacles=moment.obstacles, searched=now, looked=looked), moment)
        self._without_way = query if plan.reference is None else None
        if plan.verdict.code is not VerdictCode.DEADLINE_MISSED:
            self._blocked = None
        if plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH and obstacles.stand and now >= stream.played.end:
            tried = frozenset(attempts) if blocked is None else blocked.attempts.union(attempts)
            self._blocked = _Blocked(query, moment.obstacles, tried, plan.verdict)
        out_of_time = late.passed or (plan.reference is None and deadline.passed)
        gone_on = self._giving_way.gone_on(state.time, moment) if out_of_time else None
        if gone_on is not None:
            return gone_on
        if plan.reference is None:
            aside = None if deadline.passed else self._giving_way.plan(query, state, plan.verdict, moment, deadline)
            return aside or stream.stopped(plan.verdict, moment)
        return stream.play(plan, Followed.begun(query, plan, moment), moment)

    def stop(self, now: float, verdict: Verdict, late: Deadline = NEVER) -> JointPlan:
        """Come to rest along the way being gone, for a reason; late : as of `tick`."""
        if self._stream.played is None:
            return JointPlan(None, now, verdict)
        return self._stream.stopped(verdict, Moment(now, self._obstacles, late))

    def plan(
        self,
        start_position: np.ndarray,
        start_quaternion: np.ndarray,
        goal_position: np.ndarray,
        goal_quaternion: np.ndarray,
    ) -> JointPlan:
        """A reference between two poses under the present obstacles; the stream of `tick` is not disturbed.

        It begins at rest, in the configuration near those demonstrated that holds the tool in the start pose.
        """
        ends = []
        for name, position, quaternion in (
            ("start", start_position, start_quaternion),
            ("goal", goal_position, goal_quaternion),
        ):
            pose, reason = checked_pose(name, position, quaternion)
            if pose is None:
                return JointPlan(None, 0.0, Verdict(VerdictCode.BAD_INPUT, reason))
            ends.append(pose)
        start = self._queries.start_by_pose(ends[0])
        goal = self._queries.goal_by_pose(ends[1])
        for found in (start, goal):
            if isinstance(found, Verdict):
                return JointPlan(None, 0.0, found)
        return self.plan_configurations(start, goal)

    def plan_configurations(self, start: np.ndarray, goal: GoalChoice | ToolGoal) -> JointPlan:
        """A reference from rest in a configuration (eta,) to a goal under the present obstacles."""
        query = self._queries.build(start, goal)
        if isinstance(query, Verdict):
            return JointPlan(None, 0.0, query)
        still = np.zeros_like(start)
        state = MotionState(self._obstacles.time, start, still, still, query.start_latent)
        return self._solver.solve(query, state, self._obstacles, self._solver.cautious)

    def _next_query(self, state: MotionState, followed: Followed | None, goal: GoalChoice | ToolGoal) -> JointQuery | ToolQuery | Verdict:
        """From where the stream is on its way, so that it goes on smoothly; anew where it stands at an end of it."""
        if followed is not None and state.latent is not None:
            query = self._queries.redirected(followed.query, state.position, state.latent, goal)
            if query is not None:
                return query
        return self._queries.build(state.position, goal)

    def _kept(self, moment: Moment) -> JointPlan | None:
        """What is being played, where nothing has changed: it is still the best way."""
        followed = self._stream.following(self._query)
        if followed is None:
            return None
        unchanged = followed.obstacles.unmoved_in(moment.obstacles)
        return JointPlan(None, moment.now, followed.verdict) if unchanged or not self.settings.avoidance else None

    def _worthwhile_attempts(self, followed: Followed | None, now: float) -> tuple[Attempt, ...]:
        """All where a way has just been lost, or not been looked for yet. One where it is free, or there was none the
        last time: then another one in every tick, and the first trusting one as often as better ways are looked for."""
        attempts = self._solver.attempts
        if followed is not None:
            return attempts[:1]
        if self._query is not self._without_way:
            self._attempted = 0
            return attempts
        cautious, trusting = self._solver.cautious, self._solver.trusting
        self._attempted = (self._attempted + 1) % len(cautious)
        if now < self._trusted + _PERIOD_CLOSE - _ROUNDING:
            return (cautious[self._attempted],)
        self._trusted = now
        return (cautious[self._attempted], *trusting[:1])

    def _still_blocked(self, query: JointQuery | ToolQuery) -> _Blocked | None:
        """What was tried in vain, where that has not changed."""
        blocked = self._blocked
        if blocked is None or blocked.query is not query or not blocked.obstacles.unmoved_in(self._obstacles):
            return None
        return blocked
