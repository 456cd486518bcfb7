"""A tick decides first and writes then: until it commits, a planner and its solver are as they were."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cached_property
from itertools import count, product
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.contract.settings import SEARCH_PERIOD
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.arbiter import Arbiter, Decision
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.planning.situation import Situation
from geodesic_motion_ros.utils.deadline import NEVER, Deadline

#: Memory that searches write before they read it.
SCRATCH = ".spare_buffers"


def contents(thing: object, path: str = "", seen: dict[int, str] | None = None) -> Iterator[tuple[str, object]]:
    """All numbers, names and bytes that an object holds, each with the attributes that lead there.

    What an object works out once from its other attributes (`cached_property`) is none of them.
    """
    seen = {} if seen is None else seen
    if id(thing) in seen:
        yield path, seen[id(thing)]
        return
    if isinstance(thing, np.ndarray):
        yield path, (thing.shape, thing.dtype.str, thing.tobytes())
        return
    if isinstance(thing, (Enum, Path)) or callable(thing) or not (is_container(thing) or hasattr(thing, "__dict__")):
        yield path, repr(thing)
        return
    seen[id(thing)] = path
    if isinstance(thing, Mapping):
        parts = {f"[{key!r}]": value for key, value in thing.items()}
    elif isinstance(thing, tuple) and hasattr(thing, "_fields"):
        parts = {f".{name}": getattr(thing, name) for name in thing._fields}
    elif isinstance(thing, (tuple, list)):
        parts = {f"[{number}]": value for number, value in enumerate(thing)}
    elif isinstance(thing, (set, frozenset)):
        parts = {f"[{number}]": value for number, value in enumerate(sorted(thing, key=repr))}
    elif is_dataclass(thing):
        parts = {f".{field.name}": getattr(thing, field.name) for field in fields(thing)}
    else:
        parts = {f".{name}": value for name, value in vars(thing).items() if name not in _cached(thing)}
    for name, value in parts.items():
        if name != SCRATCH:
            yield from contents(value, path + name, seen)


def is_container(thing: object) -> bool:
    return isinstance(thing, (Mapping, tuple, list, set, frozenset))


def _cached(thing: object) -> set[str]:
    return {name for kind in type(thing).__mro__ for name, value in vars(kind).items()
            if isinstance(value, cached_property)}  # fmt: skip


def state_of(planner: ReactivePlanner) -> dict[str, object]:
    return dict(contents({name: value for name, value in vars(planner).items() if name != "_worker"}))


def decided(planner: ReactivePlanner, now: float, deadline: Deadline) -> tuple[Situation, Decision]:
    situation = planner._situation(now, NEVER, deadline)
    assert situation is not None
    return situation, Arbiter(planner.arm, situation, planner._mission, planner._memory).decide()


def after(looks: int) -> Deadline:
    """A deadline that has passed when the time has been looked at so often."""
    seen = count()
    return Deadline(float(looks), lambda: float(next(seen)))


def wall(planner: ReactivePlanner, start: np.ndarray, goal: np.ndarray) -> Obstacles:
    """Spheres side by side between start and goal of the hand, but where the arm is: that no path leads past them takes
    a search long.
    """
    ends = np.array([planner.robot.forward(end)[0] for end in (start, goal)])
    along = np.diff(ends, axis=0)[0] / np.linalg.norm(ends[1] - ends[0])
    across = np.linalg.svd(along[None])[2][1:]
    steps = 0.07 * np.arange(-8, 9)
    centres = ends.mean(axis=0) + np.array([a * across[0] + b * across[1] for a, b in product(steps, steps)])
    spheres = [Obstacles.of_spheres(centre[None], np.array([0.05])) for centre in centres]
    free = [
        all(obstacle_clearance(planner.collision, planner.robot, end, one)[0] > 0.01 for end in (start, goal))
        for one in spheres
    ]
    return Obstacles.of_spheres(centres[free], np.full(sum(free), 0.05))


@pytest.mark.parametrize("looks", [0, 1000], ids=["out of time", "in time"])
def test_to_decide_writes_neither_to_the_planner_nor_to_its_solver(stream, start, goal, looks) -> None:
    """On its path, as it loses it, and as it waits; in time, and out of time in searches that the next tick goes on
    with. The control: the tick itself writes.
    """
    planner = stream.planner
    hand, _ = planner.robot.forward(goal)
    coming = Obstacles.of_spheres(np.array([hand]), np.array([0.05]), np.array([[0.0, 0.1, 0.0]]), time=0.0)
    unfinished = written = 0
    covering = Obstacles.of_spheres(hand[None], np.array([0.05]))
    for obstacles in (Obstacles.none(), coming, wall(planner, start, goal), covering):
        planner.take_obstacles(obstacles)
        for _ in range(4):
            before = state_of(planner)
            situation, decision = decided(planner, stream.now, after(looks))
            assert state_of(planner) == before
            unfinished += decision.memory.workings.begun is not None
            planner._commit(situation, planner._mission, decision)
            stream.now += SEARCH_PERIOD
            written += state_of(planner) != before
    assert written > 0
    assert (unfinished > 0) is (looks == 0)
