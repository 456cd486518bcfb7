"""Chunks of motions that an arm can make, drawn, and how a filter plays them while nothing is near.

A motion leads smoothly through a few drawn configurations, from rest to rest, within a drawn share of the limits of
speed, acceleration and jerk, and touches the arm nowhere. It is offered as a whole, or as a stream of chunks that
overlap. What is offered says the motion: a cubic spline through the points of it, as many of them as a chunk has, is
nowhere farther from it than `SAID`. And every chunk leaves room: an arm that has heard nothing newer can come to rest
on it with half of its acceleration.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from geodesic_motion_ros.filtering.motion_filter import MotionFilter
from geodesic_motion_ros.obstacles.obstacles import Obstacles
from geodesic_motion_ros.robot.collision_model import CollisionModel, self_clearances
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits

ARMS = ("panda", "fr3", "ur5", "iiwa14")
#: Points of a chunk, how many a second, and how many chunks a second.
POINTS, RATES, HERTZ = (2, 64), (5.0, 100.0), (5.0, 50.0)
#: Shares of the limits that motions use, and how long those of streams take [s].
SHARES, SECONDS = (0.1, 0.8), (1.0, 4.0)
#: A whole motion that is shorter [s] takes the arm longer than that to begin and to end smoothly.
SHORT = 0.25
#: How far the spline through a chunk's points may be from the motion [rad].
SAID = 2e-4
#: How far a motion leads at most [rad], and how far its arm stays from itself [m].
LARGEST, CLEAR = 0.5, 0.02
#: Ticks of the filter [s]; how long an arm may be late [s] before it is given up.
TICK, PATIENCE = 0.01, 3.0
#: Time [s] that a chunk keeps for the filter, besides that in which its arm comes to rest.
_ROOM = 0.2
_LOOKED_AT = 400
#: An arm that is nearer than this share of its motion to the end of it has arrived.
_ARRIVED = 1e-2


@dataclass(frozen=True)
class DrawnMotion:
    """A motion from rest to rest, and how it is offered.

    Attributes
    ----------
    via : (k, eta) configurations [rad] that it leads through. duration : [s].
    points : of a chunk; of a whole motion all. rate : of them [Hz]. hertz : chunks a second; 0: it is offered whole.
    with_velocities, stamped : whether chunks have velocities, and a time at which they begin. leads_in : whether they
        leave out the point at that time: the arm is to come to the first one by then.
    """

    arm: str
    via: np.ndarray
    duration: float
    points: int
    rate: float
    hertz: float
    with_velocities: bool
    stamped: bool
    leads_in: bool

    @property
    def kind(self) -> tuple[str, str, str]:
        """The row of the table that counts it."""
        of = "positions, velocities" if self.with_velocities else "positions"
        whole = f"whole, {'under' if self.duration < SHORT else 'at least'} {SHORT:g} s"
        return "stream" if self.hertz else whole, of, "stamped" if self.stamped else "at once"

    def at(self, times: np.ndarray, order: int = 0) -> np.ndarray:
        """Positions [rad], or derivatives of an order up to 3, (k, eta) at times (k,) [s]; at rest outside of it."""
        path = CubicSpline(np.linspace(0.0, 1.0, len(self.via)), self.via)
        passed = _least_jerk(np.asarray(times) / self.duration)[:, :, None]
        first, second, third = (path(passed[0, :, 0], one) for one in (1, 2, 3))
        chain = (
            path(passed[0, :, 0]),
            first * passed[1],
            second * passed[1] ** 2 + first * passed[2],
            third * passed[1] ** 3 + 3.0 * second * passed[1] * passed[2] + first * passed[3],
        )
        return chain[order] / self.duration**order

    def chunk(self, begin: float) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Times (m,) [s], positions and velocities of the chunk that begins at a time of the motion [s]."""
        ahead = np.arange(int(self.leads_in), self.points) / self.rate
        return ahead, self.at(begin + ahead), self.at(begin + ahead, 1) if self.with_velocities else None


@dataclass(frozen=True)
class Played:
    """What became of a motion.

    Attributes
    ----------
    chunks, refused : how many were offered, and the reasons of those that were refused.
    path : largest distance [m] of the tool, or of a point of a link, from where it is in the nearest configuration of
        the motion, and the other direction. late : by how much it took longer [s]; inf where it did not arrive.
    stops : reasons of ticks that were not OK.
    """

    drawn: DrawnMotion
    chunks: int
    refused: tuple[str, ...]
    path: float
    late: float
    stops: tuple[str, ...]


