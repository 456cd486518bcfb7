"""A depth camera: methods are handed what its clouds show, read as the planner node reads them, not the spheres.

`RATE` pictures a second are rendered of the arm, the spheres and the declared scene (`simulation/depth_camera.py`), by
the place of the camera of `camera.py`, each in the first tick in which it is due; it is published `DELAY` later. Depths
have noise, what is behind something else is not seen, and the robot is in view. Out of a cloud

- the arm is taken, at the joints that were measured when it was rendered (`robot/self_filter.py`);
- what hangs together and is small becomes a sphere, tracked over the clouds (`obstacles/cluster_tracks.py`);
- the rest is a distance field, which stands.

All of it is code of the node, with the defaults of its parameters. Methods that know spheres alone are not handed the
field. Noise depends on the scene alone. The judge goes by the true spheres; of one that touches it is noted for how
long it had been in view.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.nodes.parameter_tables import PLANNER
from geodesic_motion_ros.nodes.seen_cloud import CloudSettings, SeenCloud, see_cloud
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.self_filter import SelfFilter
from geodesic_motion_ros.simulation.depth_camera import DepthCamera, DepthCameraSettings
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.camera import DELAY, PLACE, RATE
from geodesic_motion_studies.comparison.execution import Outcome, PlayedMethod, Stage
from geodesic_motion_studies.comparison.method import Method
from geodesic_motion_studies.comparison.scene import Scene, scene_generator
from geodesic_motion_studies.tools.collision_geometry import CollisionGeometry

#: In the middle of the picture [m]: about where the demonstrations of the shipped skills are.
TARGET = (0.35, 0.0, 0.35)
#: A sphere is in view as long as every picture has so many points of it, no farther off than noise brings them [m].
SHOWN, SHOWN_WITHIN = 4, 0.015
#: For how long before a contact pictures are looked at [s].
LOOKED_BACK = 1.0
_SOURCE = "obstacle_cloud"
# Times of ticks are off by rounding [s].
_ROUNDING = 1e-6


def node_settings() -> CloudSettings:
    """How the planner node reads clouds by default."""
    values = {parameter.name: parameter.default for parameter in PLANNER}
    return CloudSettings(
        values["obstacle_cloud_voxel"], values["obstacle_cloud_radius"], values["obstacle_cloud_thickness"],
        values["self_filter_padding"],
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Picture:
    """One cloud: when it was taken [s], the joints then (eta,) [rad], its points (n, 3) [m] in the base frame, and the
    spheres that were there: centres (3,) and radii [m].
    """

    taken: float
    joints: np.ndarray
    points: np.ndarray
    spheres: Mapping[str, tuple[np.ndarray, float]]

    def shows(self, name: str) -> bool:
        """Whether it has points of a sphere that was there."""
        if name not in self.spheres:
            return False
        centre, radius = self.spheres[name]
        off = np.linalg.norm(self.points - centre, axis=1) - radius
        return int(np.count_nonzero(off <= SHOWN_WITHIN)) >= SHOWN


class SeenInClouds(PlayedMethod):
    """A method that is handed what clouds show, and the arm that plays its answers."""

    def __init__(self, world: ArmWorld, method: Method, arena: Arena) -> None:
        super().__init__(world, method)
        self._arena, self._settings = arena, node_settings()
        self._filter = SelfFilter(arena.robot, CollisionModel.named(arena.name))

    def reset(self, scene: Scene) -> None:
        super().reset(scene)
        self._spheres = scene.spheres
        view = DepthCameraSettings(place=tuple(PLACE.tolist()), target=TARGET)
        self._camera = DepthCamera(self._arena.name, view, scene.declared)
        # Not those of the scene itself.
        (self._random,) = scene_generator(self._arena, scene.family, scene.number, scene.seed).spawn(1)
        self._tracker: ObstacleTracker = ObstacleTracker()
        self._seen: SeenCloud | None = None
        self._declared = scene.declared
        self._taken, self._unpublished = 0, deque[Picture]()
        self._pictures = deque[Picture](maxlen=round(LOOKED_BACK * RATE))

    def tick(self, now: float, obstacles: Obstacles) -> None:
        if now >= self._taken / RATE - _ROUNDING:
            self._taken += 1
            there = [(str(i), sphere.radius) for i, sphere in enumerate(self._spheres) if sphere.is_there(now)]
            placed = {name: (at, radius) for (name, radius), at in zip(there, obstacles.centres, strict=True)}
            joints = self.joint_positions
            points = self._camera.to_base(self._camera.points(joints, placed, self._random))
            picture = Picture(now, joints, points, placed)
            self._unpublished.append(picture)
            self._pictures.append(picture)
        while self._unpublished and now >= self._unpublished[0].taken + DELAY - _ROUNDING:
            self._publish(self._unpublished.popleft(), now)
        super().tick(now, self._tracker.current(now).moved_on(now, PlannerSettings.prediction, now))

    def in_view(self, geometry: CollisionGeometry) -> float:
        """Return for how long [s] pictures have shown the sphere nearest to the arm by now: LOOKED_BACK at most."""
        spheres, shown = self._pictures[-1].spheres, 0
        name = min(spheres, key=lambda one: geometry.clearance(*spheres[one]))
        for picture in reversed(self._pictures):
            if not picture.shows(name):
                break
            shown += 1
        return shown / RATE

    def close(self) -> None:
        """End the camera's world."""
        self._camera.close()

    def _publish(self, picture: Picture, now: float) -> None:
        self._seen = seen = see_cloud(
            picture.points, self._filter, picture.joints, (), self._declared.solids, self._settings, picture.taken,
            self._seen, PLACE,
        )  # fmt: skip
        self._tracker.replace_cloud(
            _SOURCE, seen.field, now, now - picture.taken, clusters=seen.clusters, around=seen.around,
            sight=seen.memory.sight,
        )


class CloudStage(Stage):
    """A stage that a depth camera watches."""

    def __init__(self, arena: Arena) -> None:
        super().__init__(arena)
        self._arena = arena

    def play(self, scene: Scene, method: Method) -> tuple[Outcome, np.ndarray]:
        seen = SeenInClouds(self.world, method, self._arena)
        try:
            outcome, postures = self.judge(scene, seen)
            if outcome.contact and outcome.contact != "scene":
                self.geometry.place(seen.joint_positions)
                outcome = replace(outcome, in_view=seen.in_view(self.geometry))
            return outcome, postures
        finally:
            seen.close()
