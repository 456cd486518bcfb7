"""Base paths of detours: what the geodesic of a skill is worth as the path that a detour leaves.

The detour planner takes any path of configurations as its base (`planning/detour_frame.py`). Here are others than the
skill's geodesic, moved to the start and the goal of a scene as the rows of the comparison move demonstrations:

- *mean demonstration*: the mean of those demonstrations that took the nearest one's mode;
- *nearest demonstration*: that one itself;
- *ProMP*: the mean of the primitive that is conditioned on start and goal.

    python -m geodesic_motion_ros.comparison.base_paths --skill panda_pouring --scenes 20 --seed 800

Search, band, time law and certificate are the same with each of them, and so is the metric: the covariance of the
demonstrations of that mode at the same share of the path. Spheres stand; where nothing blocks its base, a detour is
that base.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.comparison.arena import Arena
from geodesic_motion_ros.comparison.methods.promp import Primitives
from geodesic_motion_ros.comparison.scene import Scene, draw_scene
from geodesic_motion_ros.comparison.scene_table import print_scene_table
from geodesic_motion_ros.demonstrations.curves import arc_length_fractions
from geodesic_motion_ros.demonstrations.similarity import Similarity, compare
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.detour import DetourPlanner
from geodesic_motion_ros.planning.detour_frame import DemonstratedSpread, DetourFrame
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.settings import PlannerSettings
from geodesic_motion_ros.planning.solver import HeldQuery, MotionState, Plan, Solver
from geodesic_motion_ros.tables import text_table
from geodesic_motion_ros.verdict import Verdict, VerdictCode

BasePath = Callable[[Arena, Scene], np.ndarray]
#: Families whose spheres stand.
_FAMILIES = ("static", "elbow")
#: A conditioned ProMP is sampled so often.
_SAMPLES = 100


def nearest_demonstration(arena: Arena, scene: Scene) -> np.ndarray:
    """Configurations (m, eta) [rad] of the demonstration that begins and ends nearest, moved to start and goal."""
    return scene.demonstrations[arena.nearest(scene.start, scene.goal)].positions


def mean_demonstration(arena: Arena, scene: Scene) -> np.ndarray:
    """Mean (m, eta) [rad] of those that took the same mode, at the same shares of their paths."""
    mode = arena.modes[arena.nearest(scene.start, scene.goal)]
    return arena.moved(scene.start, scene.goal)[arena.modes == mode].mean(axis=0)


def conditioned_promp(arena: Arena, scene: Scene) -> np.ndarray:
    """Mean (m, eta) [rad] of the primitive that begins nearest, conditioned on start and goal."""
    primitives = Primitives(arena)
    primitives.reset(scene)
    return next(primitives.paths(scene.start, 0.0, Obstacles.none()))


BASES: dict[str, BasePath] = {
    "mean demonstration": mean_demonstration,
    "ProMP": conditioned_promp,
    "nearest demonstration": nearest_demonstration,
}


@dataclass(frozen=True)
class BaseOutcome:
    """What came of a scene with one base: the verdict, and how far the tool is from the closest demonstration."""

    verdict: Verdict
    similarity: Similarity | None


class BaseDetours:
    """Plans in scenes of standing spheres on one skill, from any base path."""

    def __init__(self, arena: Arena, settings: PlannerSettings | None = None) -> None:
        """settings : of the planner; its `detour` says how far all of them may lead."""
        self._arena = arena
        self._planner = planner = ReactivePlanner(arena.skill, settings, scene=DeclaredScene.empty())
        self._solver = Solver(
            arena.skill, planner.graph, planner.settings, planner.robot, planner.collision, planner.limits,
            planner.scene,
        )  # fmt: skip
        self._detours = DetourPlanner(self._solver)
        self._spread = DemonstratedSpread.of(arena.skill, arena.robot)

    def ours(self, scene: Scene) -> BaseOutcome:
        """The planner's own: what was demonstrated first, then a detour from the skill's geodesic."""
        self._planner.take_obstacles(_standing(scene))
        prepared = self._planner.prepared_configuration(scene.goal)
        if isinstance(prepared, Verdict):
            return BaseOutcome(prepared, None)
        return self._outcome(scene, self._planner.plan_configurations(scene.start, prepared.goal))

    def based(self, scene: Scene, base: BasePath) -> BaseOutcome:
        """A detour from another base path."""
        planner = self._planner
        planner.stand_at(scene.start, 0.0)
        prepared = planner.prepared_configuration(scene.goal)
        if isinstance(prepared, Verdict) or prepared.query is None:
            verdict = Verdict(VerdictCode.NO_FEASIBLE_PATH, "the skill has no path between these ends")
            return BaseOutcome(prepared if isinstance(prepared, Verdict) else verdict, None)
        plan = self._plan(prepared.query, self._frame(prepared.query, scene, base), _standing(scene))
        return self._outcome(scene, plan)

    def _frame(self, query: HeldQuery, scene: Scene, base: BasePath) -> DetourFrame:
        arena, path = self._arena, base(self._arena, scene)
        share, mode = arc_length_fractions(path), arena.modes[arena.nearest(scene.start, scene.goal)]
        covariances = query.turned_to_base(self._spread.at(share, mode))
        return DetourFrame.along(arena.robot, path, share[:, None], covariances)

    def _plan(self, query: HeldQuery, frame: DetourFrame, obstacles: Obstacles) -> Plan:
        found = self._detours.beside(frame, query, obstacles, self._planner.settings.detour)
        if isinstance(found, str):
            return Plan(None, 0.0, Verdict(VerdictCode.NO_FEASIBLE_PATH, found))
        still = np.zeros_like(query.start)
        return self._detours.plan(found, MotionState(0.0, query.start, still, still, None), obstacles)

    def _outcome(self, scene: Scene, plan: Plan) -> BaseOutcome:
        if plan.reference is None:
            return BaseOutcome(plan.verdict, None)
        instants = np.linspace(0.0, plan.reference.duration, 200)
        executed = self._arena.tool_curve(plan.reference.samples(instants)[0])
        return BaseOutcome(plan.verdict, min((compare(executed, one) for one in scene.compared), key=lambda s: s.dtw))


def measured(arena: Arena, count: int, seed: int) -> str:
    """So many scenes of each family of standing spheres, solved from each base: a table of what came of it. Similarity
    is of the scenes that are solved from all of them.
    """
    detours, scenes = BaseDetours(arena), [draw_scene(arena, family, number, seed) for family in _FAMILIES
                                           for number in range(count)]  # fmt: skip
    rows = {"ours": [detours.ours(scene) for scene in scenes]}
    rows |= {name: [detours.based(scene, base) for scene in scenes] for name, base in BASES.items()}
    common = [all(outcomes[i].similarity is not None for outcomes in rows.values()) for i in range(len(scenes))]
    cells = []
    for name, outcomes in rows.items():
        similar = [outcome.similarity for outcome, counts in zip(outcomes, common, strict=True) if counts]
        cells.append([
            name, sum(outcome.verdict.ok for outcome in outcomes), len(scenes), len(similar),
            1e3 * float(np.median([one.dtw for one in similar])) if similar else None,
            float(np.degrees(np.median([one.orientation for one in similar]))) if similar else None,
        ])  # fmt: skip
    return text_table([arena.skill.name, "solved", "of", "by all", "dtw mm", "orient deg"], cells)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    return print_scene_table("base_paths", __doc__, measured, argv)


def _standing(scene: Scene) -> Obstacles:
    """The scene's spheres, which stand."""
    centres = np.array([sphere.begin for sphere in scene.spheres]).reshape(-1, 3)
    return Obstacles.of_spheres(centres, np.array([sphere.radius for sphere in scene.spheres]))


if __name__ == "__main__":
    sys.exit(main())
