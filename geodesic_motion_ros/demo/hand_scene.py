"""The demo of a task-space skill: a sphere moves into the path of the hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from geodesic_motion_ros.demo.demo_pictures import AROUND_RGB, FREE_RGB, Curve, Film, draw_films, met
from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.demo_scene import DemoScene
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.manifold.pose_graph import PoseGraph
from geodesic_motion_ros.queries.path_smoothing import smooth_latent
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle, crossing
from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_ros.visualization.plots import BLUE, VERMILION, DrawnPath, draw_latent, draw_paths

#: The sphere: radius [m] and speed [m/s]; how far beside the tool's path it crosses [m], so that there is room on its
#: other side.
RADIUS, SPEED, BESIDE = 0.035, 0.10, 0.022
#: When the undisturbed motion would meet it (shares of its duration), and where it goes: angles about the tool's z
#: axis, from its y axis [rad].
MEETING_SHARES, DIRECTIONS = (0.5, 0.4, 0.3), (0.0, np.pi, 0.5 * np.pi, 1.5 * np.pi)
#: It sets out this far from the path [m], is there a little before the hand [s], and comes to rest this far behind it
#: [m], which is still under the palm: where a busy machine slows the arm down, the sphere is in its path all the same.
BEFORE, EARLY, AFTER = 0.30, 0.3, 0.06
#: Recorded instants that are looked up in the latent space [1/s], and the width over which they are averaged.
_REPLAY_RATE, _LATENT_SMOOTHING = 20.0, 4.0
#: What a unit quaternion counts beside a metre where the nearest node is looked up [m].
_TURNING = 0.1


class HandScene(DemoScene):
    """A sphere crosses the undisturbed motion, across the hand and a little beside the tool's path."""

    def _obstacles(self) -> Iterator[LineObstacle]:
        return across_the_hand(self.planner.robot, self.nominal)

    def draw(self, recordings: Mapping[str, Recording], out: Path) -> None:
        free, around = recordings["no_obstacle"], recordings["avoidance_on"]
        obstacle = met(around, *tool_positions(around), self.obstacle.radius)
        motions = (
            DrawnPath(self._replay(free), np.array(free.positions), "without obstacle", BLUE),
            DrawnPath(self._replay(around), np.array(around.positions), "around the moving obstacle", VERMILION),
        )
        title = f"Latent space of {self.skill.name}: two motions to one goal"
        draw_latent(out / "latent.png", self.skill, self.planner.settings, motions, obstacle, title)
        draw_paths(out / "paths.png", self.skill, motions, obstacle, "Motion of the tool, as measured")
        curves = (
            Curve(np.array(free.positions), FREE_RGB, 0.0025),
            Curve(np.array(around.positions), AROUND_RGB, 0.004),
        )
        draw_films(out, self.planner, recordings, self.obstacle.radius, Film("front", curves, tool_positions))

    def _replay(self, recording: Recording) -> np.ndarray:
        """Latent points (n, d) along a recorded motion: of the nodes whose poses are nearest, `_REPLAY_RATE` a second.

        Start and goal are the mean ones that the skill has learned: nodes need not be carried to them.
        """
        graph = self.planner.graph
        assert isinstance(graph, PoseGraph)
        decoded = graph.decoded
        times = np.arange(recording.pose_times[0], recording.pose_times[-1], 1.0 / _REPLAY_RATE)
        rows = np.searchsorted(recording.pose_times, times)
        positions, quaternions = np.array(recording.positions)[rows], np.array(recording.quaternions)[rows]
        quaternions *= np.where(quaternions @ decoded.quaternions[0] < 0.0, -1.0, 1.0)[:, None]
        known = np.concatenate([decoded.positions, _TURNING * decoded.quaternions], axis=1)
        measured = np.concatenate([positions, _TURNING * quaternions], axis=1)
        return smooth_latent(graph.latent[cKDTree(known).query(measured)[1]], _LATENT_SMOOTHING)


def across_the_hand(robot: Robot, nominal: JointReference) -> Iterator[LineObstacle]:
    """Spheres that cross a motion a little beside the tool's path: halfway and along the tool's y axis, then others."""
    for share, angle in product(MEETING_SHARES, DIRECTIONS):
        meeting = share * nominal.duration
        position, quaternion = robot.forward(nominal.sample(meeting)[0])
        x_axis, y_axis, _ = to_rotation(quaternion).as_matrix().T
        beside = np.cos(angle) * x_axis + np.sin(angle) * y_axis
        along = np.cos(angle) * y_axis - np.sin(angle) * x_axis
        at = max(meeting - EARLY, 0.0)
        # in a short motion it sets out nearer, for it does so no sooner than the arm
        yield crossing(position + BESIDE * beside, along, at, SPEED, RADIUS, min(BEFORE, SPEED * at), AFTER)


def tool_positions(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) [s] and where the tool was (n, 3) [m]."""
    return np.array(recording.pose_times), np.array(recording.positions)
