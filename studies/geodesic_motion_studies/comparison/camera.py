"""A camera: methods are handed what it and the planner node's tracker know of the spheres, not where these truly are.

`RATE` frames a second are taken, each in the first tick in which it is due, and what a frame shows is published `DELAY`
later. In a frame

- each sphere is detected where it is but for Gaussian noise of `NOISE` on each axis; which sphere it is, and its
  radius, are known;
- a detection is lost with probability `LOST`, and a sphere is not detected while the arm hides it: the straight line
  from the camera to its centre meets a collision sphere of the arm, all of it, whatever is guarded, where it is then;
- one that has vanished is deleted with the `MISSED`th frame in which the place where it was last detected is in view.

A sphere that is hidden or lost is neither published nor deleted, as with markers that have ids. What becomes of it is
up to the tracker (`obstacles/tracker.py`), which also works out the velocities.

Noise and losses are drawn for every sphere of the scene in every frame, detected or not, by the scene alone: they are
the same for every method. The judge goes by the true spheres.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.certification.path_clearance import segment_distance
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.obstacles.tracker import ObstacleTracker
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Outcome, PlayedMethod, Stage
from geodesic_motion_studies.comparison.method import Method
from geodesic_motion_studies.comparison.scene import Scene, scene_generator

#: Where the camera stands [m], in the arm's base frame: as one that is mounted to watch the table, in front of the arm
#: and above, about 1.4 m from where the demonstrations of the shipped skills are; and to their side, to the right of
#: the arm, so that what passes in front of the hand is not all behind it.
PLACE = np.array([1.4, -0.8, 1.2])
#: Frames per second, and when what one of them shows is published [s]: images, exposure and a detector.
RATE, DELAY = 30.0, 0.08
#: Of a position, the standard deviation on each axis [m], and the probability that a detection is lost.
NOISE, LOST = 0.01, 0.05
#: With so many frames that show that it is not there any more a sphere is deleted.
MISSED = 3
_SOURCE = "camera"
# Times of ticks are off by rounding [s].
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Frame:
    """What is known by one frame.

    Attributes
    ----------
    taken : when [s]. detected : centres (3,) [m] by the numbers of the scene's spheres.
    deleted : numbers of those that have been found to have vanished.
    """

    taken: float
    detected: dict[int, np.ndarray]
    deleted: tuple[int, ...]


class Camera:
    """The camera and its detector in one scene."""

    def __init__(self, arena: Arena, body: CollisionModel, scene: Scene) -> None:
        """body : all of the arm."""
        self._robot, self._body, self._count = arena.robot, body, len(scene.spheres)
        # Not those of the scene itself.
        (self._random,) = scene_generator(arena, scene.family, scene.number, scene.seed).spawn(1)
        self._last_detected: dict[int, np.ndarray] = {}
        self._missed: Counter[int] = Counter()

    def frame(self, now: float, posture: np.ndarray, centres: Mapping[int, np.ndarray]) -> Frame:
        """Take the next frame, at `now` [s].

        posture : of the arm (eta,) [rad]. centres : (3,) [m] of the spheres that are there, by number.
        """
        noise = self._random.normal(scale=NOISE, size=(self._count, 3))
        lost = self._random.uniform(size=self._count) < LOST
        arm = self._body.positions(self._robot, posture[None])[0]
        detected = {
            i: centre + noise[i] for i, centre in centres.items() if not (lost[i] or self._hidden(centre, arm))
        }
        self._last_detected |= detected
        self._missed.update(
            i for i, place in self._last_detected.items() if i not in centres and not self._hidden(place, arm)
        )
        deleted = tuple(i for i in self._last_detected if self._missed[i] == MISSED)
        for i in deleted:
            del self._last_detected[i]
        return Frame(now, detected, deleted)

    def _hidden(self, place: np.ndarray, arm: np.ndarray) -> bool:
        """Whether spheres of the arm at (S, 3) [m] hide a place (3,) [m]."""
        spheres = zip(arm, self._body.radii, strict=True)
        return any(segment_distance(PLACE, place, centre) <= radius for centre, radius in spheres)


class SeenByCamera(PlayedMethod):
    """A method that is handed what the tracker knows by the camera's frames, and the arm that plays its answers."""

    def __init__(self, world: ArmWorld, method: Method, arena: Arena) -> None:
        super().__init__(world, method)
        self._arena, self._body = arena, CollisionModel.named(arena.name)

    def reset(self, scene: Scene) -> None:
        super().reset(scene)
        self._spheres = scene.spheres
        self._camera, self._tracker = Camera(self._arena, self._body, scene), ObstacleTracker()
        self._taken, self._unpublished = 0, deque[Frame]()

    def tick(self, now: float, obstacles: Obstacles) -> None:
        if now >= self._taken / RATE - _ROUNDING:
            self._taken += 1
            # In the order of the scene's spheres; the first contact, after which one is missing, ends the scene.
            there = [i for i, sphere in enumerate(self._spheres) if sphere.is_there(now)]
            centres = dict(zip(there, obstacles.centres, strict=True))
            self._unpublished.append(self._camera.frame(now, self.joint_positions, centres))
        while self._unpublished and now >= self._unpublished[0].taken + DELAY - _ROUNDING:
            self._publish(self._unpublished.popleft(), now)
        super().tick(now, self._tracker.current(now).moved_on(now, PlannerSettings.prediction, now))

    def _publish(self, frame: Frame, now: float) -> None:
        for i, centre in frame.detected.items():
            self._tracker.put(_SOURCE, ("", i), centre, self._spheres[i].radius, now, transit=DELAY)
        for i in frame.deleted:
            self._tracker.delete(_SOURCE, ("", i), now, transit=DELAY)


class CameraStage(Stage):
    """A stage that a camera watches."""

    def __init__(self, arena: Arena) -> None:
        super().__init__(arena)
        self._arena = arena

    def play(self, scene: Scene, method: Method) -> tuple[Outcome, np.ndarray]:
        return self.judge(scene, SeenByCamera(self.world, method, self._arena))
