"""Scenes of spheres that move: how they are drawn, how they go on, what their contacts count as.

A scene has one to five spheres of 3 to 6 cm. *Crossing* ones move in a straight line towards a place where some part of
the body, the arm or the tool, would be, at that time, without obstacles, and beyond it; *chasing* ones move towards a
point of the body wherever it is. Those that are not there from the beginning appear at least `DISTANCE` from the body.

A contact counts against the planner unless

- the body stood: its command rested, and the sphere ran into it; or
- there was no room to brake: when the sphere was first there it was no farther from the body than

      v_body t_latency + stopping travel + v_sphere (t_latency + stopping time) + 1 cm,

  with t_latency until a new reference takes over, and the stop that was possible then.

A sphere that touches is taken away.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from tqdm import tqdm

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Steps of the judge per second, their length [s], and how many of them a tick of the planner has.
STEP_HZ, STEP, STEPS_PER_TICK = 200.0, 1.0 / 200.0, 2
#: Radii [m] and speeds [m/s] of the spheres; chasing ones are no faster than the last.
RADII, SPEEDS, CHASING_SPEED = (0.03, 0.06), (0.05, 0.5), 0.15
#: Share of spheres that chase.
CHASING_SHARE = 0.2
#: From the body to a sphere that appears while it moves, and to one that is there from the beginning [m].
DISTANCE, DISTANCE_AT_REST = 0.4, 0.02
#: Crossing spheres pass the body's place this far off [m], as a standard deviation, and vanish so long after [s];
#: chasing ones begin so far [m] from what they chase and give up after so long [s].
OFF, VANISHING, CHASE_FROM, CHASE_FOR = 0.04, 3.0, 0.5, 5.0
#: A scene ends at the goal, or after so long [s].
LONGEST = 25.0
#: In pictures what is farther off counts as so far [mm].
_FARTHEST = 100.0
#: Added to what braking needs [m].
ROOM = 0.01

Outcome = Literal["moving", "standing", "no room"]


@dataclass(frozen=True, eq=False)
class MovingSphere:
    """A sphere that is there from `appears` to `vanishes` [s].

    Attributes
    ----------
    begin : (3,) centre where it appears [m]. velocity : (3,) [m/s]; of a chasing one its magnitude counts.
    rests : when it comes to a stand [s].
    """

    radius: float
    appears: float
    vanishes: float
    begin: np.ndarray
    velocity: np.ndarray
    chases: bool
    rests: float = math.inf

    def is_there(self, now: float) -> bool:
        """At a time [s]."""
        return self.appears <= now < self.vanishes


@dataclass(frozen=True, eq=False)
class NominalMotion:
    """What a body does without spheres, from time 0 on for `duration` [s].

    Attributes
    ----------
    radii : (S,) of the body's spheres [m]; spheres : their centres (n, S, 3) [m] at times (n,) [s].
    chased : what chasing spheres move towards, (3,) [m] at a time [s].
    """

    duration: float
    radii: np.ndarray
    spheres: Callable[[np.ndarray], np.ndarray]
    chased: Callable[[float], np.ndarray]

    def distances(self, times: np.ndarray, centres: np.ndarray, radius: float) -> np.ndarray:
        """Signed distances (n,) [m] of the body at times (n,) [s] from spheres there, (n, 3)."""
        apart = np.linalg.norm(self.spheres(times) - centres[:, None], axis=-1)
        return np.min(apart - self.radii, axis=1) - radius


@dataclass(frozen=True, kw_only=True)
class MovingScene:
    """What happened in one scene.

    Attributes
    ----------
    spheres : how many; contacts : what each contact was. reached : whether the goal was reached, after `duration` [s].
    clearance : least distance [m] from a sphere while the body moved.
    stood : time [s] that the body stood before it reached the goal.
    ticks : processor time [s] of each tick.
    control : contacts of the moving body where the same planner ignores the spheres.
    """

    number: int
    spheres: int
    contacts: tuple[Outcome, ...]
    reached: bool
    duration: float
    clearance: float
    stood: float
    ticks: tuple[float, ...]
    control: int = 0

    def as_dict(self) -> dict[str, Any]:
        """What JSON files hold of it: all but the ticks."""
        return {name: value for name, value in asdict(self).items() if name != "ticks"}


def draw_spheres(nominal: NominalMotion, random: np.random.Generator) -> tuple[MovingSphere, ...]:
    """One to five spheres on the path of a nominal motion."""
    kinds = [_chasing if random.uniform() < CHASING_SHARE else _crossing for _ in range(random.integers(1, 6))]
    return tuple(kind(nominal, random) for kind in kinds)


def _crossing(nominal: NominalMotion, random: np.random.Generator) -> MovingSphere:
    while True:
        radius, speed = random.uniform(*RADII), random.uniform(*SPEEDS)
        meeting = random.uniform(0.1, 1.0) * nominal.duration
        body = nominal.spheres(np.array([meeting]))[0]
        place = body[random.integers(len(body))] + random.normal(scale=OFF, size=3)
        # Rather from the sides than from above or below.
        direction = random.normal(size=3) * [1.0, 1.0, 0.5]
        velocity = speed * direction / np.linalg.norm(direction)
        before = np.arange(meeting, 0.0, -0.05)
        centres = place - (meeting - before)[:, None] * velocity
        far = np.flatnonzero(nominal.distances(before, centres, radius) >= DISTANCE)
        if len(far):
            appears = float(before[far[0]])
            return MovingSphere(radius, appears, meeting + VANISHING, centres[far[0]], velocity, False)
        begin = place - meeting * velocity
        if nominal.distances(np.zeros(1), begin[None], radius)[0] >= DISTANCE_AT_REST:
            return MovingSphere(radius, 0.0, meeting + VANISHING, begin, velocity, False)


def _chasing(nominal: NominalMotion, random: np.random.Generator) -> MovingSphere:
    while True:
        radius, speed = random.uniform(*RADII), random.uniform(SPEEDS[0], CHASING_SPEED)
        appears = random.uniform(0.0, 0.5) * nominal.duration
        direction = random.normal(size=3)
        begin = nominal.chased(appears) + CHASE_FROM * direction / np.linalg.norm(direction)
        if nominal.distances(np.array([appears]), begin[None], radius)[0] >= DISTANCE - radius:
            return MovingSphere(radius, appears, appears + CHASE_FOR, begin, np.array([speed, 0.0, 0.0]), True)


class SpheresInMotion:
    """The spheres of one scene as time goes on, and what became of them.

    Attributes
    ----------
    contacts : what each contact was. clearance : least distance [m] from a sphere while the body moved.
    """

    def __init__(self, spheres: Sequence[MovingSphere], chased: Callable[[], np.ndarray]) -> None:
        """chased : what chasing spheres move towards now, (3,) [m]."""
        self._spheres, self._chased = dict(enumerate(spheres)), chased
        self._centres = {i: sphere.begin.copy() for i, sphere in self._spheres.items()}
        self._room: dict[int, bool] = {}
        self.contacts: list[Outcome] = []
        self.clearance = np.inf

    def seen(
        self, now: float, has_room: Callable[[np.ndarray, float, float], bool]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Centres (o, 3), radii (o,) [m] and velocities (o, 3) [m/s] of the spheres that are there.

        has_room : called with centre, radius and speed of a sphere that is there for the first time: may it be stopped
            for?
        """
        present = self._present(now)
        velocities = np.array([self._velocity(i, now) for i in present]).reshape(-1, 3)
        radii = np.array([self._spheres[i].radius for i in present])
        for i, velocity in zip(present, velocities, strict=True):
            if i not in self._room:
                speed = float(np.linalg.norm(velocity))
                self._room[i] = has_room(self._centres[i], self._spheres[i].radius, speed)
        return np.array([self._centres[i] for i in present]).reshape(-1, 3), radii, velocities

    def move(self, until: float) -> None:
        """Move on by one step, to a time [s]. A sphere appears where it begins."""
        for i in self._present(until):
            if self._spheres[i].appears < until - STEP:
                self._centres[i] = self._centres[i] + STEP * self._velocity(i, until - STEP)

    def judge(self, now: float, moves: bool, distance: Callable[[np.ndarray, float], float]) -> None:
        """Count contacts of a body that moves or stands. What touches is taken away.

        distance : of the body from a sphere, its centre (3,) and radius [m].
        """
        for i in self._present(now):
            apart = distance(self._centres[i], self._spheres[i].radius)
            if moves:
                self.clearance = min(self.clearance, apart)
            if apart <= 0.0:
                # What the planner has not received yet was not there in time.
                had_room = self._room.get(i, False)
                self.contacts.append("standing" if not moves else "moving" if had_room else "no room")
                del self._spheres[i]

    def placed(self, now: float) -> dict[str, tuple[np.ndarray, float]]:
        """Centre (3,) and radius [m] of those that are there."""
        return {str(i): (self._centres[i], self._spheres[i].radius) for i in self._present(now)}

    def _present(self, now: float) -> list[int]:
        return [i for i, sphere in self._spheres.items() if sphere.is_there(now)]

    def _velocity(self, i: int, now: float) -> np.ndarray:
        sphere = self._spheres[i]
        if now >= sphere.rests:
            return np.zeros(3)
        if not sphere.chases:
            return sphere.velocity
        towards = self._chased() - self._centres[i]
        return np.linalg.norm(sphere.velocity) * towards / max(float(np.linalg.norm(towards)), 1e-9)


