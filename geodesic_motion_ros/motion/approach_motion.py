"""The certified motion of an arm towards a goal that an obstacle covers, as near to it as is free."""

from __future__ import annotations

import math

import numpy as np

from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.contract.status import Refusal, Verdict
from geodesic_motion_ros.motion.path_timer import JointCurve
from geodesic_motion_ros.motion.plan import ApproachPlan, MotionState, Plan
from geodesic_motion_ros.motion.retry import Workings
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.queries.search import judge_path
from geodesic_motion_ros.utils.deadline import NEVER, Deadline


def approach_to_covered(
    solver: Solver,
    query: ArmQuery,
    state: MotionState,
    obstacles: Obstacles,
    refusal: Verdict,
    remaining: float = math.inf,
    deadline: Deadline = NEVER,
) -> ApproachPlan | None:
    """Return the certified motion along the path to a covered goal, as near to it as is free; None where that does not
    shorten the rest of the path by `APPROACH_GAIN`.

    The path is the one that the arm will follow when the goal clears: the obstacles that cover the goal are not
    counted in its search. None as well where no standing obstacle covers the goal: a moving one leaves it by
    itself, and would meet an arm that waits beside it.

    Parameters
    ----------
    refusal : states that the goal is covered; the plan's verdict states the same, and how near the motion leads.
    remaining : how much of the path the approach that is being played leaves [m]; inf: there is none.
    """
    if solver.clearance(query.goal, obstacles.static_subset.beside(solver.scene.solids)) > 0.0:
        return None
    requirement = solver.requirements.approach
    swept = obstacles.swept(requirement.horizon).beside(solver.scene.solids)
    here = min(solver.clearance(state.position, there) for there in (obstacles, swept))
    path = _path_to_covered(solver, query, state, obstacles, here, deadline) if here > 0.0 else None
    if path is None:
        return None
    placed = solver.collision.positions(solver.robot, path.configurations)
    free = solver.certifier.clearances_between(placed, swept) >= requirement.searched.of(here)
    end, left = int(np.argmin(np.append(free, False))), _lengths_left(placed)
    for _ in range(1 + constants.APPROACH_CUTS):
        if end < 1 or left[end] > min(remaining, left[0]) - constants.APPROACH_GAIN:
            return None
        part = JointCurve(path.configurations[: end + 1], path.latent[: end + 1], path.correction)
        timed = solver.timer.time_curve(state, part)
        if isinstance(timed, Refusal):
            return None
        certificate, objection = solver.certifier.assess(timed.swept, obstacles, requirement, here)
        if not objection:
            to_goal = solver.tool_distance(path.configurations[end], query.goal)
            verdict = refusal.with_remark(f"it goes as near as it can, to {1000 * to_goal:.0f} mm")
            verdict = verdict.with_figures(clearance=float(np.min(certificate.clearance)))
            plan = Plan(solver.certifier.judge(timed.reference, certificate), state.time, verdict)
            return ApproachPlan(plan, float(left[end]))
        met = solver.certifier.first_objection(certificate, requirement.margin(obstacles, here))
        assert met is not None
        posture, _, _ = timed.reference.sample(met)
        end = int(np.argmin(np.linalg.norm(part.configurations - posture, axis=1))) - 1
    return None


def _path_to_covered(
    solver: Solver, query: ArmQuery, state: MotionState, obstacles: Obstacles, here: float, deadline: Deadline
) -> JointCurve | None:
    """The path to a goal among the obstacles that do not cover it; None where there is none.

    here : clearance of the start [m].
    """
    moving, prediction = solver.collision.moving, solver.settings.prediction
    at_goal = solver.collision.positions(solver.robot, query.goal[None])[0, moving]
    others = obstacles.leaving_free(at_goal, solver.collision.radii[moving], prediction)
    ends = min(here, solver.clearance(query.goal, others.at(others.time + prediction, prediction)))
    search = solver.search_among(query, state, others.swept(prediction), ends, deadline, Workings())
    multiple = 1.0
    path = search.path(multiple)
    if isinstance(path, Refusal):
        return None
    path = search.refine(path, multiple)
    curve = solver.timer.joint_curve(query, state.position, path, True)
    if isinstance(curve, Refusal):
        return None
    sigma = solver.graph.sigma_at(curve.latent)
    figures = judge_path(solver.skill, solver.graph, query, sigma, path, here, curve.correction)
    return None if isinstance(figures, Refusal) else curve


def _lengths_left(placed: np.ndarray) -> np.ndarray:
    """How far [m] an arm has still to go from each sample on (m,), with its spheres at (m, S, 3): between two samples
    the sphere that moves farthest counts.
    """
    steps = np.max(np.linalg.norm(np.diff(placed, axis=0), axis=2), axis=1)
    return np.append(np.cumsum(steps[::-1])[::-1], 0.0)
