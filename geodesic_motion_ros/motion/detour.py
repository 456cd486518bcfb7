"""Detours: where obstacles block every path that was demonstrated, the arm leaves them by as little as it can.

The base path of a query is the one that the skill has where nothing obstructs it, first that of the demonstrated mode
which obstacles bar least. Beside it the cheapest path is searched that keeps the whole arm clear (`detour_search.py`),
drawn tight (`detour_band.py`), and timed and certified as every other path is. It is an extension of the method of the
paper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.arm_in_scene import ArmInScene
from geodesic_motion_ros.certification.seen_volume import SeenVolume
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.detours.detour_band import Band, draw_tight
from geodesic_motion_ros.detours.detour_frame import DemonstratedSpread, DetourFrame, demonstrated_mode, deviations
from geodesic_motion_ros.detours.detour_search import LatticePath, cheapest_detour
from geodesic_motion_ros.geometry.curves import arc_length_fractions
from geodesic_motion_ros.motion.motion_judge import MotionJudge
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.retry import Question
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.path_smoothing import resample_latent, smooth_latent
from geodesic_motion_ros.queries.query import ArmGoal, ArmQuery, PathEnds
from geodesic_motion_ros.trajectory.trajectory import interpolated

#: Why there is none between two configurations; in another posture there may be one.
COVERED_END = Refusal(VerdictCode.NO_FEASIBLE_PATH, "an obstacle covers where it would begin or end")
#: Why there is none where there would be one if everything were seen.
UNSEEN = Refusal(VerdictCode.NO_FEASIBLE_PATH, "the arm would enter what is not seen")
#: Widths [points] by which a band is smoothed: the second where the first cuts a corner too short.
SMOOTHINGS = (1.5, 0.5)
#: Distance between two samples of a path of the lattice that is smoothed [rad].
_LATTICE_STEP = 0.05
#: Widths [samples] by which such a path is smoothed, in the order in which they are tried.
LATTICE_SMOOTHINGS = (6.0, 3.0, 1.0)


@dataclass(frozen=True, eq=False)
class DetourRequest:
    """The search of a detour that is wanted: from where to which goal, among which obstacles, and how far off.

    Attributes
    ----------
    query : the query on which the arm stopped. position : (eta,) where the arm stands [rad].
    reach : how far the tool may leave what was demonstrated [m].
    """

    query: ArmQuery
    goal: ArmGoal
    obstacles: Obstacles
    reach: float
    position: np.ndarray

    @property
    def question(self) -> Question:
        """All that the answer depends on."""
        return Question(self.goal, self.obstacles, self.position, self.reach)


@dataclass(frozen=True, eq=False)
class Detour:
    """A path that leaves what was demonstrated to pass around obstacles, and how far it does; certified by its planner.

    Attributes
    ----------
    query : the detour leads between its start and its goal.
    base : (k, eta) the base path that the detour leaves [rad].
    configurations : (m, eta) the detour [rad]. latent : (m, d) latent points of the base path beside them.
    displacement : the largest displacement of the tool [m]. swivel : the largest swivel of the arm [rad].
    deviation : the largest Mahalanobis distance of a displacement from what was demonstrated.
    cost : of the lattice's path. evaluated : how many nodes of the lattice the search evaluated.
    """

    query: PathEnds
    base: np.ndarray
    configurations: np.ndarray
    latent: np.ndarray
    displacement: float
    swivel: float
    deviation: float
    cost: float
    evaluated: int

    @classmethod
    def from_band(
        cls, query: PathEnds, frame: DetourFrame, path: LatticePath, band: Band, smoothing: float = SMOOTHINGS[0]
    ) -> Detour:
        """Return the detour along a band, which has drawn a path of the lattice tight; smoothing : width [points]."""
        return cls(
            query, frame.configurations, smooth_latent(band.configurations, smoothing), band.latent,
            float(np.max(np.linalg.norm(band.displacements, axis=1))), float(np.max(np.abs(band.swivels))),
            float(np.max(band.deviations)), path.cost, path.evaluated,
        )  # fmt: skip

    @classmethod
    def from_lattice(cls, query: PathEnds, frame: DetourFrame, path: LatticePath, smoothing: float) -> Detour:
        """Return the detour along a path of the lattice itself; smoothing : width [samples]."""
        curve = smooth_latent(resample_latent(path.configurations, _LATTICE_STEP), smoothing)
        lengths = arc_length_fractions(path.configurations)
        latent = interpolated(np.linspace(0.0, 1.0, len(curve)), lengths, frame.latent[path.samples])
        deviation = float(np.max(deviations(path.displacements, frame.precisions[path.samples])))
        return cls(
            query, frame.configurations, curve, latent,
            float(np.max(np.linalg.norm(path.displacements, axis=1))),
            float(np.max(np.abs(path.swivels))), deviation, path.cost, path.evaluated,
        )  # fmt: skip


class DetourFinder:
    """A finder of detours beside any base path, and of their certified motions; any thread may call it."""

    def __init__(self, judge: MotionJudge) -> None:
        self._judge = judge

    def find_beside(self, frame: DetourFrame, query: PathEnds, obstacles: Obstacles, reach: float) -> Detour | Refusal:
        """Return the cheapest detour of up to `reach` [m] beside one base path, certified for an arm that begins at
        rest; or why there is none.

        The path of the lattice is drawn tight and smoothed. Where that is not certified with any smoothing, the path of
        the lattice itself is smoothed.
        """
        judge = self._judge
        required = judge.requirements.detour
        swept = obstacles.swept(required.horizon).beside(judge.scene.solids)
        ends = min(
            obstacle_clearance(judge.collision, judge.robot, end, swept)[0] for end in (query.start, query.goal)
        )
        if ends <= 0.0:
            return COVERED_END
        margin = required.searched.of(ends)
        arm = ArmInScene.of(judge.robot, judge.collision, swept, judge.seen_volume_beside(frame.configurations))
        path = cheapest_detour(frame, arm, reach, margin)
        if isinstance(path, Refusal):
            if not arm.seen.everything:
                without = cheapest_detour(frame, arm._replace(seen=SeenVolume.unbounded()), reach, margin)
                return without if isinstance(without, Refusal) else UNSEEN
            return path
        band = draw_tight(frame, arm, path, reach, margin)
        drawn = [] if band is None else [Detour.from_band(query, frame, path, band, width) for width in SMOOTHINGS]
        rounded = (Detour.from_lattice(query, frame, path, width) for width in LATTICE_SMOOTHINGS)
        still = np.zeros_like(query.start)
        at_start = MotionState(obstacles.time, query.start, still, still, None)
        refusal: Refusal | None = None
        for detour in chain(drawn, rounded):
            verdict = self.plan(detour, at_start, obstacles).verdict
            if not isinstance(verdict, Refusal):
                return detour
            refusal = refusal or verdict
        assert refusal is not None
        return refusal

    def plan(self, detour: Detour, state: MotionState, obstacles: Obstacles) -> Plan:
        """Return the certified motion along a detour from a state at its start, or why it is not certified."""
        seen = self._judge.seen_volume_beside(detour.base)
        plan = self._judge.plan_along(detour.query, state, detour.configurations, detour.latent, obstacles, seen)
        verdict = plan.verdict
        if verdict.ok:
            verdict = verdict.with_remark(
                f"a detour: it leaves what was demonstrated by {100 * detour.displacement:.1f} cm"
            )
        left = {name: getattr(detour, name) for name in ("displacement", "swivel", "deviation")}
        return replace(plan, verdict=verdict.with_figures(**left))


class DetourPlanner(DetourFinder):
    """A planner that finds detours on one skill, and plans their certified motions; any thread may call it."""

    def __init__(self, solver: Solver, spread: DemonstratedSpread | None = None) -> None:
        """spread : of the skill's demonstrations; None: it is worked out."""
        super().__init__(solver)
        self._solver = solver
        self._spread = spread or DemonstratedSpread.of(solver.skill, solver.robot)

    def with_solver(self, solver: Solver) -> DetourPlanner:
        """Return a planner of detours with another solver of the skill."""
        return DetourPlanner(solver, self._spread)

    def frames(self, query: ArmQuery, obstacles: Obstacles) -> list[DetourFrame] | Refusal:
        """Return the coordinates beside the base paths of a query, in the order in which they are tried; or why the arm
        cannot hold any.

        Where several modes were demonstrated, first that of the mode which obstacles bar least: of the geodesic of the
        metric that they reshape.
        """
        several = len(self._spread.covariances) > 1
        frames: dict[int, DetourFrame] = {}
        refusal: Refusal | None = None
        # In one mode the geodesic without obstacles serves.
        for among in (obstacles, Obstacles.none()) if several else (Obstacles.none(),):
            base = self._solver.base_path(query, among)
            if isinstance(base, Refusal):
                refusal = base
                continue
            progress, shares = self._solver.graph.progress_map(base.latent)
            mode = demonstrated_mode(shares)
            covariances = query.turn_to_base(self._spread.at(progress, mode))
            frames[mode] = DetourFrame.of_base_path(self._solver.robot, base.configurations, base.latent, covariances)
        if frames or refusal is None:
            return list(frames.values())
        return refusal

    def find(self, query: ArmQuery, obstacles: Obstacles, reach: float) -> Detour | Refusal:
        """Return the cheapest detour with displacements up to `reach` [m], or why there is none."""
        frames = self.frames(query, obstacles)
        if isinstance(frames, Refusal):
            return frames
        refusals = []
        for frame in frames:
            found = self.find_beside(frame, query, obstacles, reach)
            if isinstance(found, Detour):
                return found
            refusals.append(found)
        return UNSEEN if UNSEEN in refusals else refusals[-1]


def without_detour(plan: Plan, reach: float, refusal: Refusal) -> Plan:
    """Return a plan without a path, whose verdict says why there is no detour of up to `reach` [m] either."""
    remark = f"no detour of up to {100 * reach:.0f} cm: {refusal.reason}"
    return replace(plan, verdict=plan.verdict.with_remark(remark))
