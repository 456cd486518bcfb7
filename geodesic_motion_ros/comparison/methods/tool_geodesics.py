"""Ours with a skill of the tool: the task-space planner, whose stream of poses the arm follows.

It plans poses and guards the hand alone, whatever is guarded in the arena.
"""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np

from geodesic_motion_ros.comparison.arena import Arena
from geodesic_motion_ros.comparison.method import TICK, Answer
from geodesic_motion_ros.comparison.methods.geodesic import Part
from geodesic_motion_ros.comparison.scene import Scene
from geodesic_motion_ros.experiments.blocked_arm import HAND
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.planner_settings import PlannerSettings
from geodesic_motion_ros.quaternions import to_rotation
from geodesic_motion_ros.reference import ReferenceFollower, TaskSpaceReference

#: Without the hard part hand and spheres are so much smaller, and the hills of the metric as wide as they were.
_SHRUNK = 1e-3


class ToolGeodesics:
    """Shortest paths of the learned metric for a tool. Parts as of `Geodesics`.

    *soft*: what removes nodes and refuses references are spheres a thousandth as large.
    """

    def __init__(self, arena: Arena, part: Part = "whole", planner: PlannerSettings | None = None) -> None:
        """planner : settings; the defaults without them. Its tool is the hand of the arena's arm."""
        settings = replace(planner or PlannerSettings(), **_tool(arena))
        self._scale = 1.0
        if part == "hard":
            settings = replace(settings, ambient_law="hard")
        elif part == "soft":
            self._scale = _SHRUNK
            settings = replace(
                settings, tool_radii=tuple(_SHRUNK * radius for radius in settings.tool_radii), obstacle_margin=0.0,
                ambient_width_ratio=settings.ambient_width_ratio / _SHRUNK,
            )  # fmt: skip
        self._robot, self._planner = arena.robot, ReactivePlanner(arena.skill, settings)
        self._stream = ReferenceFollower(settings.speed)
        self._planned: TaskSpaceReference | None = None
        self.settings = {"part": part, **asdict(settings)}

    def reset(self, scene: Scene) -> None:
        """Forget all that was before."""
        self._planner.take_obstacles(Obstacles.none())
        self._planner.clear_goal()
        self._stream.reset(*self._robot.forward(scene.start))
        self._planned = None
        self._refused = self._planner.set_goal(*scene.goal_pose)

    def tick(self, now: float, obstacles: Obstacles) -> Answer:
        """As the planner node's cycle: the stream is known, and moves on by a tick."""
        stream, planner = self._stream, self._planner
        planner.take_obstacles(replace(obstacles, radii=self._scale * obstacles.radii))
        plan = planner.tick(stream.position, stream.quaternion, stream.speed, now=now)
        if plan.reference is None:
            stream.hold()
        else:
            stream.accept(plan.reference)
        verdict = plan.verdict if self._refused.ok else self._refused
        refusal = "" if verdict.ok else f"{verdict.code.name}: {verdict.reason}"
        planned = plan.reference is not None and not _is_left_of(plan.reference, self._planned)
        self._planned = plan.reference
        return Answer(refusal=refusal, pose=stream.advance(TICK), planned=planned)


def _is_left_of(reference: TaskSpaceReference, before: TaskSpaceReference | None) -> bool:
    """Whether a reference is what is left of the one before: it ends with the same latent points, all but its first."""
    if before is None:
        return False
    rest = reference.latent[1:]
    return np.array_equal(rest, before.latent[max(0, len(before.latent) - len(rest)) :])


def _tool(arena: Arena) -> dict[str, tuple]:
    """The spheres of the hand, fixed to the tool, as settings of the planner."""
    hand, posture = arena.collision.of_link(HAND), arena.shown[0, 0]
    position, quaternion = arena.robot.forward(posture)
    points = to_rotation(quaternion).inv().apply(hand.positions(arena.robot, posture[None])[0] - position)
    return {"tool_points": tuple(map(tuple, points.tolist())), "tool_radii": tuple(hand.radii.tolist())}
