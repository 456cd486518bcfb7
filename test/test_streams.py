"""Both planners repeat recorded streams: the same verdict in every tick, the same motion of the body within TOLERANCE.

streams/ holds a file for each shipped skill. A stream is a list of timed inputs, goals and spheres that move in
straight lines, and the verdict and command of every tick. No tick has a deadline. `python -m pytest -n 0 --remake
test/test_streams.py` draws the scenes of the comparison again and records anew; the same processor writes the same
bytes.

The arm is an ideal follower: its state is the command of the tick before, in a replay that of the planner under test.
Handed the recorded states instead, a planner of poses whose path deviates by less than TOLERANCE (a sphere 1 mm higher,
*static* 0 of panda_bottle2shelf) would refuse some ticks: recorded states lie off its own path.

A planner is replayed through an adapter (`Replay`); another planner needs another adapter alone. It has to keep

- of skills of the whole arm the streams *none*, *static* and *elbow*: verdicts, and the body within TOLERANCE;
- of skills of the tool the motion of the tool within TOLERANCE until the first verdict that is not OK, where reactions
  begin.

The rest, reactions to moving spheres above all, may change for the better: then it is recorded anew.

Other processors repeat the motion within the rounding of the record. The scenes *gate* 0 and 2 of panda_pouring and
*crossing* 1 of panda_reach_to_grasp are left out: there a discrete choice differs, and for some ticks the verdict or
the motion does, by up to 6 mm.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.planning.planner import ReactivePlanner
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import LONGEST
from geodesic_motion_studies.comparison.method import TICK
from geodesic_motion_studies.comparison.scene import draw_scene
from geodesic_motion_studies.experiments.moving_spheres import MovingSphere

FOLDER = Path(__file__).parent / "streams"
#: Of each skill the families of its streams, and the numbers of their scenes in the comparison with SEED.
SCENES = {
    "panda_bottle2shelf": {
        "none": (0, 1), "static": (0, 1, 2), "crossing": (0, 1), "gate": (0, 1), "redirected": (0, 1),
    },
    "panda_pouring": {
        "none": (0, 1), "static": (0, 1, 2), "crossing": (0, 1), "gate": (1, 5), "redirected": (0, 1),
    },
    "panda_reach_to_grasp": {
        "none": (0, 1), "static": (0, 1, 8), "elbow": (0, 1, 2), "crossing": (0, 2), "gate": (0, 1),
        "redirected": (0, 1),
    },
}  # fmt: skip
STREAMS = [
    (name, f"{family}{number}")
    for name, families in SCENES.items()
    for family, numbers in families.items()
    for number in numbers
]
SEED = 0
#: Of the tool, and of every sphere of the body [m]: a thousand times the rounding of the record.
TOLERANCE = 1e-3
#: States are recorded in steps of this [m], [rad].
STEP = 1e-6
#: In *redirected* the goal moves in this tick, by so much [m].
REDIRECTED, REDIRECTION = 150, np.array([0.0, 0.03, 0.0])
#: A stream ends after so many ticks at rest, where nothing will change.
RESTING = 30
#: Streams in which the planner must take note of spheres that stand so much higher [m].
CONTROLS = [
    ("panda_bottle2shelf", "static0"), ("panda_pouring", "static0"), ("panda_reach_to_grasp", "static8"),
    ("panda_reach_to_grasp", "elbow2"),
]  # fmt: skip
HIGHER = 0.05


@dataclass(frozen=True)
class Stream:
    """A stream of n ticks.

    Attributes
    ----------
    goals : (g, 9), each the tick at which it is set, 1 for a configuration [rad] or 0 for a pose [m], and its numbers.
    spheres : (m, 9), each the first tick of its presence and the first one after that, its centre [m] at the former,
        radius [m] and velocity [m/s].
    states : (n + 1, 7), configurations [rad]: where the stream begins, and the command of every tick, for the next one.
    codes : (n,) of the verdicts.
    reached : whether the tool is at the last goal in the end.
    """

    goals: np.ndarray
    spheres: np.ndarray
    states: np.ndarray
    codes: np.ndarray
    reached: bool

    def obstacles(self, tick: int) -> Obstacles:
        """The spheres that are there at a tick."""
        first, last = self.spheres[:, :2].T
        present = (first <= tick) & (tick < last)
        centres, radii, velocities = np.split(self.spheres[present, 2:], [3, 4], axis=1)
        moved = (tick - first[present, None]) * TICK * velocities
        return Obstacles.of_spheres(centres + moved, radii[:, 0].copy(), velocities.copy(), tick * TICK)

    def will_change(self, tick: int) -> bool:
        """Whether goals are set, or spheres come, stop or vanish, at a tick or later."""
        changes = np.concatenate([self.goals[:, 0], self.spheres[:, :2].ravel()])
        return bool(np.any((changes >= tick) & np.isfinite(changes)))


# ----------------------------------------------------------------- the arm


class Replay:
    """A planner that is played a stream, and an arm that follows it."""

    def __init__(self, skill: Skill) -> None:
        self._planner = ReactivePlanner(skill)

    def begin(self, state: np.ndarray) -> None:
        """The arm stands in a configuration (7,) [rad] at time 0, without a goal or an obstacle."""
        self._planner.clear_goal()
        assert self._planner.take_obstacles(Obstacles.none()).ok
        assert self._planner.stand_at(state, 0.0).verdict.ok

    def set_goal(self, goal: np.ndarray, is_configuration: bool) -> bool:
        """Set a goal (7,) and return whether it is accepted."""
        planner = self._planner
        return (planner.set_goal_configuration(goal) if is_configuration else planner.set_goal(goal[:3], goal[3:])).ok

    def tick(self, now: float, obstacles: Obstacles) -> tuple[int, np.ndarray]:
        """Return the verdict's code at a time [s], and the commanded configuration (7,) a tick later."""
        assert self._planner.take_obstacles(obstacles).ok
        plan = self._planner.tick(now)
        commanded = self._planner.commanded_state(now + TICK)
        assert commanded is not None
        return int(plan.verdict.code), commanded[0]

    def tool(self, state: np.ndarray) -> np.ndarray:
        """Where the tool is (3,) [m]."""
        return self._planner.robot.forward(state)[0]

    def points(self, states: np.ndarray) -> np.ndarray:
        """Return where the tool, then the spheres of the arm are in configurations (n, 7): (n, S, 3) [m]."""
        robot, collision = self._planner.robot, self._planner.collision
        tool = np.array([self.tool(state) for state in states])
        return np.concatenate([tool[:, None], collision.positions(robot, states)[:, collision.moving]], axis=1)


