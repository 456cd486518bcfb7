"""The demo's pictures, drawn after its runs from what was recorded: rendering stays out of every control loop."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from geodesic_motion_ros.nodes.demo_run import Recording
from geodesic_motion_ros.planner import ReactivePlanner
from geodesic_motion_ros.plots import BLUE, VERMILION, Sphere, Way, draw_latent, draw_paths
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.world import PandaWorld

_ROWS = (("avoidance_off", "avoidance off"), ("avoidance_on", "avoidance on"))
_STRIP_FRAMES, _STRIP_SIZE = 5, (340, 330)
_GIF_SIZE, _GIF_RATE, _GIF_FRAMES = (320, 300), 10.0, 60
# Recorded instants that are planned again, to know where the motion was in latent space [1/s].
_REPLAY_RATE = 20.0
# The tool's way is measured in steps of this time [s]; shorter ones than this [m] are trembling.
_STEP_TIME, _STEP_LEAST = 0.1, 0.001
_BLUE_RGB, _VERMILION_RGB = (0.0, 0.447, 0.698), (0.835, 0.369, 0.0)


def draw(planner: ReactivePlanner, radius: float, recordings: Mapping[str, Recording], out: Path) -> None:
    """Write latent.png, paths.png, strip.png and arm.gif to a folder.

    Parameters
    ----------
    planner : with the skill and the tool spheres of the runs; its goal and obstacles are changed.
    radius : of the obstacle [m].
    recordings : of the runs `no_obstacle`, `avoidance_off` and `avoidance_on`.
    """
    free, around = recordings["no_obstacle"], recordings["avoidance_on"]
    obstacle = _met(around, radius)
    ways = (
        Way(_replay(planner, free, radius), np.array(free.positions), "without obstacle", BLUE),
        Way(_replay(planner, around, radius), np.array(around.positions), "around the moving obstacle", VERMILION),
    )
    name = planner.skill.name
    draw_latent(out / "latent.png", planner, ways, obstacle, f"Latent space of {name}: two motions to one goal")
    draw_paths(out / "paths.png", planner.skill, ways, obstacle, "Way of the tool, as measured")
    with PandaWorld() as world:
        world.add_curve(np.array(free.positions), _BLUE_RGB, 0.0025)
        world.add_curve(np.array(around.positions), _VERMILION_RGB, 0.004)
        _draw_strip(out / "strip.png", world, recordings, radius)
        _draw_animation(out / "arm.gif", world, recordings, radius)


def _met(recording: Recording, radius: float) -> Sphere:
    """The obstacle at the instant when the tool was closest to it."""
    at = [_at(recording.obstacle_times, recording.obstacles, time) for time in recording.pose_times]
    nearest = int(np.argmin(np.linalg.norm(np.array(at) - np.array(recording.positions), axis=1)))
    return Sphere(at[nearest], radius, np.array(recording.obstacles))


def _at(times: list[float], values: list[np.ndarray], time: float) -> np.ndarray:
    """Recorded vector at a time, interpolated."""
    return np.array([np.interp(time, times, column) for column in np.array(values).T])


def _replay(planner: ReactivePlanner, recording: Recording, radius: float) -> np.ndarray:
    """Latent points (n, d) along a recorded motion.

    The planner is given the recorded poses and obstacles again; where it then stands on its own reference is where the
    motion was in the latent space.
    """
    goal = planner.skill.goal_pose
    planner.clear_goal()
    planner.set_goal(goal[:3], goal[3:])
    latent = []
    for time in np.arange(recording.pose_times[0], recording.pose_times[-1], 1.0 / _REPLAY_RATE):
        i = min(int(np.searchsorted(recording.pose_times, time)), len(recording.pose_times) - 1)
        if recording.obstacles:
            centre = _at(recording.obstacle_times, recording.obstacles, time)
            planner.set_obstacles(centre[None], np.array([radius]))
        else:
            planner.set_obstacles(np.zeros((0, 3)), np.zeros(0))
        reference = planner.tick(recording.positions[i], recording.quaternions[i]).reference
        if reference is not None:
            latent.append(reference.latent[0])
    return np.array([*latent, reference.latent[-1]] if reference is not None else latent)


def _draw_strip(path: Path, world: PandaWorld, recordings: Mapping[str, Recording], radius: float) -> None:
    """The arm, a row per run, at even shares of each run's own motion: time in which it stands shows nothing new."""
    width, height = _STRIP_SIZE
    picture = Image.new("RGB", (_STRIP_FRAMES * width, len(_ROWS) * height))
    for row, (key, title) in enumerate(_ROWS):
        recording = recordings[key]
        for column, time in enumerate(instants_of_motion(recording, _STRIP_FRAMES)):
            corner = (column * width, row * height)
            picture.paste(Image.fromarray(_frame(world, recording, radius, time, _STRIP_SIZE, 2)), corner)
            text = f"{time:.1f} s" if column else f"{title}, {time:.1f} s"
            _label(picture, (corner[0] + 8, corner[1] + 8), text)
    picture.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)


def instants_of_motion(recording: Recording, count: int) -> np.ndarray:
    """Times (count,) [s] of a recording, from its first to its last movement, the tool's way between them the same."""
    times = np.arange(recording.pose_times[0], recording.pose_times[-1], _STEP_TIME)
    positions = np.array([_at(recording.pose_times, recording.positions, time) for time in times])
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(np.where(steps < _STEP_LEAST, 0.0, steps))])
    if way[-1] == 0.0:
        return np.linspace(times[0], times[-1], count)
    moving, first = np.unique(way, return_index=True)
    return np.interp(np.linspace(0.0, way[-1], count), moving, times[first])


def _draw_animation(path: Path, world: PandaWorld, recordings: Mapping[str, Recording], radius: float) -> None:
    """Both runs side by side in real time."""
    end = max(recordings[key].joint_times[-1] for key, _ in _ROWS)
    frames = []
    # A picture takes a tenth of a second: a run that a busy machine has drawn out gets no more of them.
    count = min(_GIF_FRAMES, int(end * _GIF_RATE))
    for time in np.linspace(0.0, end, count):
        pair = [_frame(world, recordings[key], radius, time, _GIF_SIZE, 1) for key, _ in _ROWS]
        picture = Image.fromarray(np.concatenate(pair, axis=1))
        for column, (_, title) in enumerate(_ROWS):
            _label(picture, (column * _GIF_SIZE[0] + 8, 8), title)
        frames.append(picture)
    # one palette for all frames: a palette of its own would make the background of every frame flicker; and one that
    # covers thin curves too, which a palette by frequency leaves out
    palette = frames[len(frames) // 2].quantize(128, method=Image.Quantize.MAXCOVERAGE)
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    shown_for = int(1000.0 * end / count)
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=shown_for, loop=0, optimize=True)


def _frame(
    world: PandaWorld, recording: Recording, radius: float, time: float, size: tuple[int, int], oversampling: int
) -> np.ndarray:
    """Picture of the recorded arm and obstacle at a time."""
    robot: Robot = world.robot
    joints = _at(recording.joint_times, recording.joints, time)
    world.reset(np.clip(joints, robot.lower, robot.upper))
    world.set_obstacles({"ball": (_at(recording.obstacle_times, recording.obstacles, time), radius)})
    return world.render(*size, view="front", oversampling=oversampling)


def _label(picture: Image.Image, at: tuple[int, int], text: str) -> None:
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(15)
    left, top, right, bottom = draw.textbbox(at, text, font=font)
    draw.rectangle((left - 4, top - 3, right + 4, bottom + 3), fill=(255, 255, 255))
    draw.text(at, text, fill=(20, 24, 32), font=font)
