"""The demo of a task-space skill: a sphere moves into the way of the hand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from geodesic_motion_ros.nodes.demo_pictures import (
    AROUND_RGB,
    FREE_RGB,
    Curve,
    Film,
    draw_films,
    met,
    recorded_at,
)
from geodesic_motion_ros.nodes.demo_run import Recording
from geodesic_motion_ros.nodes.demo_scene import DEFAULTS, DemoScene
from geodesic_motion_ros.nodes.skill_kinds import task_settings
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.plots import BLUE, VERMILION, Way, draw_latent, draw_paths
from geodesic_motion_ros.quaternions import to_rotation
from geodesic_motion_ros.simulation.scenes import LineObstacle, crossing
from geodesic_motion_ros.skill import Skill

#: The sphere: radius [m] and speed [m/s]; when the undisturbed motion would meet it (share of its duration); how far
#: beside the tool's way it crosses, along the tool's x axis [m], so that there is room on its other side.
RADIUS, SPEED, MEETING_SHARE, BESIDE = 0.035, 0.10, 0.60, 0.022
#: It sets out this far from the way [m], is there a little before the hand [s], and comes to rest this far behind it
#: [m], which is still under the palm: where a busy machine slows the arm down, the sphere is in its way all the same.
BEFORE, EARLY, AFTER = 0.30, 0.3, 0.06
#: Recorded instants that are planned again, to know where the motion was in latent space [1/s].
_REPLAY_RATE = 20.0


class HandScene(DemoScene):
    """A sphere crosses the undisturbed motion, across the hand and a little beside the tool's way."""

    def __init__(self, skill: Skill) -> None:
        self.planner = ReactivePlanner(skill, task_settings(DEFAULTS))
        super().__init__(self.planner)

    def _obstacle(self) -> LineObstacle:
        meeting = MEETING_SHARE * self.nominal.duration
        position, quaternion = self.nominal.sample(meeting)
        x_axis, y_axis, _ = to_rotation(quaternion).as_matrix().T
        return crossing(position + BESIDE * x_axis, y_axis, meeting - EARLY, SPEED, RADIUS, BEFORE, AFTER)

    def families(self, recording: Recording) -> None:
        return None

    def draw(self, recordings: Mapping[str, Recording], out: Path) -> None:
        free, around = recordings["no_obstacle"], recordings["avoidance_on"]
        obstacle = met(around, *_tool_way(around), self.obstacle.radius)
        ways = (
            Way(self._replay(free), np.array(free.positions), "without obstacle", BLUE),
            Way(self._replay(around), np.array(around.positions), "around the moving obstacle", VERMILION),
        )
        title = f"Latent space of {self.skill.name}: two motions to one goal"
        draw_latent(out / "latent.png", self.skill, self.planner.settings, ways, obstacle, title)
        draw_paths(out / "paths.png", self.skill, ways, obstacle, "Way of the tool, as measured")
        curves = (
            Curve(np.array(free.positions), FREE_RGB, 0.0025),
            Curve(np.array(around.positions), AROUND_RGB, 0.004),
        )
        draw_films(out, recordings, self.obstacle.radius, Film("front", curves, _tool_way))

    def _replay(self, recording: Recording) -> np.ndarray:
        """Latent points (n, d) along a recorded motion.

        The planner is given the recorded poses and obstacles again; where it then stands on its own reference is where
        the motion was in the latent space.
        """
        planner = self.planner
        planner.clear_goal()
        planner.set_goal(self.goal[:3], self.goal[3:])
        latent = []
        for time in np.arange(recording.pose_times[0], recording.pose_times[-1], 1.0 / _REPLAY_RATE):
            i = min(int(np.searchsorted(recording.pose_times, time)), len(recording.pose_times) - 1)
            if recording.obstacles:
                centre = recorded_at(recording.obstacle_times, recording.obstacles, time)
                planner.set_obstacles(centre[None], np.array([self.obstacle.radius]))
            else:
                planner.set_obstacles(np.zeros((0, 3)), np.zeros(0))
            reference = planner.tick(recording.positions[i], recording.quaternions[i]).reference
            if reference is not None:
                latent.append(reference.latent[0])
        return np.array([*latent, reference.latent[-1]] if reference is not None else latent)


def _tool_way(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    return np.array(recording.pose_times), np.array(recording.positions)
