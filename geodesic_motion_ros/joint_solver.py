"""JointSolver: one query on a joint-space skill -> a certified reference and its verdict. Knows nothing of ROS.

Reweight, search, refine, smooth, decode, transport, time, certify: what a tick of `joint_planner.JointSpacePlanner`
does when its reference cannot stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from geodesic_motion_ros.arm_certificate import ArmCertifier, Certificate
from geodesic_motion_ros.deadline import NEVER, Deadline
from geodesic_motion_ros.graph.configuration_graph import ConfigurationGraph
from geodesic_motion_ros.graph.refinement import refined
from geodesic_motion_ros.graph.reshaping import Reshaping
from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.joint_query import JointQuery
from geodesic_motion_ros.joint_reference import JointReference, timed_joint_reference
from geodesic_motion_ros.latent_way import LatentWay, cheapest_way, same_way, way_verdict
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner_settings import MOVING_MULTIPLE, JointPlannerSettings
from geodesic_motion_ros.reference import resample_latent, smooth_latent
from geodesic_motion_ros.robot.collision_model import CollisionModel, obstacle_clearance
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.skill import Skill
from geodesic_motion_ros.verdict import Verdict, VerdictCode


class Attempt(NamedTuple):
    """A multiple of the obstacle margin, whether the way is refined, and the width in grid steps of the smoothing,
    first in the latent space, then decoded: refined ways have no corners of the grid.
    """

    multiple: float
    refine: bool
    width: float


#: What is tried until a curve is certified. Keeping further off helps more often than cutting less.
_ATTEMPTS = (
    Attempt(1.0, True, 1.0), Attempt(1.0, False, 2.0), Attempt(4.0, True, 1.0), Attempt(4.0, False, 2.0),
    Attempt(4.0, False, 1.0),
)  # fmt: skip
_LARGEST_MULTIPLE = max(attempt.multiple for attempt in _ATTEMPTS)
#: Samples of the curve per grid step.
_SAMPLES_PER_STEP = 1.0


@dataclass(frozen=True)
class JointPlan:
    """Answer of one planning step.

    Attributes
    ----------
    reference : what is to be played from `begin` on, in the place of everything before; None: what is being played
        stays, or the arm stands.
    begin : time of the reference's first knot [s].
    verdict : OK comes with a way to the goal. With any other verdict the reference is a stop.
    nodes : of the graph that the way was found along, where the first attempt found it.
    """

    reference: JointReference | None
    begin: float
    verdict: Verdict
    nodes: np.ndarray | None = None


@dataclass(frozen=True)
class MotionState:
    """State of motion in which a new reference takes over, at `time` [s]: (eta,) each, and its latent point (d,)."""

    time: float
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    latent: np.ndarray | None


class JointSolver:
    """Plans single ways on one joint-space skill; holds no state of its own."""

    def __init__(
        self,
        skill: Skill,
        graph: ConfigurationGraph,
        settings: JointPlannerSettings,
        robot: Robot,
        collision: CollisionModel,
        limits: JointLimits,
    ) -> None:
        self.skill, self.graph, self.settings, self.robot = skill, graph, settings, robot
        self.collision, self.limits = collision, limits
        self.attempts = tuple(attempt for attempt in _ATTEMPTS if settings.refine or not attempt.refine)
        self.certifier = ArmCertifier(
            robot, collision.points.frames, collision.points.offsets, collision.radii, collision.self_pairs
        )

    def solve(
        self,
        query: JointQuery,
        state: MotionState,
        obstacles: Obstacles,
        attempts: tuple[Attempt, ...],
        deadline: Deadline = NEVER,
        known: np.ndarray | None = None,
    ) -> JointPlan:
        """Search, refine, smooth, decode, time, certify: until an attempt is certified, or the deadline has passed.

        known : nodes of a way that needs no second look: where the search finds it again, that is the answer, OK.
        """
        settings = self.settings
        avoided = obstacles if settings.avoidance else Obstacles.none()
        ends = self._end_clearance(query, state, avoided)
        if isinstance(ends, Verdict):
            return JointPlan(None, state.time, ends)
        reshaping = Reshaping.of(
            query.body, avoided.swept(settings.prediction), settings.ambient_strength, settings.ambient_width_ratio,
            _LARGEST_MULTIPLE * settings.obstacle_margin, settings.ambient_law,
        )  # fmt: skip
        start = query.start_latent if state.latent is None else state.latent
        # Ends closer to an obstacle than a margin may stay so, but the path must not come closer than they are.
        margin = 0.0 if obstacles.stand else min(MOVING_MULTIPLE * settings.obstacle_margin, 0.5 * ends)
        verdict = Verdict(VerdictCode.NO_FEASIBLE_PATH)
        ways: dict[float, LatentWay | Verdict] = {}
        tried: set[tuple[bytes, bool, float]] = set()
        for number, attempt in enumerate(attempts):
            multiple, refine, width = attempt
            if number > 0 and deadline.passed:
                reason = f"out of time after {number} of {len(attempts)} attempts: {verdict.reason}"
                return JointPlan(None, state.time, replace(verdict, code=VerdictCode.DEADLINE_MISSED, reason=reason))
            kept_off = min(multiple * settings.obstacle_margin, 0.5 * ends)
            if kept_off not in ways:
                ways[kept_off] = cheapest_way(self.graph, query, start, reshaping, kept_off, deadline)
            way = ways[kept_off]
            if isinstance(way, Verdict):
                return JointPlan(None, state.time, verdict if verdict.reason else way)
            if known is not None and same_way(way.nodes, known):
                return JointPlan(None, state.time, Verdict(VerdictCode.OK, "the way being gone was found again"))
            this = way.nodes.tobytes(), refine, width
            if this in tried:
                continue
            tried.add(this)
            if refine:
                way = replace(way, polyline=refined(query.field, reshaping, kept_off, way.polyline))
            plan = self._certified(query, state, way, obstacles, margin, width)
            if plan.reference is not None:
                return replace(plan, nodes=way.nodes) if attempt == self.attempts[0] else plan
            verdict = plan.verdict
        return JointPlan(None, state.time, verdict)

    def _end_clearance(self, query: JointQuery, state: MotionState, obstacles: Obstacles) -> float | Verdict:
        """Smaller clearance [m] of present and goal configuration, or the refusal where one of them is covered.

        The goal is to be free of where obstacles are expected to come to a stand.
        """
        later = obstacles.at(obstacles.time + self.settings.prediction, self.settings.prediction)
        nearest = []
        for where, configuration, code, there in (
            ("stands", state.position, VerdictCode.IN_COLLISION, obstacles),
            ("is to go", query.goal, VerdictCode.NO_FEASIBLE_PATH, later),
        ):
            clearance, sphere = obstacle_clearance(self.collision, self.robot, configuration, there)
            if clearance <= 0.0:
                link = self.collision.link_of(sphere)
                reason = f"'{link}' overlaps an obstacle by {-1000 * clearance:.0f} mm where the arm {where}"
                return Verdict(code, reason, clearance=clearance, **query.misfits)
            nearest.append(clearance)
        return min(nearest)

    def _certified(
        self,
        query: JointQuery,
        state: MotionState,
        way: LatentWay,
        obstacles: Obstacles,
        margin: float,
        width: float,
    ) -> JointPlan:
        """Smooth, decode, transport, meet the ends exactly, time, and judge the very motion that will be played."""
        step = float(np.min(self.graph.grid.spacing)) / _SAMPLES_PER_STEP
        latent = smooth_latent(resample_latent(way.polyline, step), width * _SAMPLES_PER_STEP)
        carried = query.offsets.carried(self.graph.decoder.configurations(latent), *self.graph.progress_map(latent))
        path = smooth_latent(carried, width * _SAMPLES_PER_STEP)
        path, correction = _meeting(path, state.position, query.goal)
        reference = timed_joint_reference(path, latent, self.limits, state.velocity, state.acceleration)
        if reference is None:
            reason = "stopping first: the way to the goal turns off the present motion, or leaves the joints' limits"
            return JointPlan(None, state.time, Verdict(VerdictCode.NO_FEASIBLE_PATH, reason, **query.misfits))
        certificate = self.certify(reference, obstacles)
        objection = self.certifier.objection(certificate, margin) if self.settings.avoidance else None
        verdict = way_verdict(
            self.skill, self.graph, query, self.graph.decoder.uncertainty(latent), way,
            float(np.min(certificate.clearance)), correction,
            None if objection is None else f"on the best way {objection}",
        )  # fmt: skip
        found = replace(reference, clearance=certificate.clearance) if verdict.ok else None
        return JointPlan(found, state.time, verdict)

    def certify(self, reference: JointReference, obstacles: Obstacles) -> Certificate:
        """The certificate of a reference that begins when obstacles are where they are told to be."""
        return self.certifier.certify(reference, obstacles, self.settings.prediction)


def _meeting(path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, float]:
    """A path (m, eta) moved linearly along its arc so that it begins and ends at two configurations.

    Also how far [rad] its ends were moved.
    """
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    share = (length / max(length[-1], 1e-12))[:, None]
    at_start, at_goal = start - path[0], goal - path[-1]
    moved = float(max(np.linalg.norm(at_start), np.linalg.norm(at_goal)))
    return path + (1.0 - share) * at_start + share * at_goal, moved