class DrawnMotions:
    """Motions of one arm by a seeded generator; the same seed makes the same ones."""

    def __init__(self, arm: str, random: np.random.Generator) -> None:
        self._arm, self._random = arm, random
        self.robot = Robot.named(arm)
        self._model = CollisionModel.named(arm)
        self._limits = JointLimits.of(self.robot, self.robot.largest_speed_scale)

    def __iter__(self) -> Iterator[DrawnMotion]:
        while True:
            motion = self._draw()
            if motion is not None:
                yield motion

    def _draw(self) -> DrawnMotion | None:
        """The next motion; None where it cannot be offered so, or the arm would touch itself."""
        random = self._random
        points, rate = int(random.integers(POINTS[0], POINTS[1] + 1)), random.uniform(*RATES)
        hertz = random.uniform(*HERTZ) if random.random() < 0.5 else 0.0
        ahead = (points - 1) / rate
        duration = random.uniform(*SECONDS) if hertz else ahead
        centre = self.robot.ready + random.normal(scale=0.2, size=len(self.robot.ready))
        # Fewer than four points say a straight path.
        corners = int(random.integers(2, 6)) if points >= 4 else 2
        via = np.cumsum(random.normal(size=(corners, len(centre))), axis=0)
        offered = {"with_velocities": bool(random.integers(2)), "stamped": bool(random.integers(2))}
        offered["leads_in"] = bool(random.integers(2))
        motion = DrawnMotion(self._arm, via - via[0], duration, points, rate, hertz, **offered)
        room = ahead - 1.0 / hertz - _ROOM if hertz else np.inf
        if room <= 0.0:
            return None
        scale = min(LARGEST / np.max(np.abs(motion.via)), self._largest_scale(motion, random.uniform(*SHARES), room))
        motion = DrawnMotion(self._arm, centre + scale * motion.via, duration, points, rate, hertz, **offered)
        return motion if self._is_free(motion) else None

    def _largest_scale(self, motion: DrawnMotion, share: float, room: float) -> float:
        """By how much a motion may be enlarged that keeps a share of the limits, can stop in a time [s] and is said by
        its points.
        """
        times, limits = np.linspace(0.0, motion.duration, _LOOKED_AT), self._limits
        speed = np.min(limits.largest_speeds(self.robot.ready[None]), axis=(0, 1))
        ratios = [
            np.max(np.abs(motion.at(times, order)) / limit) / share
            for order, limit in ((1, speed), (2, limits.acceleration), (3, limits.jerk))
        ]
        ratios.append(np.max(np.abs(motion.at(times, 1)) / (0.5 * limits.acceleration)) / room)
        if motion.points >= 4:
            # A whole motion begins with its first point, a chunk anywhere, and leads on where the motion is over.
            phases, more = ((0.0, 0.3, 0.6), 4) if motion.hertz else ((0.0,), 1)
            for phase in phases:
                said = (phase + np.arange(np.ceil(motion.duration * motion.rate - 1e-9) + more)) / motion.rate
                at = np.linspace(said[0], said[-1], _LOOKED_AT)
                ratios.append(np.max(np.abs(CubicSpline(said, motion.at(said))(at) - motion.at(at))) / SAID)
        return 1.0 / max(ratios)

    def _is_free(self, motion: DrawnMotion) -> bool:
        """Whether the arm stays inside its limits and away from itself."""
        positions = motion.at(np.linspace(0.0, motion.duration, _LOOKED_AT))
        if np.any((positions < self._limits.lower) | (positions > self._limits.upper)):
            return False
        placed = self._model.positions(self.robot, positions)
        return bool(np.min(self_clearances(placed, self._model.radii, self._model.self_pairs)[0]) > CLEAR)


def _least_jerk(times: np.ndarray) -> np.ndarray:
    """The share (4, k) of a motion of least jerk that has passed at times (k,) of 0 to 1, and its derivatives."""
    time = np.clip(times, 0.0, 1.0)
    inside = (times >= 0.0) & (times <= 1.0)
    return np.stack([
        time**3 * (10.0 - 15.0 * time + 6.0 * time**2),
        30.0 * time**2 * (1.0 - time) ** 2,
        60.0 * time * (1.0 - time) * (1.0 - 2.0 * time),
        (60.0 - 360.0 * time + 360.0 * time**2) * inside,
    ])  # fmt: skip


