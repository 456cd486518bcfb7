"""ReactivePlanner: goal, obstacles and the time -> what the arm plays and the verdict, once per tick. Knows nothing of
ROS.

One planner of configurations serves every kind of skill: a query (`query`) has a configuration at each node of the
latent graph. A trajectory is certified for the whole arm, against obstacles that move on linearly for the setting
`prediction`, before it is handed out. What it has in common with other planners of a stream: `streaming_planner`.

A tick works out its `Situation` once, decides without changing anything (`arbiter`), and commits that in one place.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene, check_demonstrations
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.contract.status import Refusal, Verdict, VerdictCode
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.manifold.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.motion.plan import Plan
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.motion.worker import DETOUR_DELAY, Worker
from geodesic_motion_ros.planning.arbiter import Arbiter, Decision
from geodesic_motion_ros.planning.guarded_arm import GuardedArm
from geodesic_motion_ros.planning.memory import AttemptMemory, DetourSearch
from geodesic_motion_ros.planning.mission import GoalRequest, Mission, NextRound, PreparedGoal
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.planning.streaming_planner import PreparedArm, StreamingPlanner
from geodesic_motion_ros.queries.output_space import OutputSpace
from geodesic_motion_ros.queries.pose_query import checked_pose
from geodesic_motion_ros.queries.query import ArmGoal, ArmQuery
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.skill.skill import Skill


class ReactivePlanner(StreamingPlanner[GuardedArm]):
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
        robot = robot or Robot.named(skill.robot)
        OutputSpace.of(skill).check_robot(robot)
        of_arm = CollisionModel.named(skill.robot)
        guarded = collision or of_arm
        if settings.avoid == "tool":
            guarded = guarded.guarding_tool(robot, settings.tool_points, settings.tool_radii)
        self.graph: ConfigurationGraph | PoseGraph = skill.graph(settings.grid_shape, settings.neighbours)
        limits = JointLimits.of(robot, settings.joint_speed_scale, settings.acceleration_scale)
        solver = Solver(skill, self.graph, settings, robot, guarded, limits, scene)
        super().__init__(GuardedArm.of(solver), robot, scene, self.graph.latent.shape[1])
        if self.scene.names:
            check_demonstrations(self.scene, skill, *solver.space.demonstrated_spheres(skill, robot, of_arm))
        self._worker = detours or Worker(DETOUR_DELAY)
        self._mission, self._memory = Mission(), AttemptMemory()

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

    def _prepared_arm(self, arm: GuardedArm, holds_others: bool) -> PreparedArm[GuardedArm]:
        query = before = self._mission.query
        if before is not None and (
            holds_others or arm.solver.settings.obstacle_margin != self.settings.obstacle_margin
        ):
            rebuilt = arm.queries.rebuild(before)
            query = None if isinstance(rebuilt, Refusal) else rebuilt
        return PreparedArm(arm, before, query)

    def _arm_taken(self, prepared: PreparedArm[GuardedArm]) -> ArmQuery | None:
        query = prepared.query if self._mission.query is prepared.before else None
        self._mission, self._memory = replace(self._mission, query=query), AttemptMemory()
        return query

    def _stands_anew(self) -> None:
        self._mission, self._memory = replace(self._mission, query=None), AttemptMemory()

    def _in_turn(self, configuration: np.ndarray) -> np.ndarray:
        return self._arm.queries.in_turn(configuration)

    # ------------------------------------------------------------- planning

    @property
    def round(self) -> int:
        """Number of the round to the goal in which a closed skill is, from 1 on; 0 before it sets out."""
        return 0 if self.skill.period is None else self._mission.round

    def _decide(self, situation: Situation) -> Plan:
        mission = self._mission
        if situation.at_rest and mission.requested is not None:
            mission = mission.activate(mission.requested, None)
        mission = self._with_next_round(situation, mission)
        return self._commit(situation, mission, Arbiter(self._arm, situation, mission, self._memory).decide())

    def _stop(self, situation: Situation, verdict: Refusal) -> Plan:
        mission = self._mission
        return self._commit(situation, mission, Decision(situation.begin_stop(verdict), mission.query, self._memory))

    def _take_aim_back(self, aim: tuple[Mission, AttemptMemory]) -> None:
        self._mission, memory = aim
        # A search of a detour that was begun is not begun again.
        self._memory = replace(memory, detour=self._memory.detour or memory.detour)

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

    def _commit(self, situation: Situation, mission: Mission, decision: Decision) -> Plan:
        """Play a decision, and remember it: nothing else in a tick changes the planner."""
        before, memory = (mission, self._memory), decision.memory
        if decision.detour is not None:
            state, obstacles = situation.state, situation.expected_obstacles
            latent = None if state.latent is None else state.latent_on(decision.detour.query)
            search = partial(self._arm.find_requested_detour, decision.detour, latent, obstacles)
            memory = replace(memory, detour=DetourSearch(self._worker.start(search, situation.now), decision.detour))
        self._mission, self._memory = mission.after(decision.query, decision.step, situation.now), memory
        plan = self._commit_step(situation, decision.step, before)
        if plan.verdict.ok and self.round > 0:
            of = f" of {self.settings.rounds}" if self.settings.periodic and self.settings.rounds else ""
            plan = replace(plan, verdict=plan.verdict.with_remark(f"round {self.round}{of}"))
        return plan

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
