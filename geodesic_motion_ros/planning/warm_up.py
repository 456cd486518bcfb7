"""Loads the compiled kernels of a planner, or has them compiled on the first start: no tick of its stream shall wait
for that. What is not loaded is compiled in the first tick that needs it, for seconds.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.evasion_motion import evasion_beside_graph
from geodesic_motion_ros.planning.guarded_arm import GuardedArm
from geodesic_motion_ros.planning.plan import MotionState
from geodesic_motion_ros.planning.pose_query import Pose
from geodesic_motion_ros.planning.search import load_search
from geodesic_motion_ros.planning.status import Refusal, VerdictCode
from geodesic_motion_ros.trajectory.timing import load_references

if TYPE_CHECKING:
    from geodesic_motion_ros.planning.planner import ReactivePlanner


def load_kernels(trial: ReactivePlanner, arm: GuardedArm) -> None:
    """Let a planner that has played nothing play a short stream with its arm: with an obstacle, a new goal in motion,
    and a stop.
    """
    solver, skill = arm.solver, trial.skill
    if trial.robot.takes_poses:
        start = arm.queries.start_by_pose(Pose(skill.start_pose[:3], skill.start_pose[3:]))
        position, quaternion = skill.goal_pose[:3], skill.goal_pose[3:]
        goals = [partial(trial.prepare_goal, position + offset, quaternion) for offset in (0.0, 0.003)]
    else:
        start = skill.mean_configuration("start")
        end = skill.mean_configuration("goal")
        goals = [partial(trial.prepare_configuration, end + offset) for offset in (0.0, 0.02)]
    trial.stand_at(trial.robot.ready if isinstance(start, Refusal) else start, 0.0)
    trial.take_goal(goals[0]())
    for time in (0.0, 0.1, 0.2):
        trial.take_obstacles(Obstacles.one_of_each(np.array([0.0, 0.0, 3.0 + time]), np.full(3, 1e-3), time))
        trial.tick(time)
    goal = goals[1]()
    trial.take_goal(goal)
    trial.tick(0.3)
    query, commanded = None if isinstance(goal, Refusal) else goal.query, trial.commanded_state(0.3)
    if query is not None:
        load_search(trial.graph, query, trial.settings)
    if query is not None and commanded is not None and trial.may_detour:
        arm.detours.find(query, trial.obstacles, 0.1)
        state = MotionState(0.3, *commanded, query.start_latent)
        evasion_beside_graph(solver, query, state, trial.obstacles, 0.1)
    load_references(trial.limits, solver.tool)
    trial.stop(0.4, Refusal(VerdictCode.NO_GOAL))
