"""A robot's spheres over its collision bodies, for a person to look at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from scipy.spatial import ConvexHull

from geodesic_motion_ros.robot.collision_bodies import Body
from geodesic_motion_ros.robot.kinematics import Robot

VIEWS = ((15.0, -60.0), (15.0, 30.0))


def draw_spheres(robot: Robot, bodies: Sequence[Body], spheres: Mapping[str, np.ndarray], path: Path) -> None:
    """Draw the hulls of the bodies, dark, and the spheres (S, 4) [m] by link over them, at the ready posture, twice."""
    rotations, origins = robot.link_frames(robot.ready)

    def placed(link: str, points: np.ndarray) -> np.ndarray:
        frame = robot.link_names.index(link)
        return points @ rotations[frame].T + origins[frame]

    around, up = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9))
    ball = np.stack([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)], axis=-1)
    corners = np.concatenate([placed(body.link, body.vertices) for body in bodies])
    figure = plt.figure(figsize=(12, 6))
    for number, (elevation, azimuth) in enumerate(VIEWS):
        axes = figure.add_subplot(1, len(VIEWS), number + 1, projection="3d")
        for body in bodies:
            triangles = placed(body.link, body.vertices)[ConvexHull(body.vertices).simplices]
            axes.add_collection3d(Poly3DCollection(triangles, facecolor="0.25", edgecolor="none"))
        for colour, (link, rows) in enumerate(spheres.items()):
            for centre, radius in zip(placed(link, rows[:, :3]), rows[:, 3], strict=True):
                axes.plot_surface(*np.moveaxis(centre + radius * ball, -1, 0), color=f"C{colour % 10}", alpha=0.15)
        middle, half = 0.5 * (corners.min(axis=0) + corners.max(axis=0)), 0.5 * np.ptp(corners, axis=0).max()
        for name, value in zip("xyz", middle, strict=True):
            getattr(axes, f"set_{name}lim")(value - half, value + half)
            getattr(axes, f"set_{name}label")(f"{name} [m]")
        axes.set_box_aspect((1, 1, 1))
        axes.view_init(elevation, azimuth)
    figure.savefig(path, dpi=100, bbox_inches="tight")
    plt.close(figure)