def needed_room(travel: float, rest: float, speed: float) -> float:
    """Distance [m] from which a sphere at a speed [m/s] can be stopped for: the body moves on by `travel` [m] until it
    rests, `rest` [s] from now.
    """
    return travel + speed * rest + ROOM


def moving_figures(scenes: Sequence[MovingScene]) -> dict[str, float | int]:
    """The figures of scenes with any body."""
    contacts = Counter(contact for scene in scenes for contact in scene.contacts)
    ticks = 1e3 * np.concatenate([scene.ticks for scene in scenes])
    return {
        "scenes": len(scenes),
        "spheres": sum(scene.spheres for scene in scenes),
        "contacts_moving": contacts["moving"],
        "contacts_moving_without_avoidance": sum(scene.control for scene in scenes),
        "contacts_no_room": contacts["no room"],
        "contacts_standing": contacts["standing"],
        "goals_reached": sum(scene.reached for scene in scenes),
        "least_clearance_mm": 1e3 * min(scene.clearance for scene in scenes),
        "median_duration_s": float(np.median([scene.duration for scene in scenes])),
        "tick_p50_ms": float(np.percentile(ticks, 50)),
        "tick_p99_ms": float(np.percentile(ticks, 99)),
        "tick_longest_ms": float(np.max(ticks)),
    }


