"""A sphere moves through the path of a bottle that is carried along its geodesic: followed tick by tick, and drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle, crossing
from geodesic_motion_ros.simulation.tabletop import fixed_to
from geodesic_motion_ros.simulation.teacher import bottle_in_hand
from geodesic_motion_ros.studies.experiments.held_bottle import SIDES, SPHERE_RADIUS, bottle_distance, sphere_beside
from geodesic_motion_ros.studies.experiments.pouring_places import at_bottle, at_cup
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION

#: Speed of the sphere [m/s].
_SPEED = 0.08
#: Time between ticks of the stream, and longest stream [s].
_TICK, _LONGEST = 0.02, 20.0
#: The goal is reached within this [m].
_ARRIVED = 1e-3


@dataclass(frozen=True, eq=False)
class Moment:
    """The stream at a time [s]: the sphere's centre (3,), how the tool is turned (4,), its path so far, and the
    geodesic from there (n, 3).
    """

    time: float
    centre: np.ndarray
    quaternion: np.ndarray
    followed: np.ndarray
    ahead: np.ndarray


@dataclass(frozen=True, eq=False)
class Stream:
    """A sphere moves through the path of a tool that follows its geodesic.

    Attributes
    ----------
    moments : two, before the sphere matters and when it is nearest. nominal : (n, 3) the geodesic without it.
    clearance : least exact distance of the bottle from the sphere [m]; unaware : had the tool followed the nominal one.
    """

    moments: tuple[Moment, Moment]
    nominal: np.ndarray
    reached: bool
    clearance: float
    unaware: float


def past_a_moving_sphere(planner: ReactivePlanner, bottle: int = 0, cup: int = 2) -> Stream:
    """Follow the stream while a sphere crosses under the bottle where it would be halfway, just then.

    planner : of which only the tool, and what it holds, avoids obstacles.
    """
    start, goal = at_bottle(bottle), at_cup(cup)
    planner.take_obstacles(Obstacles.none())
    planned = planner.plan(*start, *goal).reference
    if planned is None:
        raise ParameterError(f"there is no path from bottle {bottle} to cup {cup} even without the sphere")
    half = 0.5 * planned.duration
    middle = planner.robot.forward(planned.sample(half)[0])
    beside = sphere_beside(*middle, np.array(SIDES[0]))
    sphere = crossing(beside, np.array([-1.0, 0.0, 0.0]), half, _SPEED, SPHERE_RADIUS)
    planner.clear_goal()
    planner.stand_at(planned.positions[0], 0.0)
    planner.set_goal(*goal)
    configurations, centres = [planned.positions[0]], [sphere.position(0.0)]
    ahead = [planned.positions]
    while len(configurations) * _TICK < _LONGEST and not _arrived(planner, configurations[-1], goal[0]):
        now = (len(configurations) - 1) * _TICK
        centre, velocity = sphere.position(now), _velocity(sphere, now)
        planner.take_obstacles(Obstacles.of_spheres(centre[None], np.array([SPHERE_RADIUS]), velocity[None], now))
        planner.tick(now)
        path, commanded = planner.to_goal(), planner.commanded(now + _TICK)
        assert commanded is not None
        configurations.append(commanded[0])
        centres.append(sphere.position(now + _TICK))
        ahead.append(ahead[-1] if path is None else path[0].positions)
    times = _TICK * np.arange(len(configurations))
    played, turned = _tool(planner, np.array(configurations))
    unaware = _tool(planner, planned.samples(times)[0])
    nearest = int(np.argmin(np.linalg.norm(played - centres, axis=1)))
    moments = tuple(
        Moment(float(times[at]), centres[at], turned[at], played[: at + 1], _tool(planner, ahead[at])[0])
        for at in (nearest // 3, nearest)
    )
    return Stream(
        (moments[0], moments[1]), _tool(planner, planned.positions)[0],
        _arrived(planner, configurations[-1], goal[0]),
        bottle_distance(played, turned, np.array(centres), SPHERE_RADIUS),
        bottle_distance(*unaware, np.array(centres), SPHERE_RADIUS),
    )  # fmt: skip


def _tool(planner: ReactivePlanner, configurations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tool positions (n, 3) [m] and quaternions (n, 4) in configurations (n, eta) [rad]."""
    return end_effector_poses(np.ascontiguousarray(configurations), planner.robot.chain)


def _arrived(planner: ReactivePlanner, configuration: np.ndarray, goal: np.ndarray) -> bool:
    return bool(np.linalg.norm(planner.robot.forward(configuration)[0] - goal) <= _ARRIVED)


def _velocity(sphere: LineObstacle, now: float) -> np.ndarray:
    return (sphere.position(now + _TICK) - sphere.position(now)) / _TICK


def draw_moment(axes: Axes, shown: Demonstrations, nominal: np.ndarray, moment: Moment) -> list[Any]:
    """The stream at a time, seen along x: the tool's paths, and the outline of what it holds.

    nominal : as of `Stream`. Returns what a legend shows.
    """
    for item in shown:
        axes.plot(*(100.0 * item.positions[:, 1:].T), color=GREY, linewidth=0.6, alpha=0.5)
    centre, radius = 100.0 * moment.centre[1:], 100.0 * SPHERE_RADIUS
    axes.add_patch(Circle(centre, radius, color=ORANGE, alpha=0.85, label="moving sphere"))
    for part in bottle_in_hand():
        held = fixed_to(moment.followed[-1], moment.quaternion, part)
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [part.radius, 0.5 * part.height]
        along = to_rotation(np.array(held.quaternion)).apply([0.0, 0.0, 1.0])[1:]
        across = np.array([along[1], -along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
        outline = np.array(held.centre)[1:] + corners[:, :1] * across + corners[:, 1:] * along
        axes.add_patch(Polygon(100.0 * outline, facecolor=GREEN, alpha=0.5, label="bottle"))
    axes.plot(*(100.0 * nominal[:, 1:].T), "--", color=BLUE, linewidth=1.6, label="geodesic without it")
    axes.plot(*(100.0 * moment.ahead[:, 1:].T), color=VERMILION, linewidth=2.2, label="geodesic at the time")
    axes.plot(*(100.0 * moment.followed[:, 1:].T), color="black", linewidth=2.4, label="path followed so far")
    axes.plot(*(100.0 * moment.followed[-1, 1:]), "o", color="black", markersize=6)
    axes.set(xlabel="y [cm]", ylabel="z [cm]", aspect="equal")
    return axes.get_legend_handles_labels()[0]
