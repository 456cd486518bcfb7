"""The first certified detour among spheres that block every demonstrated path, and what the band gains.

A scene is a motion from where one demonstration begins to where another one ends, and so many spheres of 3 to 6 cm that
stand on the demonstrations, drawn as those of the comparison (`studies/comparison/families.py`): none of the
demonstrations stays free, start and goal do, and the planner has no path without a detour. The *first* detour is the
path of the lattice, timed and certified as it is; the band draws it tight, and what comes of that is timed and
certified again. Every scene is solved several times and counts by its fastest: the planner repeats itself to the bit.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.certification.arm_in_scene import ArmInScene
from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.detours.detour_band import band_cost, draw_tight
from geodesic_motion_ros.detours.detour_frame import DetourFrame
from geodesic_motion_ros.detours.detour_search import LatticePath, cheapest_detour
from geodesic_motion_ros.kernels.loading import load_kernels
from geodesic_motion_ros.motion.detour import LATTICE_SMOOTHINGS, Detour, DetourPlanner
from geodesic_motion_ros.motion.plan import MotionState, Plan
from geodesic_motion_ros.motion.solver import Solver
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.query import ArmQuery
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.benchmarks.stopwatch import Stopwatch, no_garbage_collection
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.demonstrated_motions import DemonstratedMotions
from geodesic_motion_studies.comparison.families import FREE_END, draw_standing
from geodesic_motion_studies.comparison.scene import moved_demonstrations
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

#: Starts and goals, and spheres between two of them, that are drawn until it is said that none fit.
_ENDS, _SPHERES = 20, 30_000


@dataclass(frozen=True, eq=False)
class BlockedMotion:
    """Between two demonstrations: the planner's query, the arm at rest where it begins, the demonstrated motions."""

    query: ArmQuery
    state: MotionState
    demonstrated: DemonstratedMotions


@dataclass
class DetourTimes:
    """Durations in scenes of one number of spheres.

    Attributes
    ----------
    found, refusals : in how many scenes there was a path of the lattice; in how many not, by the reason.
    first : from the base path to the lattice's path, timed and certified, where it was certified.
    band : to draw it tight, to time and certify that, where it was certified.
    gains : cost of each band over that of the lattice's path.
    """

    found: int = 0
    refusals: Counter[str] = field(default_factory=Counter)
    first: Stopwatch = field(default_factory=Stopwatch)
    band: Stopwatch = field(default_factory=Stopwatch)
    gains: list[float] = field(default_factory=list)


class _First(NamedTuple):
    """A path of the lattice in its coordinates, and the motion along it."""

    frame: DetourFrame
    arm: ArmInScene
    path: LatticePath
    plan: Plan


