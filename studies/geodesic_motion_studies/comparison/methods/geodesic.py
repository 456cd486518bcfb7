"""Ours: the joint-space planner of this package; whole, with its hard part alone, and with its soft part alone."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Literal

import numpy as np

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.kernels.loading import load_kernels
from geodesic_motion_ros.motion.tracking import Tracking, TrackingMonitor
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.body_points import BodyPoints
from geodesic_motion_ros.robot.collision_model import CollisionModel
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.method import Answer
from geodesic_motion_studies.comparison.scene import Scene
from geodesic_motion_studies.comparison.spheres_seen import SpheresSeen

Part = Literal["whole", "demonstrated", "hard", "soft"]


class Geodesics:
    """Shortest paths of the learned metric, in a scene where nothing stands but the spheres and what is declared.

    *whole*: as the planner is. *demonstrated*, and the others: without detours (`detour` 0).
    *hard*: nodes in obstacles are removed and references certified, but the metric does not grow towards obstacles.
    *soft*: the metric grows, but nothing is removed or certified. This is not the paper's planner: endpoints are
    normalised (canonical sheet), the graph is pruned, obstacles are predicted and the cost of a path is limited, as in
    the other parts. It has no body that could touch what is declared, and does not know of it.
    """

    def __init__(self, arena: Arena, part: Part = "whole", planner: PlannerSettings | None = None) -> None:
        """planner : settings; the defaults without them."""
        settings = planner or PlannerSettings()
        if part != "whole":
            settings = replace(settings, detour=0.0)
        if part == "hard":
            settings = replace(settings, ambient_law="hard")
        if not arena.whole_arm:
            settings = replace(settings, **tool_of(arena))
        if part != "soft":
            settings = replace(settings, avoid=arena.guard)
        self._arena, self._part = arena, part
        # By what is declared around the arm: a planner has one scene, and takes seconds to make.
        self._planners: dict[bytes, ReactivePlanner] = {}
        self._seen = SpheresSeen()
        self._planner_settings = settings
        self.settings = {"part": part, **asdict(settings)}

    def reset(self, scene: Scene) -> None:
        """Forget all that was before."""
        declared = scene.declared.solids.tobytes()
        if declared not in self._planners:
            self._planners[declared] = self._made(scene.declared)
        self._planner = self._planners[declared]
        self._tracking = TrackingMonitor(self._planner.robot, self._planner.collision)
        self._seen = SpheresSeen()
        self._planner.set_tracking(Tracking())
        self._planner.take_obstacles(Obstacles.none())
        self._planner.stand_at(scene.start, 0.0)
        if self._arena.whole_arm:
            self._planner.set_goal_configuration(scene.goal)
        else:
            self._planner.set_goal(*scene.goal_pose)

    def _made(self, declared: DeclaredScene) -> ReactivePlanner:
        skill, settings = self._arena.skill, self._planner_settings
        if self._part == "soft":
            planner = ReactivePlanner(skill, settings, collision=no_body(self._arena.robot))
        else:
            planner = ReactivePlanner(skill, settings, scene=declared)
        load_kernels(planner)
        return planner

    def track(self, measured: np.ndarray, now: float) -> None:
        """As the planner node's cycle."""
        commanded = self._planner.commanded_state(now)
        assert commanded is not None
        self._planner.set_tracking(self._tracking.add(measured, commanded[0], now))

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """As the planner node's cycle."""
        self._planner.take_obstacles(self._seen.with_errors(now, obstacles))
        plan = self._planner.tick(now)
        refusal = "" if plan.verdict.ok else f"{plan.verdict.code.name}: {plan.verdict.reason}"
        if plan.reference is None or now >= plan.begin + plan.reference.duration:
            return Answer(refusal=refusal)
        return Answer.playing(plan.reference, plan.begin, refusal)


def no_body(robot: Robot) -> CollisionModel:
    """A body that no obstacle can touch: a millimetre inside the shoulder."""
    frame = int(np.flatnonzero(robot.chain[3] >= 0)[0]) + 1
    points = BodyPoints((robot.link_names[frame],), np.array([frame], dtype=np.int64), np.zeros((1, 3)))
    return CollisionModel(points, np.array([1e-3]), np.array([True]), np.empty((0, 2), dtype=np.int64))


def tool_of(arena: Arena) -> dict[str, tuple]:
    """The spheres of the hand, fixed to the tool, as settings of the planner."""
    hand, posture = CollisionModel.named(arena.name).of_link(arena.hand), arena.shown[0, 0]
    position, quaternion = arena.robot.forward(posture)
    points = to_rotation(quaternion).inv().apply(hand.positions(arena.robot, posture[None])[0] - position)
    return {"tool_points": tuple(map(tuple, points.tolist())), "tool_radii": tuple(hand.radii.tolist())}
