"""Strips: the arm at even shares of the time of a motion, side by side, with the curves of tool and elbow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.robot.swivel import elbow_position
from geodesic_motion_ros.simulation.world import ArmWorld

_TOOL_COLOUR, _ELBOW_COLOUR = (0.16, 0.50, 0.73), (0.93, 0.58, 0.12)
#: Postures on a motion that its drawn curves are made of.
_SAMPLES = 100


def posture_strips(
    motions: Sequence[np.ndarray],
    obstacles: Sequence[Mapping[str, tuple[np.ndarray, float]]],
    width: int = 600,
    height: int = 400,
    postures: int = 5,
    view: str = "front",
    curves: bool = True,
    robot: str = DEFAULT_ROBOT,
) -> np.ndarray:
    """Picture, uint8, with a row for each motion; a posture is (height, width, 3) pixels.

    Parameters
    ----------
    motions : configurations (n, eta) [rad] each, evenly spaced in time.
    obstacles : of each motion, name -> (centre (3,), radius) [m].
    view : one of `camera.VIEWS`. curves : draw the curves of tool and elbow.
    robot : whose motions they are, its name.
    """
    with ArmWorld(scene=DeclaredScene.from_name("table"), robot=robot) as world:
        rows = []
        for motion, spheres in zip(motions, obstacles, strict=True):
            world.set_obstacles(spheres)
            rows.append(_strip(world, motion, width, height, postures, view, curves))
    return np.concatenate(rows)


def _strip(
    world: ArmWorld, motion: np.ndarray, width: int, height: int, postures: int, view: str, curves: bool
) -> np.ndarray:
    if curves:
        along = motion[evenly(len(motion), _SAMPLES)]
        world.add_curve(np.array([world.robot.forward(posture)[0] for posture in along]), _TOOL_COLOUR)
        world.add_curve(np.array([elbow_position(world.robot, posture) for posture in along]), _ELBOW_COLOUR)
    pictures = []
    for configuration in motion[evenly(len(motion), postures)]:
        world.reset(configuration)
        pictures.append(world.render(width, height, view, oversampling=2))
    world.clear_curves()
    return np.concatenate(pictures, axis=1)


def numbered(centres: np.ndarray, radii: np.ndarray) -> dict[str, tuple[np.ndarray, float]]:
    """Spheres (o, 3), (o,) [m] as `posture_strips` takes those of a motion."""
    return {str(i): (centre, float(radius)) for i, (centre, radius) in enumerate(zip(centres, radii, strict=True))}


def draw_strip(axes: Axes, strip: np.ndarray, title: str) -> None:
    """A strip as a panel of a picture."""
    axes.imshow(strip)
    axes.set_axis_off()
    axes.set_title(title, loc="left", fontsize=11)


def evenly(count: int, wanted: int) -> np.ndarray:
    """At most so many indices of `count`, the first and the last among them."""
    return np.unique(np.linspace(0.0, count - 1, min(count, wanted)).astype(int))
