"""A bottle in the hand: taken and put down in motion, among the spheres of the benchmark.

    python -m geodesic_motion_studies.comparison.bottle_in_hand --skill panda_pouring --scenes 12 --seed 800

Scenes are those of the benchmark with all of the arm guarded. After `TAKEN` the hand holds a bottle as soon as no
sphere is within `ROOM` of where that is then, and after `PUT_DOWN` it holds none. Judged as everywhere: the meshes of
the arm, and while it is held the bottle itself, a cylinder. Starts and goals were drawn for an empty hand, so that a
goal may be one that the bottle cannot go to: what counts is what is touched. The control is a planner that does
not know of it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.quaternions import inverse, rotate
from geodesic_motion_ros.geometry.shapes import cylinder_distances
from geodesic_motion_ros.geometry.task_frame import TaskFrame
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.held_objects import HeldObject
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Outcome, PlayedMethod, Stage
from geodesic_motion_studies.comparison.families import Family
from geodesic_motion_studies.comparison.method import Method
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.scene import Scene, draw_scene
from geodesic_motion_studies.comparison.scene_table import print_scene_table
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

#: 3 cm in radius and 20 cm long, held across the fingers.
BOTTLE = HeldObject("bottle", "cylinder", (0.03, 0.2), (0.05, 0.0, 0.0), (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0))
#: When it is taken, and when it is put down [s].
TAKEN, PUT_DOWN = 1.0, 4.0
#: Nobody puts a bottle into a hand beside a sphere that is nearer than this [m].
ROOM = 0.03
FAMILIES: tuple[Family, ...] = ("static", "elbow", "crossing", "chasing")


class MeshesAndBottle(CollisionGeometry):
    """The meshes of an arm, and the bottle in its hand.

    Attributes
    ----------
    holds : whether the hand holds it.
    """

    holds = False
    _tool = TaskFrame.identity()

    def place(self, joint_positions: np.ndarray) -> None:
        super().place(joint_positions)
        self._tool = TaskFrame(*self.robot.forward(joint_positions))

    def clearances(self, centre: np.ndarray, radius: float, cutoff: float = 2.0) -> dict[str, float]:
        nearest = super().clearances(centre, radius, cutoff)
        if self.holds:
            nearest[BOTTLE.name] = self.bottle_clearance(centre, radius)
        return nearest

    def bottle_clearance(self, centre: np.ndarray, radius: float) -> float:
        """Signed distance [m] of the bottle, where the hand would hold it, from a sphere."""
        position, quaternion = self._tool.to_base(np.array(BOTTLE.position), np.array(BOTTLE.quaternion))
        seen = rotate(inverse(quaternion), (centre - position)[None])
        return float(cylinder_distances(seen, *BOTTLE.dimensions)[0]) - radius


class Holding(Geodesics):
    """Ours, which knows what its hand holds, or as a control does not."""

    def __init__(self, arena: Arena, knows_bottle: bool = True, planner: PlannerSettings | None = None) -> None:
        super().__init__(arena, planner=planner)
        self._knows_bottle = knows_bottle

    def reset(self, scene: Scene) -> None:
        for planner in self._planners.values():
            planner.hold([])
        super().reset(scene)

    def hold(self, objects: Sequence[HeldObject]) -> None:
        """The hand holds these from now on."""
        if self._knows_bottle:
            verdict = self._planner.hold(objects)
            assert verdict.ok, verdict.reason
            self._tracking.take_collision(self._planner.collision)


class _BottleInHand(PlayedMethod):
    """An arm whose hand is given a bottle, and gives it away."""

    def __init__(self, world: ArmWorld, method: Holding, geometry: MeshesAndBottle) -> None:
        super().__init__(world, method)
        self._holding, self._geometry = method, geometry

    def reset(self, scene: Scene) -> None:
        self._geometry.holds = False
        super().reset(scene)

    def tick(self, now: float, obstacles: Obstacles) -> None:
        if self._geometry.holds and now >= PUT_DOWN:
            self._hold(False)
        elif not self._geometry.holds and TAKEN <= now < PUT_DOWN and self._has_room(obstacles):
            self._hold(True)
        super().tick(now, obstacles)

    def _has_room(self, obstacles: Obstacles) -> bool:
        self._geometry.place(self.joint_positions)
        spheres = zip(obstacles.centres, obstacles.radii, strict=True)
        return all(self._geometry.bottle_clearance(centre, radius) >= ROOM for centre, radius in spheres)

    def _hold(self, holds: bool) -> None:
        self._geometry.holds = holds
        self._holding.hold([BOTTLE] if holds else [])


class BottleStage(Stage):
    """A stage on which the bottle is guarded and judged as the arm is."""

    geometry: MeshesAndBottle

    def __init__(self, arena: Arena) -> None:
        super().__init__(arena, MeshesAndBottle("panda"))
        self.guarded |= {BOTTLE.name}

    def play(self, scene: Scene, method: Method) -> tuple[Outcome, np.ndarray]:
        assert isinstance(method, Holding)
        return self.judge(scene, _BottleInHand(self.world, method, self.geometry))


def measured(arena: Arena, count: int, seed: int) -> str:
    """So many scenes of each family, played by ours and by the control: a table of what was touched."""
    stage, cells = BottleStage(arena), []
    scenes = [draw_scene(arena, family, number, seed) for family in FAMILIES for number in range(count)]
    for name, knows_bottle in (("ours", True), ("control: does not know of it", False)):
        method = Holding(arena, knows_bottle)
        outcomes = [stage.play(scene, method)[0] for scene in scenes]
        cells.append([
            name, len(scenes), sum(outcome.touched_moving for outcome in outcomes),
            sum(outcome.contact == "standing" for outcome in outcomes),
            sum(outcome.success for outcome in outcomes),
        ])  # fmt: skip
    head = [arena.skill.name, "scenes", "touched moving", "standing", "reached"]
    return text_table(head, cells)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    return print_scene_table("bottle_in_hand", __doc__, measured, argv)


if __name__ == "__main__":
    sys.exit(main())
