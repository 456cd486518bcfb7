"""Certified motions of an arm that makes room, to places to which no obstacle is expected to come: on the graph nearby,
or beside it. One that touches already what moves leaves it.
"""

from __future__ import annotations

import math
from itertools import islice

import numpy as np

from geodesic_motion_ros.certification.arm_in_scene import ArmInScene
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.requirement import Requirement
from geodesic_motion_ros.contract.status import Figures, Refusal, Verdict
from geodesic_motion_ros.motion.motion_judge import MotionJudge
from geodesic_motion_ros.motion.path_timer import JointCurve
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.retry import Workings
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.evasion_targets import displaced_paths, paths_to_targets
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.trajectory.trajectory import JointReference, joined
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: What is said of an arm that makes room.
EVADING = "evading what is coming"


def evasion_on_graph(
    solver: Solver,
    query: ArmQuery,
    state: MotionState,
    obstacles: Obstacles,
    stop: JointReference,
    workings: Workings,
    deadline: Deadline = NEVER,
) -> Plan | None:
    """Return a certified motion to a place on the graph nearby, to which no obstacle is expected to come; None where
    none is found in time.

    An arm in motion stops first, as it can go back then, or else sets out as it moves. A search that was out of time is
    resumed by the next one, which begins with the targets that it did not try.

    stop : the soonest stop from the state. workings : as of `solve`.
    """
    requirement = solver.requirements.evasion
    evaluation = solver.evaluation(query, obstacles.swept(requirement.horizon))
    apart, tried = requirement.searched.of(), workings.evasions.pop(requirement, 0)
    targets = (
        (begin, first, path)
        for begin, first in _begins(solver, state, obstacles, stop)
        for path in paths_to_targets(
            solver.graph, query, begin.latent_on(query), evaluation, constants.EVASION_STEPS, apart
        )
    )
    for number, (begin, first, path) in enumerate(islice(targets, tried, None), tried + 1):
        timed = workings.time_path(solver.timer, query, begin, path, False, math.inf)
        if not isinstance(timed, Refusal):
            whole = timed.reference if first is None else joined(first, 0.0, timed.reference, first.duration)
            swept = solver.certifier.sweep(whole)
            certificate, objection = solver.certifier.assess_leaving(swept, obstacles, requirement, stop)
            figures = solver.judge(query, path, timed, certificate, objection)
            if not isinstance(figures, Refusal):
                return Plan(solver.certifier.judge(whole, certificate), state.time, Verdict(figures=figures))
        if deadline.passed:
            workings.evasions[requirement] = number
            return None
    return None


def _begins(
    solver: Solver, state: MotionState, obstacles: Obstacles, stop: JointReference
) -> list[tuple[MotionState, JointReference | None]]:
    """The states in which an evasion may set out, in the order in which they are tried, each with the motion that
    is played until then: at rest after a stop, where no obstacle meets that; and in motion.
    """
    if not np.any(state.velocity):
        return [(state, None)]
    while_stopping = solver.requirements.evasion.until(stop.duration)
    _, met = solver.certifier.assess(solver.certifier.sweep(stop), obstacles, while_stopping)
    return [(state, None)] if met else [(state.after(stop), stop), (state, None)]


def evasion_beside_graph(
    solver: Solver,
    query: ArmQuery,
    state: MotionState,
    obstacles: Obstacles,
    stop: JointReference,
    reach: float,
    workings: Workings,
    deadline: Deadline = NEVER,
) -> Plan | None:
    """Return a certified motion to a place beside the graph, to which no obstacle comes soon; None where none is found
    in time. The next search resumes one that was out of time.

    stop : the soonest stop from the state. reach : how far the tool may be from what was demonstrated [m]. workings :
        as of `solve`.
    """
    latent = state.latent_on(query)[None]
    progress, _ = solver.graph.progress_map(latent)
    configurations = query.configurations_along(latent, state.position)
    if isinstance(configurations, Refusal):
        return None
    undisplaced, left = solver.robot.forward(configurations[0])[0], reach - query.displaced_at(progress)
    required = solver.requirements.beside_graph
    return evasion_beside(solver, required, latent[0], state, obstacles, stop, undisplaced, left, workings, deadline)


def evasion_beside(
    judge: MotionJudge,
    requirement: Requirement,
    latent: np.ndarray,
    state: MotionState,
    obstacles: Obstacles,
    stop: JointReference,
    undisplaced: np.ndarray,
    reach: float,
    workings: Workings,
    deadline: Deadline = NEVER,
) -> Plan | None:
    """Return a certified motion to a place beside where the arm is, to which no obstacle comes within the horizon of a
    requirement; None where none is found in time. The next search resumes one that was out of time.

    latent : (d,) of the motion, which makes no progress. undisplaced, reach : no target is farther from this place (3,)
        of the tool [m]. stop, workings : as of `evasion_beside_graph`.
    """
    seen = judge.seen_volume_beside(state.position[None])
    swept = obstacles.swept(requirement.horizon).beside(judge.scene.solids)
    arm, apart = ArmInScene.of(judge.robot, judge.collision, swept, seen), requirement.searched.of()
    targets = displaced_paths(judge.robot, arm, state.position, undisplaced, reach, apart)
    tried = workings.evasions.pop(requirement, 0)
    for number, curve in enumerate(islice(targets, tried, constants.EVASION_DISPLACED), tried + 1):
        reference = judge.time_along(state, JointCurve(curve, np.repeat(latent[None], len(curve), axis=0), 0.0))
        if not isinstance(reference, Refusal):
            evading = judge.certifier.sweep(reference)
            certificate, met = judge.certifier.assess_leaving(evading, obstacles, requirement, stop)
            if not (met or judge.certifier.seen_objection(evading, seen)):
                verdict = Verdict(figures=Figures(clearance=float(np.min(certificate.clearance))))
                return Plan(judge.certifier.judge(reference, certificate), state.time, verdict)
        if deadline.passed:
            workings.evasions[requirement] = number
            return None
    return None
