"""Pictures of the arm in the demo, drawn after its runs from what was recorded: rendering stays out of its loops."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from geodesic_motion_ros.demo.demo_run import Recording
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.camera import View, view_named
from geodesic_motion_ros.simulation.world import ArmWorld
from geodesic_motion_ros.visualization.plots import Sphere

_ROWS = (("avoidance_off", "avoidance off"), ("avoidance_on", "avoidance on"))
_STRIP_FRAMES, _STRIP_SIZE = 5, (340, 330)
_GIF_SIZE, _GIF_RATE, _GIF_FRAMES = (320, 300), 10.0, 60
# The distance that a point covers is measured in steps of this time [s]; shorter ones than this [m] are trembling.
_STEP_TIME, _STEP_LEAST = 0.1, 0.001
#: Colours of the motions without obstacle and around it, those of the plots.
FREE_RGB, AROUND_RGB = (0.0, 0.447, 0.698), (0.835, 0.369, 0.0)


@dataclass(frozen=True)
class Curve:
    """A tube in the scene: points (n, 3) [m], colour (r, g, b in [0, 1]), radius [m]."""

    points: np.ndarray
    colour: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class Film:
    """Camera, curves and traced point of the pictures that show a demo's runs.

    Attributes
    ----------
    view : one of `camera.VIEWS`, which is turned to where the first of the curves is.
    curves : they are drawn into every picture.
    followed : returns times (n,) [s] and points (n, 3) [m] of the part of the arm that a recording is about.
    """

    view: str
    curves: Sequence[Curve]
    followed: Callable[[Recording], tuple[np.ndarray, np.ndarray]]


def draw_films(
    out: Path, planner: ReactivePlanner, recordings: Mapping[str, Recording], radius: float, film: Film
) -> None:
    """Write strip.png and arm.gif of the runs with the obstacle, of this radius [m], to a folder: the planner's arm in
    its scene.
    """
    view = view_named(film.view).facing(film.curves[0].points.mean(axis=0))
    with ArmWorld(scene=planner.scene, robot=planner.skill.robot) as world:
        for curve in film.curves:
            world.add_curve(curve.points, curve.colour, curve.radius)
        _draw_strip(out / "strip.png", world, recordings, radius, film, view)
        _draw_animation(out / "arm.gif", world, recordings, radius, view)


def met(recording: Recording, times: np.ndarray, points: np.ndarray, radius: float) -> Sphere:
    """The obstacle at the instant when it was closest to a part of the arm: times (n,) [s] and points (n, 3) [m]."""
    at = np.array([recorded_at(recording.obstacle_times, recording.obstacles, time) for time in times])
    nearest = int(np.argmin(np.linalg.norm(at - points, axis=1)))
    return Sphere(at[nearest], radius, np.array(recording.obstacles))


def recorded_at(times: Sequence[float], values: Sequence[np.ndarray], time: float) -> np.ndarray:
    """Recorded vector at a time, interpolated."""
    return np.array([np.interp(time, times, column) for column in np.array(values).T])


def _draw_strip(
    path: Path, world: ArmWorld, recordings: Mapping[str, Recording], radius: float, film: Film, view: View
) -> None:
    """The arm, a row per run, at even shares of each run's own motion: time in which it stands shows nothing new."""
    width, height = _STRIP_SIZE
    picture = Image.new("RGB", (_STRIP_FRAMES * width, len(_ROWS) * height))
    for row, (key, title) in enumerate(_ROWS):
        recording = recordings[key]
        for column, time in enumerate(instants_of_motion(*film.followed(recording), _STRIP_FRAMES)):
            corner = (column * width, row * height)
            picture.paste(Image.fromarray(_frame(world, recording, radius, time, _STRIP_SIZE, view, 2)), corner)
            text = f"{time:.1f} s" if column else f"{title}, {time:.1f} s"
            _label(picture, (corner[0] + 8, corner[1] + 8), text)
    picture.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)


def instants_of_motion(times: np.ndarray, positions: np.ndarray, count: int) -> np.ndarray:
    """Times (count,) [s] from the first to the last movement of a recorded point, at equal distances that it covers.

    times (n,) [s], positions (n, 3) [m].
    """
    regular = np.arange(times[0], times[-1], _STEP_TIME)
    steps = np.linalg.norm(np.diff([recorded_at(times, positions, time) for time in regular], axis=0), axis=1)
    covered = np.concatenate([[0.0], np.cumsum(np.where(steps < _STEP_LEAST, 0.0, steps))])
    if covered[-1] == 0.0:
        return np.linspace(times[0], times[-1], count)
    moving, first = np.unique(covered, return_index=True)
    return np.interp(np.linspace(0.0, covered[-1], count), moving, regular[first])


def _draw_animation(
    path: Path, world: ArmWorld, recordings: Mapping[str, Recording], radius: float, view: View
) -> None:
    """Both runs side by side in real time."""
    end = max(recordings[key].joint_times[-1] for key, _ in _ROWS)
    frames = []
    # A picture takes a tenth of a second: a run that a busy machine has drawn out gets no more of them.
    count = min(_GIF_FRAMES, int(end * _GIF_RATE))
    for time in np.linspace(0.0, end, count):
        pair = [_frame(world, recordings[key], radius, time, _GIF_SIZE, view, 1) for key, _ in _ROWS]
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
    world: ArmWorld,
    recording: Recording,
    radius: float,
    time: float,
    size: tuple[int, int],
    view: View,
    oversampling: int,
) -> np.ndarray:
    """Picture of the recorded arm and obstacle at a time."""
    robot: Robot = world.robot
    joints = recorded_at(recording.joint_times, recording.joints, time)
    world.reset(np.clip(joints, robot.lower, robot.upper))
    world.set_obstacles({"ball": (recorded_at(recording.obstacle_times, recording.obstacles, time), radius)})
    return world.render(*size, view=view, oversampling=oversampling)


def _label(picture: Image.Image, at: tuple[int, int], text: str) -> None:
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(15)
    left, top, right, bottom = draw.textbbox(at, text, font=font)
    draw.rectangle((left - 4, top - 3, right + 4, bottom + 3), fill=(255, 255, 255))
    draw.text(at, text, fill=(20, 24, 32), font=font)
