"""Bottles carried along geodesics: over all cups in a chain, by the arm, and past a moving sphere, tick by tick."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

from geodesic_motion_ros.contract.status import Refusal
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.geometry.curves import interpolate, pose_arc_length
from geodesic_motion_ros.geometry.quaternions import continuous_signs, to_rotation
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.queries.pose_path import PosePath, PosePathPlanner
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.simulation.gestures import RATE_HZ, STEPS_PER_SAMPLE, smooth_step
from geodesic_motion_ros.simulation.joint_teacher import CUP_PLACES
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle, crossing
from geodesic_motion_ros.simulation.tabletop import Cylinder, TabletopWorld, fixed_to
from geodesic_motion_ros.simulation.teacher import CUP_REGION, Motion, bottle_in_hand, perform
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.visualization.plots import BLUE, GREEN, GREY, ORANGE, VERMILION
from geodesic_motion_studies.experiments.pouring_scene import (
    PLACES,
    SIDES,
    SPHERE_RADIUS,
    at_bottle,
    at_cup,
    bottle_distance,
    bottle_mouth,
    sphere_beside,
    standing_there,
)

#: The arm waits so long over each cup [s].
_PAUSE = 0.5
#: Largest speed of the tool [m/s]; a rotation of one radian counts as so much of its path [m].
_SPEED, _ROTATION_LENGTH = 0.2, 0.25
#: Largest over mean speed of `smooth_step`.
_PEAK = 1.875


@dataclass(frozen=True, eq=False)
class Chain:
    """One bottle over all cups.

    Attributes
    ----------
    parts : the geodesics; fewer than cups where the planner refused one, for a reason.
    mouth_off : of each part, horizontal distance of the bottle's mouth from the cup's axis when it is poured [m].
    behind : largest distance of the tool from where it was to be at the time [m].
    clearance : least distance of the arm from what stands there [m].
    joints : (k, 7) what the arm did [rad].
    """

    seed: int
    parts: tuple[PosePath, ...]
    reason: str = ""
    mouth_off: tuple[float, ...] = ()
    behind: float = math.nan
    clearance: float = math.nan
    joints: np.ndarray = field(default_factory=lambda: np.empty((0, 7)))


def pour_all_cups(planner: PosePathPlanner, seed: int, bottle: int = 0) -> Chain:
    """Plan and play the chain of one bottle."""
    planner.take_obstacles(Obstacles.none())
    stops = [at_bottle(bottle), *(at_cup(cup) for cup in PLACES)]
    parts: list[PosePath] = []
    for begin, end in pairwise(stops):
        path = planner.plan(*begin, *end)
        if isinstance(path, Refusal):
            return Chain(seed, tuple(parts), f"part {len(parts)}: {path.reason}")
        parts.append(path)
    motion, poured = _played(parts, standing_there(bottle))
    with TabletopWorld(rate_hz=RATE_HZ * STEPS_PER_SAMPLE) as world:
        done = perform(world, motion)
    tool = done.demonstration
    mouth = [bottle_mouth(tool.positions[at], tool.quaternions[at]) for at in poured]
    cups = [CUP_REGION.at(np.array(CUP_PLACES[cup])) for cup in PLACES]
    off = tuple(float(np.linalg.norm(place[:2] - cup)) for place, cup in zip(mouth, cups, strict=True))
    behind = float(np.linalg.norm(tool.positions - motion.positions, axis=1).max())
    return Chain(seed, tuple(parts), "", off, behind, done.clearance, done.joint_positions)


def _played(parts: Sequence[PosePath], solid: Sequence[Cylinder]) -> tuple[Motion, list[int]]:
    """Paths one after the other, each from rest to rest with a pause after it, and the last samples of the pauses."""
    poses, poured, count = [], [], 0
    for part in parts:
        length = pose_arc_length(part.positions, part.quaternions, _ROTATION_LENGTH)
        seconds = _PEAK * length[-1] / _SPEED
        # `smooth_step` stays at 1 in the pause.
        phase = smooth_step(np.arange(0.0, seconds + _PAUSE, 1.0 / RATE_HZ) / seconds)
        poses.append(interpolate(length, part.positions, part.quaternions, length[-1] * phase))
        count += len(phase)
        poured.append(count - 1)
    positions, quaternions = (np.concatenate(arrays) for arrays in zip(*poses, strict=True))
    times = np.arange(count) / RATE_HZ
    return Motion("chain", times, positions, continuous_signs(quaternions), tuple(solid), bottle_in_hand()), poured


#: Speed of the sphere [m/s].
_SPHERE_SPEED = 0.08
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
    sphere = crossing(beside, np.array([-1.0, 0.0, 0.0]), half, _SPHERE_SPEED, SPHERE_RADIUS)
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
        path, commanded = planner.motion_to_goal(), planner.commanded_state(now + _TICK)
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
