"""Loads the compiled kernels of a planner into this process, so that no tick of its stream waits for them.

numba reads a kernel from its cache, or compiles it, where a process first calls it. So a program calls `load_kernels`
before it begins a stream: a kernel that is not called here is read in the first tick that needs it, or compiled, for
seconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.filtering.offer import Offer
from geodesic_motion_ros.geometry.pose import Pose
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.motion.evasion_motion import evasion_beside, evasion_beside_graph
from geodesic_motion_ros.motion.plan import Aim, MotionState, Plan
from geodesic_motion_ros.motion.played import FollowedPlan, PlayedTrajectory
from geodesic_motion_ros.motion.retry import Workings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.planning.streaming_planner import StreamingPlanner
from geodesic_motion_ros.queries.search import load_search
from geodesic_motion_ros.trajectory.timing import load_references
from geodesic_motion_ros.trajectory.trajectory import JointReference

#: How far from what was demonstrated a detour and an evasion are looked for [m].
_REACH = 0.1


def load_kernels(planner: ReactivePlanner) -> None:
    """Load every compiled kernel that a tick of a planner may call, or compile those that numba's cache lacks.

    The parts of a tick are called: from the skill's start to its goal, among an obstacle of each kind far above the
    arm. The planner stays as it is.
    """
    arm, solver, skill = planner.arm, planner.arm.solver, planner.skill
    load_references(planner.limits, solver.tool)
    frame = TaskFrame.identity()
    if planner.robot.takes_poses:
        start = arm.queries.start_by_pose(Pose(skill.start_pose[:3], skill.start_pose[3:]))
        goal = arm.queries.goal_by_pose(Pose(skill.goal_pose[:3], skill.goal_pose[3:]), frame)
    else:
        start = skill.mean_configuration("start")
        goal = arm.queries.goal_by_configuration(skill.mean_configuration("goal"), frame)
    if isinstance(goal, Refusal):
        return
    start = planner.robot.ready if isinstance(start, Refusal) else start
    query = arm.queries.build(start, goal)
    if isinstance(query, Refusal):
        return
    load_search(planner.graph, query, planner.settings)
    obstacles, still = Obstacles.one_of_each(np.array([0.0, 0.0, 3.0]), np.full(3, 1e-3), 0.0), np.zeros_like(start)
    state = MotionState(0.0, start, still, still, query.start_latent)
    if planner.may_detour:
        arm.detours.find(query, obstacles, _REACH)
        standing = JointReference.standing(start, query.start_latent)
        evasion_beside_graph(solver, query, state, obstacles, standing, _REACH, Workings())
    plan = solver.solve(query, state, obstacles, solver.cautious_attempts)
    moving = _followed(planner, query, plan, obstacles)
    if moving is not None:
        arm.query_from(moving.state, moving.followed, goal)


def load_filter_kernels(motion_filter: MotionFilter) -> None:
    """Load every compiled kernel that a tick of a filter may call, as `load_kernels` does for a planner."""
    solver, start = motion_filter.arm.solver, motion_filter.robot.ready
    load_references(motion_filter.limits, solver.tool)
    obstacles, still = Obstacles.one_of_each(np.array([0.0, 0.0, 3.0]), np.full(3, 1e-3), 0.0), np.zeros_like(start)
    times = np.linspace(0.0, 2.0, 21)
    # From rest to rest it is played at its times, in full motion at the end it is not.
    for passed in (0.5 - 0.5 * np.cos(np.pi * times / times[-1]), times / times[-1]):
        offer = Offer(times, start + 0.1 * passed[:, None])
        offer.nearest(start, motion_filter.limits)
        state = MotionState(0.0, start, still, still, offer.start_latent)
        reference = solver.motion(offer, state, 0.0)
        if reference is None:
            continue
        solver.longest_free(reference, state, obstacles, lambda plan: plan)
        _followed(motion_filter, offer, solver.certified(reference, state, obstacles), obstacles)
    if motion_filter.may_detour:
        solver.find_detour(offer, start, 0.0, obstacles, _REACH)
        standing, (place, _) = JointReference.standing(start, offer.start_latent), motion_filter.robot.forward(start)
        required = solver.requirements.evasion
        evasion_beside(solver, required, offer.start_latent, state, obstacles, standing, place, _REACH, Workings())


def _followed(planner: StreamingPlanner[Any], aim: Aim, plan: Plan, obstacles: Obstacles) -> Situation | None:
    """Call what a tick calls that follows a plan: the situation then; None where there is no motion."""
    if plan.trajectory is None:
        return None
    certifier = planner.arm.solver.certifier
    played, followed = PlayedTrajectory(plan.trajectory, 0.0, certifier), FollowedPlan.of(aim, plan, obstacles, 0.0)
    moving = Situation(planner.settings, planner.limits, certifier, played, followed, 0.1, obstacles)
    moving.remaining_clearance()
    stop = moving.begin_stop(Refusal(VerdictCode.NO_GOAL)).plan
    if stop.trajectory is not None:
        plan.trajectory.continue_by(stop.trajectory, 0.0, stop.begin)
    return moving