def draw_clearances(axes: Axes, clearances: Mapping[str, Sequence[float]]) -> None:
    """How often which least clearance [m] was, one line for each label, whose {} becomes their number."""
    least = min((min(values) for values in clearances.values() if len(values)), default=0.0)
    edges = np.linspace(min(0.0, 1e3 * least), _FARTHEST, 31)
    for label, values in clearances.items():
        if len(values):
            drawn = np.minimum(1e3 * np.array(values), _FARTHEST)
            axes.hist(drawn, bins=edges, histtype="step", label=label.format(len(values)))
    axes.set_xticks([0.0, 0.5 * _FARTHEST, _FARTHEST], ["0", f"{0.5 * _FARTHEST:g}", f"{_FARTHEST:g} or more"])
    axes.axvline(0.0, color="tab:red", label="contact")
    axes.legend()


class Stage(Protocol):
    """What all scenes of one process are played with."""

    def scene(self, number: int) -> MovingScene:
        """Draw and play scene number `number`; it depends on nothing else but the seed."""


#: Of a process that plays scenes.
_stage: Stage | None = None


def _prepare(make: Callable[..., Stage], arguments: tuple[Any, ...]) -> None:
    global _stage
    _stage = make(*arguments)


def _scene(number: int) -> MovingScene:
    assert _stage is not None
    return _stage.scene(number)


def play_scenes(
    make: Callable[..., Stage], arguments: tuple[Any, ...], scenes: int, processes: int
) -> list[Any]:
    """Draw and play scenes in processes of their own, on stages make(*arguments).

    They are the same ones for the same arguments, however many processes there are.
    """
    # As the planner node does: threads of the linear algebra would only wait for each other.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    with get_context("spawn").Pool(processes, _prepare, (make, arguments)) as pool:
        made = pool.imap(_scene, range(scenes))
        return list(tqdm(made, desc="moving", unit="scene", total=scenes))
