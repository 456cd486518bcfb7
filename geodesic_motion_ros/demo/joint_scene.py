"""The demo of a joint-space skill: a sphere moves into the path of the hand; pictures of the whole arm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from geodesic_motion_ros.demo.demo_pictures import AROUND_RGB, FREE_RGB, Curve, Film, draw_films, met
from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.demo_scene import DemoScene
from geodesic_motion_ros.demo.hand_scene import across_the_hand
from geodesic_motion_ros.queries.path_smoothing import smooth_latent
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle
from geodesic_motion_ros.visualization.joint_plots import draw_tubes
from geodesic_motion_ros.visualization.plots import (
    BLUE,
    VERMILION,
    DrawnPath,
    Sphere,
    draw_in_space,
    legend_below,
    write_figure,
)

#: Recorded instants that are looked up in the latent space [1/s].
_REPLAY_RATE = 20.0
#: Width over which their latent points are averaged, in instants.
_LATENT_SMOOTHING = 4.0
#: Radii [m] of the tubes that show where a part of the arm was, without obstacle and around it: where both motions are
#: one the thicker tube is seen.
_TUBES = {"tool": (0.0015, 0.0025), "elbow": (0.0055, 0.007)}
#: The name of a curve stands beside its beginning [cm].
_NAME_ABOVE = np.array([0.0, -1.0, 2.0])


class JointScene(DemoScene):
    """A sphere crosses the undisturbed motion as in the scene of the hand: the elbow has no other side to take.

    Attributes
    ----------
    shown : parts of the arm whose paths are drawn; the last is the one that the sphere meets.
    view : one of `camera.VIEWS`.
    """

    # Where a trajectory comes too late, or the simulation stands still for a moment, the arm is soon far from where it
    # was sent: its joints make one radian a second. A robot's own controller does not pause.
    patience = MappingProxyType({"latency": 0.1, "tracking_tolerance_joint": 0.3})
    shown: tuple[str, ...] = ("tool",)
    view = "front"

    def _obstacles(self) -> Iterator[LineObstacle]:
        return across_the_hand(self.planner.robot, self.nominal)

    def positions(self, part: str, configurations: np.ndarray) -> np.ndarray:
        """Where a part of the arm is (n, 3) [m] in configurations (n, eta) [rad]."""
        return end_effector_poses(np.ascontiguousarray(configurations), self.planner.robot.chain)[0]

    def draw(self, recordings: Mapping[str, Recording], out: Path) -> None:
        free, around = recordings["no_obstacle"], recordings["avoidance_on"]
        obstacle = met(around, *self._followed(around), self.obstacle.radius)
        named = ((free, "without obstacle", BLUE), (around, "around the moving obstacle", VERMILION))
        measured = [
            DrawnPath(self._replay(recording), np.array(recording.positions), name, colour)
            for recording, name, colour in named
        ]
        parts = {
            part: [
                replace(motion, positions=self.positions(part, np.array(recording.joints)))
                for motion, (recording, *_) in zip(measured, named, strict=True)
            ]
            for part in self.shown
        }
        title = f"Latent space of {self.skill.name}: two motions to one goal"
        draw_tubes(out / "latent.png", self.planner, measured, obstacle, title)
        self._draw_paths(out / "paths.png", parts, obstacle)
        curves = [
            Curve(motion.positions, colour, radius)
            for part, motions in parts.items()
            for motion, colour, radius in zip(motions, (FREE_RGB, AROUND_RGB), _TUBES[part], strict=True)
        ]
        film = Film(self.view, curves, self._followed)
        draw_films(out, self.planner, recordings, self.obstacle.radius, film)

    def _followed(self, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) [s] and where the part that the sphere meets was (n, 3) [m]."""
        return np.array(recording.joint_times), self.positions(self.shown[-1], np.array(recording.joints))

    def _draw_paths(self, path: Path, motions: Mapping[str, Sequence[DrawnPath]], obstacle: Sphere) -> None:
        """Measured motions of parts of the arm, by their names, among those in the demonstrations."""
        demonstrated = [self.skill.decoder.configurations(code) for code in self.skill.codes]
        among = [self.positions(part, item) for part in motions for item in demonstrated]
        figure = Figure(figsize=(9.0, 6.4), layout="constrained")
        space = figure.add_subplot(projection="3d", computed_zorder=False)
        every = [motion for part in motions.values() for motion in part]
        handles = draw_in_space(space, among, every, obstacle, zoom=1.15)
        for name, (undisturbed, *_) in motions.items():
            space.text(*(100.0 * undisturbed.positions[0] + _NAME_ABOVE), name, fontsize=11, ha="right", zorder=5)
        figure.suptitle(f"Motions of the {' and the '.join(motions)}, as measured", x=0.01, ha="left", fontsize=11)
        legend_below(figure, handles)
        write_figure(figure, path)

    def _replay(self, recording: Recording) -> np.ndarray:
        """Latent points (n, d) along a recorded motion."""
        return smooth_latent(self.planner.graph.latent[self.nodes_along(recording)], _LATENT_SMOOTHING)

    def nodes_along(self, recording: Recording) -> np.ndarray:
        """Nodes (n,) of the latent graph whose configurations are nearest to those measured, `_REPLAY_RATE` a second.

        Start and goal are the mean ones that the skill has learned: nodes need not be carried to them.
        """
        times = np.arange(recording.joint_times[0], recording.joint_times[-1], 1.0 / _REPLAY_RATE)
        measured = np.array(recording.joints)[np.searchsorted(recording.joint_times, times)]
        return cKDTree(self.planner.graph.configurations).query(measured)[1]