def play(motion_filter: MotionFilter, drawn: DrawnMotion) -> Played:
    """Offer a motion to a filter that is new to it, tick, and compare what was played with it."""
    motion_filter.observe(Obstacles.none())
    motion_filter.stand_at(drawn.at(np.zeros(1))[0], 0.0)
    latency = motion_filter.latency
    # What is stamped begins when the arm can join it.
    begin = latency + TICK
    refused, stops, commanded = [], [], []
    now, sent, end = 0.0, 0, np.inf
    while now < begin + drawn.duration + PATIENCE:
        if sent == 0 or (drawn.hertz and sent / drawn.hertz <= now and (sent - 1) / drawn.hertz < drawn.duration):
            times, positions, velocities = drawn.chunk(sent / drawn.hertz if sent else 0.0)
            stamp = begin + (sent / drawn.hertz if sent else 0.0) if drawn.stamped else None
            verdict = motion_filter.offer(times, positions, velocities, stamp)
            refused += [] if verdict.ok else [verdict.reason]
            sent += 1
        plan = motion_filter.tick(now)
        if plan.reference is not None:
            end = plan.begin + plan.reference.duration
        if not plan.verdict.ok and now >= begin:
            stops.append(plan.verdict.reason)
        state = motion_filter.commanded_state(now)
        assert state is not None
        commanded.append(state[0])
        now += TICK
        is_sent = not drawn.hertz or (sent - 1) / drawn.hertz >= drawn.duration
        if is_sent and now > end + TICK and plan.verdict.ok:
            break
    arrived = np.max(np.abs(commanded[-1] - drawn.at(np.array([drawn.duration]))[0])) < 1e-3
    began = begin if drawn.stamped else latency
    moved = np.array(commanded)
    wanted = drawn.at(np.linspace(0.0, drawn.duration, _LOOKED_AT))
    late = _arrival(moved, TICK, wanted[-1]) - began - _arrival(wanted, drawn.duration / (_LOOKED_AT - 1), wanted[-1])
    late = late if arrived else np.inf
    return Played(drawn, sent, tuple(refused), off_path(drawn, motion_filter, moved), late, tuple(stops))


def _arrival(positions: np.ndarray, step: float, end: np.ndarray) -> float:
    """When a motion, positions (n, eta) [rad] every `step` [s], is at its end for good, but for `_ARRIVED` of its size.
    """
    left = np.linalg.norm(positions - end, axis=1)
    near = _ARRIVED * np.max(left)
    last = int(np.flatnonzero(left > near)[-1])
    return step * (last + (left[last] - near) / (left[last] - left[last + 1]))


def off_path(drawn: DrawnMotion, motion_filter: MotionFilter, commanded: np.ndarray) -> float:
    """Largest distance [m], as of `Played.path`, between a motion and configurations (n, eta) that were commanded."""
    wanted = drawn.at(np.linspace(0.0, drawn.duration, 2000))
    return max(_off(commanded, wanted, motion_filter), _off(wanted[::10], commanded, motion_filter))


def _off(some: np.ndarray, line: np.ndarray, motion_filter: MotionFilter) -> float:
    """How far [m] the points of the arm in some configurations are from where they are on a line through others."""
    _, nearest = cKDTree(line).query(some)
    best = np.full(len(some), np.inf)
    for side in (-1, 0):
        first = np.clip(nearest + side, 0, len(line) - 2)
        begins, steps = line[first], line[first + 1] - line[first]
        lengths = np.maximum(np.sum(steps**2, axis=1), 1e-18)
        share = np.clip(np.sum((some - begins) * steps, axis=1) / lengths, 0.0, 1.0)
        best = np.minimum(best, _apart(some, begins + share[:, None] * steps, motion_filter))
    return float(np.max(best))


def _apart(one: np.ndarray, other: np.ndarray, motion_filter: MotionFilter) -> np.ndarray:
    """How far [m] (n,) the tool, or the point of a link that is farthest, is between configurations (n, eta)."""
    places = [motion_filter.collision.positions(motion_filter.robot, each) for each in (one, other)]
    tools = [np.array([motion_filter.robot.forward(row)[0] for row in each]) for each in (one, other)]
    links = np.max(np.linalg.norm(places[0] - places[1], axis=2), axis=1)
    return np.maximum(links, np.linalg.norm(tools[0] - tools[1], axis=1))
