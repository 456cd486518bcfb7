"""ReactivePlanner: goal, obstacles and the present pose -> reference and verdict, once per tick. Knows nothing of ROS.

Poses and obstacles come in the base frame, and so do references leave; in between everything is in the task frame, the
frame that the skill was shown in (`task_frame`).

While the start moves along its own reference its query (the graph transported to start and goal) stays, and as long as
obstacles stay too, so does the reference itself. Otherwise the search is repeated. A new way begins with the velocity
that the tool has: it is bent to it, or, where it leads elsewhere, the tool stops along the old way first.

What moves counts as standing where it is expected to be after the prediction; where that leaves no way, a trusting one
is gone, which it has left by then. Where there is none either, or it would have to be passed in time, the tool stops;
where something is then coming to where it stands, it gives way to it (`pose_giving_way`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.aim import Aim, to_task
from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.graph.pose_graph import PoseGraph
from geodesic_motion_ros.latent_way import load_search
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.planning.pose_path import checked_spheres
from geodesic_motion_ros.pose_giving_way import PoseGivingWay
from geodesic_motion_ros.pose_smoothing import LAG
from geodesic_motion_ros.pose_solver import AT_REST, MOST_STRAIN, Motion, Plan, PoseSolver, Scene, refusal
from geodesic_motion_ros.pose_stream import PoseStream
from geodesic_motion_ros.quaternions import angle_between
from geodesic_motion_ros.query import Pose, Query, QueryBuilder, checked_pose
from geodesic_motion_ros.reference import ReferenceFollower, TaskSpaceReference
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.task_frame import TaskFrame
from geodesic_motion_ros.verdict import Verdict, VerdictCode

#: Trusting ways are looked for again after so long [s] where there was none.
_AGAIN = 0.05 - 1e-6


@dataclass(frozen=True)
class _Turned:
    """A query whose way turns off the motion that the stream had, among which obstacles, and what was said of it."""

    query: Query
    obstacles: Obstacles
    verdict: Verdict


@dataclass(frozen=True)
class PreparedGoal:
    """A goal that is not refused, in the task frame as it stood, and the graph carried to it.

    No query where it was not known where the stream is, or no way begins there, or the goal was told already.
    """

    aim: Aim
    verdict: Verdict
    query: Query | None


class ReactivePlanner:
    """Plans on one skill: set a goal, set obstacles, tick.

    `tick` serves one stream of poses; it, `stop`, and what sets, takes or clears the goal are called by one thread.
    `plan` and `prepared_goal` answer on their own, from any thread. Obstacles are replaced as a whole, so every step
    sees one consistent set.
    """

    def __init__(self, skill: Skill, settings: PlannerSettings | None = None) -> None:
        self.skill = skill
        self.settings = settings or PlannerSettings()
        self.graph: PoseGraph = skill.graph(self.settings.grid_shape, self.settings.neighbours)
        self._queries = QueryBuilder(skill, self.graph, self.settings)
        self.robot = Robot.named(skill.robot)
        self._solver = PoseSolver(skill, self.graph, self.settings, self.robot)
        self._scene = Scene.of(TaskFrame.identity(), Obstacles.none())
        # What ticks plan to; what was told last, which differs by little at most, and the query prepared for it.
        self._aim = self._told = Aim.none()
        self._prepared: Query | None = None
        self._query: Query | None = None
        self._stream = PoseStream(self.settings, self._solver)
        self._giving_way = PoseGivingWay(self.settings, self._solver, self._stream, self._queries.may_start)
        self._turned: _Turned | None = None
        # When a trusting way was looked for in vain [s].
        self._distrusted = -np.inf
        self._warm_up()

    def _warm_up(self) -> None:
        """Load the compiled kernels, or compile them on the first start: no tick of the stream shall wait for that.

        A short stream from the skill's start, with obstacles that stand and then move, a moving goal and a stop; then
        all is forgotten.
        """
        start, goal = np.split(self.skill.start_pose, [3]), np.split(self.skill.goal_pose, [3])
        self.set_goal(*goal)
        follower = ReferenceFollower(self.settings.speed)
        follower.reset(*start)
        for shift, velocity in ((0.0, 0.0), (0.0, 0.0), (0.003, 1e-3), (0.003, 1e-3)):
            self.take_obstacles(Obstacles.one_of_each(start[0] + [0.0, 0.0, 1.0], np.full(3, velocity), 0.0))
            self.set_goal(goal[0] + shift, goal[1])
            plan = self.tick(follower.position, follower.quaternion, follower.speed)
            if plan.reference is not None:
                follower.accept(plan.reference)
            follower.advance(0.1)
        if self._query is not None:
            load_search(self.graph, self._query, self.settings)
        self.stop(follower.position, follower.quaternion, follower.speed)
        self._aim = self._told = Aim.none()
        self._scene = Scene.of(self._aim.frame, Obstacles.none())
        self._prepared = self._query = self._turned = None
        self._stream.forget()
        self._distrusted = -np.inf
        self._giving_way.forget()

    # ---------------------------------------------------------------- inputs

    def set_goal(self, position: np.ndarray, quaternion: np.ndarray, in_task_frame: bool = False) -> Verdict:
        """Ask for a goal pose, (3,) [m] and (4,): `take_goal` what was prepared."""
        return self.take_goal(self.prepared_goal(position, quaternion, in_task_frame))

    def prepared_goal(
        self,
        position: np.ndarray,
        quaternion: np.ndarray,
        in_task_frame: bool = False,
        present: tuple[np.ndarray, np.ndarray, float] | None = None,
    ) -> PreparedGoal | Verdict:
        """All that takes time of asking for a goal pose: any thread may do it while another one ticks.

        BAD_INPUT or GOAL_OUT_OF_SUPPORT where the goal is refused.

        Parameters
        ----------
        position, quaternion : (3,) [m] and (4,) in the base frame, or in the task frame, with which it then moves.
        present : commanded tool pose, (3,) [m] and (4,), and its speed [m/s]: from there the graph is carried. None:
            the first tick does that, and takes longer.
        """
        pose, reason = checked_pose("goal", position, quaternion)
        if pose is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        # Whoever ticks may replace it meanwhile.
        told = self._told
        aim = Aim(pose, in_task_frame, told.frame)
        verdict = self._goal_verdict(aim.in_task(), aim.frame)
        if not verdict.ok:
            return verdict
        query = None
        if present is not None and not aim.is_same(told):
            query = self._next_query(to_task(aim.frame, Pose(*present[:2])), aim.in_task(), present[2])
        return PreparedGoal(aim, verdict, query if isinstance(query, Query) else None)

    def take_goal(self, prepared: PreparedGoal | Verdict) -> Verdict:
        """Make a prepared goal the one that ticks plan to: where it is hardly elsewhere (`aim`), once the tool rests.
        Where it was refused the old goal stays, and the refusal is returned.
        """
        if isinstance(prepared, Verdict):
            return prepared
        query = prepared.query if prepared.aim.frame is self._told.frame else None
        self._tell(replace(prepared.aim, frame=self._told.frame), query)
        return prepared.verdict

    def set_task_frame(self, position: np.ndarray, quaternion: np.ndarray) -> Verdict:
        """Say where the frame that the skill was shown in stands now: (3,) [m] and (4,) in the base frame.

        Goals and obstacles that were given in the base frame stay where they are. A frame that takes the goal hardly
        elsewhere (`aim`) moves it when the tool rests. BAD_INPUT for a pose that is none; then the old frame stays.
        """
        pose, reason = checked_pose("task frame", position, quaternion)
        if pose is None:
            return Verdict(VerdictCode.BAD_INPUT, reason)
        self._tell(replace(self._told, frame=TaskFrame(pose.position, pose.quaternion)), None)
        return Verdict(VerdictCode.OK)

    def _tell(self, told: Aim, prepared: Query | None) -> None:
        if told.is_same(self._told):
            return
        self._told, self._prepared = told, prepared
        if self._query is None or not told.is_near(self._aim):
            self._take_told()

    def _take_told(self) -> None:
        """Plan to what was told last from now on."""
        told, before = self._told, self._aim
        if told is before:
            return
        if told.frame is not before.frame:
            self._scene = Scene.of(told.frame, self._scene.in_base)
            self._stream.move_frame(before.frame, told.frame)
        self._aim, self._query, self._prepared = told, self._prepared, None

    def clear_goal(self) -> None:
        """Forget the goal; ticks answer NO_GOAL until the next."""
        self._told, self._prepared = replace(self._told, goal=None), None
        self._take_told()
        self._distrusted = -np.inf
        self._giving_way.forget()

    def set_obstacles(self, centres: np.ndarray, radii: np.ndarray) -> Verdict:
        """Replace all obstacles by spheres that stand, centres (o, 3) and radii (o,) [m] in the base frame.

        BAD_INPUT names the first obstacle that is not finite or has no positive radius; then the old ones stay.
        """
        spheres = checked_spheres(centres, radii)
        return spheres if isinstance(spheres, Verdict) else self.take_obstacles(spheres)

    def take_obstacles(self, obstacles: Obstacles) -> Verdict:
        """Replace all obstacles by others of every kind, in the base frame.

        BAD_INPUT names the first that is none; then the old ones stay.
        """
        objection = obstacles.objection()
        if objection:
            return Verdict(VerdictCode.BAD_INPUT, objection)
        self._scene = Scene.of(self._scene.frame, obstacles.distinct())
        return Verdict(VerdictCode.OK)

    # ------------------------------------------------------------- planning

    def tick(
        self,
        position: np.ndarray,
        quaternion: np.ndarray,
        speed: float = 0.0,
        deadline: Deadline = NEVER,
        now: float = 0.0,
    ) -> Plan:
        """One step of the stream: reference from the present commanded pose to the goal, and the verdict.

        DEADLINE_MISSED where the deadline left no time for all that could be tried, and nothing else is certified: what
        is being followed, to the goal or aside, is gone on as long as it is.

        Parameters
        ----------
        position, quaternion : (3,) [m] and (4,) commanded tool pose now; speed : its speed now [m/s].
        now : time of the clock that those of obstacles are of [s]: those that move are where they are by then.
        """
        start, reason = checked_pose("state", position, quaternion)
        if start is None:
            return refusal(VerdictCode.BAD_INPUT, reason)
        if speed <= 0.0 and not self._told.ends_with(self._aim):
            self._take_told()
        if self._aim.goal is None:
            return refusal(VerdictCode.NO_GOAL, "no goal has been given")
        scene = self._scene_at(now)
        plan = self._tick_in_task(to_task(scene.frame, start), self._aim.in_task(), scene, speed, deadline)
        return plan.in_base(scene.frame)

    def _scene_at(self, now: float) -> Scene:
        """The scene with obstacles that move where they are when the tool does what is planned at a time [s]."""
        scene = self._scene
        if scene.in_task.stand:
            return scene
        return replace(scene, in_task=scene.in_task.at(now + LAG, self.settings.prediction))

    def _tick_in_task(self, start: Pose, goal: Pose, scene: Scene, speed: float, deadline: Deadline) -> Plan:
        stream = self._stream
        motion = stream.motion(start, speed)
        kept = stream.kept(self._query, start, motion, scene)
        if kept is not None:
            return kept
        stopping = self._stopping_first(start, scene, speed)
        if stopping is not None:
            return stopping
        latent = self._locate(start, speed)
        if latent is None:
            query = self._next_query(start, goal, speed)
            if isinstance(query, Verdict):
                return self._stopped(Plan(None, query), stream.braking(start, scene.in_task, speed))
            self._query, latent = query, query.start_latent
        assert self._query is not None
        plan = self._solved(self._query, start, latent, scene, motion, deadline)
        plan = stream.chosen(plan, self._query, start, motion, scene)
        self._turned = _Turned(self._query, scene.in_task, plan.verdict) if plan.turning else None
        if plan.reference is not None and plan.reference.strain > MOST_STRAIN:
            plan = self._stop_first(plan, start, scene, speed)
        if plan.verdict.ok:
            return stream.begin(self._query, plan, scene)
        gone_on = self._gone_on(plan, start, motion, scene)
        if gone_on is not None:
            return gone_on
        if plan.blocked or (plan.turning and stream.gives_way):
            # A tool that gives way does not stop for a way that it can enter from rest alone.
            return self._without_way(plan.verdict, start, latent, scene, motion, deadline)
        return plan if plan.reference else self._stopped(plan, stream.braking(start, scene.in_task, speed))

    def _solved(
        self, query: Query, start: Pose, latent: np.ndarray, scene: Scene, motion: Motion, deadline: Deadline
    ) -> Plan:
        """A way where what moves counts as standing where it will be; where that leaves none, a trusting one."""
        plan = self._solver.solve(query, start, latent, scene, motion, deadline)
        now = scene.in_task.time
        looks = abs(now - self._distrusted) >= _AGAIN and not deadline.passed
        if plan.blocked and looks and not scene.in_task.stand:
            trusting = self._solver.solve(query, start, latent, scene, motion, deadline, trusting=True)
            plan = trusting if trusting.trusting else plan
            self._distrusted = self._distrusted if trusting.trusting else now
        return self._stream.stoppable(plan, start, motion, scene)

    def _gone_on(self, plan: Plan, start: Pose, motion: Motion, scene: Scene) -> Plan | None:
        """What is being followed, where no way was found or there was no time to: a way to the goal, or one aside."""
        assert self._query is not None
        going = self._stream.gone_on(self._query, start, motion, scene, plan.turning)
        if going is not None or plan.verdict.code is not VerdictCode.DEADLINE_MISSED:
            return going
        aside = self._giving_way.gone_on(start, motion, scene)
        return None if aside is None else self._stream.begin(self._query, aside, scene, gives_way=True)

    def _without_way(
        self, verdict: Verdict, start: Pose, latent: np.ndarray, scene: Scene, motion: Motion, deadline: Deadline
    ) -> Plan:
        """Give way to what is coming, go on past it, or come to rest."""
        assert self._query is not None
        stop = self._stream.braking(start, scene.in_task, motion.speed * self.settings.speed)
        plan = self._giving_way.plan(self._query, start, latent, scene, motion, verdict, stop, deadline)
        if plan is None or plan.reference is None:
            past = self._stream.gone_past(self._query, start, motion, scene, stop)
            return past or self._stopped(Plan(None, verdict), stop)
        return self._stream.begin(self._query, plan, scene, gives_way=True)

    def _stopped(self, plan: Plan, stop: TaskSpaceReference | None) -> Plan:
        """A plan without a reference with the stop along the way being followed, and what is met on it."""
        verdict = plan.verdict
        nearest = np.inf if stop is None else float(np.min(stop.clearance))
        if nearest <= 0.0 and self.settings.avoidance:
            reason = f"{verdict.reason}; while stopping, the tool overlaps an obstacle by {-1000 * nearest:.0f} mm"
            verdict = replace(verdict, reason=reason, clearance=nearest)
        return replace(plan, reference=stop, verdict=verdict)

    def _stopping_first(self, start: Pose, scene: Scene, speed: float) -> Plan | None:
        """The rest of a stop before a way that turns off the present motion: it will do so until the tool rests."""
        turned = self._turned
        if turned is None or speed <= 0.0 or turned.query is not self._query:
            return None
        if not turned.obstacles.unmoved_in(scene.in_task):
            return None
        braking = self._stream.free_braking(start, scene.in_task, speed)
        return None if braking is None else Plan(braking, turned.verdict, turning=True)

    def _stop_first(self, plan: Plan, start: Pose, scene: Scene, speed: float) -> Plan:
        """The stop before a way that is entered too fast; that way itself where the stop is not free."""
        braking = self._stream.free_braking(start, scene.in_task, speed)
        if braking is None:
            return plan
        reason = "stopping first: the way to the goal bends too much for the present speed"
        return Plan(braking, replace(plan.verdict, code=VerdictCode.NO_FEASIBLE_PATH, reason=reason), turning=True)

    def stop(
        self, position: np.ndarray, quaternion: np.ndarray, speed: float, now: float = 0.0
    ) -> TaskSpaceReference | None:
        """Ramped stop of the stream from the present commanded pose and speed [m/s], certified like any reference.

        None at rest and before the first reference: stay where you are. now : as of `tick`.
        """
        start, _ = checked_pose("state", position, quaternion)
        if start is None:
            return None
        scene = self._scene_at(now)
        reference = self._stream.braking(to_task(scene.frame, start), scene.in_task, speed)
        return None if reference is None else reference.moved(scene.frame.to_base)

    def plan(
        self,
        start_position: np.ndarray,
        start_quaternion: np.ndarray,
        goal_position: np.ndarray,
        goal_quaternion: np.ndarray,
    ) -> Plan:
        """A reference between two poses under the present obstacles; the stream of `tick` is not disturbed."""
        start, start_reason = checked_pose("start", start_position, start_quaternion)
        goal, goal_reason = checked_pose("goal", goal_position, goal_quaternion)
        if start is None or goal is None:
            return refusal(VerdictCode.BAD_INPUT, start_reason or goal_reason)
        scene = self._scene
        start, goal = to_task(scene.frame, start), to_task(scene.frame, goal)
        verdict = self._goal_verdict(goal, scene.frame)
        if not verdict.ok:
            return Plan(None, verdict)
        query = self._queries.build(start, goal)
        if isinstance(query, Verdict):
            return Plan(None, query)
        return self._solver.solve(query, start, query.start_latent, scene, AT_REST).in_base(scene.frame)

    def _goal_verdict(self, goal: Pose, frame: TaskFrame) -> Verdict:
        """Whether a goal (task frame) is within the arm's reach and within what was demonstrated."""
        beyond = self._solver.beyond_reach(goal.position[None], frame)
        if beyond:
            return Verdict(VerdictCode.GOAL_OUT_OF_SUPPORT, f"the goal is {beyond}")
        return self._queries.goal_verdict(goal)

    def query(
        self,
        start_position: np.ndarray,
        start_quaternion: np.ndarray,
        goal_position: np.ndarray,
        goal_quaternion: np.ndarray,
    ) -> Query | None:
        """The graph transported to a start and goal (task frame), to look at; None where `plan` would refuse them."""
        start, _ = checked_pose("start", start_position, start_quaternion)
        goal, _ = checked_pose("goal", goal_position, goal_quaternion)
        built = None if start is None or goal is None else self._queries.build(start, goal)
        return built if isinstance(built, Query) else None

    # --------------------------------------------------------------- query

    def _next_query(self, start: Pose, goal: Pose, speed: float) -> Query | Verdict:
        """In motion from where the stream is on its reference, so that it goes on smoothly; anew at rest."""
        # Whoever ticks may replace it meanwhile.
        followed = self._stream.followed
        if followed is not None and speed > 0.0:
            latent = self._stream.latent_on(followed.reference, start)
            redirected = None if latent is None else self._queries.redirected(followed.query, start, latent, goal)
            if redirected is not None:
                return redirected
        return self._queries.build(start, goal)

    def _locate(self, pose: Pose, speed: float) -> np.ndarray | None:
        """Latent point of a pose on the reference being followed; None where a new query must begin: so too where the
        tool has stepped aside from the sheet, and rests.
        """
        if self._query is None:
            return None
        stream = self._stream
        if stream.followed is None or stream.followed.query is not self._query:
            anchor = self._query.start
            moved = float(np.linalg.norm(pose.position - anchor.position))
            near = stream.near(moved, float(angle_between(pose.quaternion, anchor.quaternion)))
            return self._query.start_latent + self._passed(anchor, pose) if near else None
        latent = stream.latent_on(stream.followed.reference, pose)
        if latent is None or not stream.gives_way or speed > 0.0:
            return latent
        on_sheet = stream.near(*self._solver.off_the_sheet(self._query, latent, pose))
        return None if not on_sheet and self._queries.may_start(pose) else latent

    def _passed(self, begin: Pose, end: Pose) -> np.ndarray:
        """Latent difference (d,) of two poses on the reference still followed, where both are: a stop goes on there."""
        nowhere, followed = np.zeros(self.graph.latent.shape[1]), self._stream.followed
        if followed is None:
            return nowhere
        here, there = (self._stream.latent_on(followed.reference, pose) for pose in (begin, end))
        return nowhere if here is None or there is None else there - here
