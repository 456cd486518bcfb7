"""Loads the compiled kernels of a planner into this process, so that no tick of its stream waits for them.

numba reads a kernel from its cache, or compiles it, where a process first calls it. So a program calls `load_kernels`
before it begins a stream: a kernel that is not called here is read in the first tick that needs it, or compiled, for
seconds.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.evasion_motion import evasion_beside_graph
from geodesic_motion_ros.planning.plan import MotionState
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.pose_query import Pose
from geodesic_motion_ros.planning.search import load_search
from geodesic_motion_ros.planning.status import Verdict, VerdictCode
from geodesic_motion_ros.trajectory.timing import load_references


def load_kernels(planner: ReactivePlanner) -> None:
    """Load every compiled kernel that a tick of a planner may call, or compile those that numba's cache lacks.

    The planner stays as it is: another one of the same skill plays a short stream, with an obstacle of each kind far
    above the arm, a new goal in motion, and a stop. What a stream needs in few situations only is called by itself.
    """
    scene = planner.scene if planner.may_detour else None
    trial = ReactivePlanner(planner.skill, planner.settings, planner.robot, scene=scene)
    arm, skill = trial.arm, trial.skill
    if trial.robot.takes_poses:
        start = arm.queries.start_by_pose(Pose(skill.start_pose[:3], skill.start_pose[3:]))
        position, quaternion = skill.goal_pose[:3], skill.goal_pose[3:]
        goals = [partial(trial.prepared_goal, position + offset, quaternion) for offset in (0.0, 0.003)]
    else:
        start, end = skill.mean_configuration("start"), skill.mean_configuration("goal")
        goals = [partial(trial.prepared_configuration, end + offset) for offset in (0.0, 0.02)]
    trial.stand_at(trial.robot.ready if isinstance(start, Verdict) else start, 0.0)
    goal = goals[0]()
    trial.take_goal(goal)
    for time in (0.0, 0.1, 0.2):
        trial.take_obstacles(Obstacles.one_of_each(np.array([0.0, 0.0, 3.0 + time]), np.full(3, 1e-3), time))
        trial.tick(time)
    trial.take_goal(goals[1]())
    trial.tick(0.3)
    commanded = trial.commanded(0.3)
    trial.stop(0.4, Verdict(VerdictCode.NO_GOAL))
    load_references(trial.limits, arm.solver.tool)
    if isinstance(goal, Verdict) or goal.query is None or commanded is None:
        return
    load_search(trial.graph, goal.query, trial.settings)
    if trial.may_detour:
        arm.detours.find(goal.query, trial.obstacles, 0.1)
        state = MotionState(0.3, *commanded, goal.query.start_latent)
        evasion_beside_graph(arm.solver, goal.query, state, trial.obstacles, 0.1)
