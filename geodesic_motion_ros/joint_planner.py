"""JointSpacePlanner: goal, obstacles and the time -> joint reference and verdict, once per tick. Knows nothing of ROS.

The planner owns the stream: it knows the reference that is being played, and therefore the state of motion in which a
new one takes over, a moment (`latency`) from now. A new reference repeats the old one until there, and is continuous
with it in position, velocity and acceleration; every reference ends at rest. It is certified for the whole arm, against
obstacles that move on linearly for a while, before it is handed out.

While nothing changes the reference stays. Otherwise the search is repeated, and the new way taken where it is a gain.
Where no way is left that can be certified the arm stops along the way it was going; where something is then coming to
where it stands, it gives way to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.arm_certificate import Certificate, SweptArm
from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.errors import RobotError
from geodesic_motion_ros.graph.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_query import GoalChoice, JointQuery, JointQueryBuilder
from geodesic_motion_ros.joint_reference import JointReference, joined, load_references, stopping_reference
from geodesic_motion_ros.joint_solver import Attempt, JointPlan, JointSolver, MotionState
from geodesic_motion_ros.latent_way import load_search
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import MOVING_MULTIPLE, JointPlannerSettings
from geodesic_motion_ros.query import checked_pose
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearance
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: A new way must take so much less time than the one being followed.
_WORTHWHILE = 1.05
#: Obstacles nearer than this to the way being followed make every bit of clearance a gain [m].
_CLOSE = 0.03
#: An obstacle has come nearer when it has by so much [m].
_NEARER = 1e-3
#: While a way is free, better ones are looked for so often [s]: with obstacles near it, and without.
_PERIOD_CLOSE, _PERIOD_FAR = 0.05, 0.1
#: Of times [s].
_ROUNDING = 1e-6
#: Knots are no nearer to each other [s].
_SHORTEST_INTERVAL = 1e-3
#: An arm without a way gives way to what comes within so many times the prediction: to get out of the way takes longer
#: than to stop.
_AHEAD = 2.0
#: No less than this share of what a way promised, or of the margin among obstacles that move, must be left.
_LEFT_OF_PROMISE = 0.5


@dataclass(frozen=True)
class PreparedGoal:
    """A goal that is not refused, and the graph carried to it from where the stream was; None: that was not known.

    `stands` tells how often the arm had been said to stand somewhere by then.
    """

    choice: GoalChoice
    query: JointQuery | None
    stands: int


@dataclass(frozen=True)
class _Played:
    """A reference and when it begins [s]."""

    reference: JointReference
    begin: float

    @property
    def end(self) -> float:
        return self.begin + self.reference.duration

    def switch(self, earliest: float) -> float:
        """When another one takes over, at or after a time [s]: no nearer to the knot before than may be."""
        return earliest if earliest >= self.end else max(earliest, self.knot_before(earliest) + _SHORTEST_INTERVAL)

    def knot_before(self, time: float) -> float:
        """The last knot at or before a time [s]; that time itself where the arm stands by then."""
        if time >= self.end:
            return time
        knots = self.begin + self.reference.times
        return float(knots[max(0, int(np.searchsorted(knots, time, side="right")) - 1)])


@dataclass(frozen=True)
class _Followed:
    """What the reference being played was planned for, its verdict, and when another was last looked for [s].

    The verdict tells the present clearance; `promised` was that of the plan, `looked` that when another curve was last
    drawn [m]. `nodes` and `trusting` as of `JointPlan`. `gives_way`: it leads aside, from where something is coming.
    """

    query: JointQuery
    verdict: Verdict
    obstacles: Obstacles
    searched: float
    promised: float
    looked: float
    nodes: np.ndarray | None = None
    trusting: bool = False
    gives_way: bool = False

    @property
    def keeps_off(self) -> bool:
        """Whether no obstacle is near, or has come nearer: then the same way again is no gain."""
        return self.verdict.clearance > min(_CLOSE, self.looked - _NEARER)


@dataclass(frozen=True)
class _Blocked:
    """What was tried in vain for an arm at rest among obstacles that stand: it need not be tried again."""

    query: JointQuery
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
        self, skill: Skill, settings: JointPlannerSettings | None = None, collision: CollisionModel | None = None
    ) -> None:
        """collision : the spheres that obstacles are kept away from; None: those of the skill's robot."""
        self.skill = skill
        self.settings = settings or JointPlannerSettings()
        self.robot = Robot.named(skill.robot)
        self.collision = collision or CollisionModel.named(skill.robot)
        self.graph: ConfigurationGraph = skill.graph(self.settings.grid_shape, self.settings.neighbours)
        self.limits = JointLimits.of(self.robot, self.settings.speed_scale, self.settings.acceleration_scale)
        self._solver = JointSolver(skill, self.graph, self.settings, self.robot, self.collision, self.limits)
        self._queries = JointQueryBuilder(skill, self.graph, self.settings, self.collision)
        self._obstacles = Obstacles.none()
        # The time of the newest tick [s], and when what it finds comes too late.
        self._ticked, self._late = 0.0, NEVER
        self._goal: GoalChoice | None = None
        self._query: JointQuery | None = None
        self._played: _Played | None = None
        # Where that takes the arm; None where nobody has asked yet.
        self._swept: SweptArm | None = None
        # What was played until this began: the arm's newest state may be older than that.
        self._played_before: _Played | None = None
        self._stands = 0
        self._followed: _Followed | None = None
        # The query for which there was no way the last time, and the attempt that was made then.
        self._without_way: JointQuery | None = None
        self._attempted = 0
        self._blocked: _Blocked | None = None
        # When a trusting attempt, and when a way aside, was last looked for in vain [s].
        self._trusted = self._looked_aside = -np.inf
        self._warm_up()

    def _warm_up(self) -> None:
        """Load the compiled kernels, or compile them on the first start: no tick of the stream shall wait for that.

        A short stream with an obstacle, a new goal in motion and a stop; then all is forgotten.
        """
        start, goal = self.graph.decoder.configurations(self.skill.codes[0, [0, -1]])
        self.stand_at(np.clip(start, self.limits.lower, self.limits.upper), 0.0)
        self.set_goal_configuration(np.clip(goal, self.limits.lower, self.limits.upper))
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
        self._goal = self._query = self._played = self._played_before = self._swept = self._followed = None

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

    def _prepared(self, choice: GoalChoice | Verdict) -> PreparedGoal | Verdict:
        """The goal with the graph carried to it from where the stream is about to be, so that ticks remain short."""
        judged = self._free_of_itself(choice) if isinstance(choice, GoalChoice) else choice
        if isinstance(judged, Verdict):
            return judged
        # Whoever ticks may replace these meanwhile.
        stands, played, followed = self._stands, self._played, self._followed
        if played is None:
            return PreparedGoal(judged, None, stands)
        found = self._next_query(self._state_at_switch(played, followed, self._ticked), followed, judged)
        return PreparedGoal(judged, found if isinstance(found, JointQuery) else None, stands)

    def take_goal(self, prepared: PreparedGoal | Verdict) -> Verdict:
        """Make a prepared goal the one that ticks plan to. Where it was refused the old goal stays, and the refusal is
        returned; the reason of an OK verdict states how the configuration was chosen.
        """
        if isinstance(prepared, Verdict):
            return prepared
        # What was carried from where the arm no longer is has to be carried anew.
        self._goal, self._query = prepared.choice, prepared.query if prepared.stands == self._stands else None
        return Verdict(VerdictCode.OK, f"goal: {prepared.choice.stated}")

    def _free_of_itself(self, choice: GoalChoice) -> GoalChoice | Verdict:
        """The configurations in which no two links touch."""
        found = [self_clearance(self.collision, self.robot, goal) for goal in choice.configurations]
        free = np.array([clearance > 0.0 for clearance, _ in found])
        if np.any(free):
            return replace(choice, configurations=choice.configurations[free])
        clearance, pair = found[0]
        first, second = (self.collision.link_of(sphere) for sphere in pair)
        reason = f"at the goal '{first}' and '{second}' would overlap by {-1000 * clearance:.0f} mm"
        return Verdict(VerdictCode.IN_COLLISION, reason, clearance=clearance)

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
        self._played, self._played_before, self._swept = _Played(standing, now), None, None
        self._followed = self._query = None
        self._trusted = self._looked_aside = -np.inf
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
        played = self._played
        if played is None:
            return None
        if time < played.begin and self._played_before is not None:
            played = self._played_before
        return played.reference.sample(time - played.begin)

    def playing(self, now: float) -> tuple[JointReference, float] | None:
        """What is being played from its last knot at or before `now` [s] on, and the time of that; None where that is
        not known, or over.
        """
        played = self._played
        if played is None or not played.begin <= now < played.end:
            return None
        knot = played.knot_before(now)
        return played.reference.rest(knot - played.begin), knot

    def braked(self, reference: JointReference, begin: float, verdict: Verdict) -> None:
        """The arm does not play what it was to play, but a reference that begins at a time [s] and is a stop: say why.

        The next tick plans on from there.
        """
        self._played_before = self._played
        self._played, self._swept = _Played(reference, begin), None
        if self._followed is not None:
            self._followed = replace(self._followed, verdict=verdict, nodes=None)

    def way(self) -> tuple[JointReference, float] | None:
        """What is being played and the time of its first knot [s], where it leads to the goal."""
        if self._played is None or self._followed is None or not self._followed.verdict.ok:
            return None
        return self._played.reference, self._played.begin

    def tick(self, now: float, deadline: Deadline = NEVER, late: Deadline = NEVER) -> JointPlan:
        """One step of the stream at `now` [s]: what is to be played, and the verdict.

        DEADLINE_MISSED where the deadline did not leave time for all that could be tried: then the arm stops along its
        way, and the next ticks go on trying. So too where `late` has passed by the time that a reference is found: it
        would take over in the past. A way that is still free is gone on; without one, `stop` is to be asked for.
        """
        self._ticked, self._late = now, late
        if self._played is None:
            return JointPlan(None, now, Verdict(VerdictCode.STALE_STATE, "where the arm stands is not known yet"))
        if self._goal is None:
            return self._stopped(now, Verdict(VerdictCode.NO_GOAL, "no goal has been given"))
        kept = self._kept(now)
        if kept is not None:
            return kept
        state = self._state_at_switch(self._played, self._followed, now)
        obstacles = self._obstacles.at(state.time, self.settings.prediction)
        query = self._query or self._next_query(state, self._followed, self._goal)
        if isinstance(query, Verdict):
            return self._stopped(now, query)
        self._query = query
        followed = self._free_way(state, obstacles)
        if followed is not None:
            period = _PERIOD_CLOSE if followed.verdict.clearance <= _CLOSE else _PERIOD_FAR
            if now < followed.searched + period - _ROUNDING:
                self._followed = followed
                return self._continued(now, followed)
        blocked = self._still_blocked(query)
        if blocked is not None and blocked.attempts.issuperset(self._solver.cautious):
            return self._stopped(now, blocked.verdict)
        known = followed.nodes if followed is not None and followed.keeps_off else None
        attempts = self._worthwhile_attempts(followed, now)
        plan = self._solver.solve(query, state, obstacles, attempts, deadline, known)
        if followed is not None and (late.passed or not self._gains(plan, followed, state)):
            found_again = plan.reference is None and plan.verdict.ok
            looked = followed.looked if found_again else followed.verdict.clearance
            self._followed = replace(followed, obstacles=self._obstacles, searched=now, looked=looked)
            return self._continued(now, followed)
        self._without_way = query if plan.reference is None else None
        if plan.verdict.code is not VerdictCode.DEADLINE_MISSED:
            self._blocked = None
        if plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH and obstacles.stand and now >= self._played.end:
            tried = frozenset(attempts) if blocked is None else blocked.attempts.union(attempts)
            self._blocked = _Blocked(query, self._obstacles, tried, plan.verdict)
        if plan.reference is None:
            aside = None if deadline.passed else self._aside(now, query, state, obstacles, plan.verdict, deadline)
            return aside or self._stopped(now, plan.verdict)
        nearest = plan.verdict.clearance
        found = _Followed(query, plan.verdict, self._obstacles, now, nearest, nearest, plan.nodes, plan.trusting)
        return self._play(plan.reference, now, state.time, found)

    def stop(self, now: float, verdict: Verdict, late: Deadline = NEVER) -> JointPlan:
        """Come to rest along the way being gone, for a reason; late : as of `tick`."""
        self._late = late
        return JointPlan(None, now, verdict) if self._played is None else self._stopped(now, verdict)

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

    def plan_configurations(self, start: np.ndarray, goal: GoalChoice) -> JointPlan:
        """A reference from rest in a configuration (eta,) to a goal under the present obstacles."""
        query = self._queries.build(start, goal)
        if isinstance(query, Verdict):
            return JointPlan(None, 0.0, query)
        still = np.zeros_like(start)
        state = MotionState(self._obstacles.time, start, still, still, query.start_latent)
        return self._solver.solve(query, state, self._obstacles, self._solver.cautious)

    def _state_at_switch(self, played: _Played, followed: _Followed | None, now: float) -> MotionState:
        time = played.switch(now + self.settings.latency)
        local = time - played.begin
        latent = None if followed is None else played.reference.latent_at(local)
        return MotionState(time, *played.reference.sample(local), latent)

    def _next_query(self, state: MotionState, followed: _Followed | None, goal: GoalChoice) -> JointQuery | Verdict:
        """From where the stream is on its way, so that it goes on smoothly; anew where it stands at an end of it."""
        if followed is not None and state.latent is not None:
            query = self._queries.redirected(followed.query, state.position, state.latent, goal)
            if query is not None:
                return query
        return self._queries.build(state.position, goal)

    def _kept(self, now: float) -> JointPlan | None:
        """What is being played, where nothing has changed: it is still the best way."""
        followed = self._followed
        if followed is None or followed.query is not self._query or not followed.verdict.ok:
            return None
        unchanged = followed.obstacles.unmoved_in(self._obstacles)
        return JointPlan(None, now, followed.verdict) if unchanged or not self.settings.avoidance else None

    def _free_way(self, state: MotionState, obstacles: Obstacles) -> _Followed | None:
        """What is being played, with its present clearance, where it leads to the present goal and is free."""
        followed, played = self._followed, self._played
        if followed is None or played is None or followed.query is not self._query or not followed.verdict.ok:
            return None
        left = self._left(played, state.time)
        certificate = self._solver.certifier.certify_swept(
            left, obstacles, self.settings.prediction, beyond=not followed.trusting
        )
        if self.settings.avoidance and self._solver.certifier.objection(certificate) is not None:
            return None
        return replace(followed, verdict=replace(followed.verdict, clearance=float(np.min(certificate.clearance))))

    def _left(self, played: _Played, time: float) -> SweptArm:
        """Where what is being played takes the arm from a time [s] on."""
        if self._swept is None:
            self._swept = self._solver.certifier.swept(played.reference)
        return self._swept.since(time - played.begin)

    def _worthwhile_attempts(self, followed: _Followed | None, now: float) -> tuple[Attempt, ...]:
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

    def _still_blocked(self, query: JointQuery) -> _Blocked | None:
        """What was tried in vain, where that has not changed."""
        blocked = self._blocked
        if blocked is None or blocked.query is not query or not blocked.obstacles.unmoved_in(self._obstacles):
            return None
        return blocked

    def _gains(self, plan: JointPlan, followed: _Followed, state: MotionState) -> bool:
        """Whether a new plan is safer than what is being played from a state on, or takes clearly less time."""
        assert self._played is not None
        if plan.reference is None:
            return False
        if followed.trusting and not plan.trusting:
            return True
        nearest, left = followed.verdict.clearance, self._played.end - state.time
        safer = self.settings.avoidance and nearest <= _CLOSE and plan.verdict.clearance > nearest
        return safer or left > _WORTHWHILE * plan.reference.duration

    def _continued(self, now: float, followed: _Followed) -> JointPlan:
        """What is being played, or a stop where obstacles have come nearer than expected and it keeps further off."""
        nearest = followed.verdict.clearance
        kept = min(followed.promised, MOVING_MULTIPLE * self.settings.obstacle_margin)
        if self.settings.avoidance and not self._obstacles.stand and nearest < _LEFT_OF_PROMISE * kept:
            _, _, certificate = self._stop(now)
            if np.min(certificate.clearance) > nearest:
                reason = f"an obstacle has come within {nearest:.3f} m of the way being gone"
                return self._stopped(now, Verdict(VerdictCode.NO_FEASIBLE_PATH, reason))
        return JointPlan(None, now, followed.verdict)

    def _aside(
        self,
        now: float,
        query: JointQuery,
        state: MotionState,
        obstacles: Obstacles,
        verdict: Verdict,
        deadline: Deadline,
    ) -> JointPlan | None:
        """A way aside where something comes to where the arm stops or stands, and it has no way to the goal.

        None where there is none, or nothing comes: then to stop along the way being gone is the answer.
        """
        assert self._played is not None
        if not self.settings.avoidance or obstacles.stand or verdict.code is not VerdictCode.NO_FEASIBLE_PATH:
            return None
        followed, certifier = self._followed, self._solver.certifier
        if followed is not None and followed.verdict.ok and now < self._played.end:
            left = certifier.swept(self._stop(now)[0])
        else:
            left = self._left(self._played, state.time)
        going = JointPlan(None, now, verdict) if followed is not None and followed.gives_way else None
        for horizon in (_AHEAD * self.settings.prediction, self.settings.prediction):
            certificate = certifier.certify_swept(left, obstacles, horizon, beyond=False)
            if certifier.objection(certificate) is None:
                return going
            looks = now >= self._looked_aside + _PERIOD_CLOSE - _ROUNDING
            plan = self._solver.aside(query, state, obstacles, horizon, deadline) if looks else None
            if plan is not None:
                break
        else:
            self._looked_aside = now if looks else self._looked_aside
            return None
        assert plan.reference is not None
        nearest = plan.verdict.clearance
        verdict = replace(verdict, clearance=nearest, reason=f"{verdict.reason}; giving way to what is coming")
        found = _Followed(query, verdict, self._obstacles, now, nearest, nearest, gives_way=True)
        return self._play(plan.reference, now, state.time, found)

    def _stop(self, now: float) -> tuple[JointReference, float, Certificate]:
        """The soonest stop along what is being played, when it takes over [s], and its certificate, which counts what
        comes to where the arm then stands.
        """
        assert self._played is not None
        prediction, certifier = self.settings.prediction, self._solver.certifier
        switch = self._played.switch(now + self.settings.latency)
        stop = stopping_reference(self._played.reference, switch - self._played.begin, self.limits)
        swept = certifier.swept(stop).lasting(prediction)
        return stop, switch, certifier.certify_swept(swept, self._obstacles.at(switch, prediction), prediction)

    def _stopped(self, now: float, verdict: Verdict) -> JointPlan:
        """A stop along the way being gone, or what is being played where that is one already."""
        assert self._played is not None
        followed = self._followed
        stops_already = followed is None or not (followed.verdict.ok or followed.gives_way)
        if stops_already or now >= self._played.end:
            return JointPlan(None, now, verdict)
        stop, switch, certificate = self._stop(now)
        objection = self._solver.certifier.objection(certificate)
        verdict = replace(verdict, clearance=float(np.min(certificate.clearance)))
        if objection is not None and self.settings.avoidance:
            verdict = replace(verdict, reason=f"{verdict.reason}; while stopping, {objection}")
        assert self._followed is not None
        nearest = verdict.clearance
        stopping = _Followed(self._followed.query, verdict, self._obstacles, now, nearest, nearest)
        return self._play(stop, now, switch, stopping)

    def _play(self, reference: JointReference, now: float, switch: float, followed: _Followed) -> JointPlan:
        """Hand out what is being played until the switch, and the new reference from there on; nothing if it is too
        late for that.
        """
        assert self._played is not None
        if self._late.passed:
            reason = (
                "what was found would take over in the past: the tick took longer than the setting latency, "
                f"{self.settings.latency:g} s, leaves; more latency, or a less busy machine, would do"
            )
            return JointPlan(None, now, Verdict(VerdictCode.DEADLINE_MISSED, reason))
        self._followed = followed
        begin = self._played.knot_before(now)
        self._played_before = self._played
        old = self._played.reference
        if not np.any(old.latent):
            # Where the arm stood before its first way had no latent point yet.
            old = replace(old, latent=np.repeat(reference.latent[:1], len(old.times), axis=0))
        whole = joined(old, begin - self._played.begin, reference, switch - self._played.begin)
        self._played, self._swept = _Played(whole, begin), None
        return JointPlan(whole, begin, followed.verdict)