class DetourBench:
    """A planner on a skill of either kind, motions between its demonstrations, and spheres that block them.

    Attributes
    ----------
    margin : clearance that detours keep [m].
    """

    def __init__(self, skill: Skill, motions: int, plays: int, seed: int) -> None:
        """motions : so many are drawn. plays : how often each scene is solved.

        Raises
        ------
        ParameterError : no scenes are drawn for this skill (`studies/comparison/arena.py`), or it has no path between
        its
            demonstrations.
        """
        self._arena, self._plays = Arena.of(skill, "arm"), plays
        self.planner = planner = ReactivePlanner(skill, scene=DeclaredScene.empty())
        load_kernels(planner)
        self._solver = Solver(
            skill, planner.graph, planner.settings, planner.robot, planner.collision, planner.limits, planner.scene
        )
        self._detours = DetourPlanner(self._solver)
        # The ends are free of spheres by more than twice the margin: none has to be smaller.
        self._reach, self.margin = planner.settings.detour, planner.settings.obstacle_margin
        random = np.random.default_rng(seed)
        self.motions = [self._motion(random) for _ in range(motions)]

    def _motion(self, random: np.random.Generator) -> BlockedMotion:
        arena, planner = self._arena, self.planner
        for _ in range(_ENDS):
            first, last = random.integers(len(arena.shown), size=2)
            start, goal = arena.shown[first, 0], arena.shown[last, -1]
            planner.stand_at(start, 0.0)
            prepared = planner.prepare_configuration(goal)
            if isinstance(prepared, Refusal) or prepared.query is None:
                continue
            still = np.zeros_like(start)
            state = MotionState(0.0, start, still, still, prepared.query.start_latent)
            moved = moved_demonstrations(arena, start, goal)
            return BlockedMotion(prepared.query, state, DemonstratedMotions(arena, moved, tool_chased=True))
        raise ParameterError(f"skill '{arena.skill.name}' has no path between {_ENDS} pairs of its demonstrations")

    def spheres(self, motion: BlockedMotion, count: int, random: np.random.Generator) -> Obstacles:
        """So many spheres that block all demonstrations, and the planner where it makes no detour.

        ParameterError where none are found.
        """
        drawn: list[MovingSphere] = []
        for _ in range(_SPHERES):
            drawn.extend(draw_standing(motion.demonstrated, random) or ())
            if len(drawn) == count:
                centres = np.array([sphere.begin for sphere in drawn])
                obstacles = Obstacles.of_spheres(centres, np.array([sphere.radius for sphere in drawn]))
                if not np.any(motion.demonstrated.free_of(drawn)) and self._blocks(motion, obstacles):
                    return obstacles
                drawn.clear()
        raise ParameterError(
            f"no {count} spheres were found that block every demonstrated path of '{self._arena.skill.name}' and leave "
            "its ends free"
        )

    def _blocks(self, motion: BlockedMotion, obstacles: Obstacles) -> bool:
        """Whether the planner, free at both ends, has no path without a detour."""
        planner, query = self.planner, motion.query
        for end in (query.start, query.goal):
            if obstacle_clearance(planner.collision, planner.robot, end, obstacles)[0] < FREE_END:
                return False
        plan = self._solver.solve(query, motion.state, obstacles, self._solver.cautious_attempts)
        return plan.verdict.code is VerdictCode.NO_FEASIBLE_PATH

    def measure(self, motion: BlockedMotion, obstacles: Obstacles, into: DetourTimes) -> None:
        """Search the detour of one scene, several times."""
        first, band = [Stopwatch() for _ in range(self._plays)], [Stopwatch() for _ in range(self._plays)]
        with no_garbage_collection():
            for play in range(self._plays):
                with first[play]:
                    found = self._first(motion, obstacles)
                if isinstance(found, Refusal):
                    into.refusals[found.reason] += 1
                    return
                with band[play]:
                    drawn = draw_tight(found.frame, found.arm, found.path, self._reach, self.margin)
                    if drawn is not None:
                        detour = Detour.from_band(motion.query, found.frame, found.path, drawn)
                        tight = self._detours.plan(detour, motion.state, obstacles)
        into.found += 1
        if found.plan.verdict.ok:
            into.first.add(Stopwatch.fastest(first), [0])
        if drawn is not None:
            if tight.verdict.ok:
                into.band.add(Stopwatch.fastest(band), [0])
            into.gains.append(band_cost(found.frame, found.arm, drawn) / found.path.cost)

    def _first(self, motion: BlockedMotion, obstacles: Obstacles) -> _First | Refusal:
        """The lattice's path, timed and certified; or why there is none."""
        frames, planner = self._detours.frames(motion.query, obstacles), self.planner
        if isinstance(frames, Refusal):
            return frames
        arm = ArmInScene.of(planner.robot, planner.collision, obstacles)
        for frame in frames:
            path = cheapest_detour(frame, arm, self._reach, self.margin)
            if isinstance(path, LatticePath):
                lattice = Detour.from_lattice(motion.query, frame, path, LATTICE_SMOOTHINGS[-1])
                return _First(frame, arm, path, self._detours.plan(lattice, motion.state, obstacles))
        return path
