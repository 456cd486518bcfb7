"""The demo of a joint-space skill: a sphere moves to where the elbow would be, far from the hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from types import MappingProxyType

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from geodesic_motion_ros.demo.demo_pictures import AROUND_RGB, FREE_RGB, Curve, Film, draw_films, met
from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.demo.demo_scene import DEFAULTS, DemoScene
from geodesic_motion_ros.nodes.skill_kinds import planner_settings
from geodesic_motion_ros.planning.declared_scene import DeclaredScene
from geodesic_motion_ros.planning.path_smoothing import smooth_latent
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.swivel import elbow_position, swivel_angle
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle, crossing
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import JointReference
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

#: The sphere: radius [m], speed [m/s], and how far from its place it sets out [m].
RADIUS, SPEED, BEFORE = 0.055, 0.10, 0.45
#: It comes to rest this long [s] after the undisturbed elbow would have been there. Its surface is in the path seconds
#: before: the elbow has set out by then, and has time to turn back.
LATE = 1.7
#: A family counts as taken where its mean path has more than this share; where families begin and end alike, none has.
_TAKEN_SHARE = 0.9
#: Recorded instants that are looked up in the latent space [1/s].
_REPLAY_RATE = 20.0
#: Width over which their latent points are averaged, in instants.
_LATENT_SMOOTHING = 4.0
#: Radii [m] of the tubes that show where tool and elbow were, without obstacle and around it: where both motions are
#: one the thicker tube is seen.
_TOOL_TUBES, _ELBOW_TUBES = (0.0015, 0.0025), (0.0055, 0.007)
#: The name of a curve stands beside its beginning [cm].
_NAME_ABOVE = np.array([0.0, -1.0, 2.0])


class ElbowScene(DemoScene):
    """A sphere comes from outside to where the undisturbed elbow would be swung out furthest, and stays."""

    # Where a trajectory comes too late, or the simulation stands still for a moment, the arm is soon far from where it
    # was sent: its joints make one radian a second. A robot's own controller does not pause.
    patience = MappingProxyType({"latency": 0.1, "tracking_tolerance_joint": 0.3})

    def __init__(self, skill: Skill, declared: DeclaredScene | None = None) -> None:
        """declared : what always stands around the arm; None: nothing was declared."""
        self.planner = ReactivePlanner(skill, planner_settings(DEFAULTS | self.patience), scene=declared)
        super().__init__(self.planner)

    def _obstacle(self) -> LineObstacle:
        time = self._furthest_out(self.nominal)
        configuration = self.nominal.sample(time)[0]
        robot = self.planner.robot
        elbow, hand = elbow_position(robot, configuration), robot.forward(configuration)[0]
        inwards = _foot(elbow, robot.shoulder, hand) - elbow
        return crossing(elbow, inwards, time + LATE, SPEED, RADIUS, BEFORE, after=0.0)

    def _furthest_out(self, reference: JointReference) -> float:
        angles = [abs(swivel_angle(self.planner.robot, position)) for position in reference.positions]
        return float(reference.times[np.argmax(angles)])

    def families(self, recording: Recording) -> list[int] | None:
        if self.planner.graph.mean_path_count == 0:
            return None
        shares = self.planner.graph.mean_path_shares[self._nodes_along(recording)]
        taken = np.argmax(shares, axis=1)[np.max(shares, axis=1) > _TAKEN_SHARE]
        return [int(family) for family, _ in groupby(taken)]

    def draw(self, recordings: Mapping[str, Recording], out: Path) -> None:
        free, around = recordings["no_obstacle"], recordings["avoidance_on"]
        obstacle = met(around, *self._elbow_positions(around), self.obstacle.radius)
        tool = (
            self._measured(free, "without obstacle", BLUE),
            self._measured(around, "around the moving obstacle", VERMILION),
        )
        elbow = tuple(
            replace(motion, positions=self._elbow_positions(recording)[1])
            for motion, recording in zip(tool, (free, around), strict=True)
        )
        title = f"Latent space of {self.skill.name}: two motions to one goal"
        draw_tubes(out / "latent.png", self.planner, tool, obstacle, title)
        self._draw_paths(out / "paths.png", {"tool": tool, "elbow": elbow}, obstacle)
        curves = [
            Curve(motion.positions, colour, radius)
            for motions, radii in ((tool, _TOOL_TUBES), (elbow, _ELBOW_TUBES))
            for motion, colour, radius in zip(motions, (FREE_RGB, AROUND_RGB), radii, strict=True)
        ]
        film = Film("elbow", curves, self._elbow_positions)
        draw_films(out, self.planner.scene, recordings, self.obstacle.radius, film)

    def _measured(self, recording: Recording, name: str, colour: str) -> DrawnPath:
        latent = self.planner.graph.latent[self._nodes_along(recording)]
        return DrawnPath(smooth_latent(latent, _LATENT_SMOOTHING), np.array(recording.positions), name, colour)

    def _elbow_positions(self, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) [s] and where the elbow was (n, 3) [m]."""
        return np.array(recording.joint_times), self._elbows(np.array(recording.joints))

    def _elbows(self, configurations: np.ndarray) -> np.ndarray:
        return np.array([elbow_position(self.planner.robot, configuration) for configuration in configurations])

    def _draw_paths(self, path: Path, motions: Mapping[str, Sequence[DrawnPath]], obstacle: Sphere) -> None:
        """Measured motions of parts of the arm, by their names, among those of tool and elbow in the demonstrations."""
        demonstrated = [self.skill.decoder.configurations(code) for code in self.skill.codes]
        tools = [end_effector_poses(np.ascontiguousarray(item), self.planner.robot.chain)[0] for item in demonstrated]
        figure = Figure(figsize=(9.0, 6.4), layout="constrained")
        space = figure.add_subplot(projection="3d", computed_zorder=False)
        every = [motion for part in motions.values() for motion in part]
        handles = draw_in_space(space, [*tools, *map(self._elbows, demonstrated)], every, obstacle, zoom=1.15)
        for name, (undisturbed, *_) in motions.items():
            space.text(*(100.0 * undisturbed.positions[0] + _NAME_ABOVE), name, fontsize=11, ha="right", zorder=5)
        figure.suptitle("Motions of tool and elbow, as measured", x=0.01, ha="left", fontsize=11)
        legend_below(figure, handles)
        write_figure(figure, path)

    def _nodes_along(self, recording: Recording) -> np.ndarray:
        """Nodes (n,) of the latent graph whose configurations are nearest to those measured, `_REPLAY_RATE` a second.

        Start and goal are the mean ones that the skill has learned: nodes need not be carried to them.
        """
        times = np.arange(recording.joint_times[0], recording.joint_times[-1], 1.0 / _REPLAY_RATE)
        measured = np.array(recording.joints)[np.searchsorted(recording.joint_times, times)]
        return cKDTree(self.planner.graph.configurations).query(measured)[1]


def _foot(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Where the perpendicular from a point (3,) meets the line through two others."""
    along = (end - start) / np.linalg.norm(end - start)
    return start + ((point - start) @ along) * along
