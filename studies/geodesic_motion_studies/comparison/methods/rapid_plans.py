"""RRT-Connect of roboplan, which looks at its plan ten times a second, and plans anew where that is blocked.

S. Castro, "roboplan", a library on Pinocchio whose collision checks are compiled: a plan takes milliseconds. Its model
is the arm's own URDF with the collision spheres that all methods go by, and links that may meet with all of them. A
plan knows where obstacles are, not how they move, and keeps `KEPT_OFF` from them, or half of what start or goal keep.
It is cut short by the library, rounded, and timed within the limits that every method has.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Callable
from itertools import combinations
from typing import Any

import numpy as np

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.queries.path_smoothing import resample_latent, smooth_latent
from geodesic_motion_ros.trajectory.timing import timed_joint_reference
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.method import Answer
from geodesic_motion_studies.comparison.replanning import LATENCY, Playing
from geodesic_motion_studies.comparison.scene import Scene

#: How often it looks [s], nodes of the trees, their longest step and how finely motions are looked at [rad], and what
#: is kept from obstacles [m].
PERIOD, NODES, STEP, CHECKED, KEPT_OFF = 0.1, 3000, 1.0, 0.05, 0.02
#: Samples of a plan are so far apart [rad], and corners are rounded over so many of them.
SAMPLED, ROUNDED = 0.03, 3.0
_GROUP = "arm"


class RapidPlans:
    """The plans of one arm to the goal of one scene after the other."""

    def __init__(self, arena: Arena) -> None:
        from roboplan.core import Scene as Model
        from roboplan.core import loadUrdfSceneDescriptionFromXml

        self._arena = arena
        self._model = Model(_GROUP, loadUrdfSceneDescriptionFromXml(_with_spheres(arena)))
        self._model.addGroup(_GROUP, self._model.getJointNames())
        links, meeting = dict.fromkeys(arena.collision.points.names), _meeting(arena)
        self._model.setCollisions([pair for pair in combinations(links, 2) if pair not in meeting], False)
        self._model.setCollisions([pair for pair in combinations(links, 2) if pair in meeting], True)
        self.settings: dict[str, Any] = {
            "library": "roboplan", "planner": "RRTConnect", "period": PERIOD, "nodes": NODES, "step": STEP,
            "checked": CHECKED, "kept_off": KEPT_OFF, "rounded": ROUNDED, "latency": LATENCY,
        }  # fmt: skip

    def reset(self, scene: Scene) -> None:
        """Forget the plan before."""
        self._goal, self._solids, self._path = scene.goal, scene.declared.solids, np.empty((0, len(scene.goal)))
        self._seed = scene.number

    def is_free(self, position: np.ndarray, obstacles: Obstacles) -> bool:
        """Whether the plan is free from its place nearest to a position (eta,) [rad] on; False where there is none."""
        if not len(self._path):
            return False
        left = self._path[int(np.argmin(np.linalg.norm(self._path - position, axis=1))) :]
        with _Among(self._model, obstacles.beside(self._solids), self._kept_off(left[0], obstacles)):
            return not any(self._model.hasCollisions(configuration) for configuration in left)

    def planned(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, obstacles: Obstacles
    ) -> JointReference | None:
        """Plan anew from a state of motion (eta,); None where no plan is found, or the arm cannot be led onto it."""
        self._path = np.empty((0, len(self._goal)))
        path = self._found(position, obstacles)
        if path is None:
            return None
        curve = smooth_latent(resample_latent(path, SAMPLED), ROUNDED)
        curve[0], curve[-1] = position, self._goal
        shares = np.linspace(0.0, 1.0, len(curve))[:, None]
        limits = self._arena.limits
        inside = np.clip(curve, limits.lower, limits.upper)
        reference = timed_joint_reference(inside, shares, limits, velocity, acceleration)
        if reference is not None:
            self._path = curve
        return reference

    def _found(self, position: np.ndarray, obstacles: Obstacles) -> np.ndarray | None:
        """Corners (n, eta) [rad] of a path to the goal."""
        from roboplan.core import JointConfiguration, PathShortcutter, PathShortcuttingOptions
        from roboplan.rrt import RRT, RRTOptions

        self._seed += 1
        with _Among(self._model, obstacles.beside(self._solids), self._kept_off(position, obstacles)):
            options = RRTOptions(_GROUP, NODES, STEP, CHECKED, rrt_connect=True)
            planner, names = RRT(self._model, options), self._model.getJointNames()
            planner.setRngSeed(self._seed)
            try:
                path = planner.plan(JointConfiguration(names, position), JointConfiguration(names, self._goal))
            except RuntimeError:
                return None
            cut = PathShortcutter(self._model, PathShortcuttingOptions(_GROUP, CHECKED, seed=self._seed))
            return np.array(cut.shortcut(path).positions)

    def _kept_off(self, position: np.ndarray, obstacles: Obstacles) -> float:
        """What is kept [m]: an arm that stands nearer to an obstacle may leave it, and may go to a goal that is."""
        there = obstacles.beside(self._solids)
        body, ends = (self._arena.collision, self._arena.robot), (position, self._goal)
        return min(KEPT_OFF, *(0.5 * max(0.0, obstacle_clearance(*body, end, there)[0]) for end in ends))


class PlanFollower(Playing):
    """Plays the plans: the newest, while it is free where obstacles are; without one the arm stops along it."""

    def __init__(self, arena: Arena) -> None:
        super().__init__(arena)
        self._plans = RapidPlans(arena)
        self.settings = self._plans.settings

    def reset(self, scene: Scene) -> None:
        """Forget all that was before."""
        super().reset(scene)
        self._plans.reset(scene)
        self._looked, self._refusal = -np.inf, ""

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """Look at the plan where it is time to; the obstacles are taken to stand where they are."""
        if now < self._looked + PERIOD - 1e-6:
            return Answer(refusal=self._refusal)
        self._looked, switch = now, now + LATENCY
        state = self._played.sample(switch - self._begin)
        if self._plans.is_free(state[0], obstacles):
            return Answer()
        reference = self._plans.planned(*state, obstacles)
        self._refusal = "" if reference is not None else "no plan was found"
        if reference is None:
            return self._stop(now, switch, self._refusal)
        return self._play(reference, now, switch, "")


class _Among:
    """Obstacles in the library's model, enlarged by what is kept from them [m], for as long as a block takes."""

    def __init__(self, model: Any, obstacles: Obstacles, kept_off: float) -> None:
        self._model, self._obstacles, self._kept_off = model, obstacles, kept_off
        self._names: list[str] = []

    def __enter__(self) -> None:
        from roboplan.core import Box, Sphere

        for centre, radius in zip(self._obstacles.centres, self._obstacles.radii, strict=True):
            self._add(self._model.addSphereGeometry, Sphere(radius + self._kept_off), centre, np.eye(3))
        for solid in self._obstacles.solids:
            sizes = 2.0 * (solid[3:6] + solid[6] + self._kept_off)
            self._add(self._model.addBoxGeometry, Box(*sizes), solid[:3], solid[7:].reshape(3, 3))

    def _add(self, add: Callable[..., None], shape: Any, centre: np.ndarray, rotation: np.ndarray) -> None:
        placed, name = np.eye(4), f"obstacle_{len(self._names)}"
        placed[:3, :3], placed[:3, 3] = rotation, centre
        add(name, "universe", shape, placed, np.ones(4))
        self._names.append(name)

    def __exit__(self, *error: object) -> None:
        for name in self._names:
            self._model.removeGeometry(name)


def _with_spheres(arena: Arena) -> str:
    """The arm's URDF with its collision spheres."""
    tree = ElementTree.parse(arena.robot.urdf).getroot()
    links, model = {link.get("name"): link for link in tree.iter("link")}, arena.collision
    for name, offset, radius in zip(model.points.names, model.points.offsets, model.radii, strict=True):
        collision = ElementTree.SubElement(links[name], "collision")
        ElementTree.SubElement(collision, "origin", xyz=" ".join(map(str, offset)), rpy="0 0 0")
        ElementTree.SubElement(ElementTree.SubElement(collision, "geometry"), "sphere", radius=str(radius))
    return ElementTree.tostring(tree, encoding="unicode")


def _meeting(arena: Arena) -> set[tuple[str, str]]:
    """Pairs of links all of whose spheres must not overlap; those of which some may are not checked."""
    names = arena.collision.points.names
    spheres, checked = Counter(names), Counter((names[one], names[other]) for one, other in arena.collision.self_pairs)
    return {pair for pair, count in checked.items() if count == spheres[pair[0]] * spheres[pair[1]]}