# ----------------------------------------------------------------- playing


def step(replay: Replay, stream: Stream, tick: int) -> tuple[int, np.ndarray]:
    """Hand over the inputs of a tick; the verdict's code and the commanded state (7,)."""
    for at, is_configuration, *goal in stream.goals:
        if at == tick:
            assert replay.set_goal(np.array(goal), bool(is_configuration))
    return replay.tick(tick * TICK, stream.obstacles(tick))


def reaches(replay: Replay, stream: Stream, state: np.ndarray) -> bool:
    """Whether the tool is at the last goal in a state (7,)."""
    _, is_configuration, *goal = stream.goals[-1]
    place = replay.tool(np.array(goal)) if is_configuration else goal[:3]
    return bool(np.linalg.norm(replay.tool(state) - place) < TOLERANCE)


def assert_repeats(replay: Replay, stream: Stream) -> None:
    """The planner repeats a stream's verdicts, motion and outcome."""
    replay.begin(stream.states[0])
    codes, commanded = zip(*(step(replay, stream, tick) for tick in range(len(stream.codes))), strict=True)
    np.testing.assert_array_equal(codes, stream.codes)
    apart = np.linalg.norm(replay.points(np.array(commanded)) - replay.points(stream.states[1:]), axis=-1)
    assert np.max(apart) < TOLERANCE, f"first in tick {np.argmax(np.max(apart, axis=1) >= TOLERANCE)}"
    assert reaches(replay, stream, commanded[-1]) == stream.reached


# ------------------------------------------------------------------- files


@cache
def replay_of(name: str) -> Replay:
    """A planner on a shipped skill. What it did before makes no difference (test/nodes/test_same_bytes.py)."""
    return Replay(Skill.load(name))


