"""Scripted obstacles: spheres whose centres are functions of time.

They are written as a mapping, in code or in YAML, from a name to the fields of one obstacle:

    ball:  {kind: line, start: [0.5, -0.4, 0.3], end: [0.5, 0.2, 0.3], speed: 0.2, radius: 0.05}
    post:  {kind: static, centre: [0.4, 0.0, 0.2], radius: 0.04}
    orbit: {kind: circle, centre: [0.45, 0.0, 0.3], amplitude: 0.15, period: 6.0, radius: 0.03}
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from typing import ClassVar

import numpy as np

from geodesic_motion_ros.utils.errors import ParameterError

Point = tuple[float, float, float]


@dataclass(frozen=True)
class StaticObstacle:
    """A sphere of `radius` [m] that rests at `centre` [m]."""

    kind: ClassVar[str] = "static"
    centre: Point
    radius: float

    def __post_init__(self) -> None:
        _check_points(self, "centre")
        _check_positive(self, "radius")

    def position(self, time: float) -> np.ndarray:
        """Centre (3,) [m] at `time` [s]."""
        return np.array(self.centre)


@dataclass(frozen=True)
class LineObstacle:
    """A sphere that waits at `start`, leaves at `start_time` [s] with `speed` [m/s] and stays at `end`."""

    kind: ClassVar[str] = "line"
    start: Point
    end: Point
    speed: float
    radius: float
    start_time: float = 0.0

    def __post_init__(self) -> None:
        _check_points(self, "start", "end")
        _check_positive(self, "speed", "radius")
        _check_finite(self, "start_time")

    def position(self, time: float) -> np.ndarray:
        """Centre (3,) [m] at `time` [s]."""
        start, path = np.array(self.start), np.subtract(self.end, self.start)
        length = np.linalg.norm(path)
        if length == 0.0:
            return start
        return start + np.clip(self.speed * (time - self.start_time) / length, 0.0, 1.0) * path


@dataclass(frozen=True)
class CircleObstacle:
    """A sphere that circles about `centre` with radius `amplitude` [m] once in `period` [s].

    It moves in the plane across `axis`, from `start_time` [s] on; before, it rests where it will set out.
    """

    kind: ClassVar[str] = "circle"
    centre: Point
    amplitude: float
    period: float
    radius: float
    axis: Point = (0.0, 0.0, 1.0)
    start_time: float = 0.0

    def __post_init__(self) -> None:
        _check_points(self, "centre", "axis")
        _check_positive(self, "amplitude", "period", "radius")
        _check_finite(self, "start_time")
        if not np.linalg.norm(self.axis) > 0.0:
            raise ParameterError("axis of a circle obstacle is zero: it must be a direction")

    def position(self, time: float) -> np.ndarray:
        """Centre (3,) [m] at `time` [s]."""
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        across = np.eye(3)[np.argmin(np.abs(axis))]
        first = across - (across @ axis) * axis
        first /= np.linalg.norm(first)
        angle = 2.0 * np.pi * max(time - self.start_time, 0.0) / self.period
        radial = np.cos(angle) * first + np.sin(angle) * np.cross(axis, first)
        return np.array(self.centre) + self.amplitude * radial


Obstacle = StaticObstacle | LineObstacle | CircleObstacle
KINDS: dict[str, type[Obstacle]] = {kind.kind: kind for kind in (StaticObstacle, LineObstacle, CircleObstacle)}


@dataclass(frozen=True)
class ScriptedSpheres:
    """Named obstacles that move by script."""

    items: Mapping[str, Obstacle]

    @classmethod
    def from_dict(cls, description: Mapping[str, Mapping]) -> ScriptedSpheres:
        """From name -> fields of an obstacle, as YAML gives it (see the head of this module).

        Raises
        ------
        ParameterError : an unknown kind, a field missing, unknown or out of range; the obstacle is named.
        """
        if not isinstance(description, Mapping):
            raise ParameterError(f"scripted spheres map names to obstacles, but this is a {type(description).__name__}")
        return cls({str(name): _obstacle_from_dict(str(name), entry) for name, entry in description.items()})

    def obstacles(self, time: float) -> dict[str, tuple[np.ndarray, float]]:
        """Name -> (centre (3,) [m], radius [m]) at `time` [s]."""
        return {name: (item.position(time), item.radius) for name, item in self.items.items()}


def crossing(
    point: np.ndarray,
    direction: np.ndarray,
    time: float,
    speed: float,
    radius: float,
    before: float = 0.3,
    after: float = 0.3,
) -> LineObstacle:
    """A sphere that passes `point` (3,) [m] at `time` [s], moving along `direction` (3,) with `speed` [m/s].

    Parameters
    ----------
    before, after : how far from `point` it sets out and comes to rest [m].

    Raises
    ------
    ParameterError : something is not finite or not positive, or the direction is zero.
    """
    vector = np.asarray(direction, dtype=float)
    length = np.linalg.norm(vector)
    if not (vector.shape == (3,) and np.isfinite(length) and length > 0.0):
        raise ParameterError(
            f"direction of a crossing obstacle is {vector.tolist()}: expected a vector (3,) unequal zero"
        )
    if not (np.isfinite([before, after]).all() and min(before, after) >= 0.0 and speed > 0.0):
        raise ParameterError(
            f"a crossing obstacle has speed {speed}, before {before}, after {after}: speed must be positive, "
            "distances not negative"
        )
    centre, unit = np.asarray(point, dtype=float), vector / length
    return LineObstacle(
        start=tuple(centre - before * unit),
        end=tuple(centre + after * unit),
        speed=speed,
        radius=radius,
        start_time=time - before / speed,
    )


#: Obstacles in front of the arm, for a twin started without a task of its own.
NAMED: dict[str, dict[str, dict]] = {
    "empty": {},
    "static": {"post": {"kind": "static", "centre": [0.45, -0.10, 0.30], "radius": 0.05}},
    "crossing": {
        "ball": {
            "kind": "line",
            "start": [0.65, -0.15, 0.35],
            "end": [0.15, -0.15, 0.35],
            "speed": 0.10,
            "start_time": 2.0,
            "radius": 0.05,
        }
    },
    "circle": {
        "ball": {
            "kind": "circle",
            "centre": [0.45, -0.10, 0.40],
            "amplitude": 0.15,
            "period": 8.0,
            "radius": 0.04,
        }
    },
    "two": {
        "high": {
            "kind": "line",
            "start": [0.45, 0.30, 0.45],
            "end": [0.45, -0.50, 0.45],
            "speed": 0.12,
            "radius": 0.04,
        },
        "low": {
            "kind": "circle",
            "centre": [0.40, -0.20, 0.25],
            "amplitude": 0.10,
            "period": 6.0,
            "radius": 0.03,
            "axis": [1.0, 0.0, 0.0],
        },
    },
}


def spheres_named(name: str) -> ScriptedSpheres:
    """One of `NAMED`.

    Raises
    ------
    ParameterError : there is none of this name; the message lists those there are.
    """
    if name not in NAMED:
        raise ParameterError(f"there are no spheres '{name}': there are {', '.join(NAMED)}")
    return ScriptedSpheres.from_dict(NAMED[name])


def _obstacle_from_dict(name: str, entry: Mapping) -> Obstacle:
    if not isinstance(entry, Mapping) or entry.get("kind") not in tuple(KINDS):
        kind = entry.get("kind") if isinstance(entry, Mapping) else entry
        raise ParameterError(f"obstacle '{name}' has kind {kind!r}: the kinds are {', '.join(KINDS)}")
    kind = KINDS[entry["kind"]]
    given = {key: value for key, value in entry.items() if key != "kind"}
    known = [field.name for field in fields(kind)]
    required = [field.name for field in fields(kind) if field.default is MISSING]
    wrong = [f"unknown '{key}'" for key in given if key not in known]
    wrong += [f"no '{key}'" for key in required if key not in given]
    if wrong:
        raise ParameterError(f"obstacle '{name}' has {', '.join(wrong)}: a {kind.kind} obstacle has {', '.join(known)}")
    try:
        return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in given.items()})
    except ParameterError as error:
        raise ParameterError(f"obstacle '{name}': {error}") from error


def _check_points(obstacle: Obstacle, *names: str) -> None:
    for name in names:
        value = getattr(obstacle, name)
        if not (isinstance(value, (tuple, list, np.ndarray)) and len(value) == 3 and all(_is_number(v) for v in value)):
            raise ParameterError(f"{name} of a {obstacle.kind} obstacle is {value}: expected three finite numbers")


def _check_positive(obstacle: Obstacle, *names: str) -> None:
    for name in names:
        value = getattr(obstacle, name)
        if not (_is_number(value) and value > 0.0):
            raise ParameterError(f"{name} of a {obstacle.kind} obstacle is {value}: expected a positive number")


def _check_finite(obstacle: Obstacle, *names: str) -> None:
    for name in names:
        value = getattr(obstacle, name)
        if not _is_number(value):
            raise ParameterError(f"{name} of a {obstacle.kind} obstacle is {value}: expected a finite number")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.floating)) and not isinstance(value, bool) and bool(np.isfinite(value))