def load(name: str, key: str) -> Stream:
    """One of the recorded streams of a shipped skill."""
    with np.load(FOLDER / f"{name}.npz") as archive:
        values = {field.name: archive[f"{key}/{field.name}"] for field in fields(Stream)}
    values["states"] = STEP * np.cumsum(np.cumsum(values["states"], axis=0), axis=0)
    values["reached"] = bool(values["reached"])
    return Stream(**values)


def save(name: str, streams: dict[str, Stream]) -> None:
    """Save the streams of a skill by their names, states as second differences of whole numbers: small, and exact."""
    arrays: dict[str, object] = {}
    for key, stream in streams.items():
        steps = np.round(stream.states / STEP).astype(np.int32)
        packed = np.diff(steps, n=2, axis=0, prepend=np.zeros((2, 7), dtype=np.int32))
        for field, value in vars(replace(stream, states=packed)).items():
            arrays[f"{key}/{field}"] = value
    np.savez_compressed(FOLDER / f"{name}.npz", **arrays)


# --------------------------------------------------------------- recording


def sphere_rows(sphere: MovingSphere) -> list[list[float]]:
    """Rows of `Stream.spheres`: two of a sphere that comes to rest."""
    rests, vanishes = np.ceil(np.array([sphere.rests, sphere.vanishes]) / TICK)
    rows = [[0, min(rests, vanishes), *sphere.begin, sphere.radius, *sphere.velocity]]
    if rests < vanishes:
        rows.append([rests, vanishes, *(sphere.begin + sphere.rests * sphere.velocity), sphere.radius, 0, 0, 0])
    return rows


def drawn(arena: Arena, family: str, number: int) -> Stream:
    """A stream without ticks: a scene of the comparison, *redirected* one without spheres."""
    redirected = family == "redirected"
    scene = draw_scene(arena, "none" if redirected else family, number, SEED)
    position, quaternion = scene.goal_pose
    goals = [[0, arena.whole_arm, *(scene.goal if arena.whole_arm else (*position, *quaternion))]]
    if redirected:
        goals.append([REDIRECTED, False, *(position + REDIRECTION), *quaternion])
    rows = np.array([row for sphere in scene.spheres for row in sphere_rows(sphere)]).reshape(-1, 9)
    start = STEP * np.round(scene.start[None] / STEP)
    return Stream(np.array(goals), rows, start, np.empty(0, dtype=np.uint8), reached=False)


def recorded(replay: Replay, stream: Stream) -> Stream:
    """A stream with its ticks, until the arm rests for good."""
    states, codes, still = [stream.states[0]], [], 0
    replay.begin(states[0])
    while still < RESTING and len(codes) < LONGEST / TICK:
        changes = stream.will_change(len(codes))
        code, commanded = step(replay, stream, len(codes))
        still = 0 if changes or np.max(np.abs(commanded - states[-1])) > STEP else still + 1
        codes.append(code)
        states.append(commanded)
    reached = reaches(replay, stream, states[-1])
    return replace(stream, states=np.array(states), codes=np.array(codes, dtype=np.uint8), reached=reached)


def record(name: str) -> None:
    """Record all streams of a skill."""
    arena = Arena.of(Skill.load(name))
    scenes = [(family, number) for family, numbers in SCENES[name].items() for number in numbers]
    streams = {f"{f}{n}": recorded(Replay(arena.skill), drawn(arena, f, n)) for f, n in scenes}
    save(name, streams)


# ------------------------------------------------------------------- tests


@pytest.fixture(scope="module", autouse=True)
def _remade(pytestconfig: pytest.Config) -> None:
    if pytestconfig.getoption("--remake"):
        for name in SCENES:
            record(name)


@pytest.mark.parametrize(("name", "key"), STREAMS)
def test_a_planner_repeats_a_recorded_stream(name: str, key: str) -> None:
    assert_repeats(replay_of(name), load(name, key))


@pytest.mark.parametrize(("name", "key"), CONTROLS)
def test_a_sphere_elsewhere_is_noticed(name: str, key: str) -> None:
    """The control."""
    stream = load(name, key)
    stream.spheres[:, 4] += HIGHER
    with pytest.raises(AssertionError):
        assert_repeats(replay_of(name), stream)
