"""Offer: a trajectory that somebody else wants an arm to play, a chunk or a whole one, and why it is refused."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.queries.round_frame import RoundFrame
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.limits import JointLimits
from geodesic_motion_ros.trajectory.trajectory import PERIOD, interpolated
from geodesic_motion_ros.utils.checked_numbers import check_time, real_array
from geodesic_motion_ros.utils.errors import PlanningError

#: Two points between which a joint would move faster than its limit by this factor are a jump: anything slower is only
#: timed more slowly.
JUMP_FACTOR = 2.0
#: An offer that begins farther than this [rad] from where the arm is to be then is a jump as well.
LARGEST_JUMP = 0.3
#: A place of an offer is about as near as another one where the arm comes to it no later than so much [s].
ABOUT_AS_NEAR = 0.01
#: An offer that lasts longer [s] is none that a person waits for; what is drawn of it would fill the memory.
LONGEST = 600.0
#: An offer that begins so much later [s] is of another clock.
LATEST_BEGIN = 60.0
#: A chunk whose joints are all slower than this at its end [rad/s] ends at rest. Two that end nearer to each other than
#: this [rad] lead to the same place. Beyond its end a chunk is taken to go on by up to so much of a joint [rad].
ENDS_AT_REST, SAME_END, CONTINUED = 0.02, 0.1, 2.0


@dataclass(frozen=True, eq=False)
class OfferRequest:
    """A trajectory as it was offered, whatever is in it: as of `Offer`."""

    times: object
    positions: object
    velocities: object = None
    begin: float | None = None


@dataclass(frozen=True, eq=False)
class Offer:
    """A trajectory that is offered: at its times, no sooner, the arm is to be at its positions.

    Attributes
    ----------
    times : (m,) [s] of the points, increasing from `times[0]` >= 0. positions : (m, eta) [rad].
    velocities : (m, eta) [rad/s]; None: the points alone say how the arm moves.
    begin : when time 0 is [s]; None: at once.
    """

    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray | None = None
    begin: float | None = None

    @property
    def duration(self) -> float:
        """The time of its last point [s]."""
        return float(self.times[-1])

    @property
    def start_latent(self) -> np.ndarray:
        """The progress (1,) [s] at its first point: what the stream has in the place of a latent point."""
        return self.times[:1]

    @property
    def round_frame(self) -> RoundFrame | None:
        """An offer has no rounds."""
        return None

    @property
    def end_velocity(self) -> np.ndarray:
        """The velocity (eta,) [rad/s] with which it comes to its last point."""
        if self.velocities is not None:
            return self.velocities[-1]
        if len(self.times) < 2:
            return np.zeros(self.positions.shape[1])
        return (self.positions[-1] - self.positions[-2]) / (self.times[-1] - self.times[-2])

    @property
    def ends_in_motion(self) -> bool:
        """Whether it is a chunk, which others will continue."""
        return bool(np.max(np.abs(self.end_velocity)) > ENDS_AT_REST)

    def in_turn(self, robot: Robot, position: np.ndarray) -> Offer:
        """Return it with continuous joints in the turn in which its first point is nearest to a position (eta,) [rad].
        """
        turned = robot.nearest_turn(self.positions[0], position) - self.positions[0]
        return Offer(self.times, self.positions + turned, self.velocities, self.begin)

    def ends_like(self, other: Offer) -> bool:
        """Whether another one leads to about the same place."""
        return bool(np.max(np.abs(self.positions[-1] - other.positions[-1])) <= SAME_END)

    def continued(self, limits: JointLimits) -> Offer:
        """Return it with what follows, if the arm goes on as it moves at the end: straight on by up to `CONTINUED`, as
        far as the limits of positions allow.
        """
        velocity = self.end_velocity
        if not self.ends_in_motion:
            return self
        passed = np.arange(1, math.ceil(CONTINUED / np.max(np.abs(velocity)) / PERIOD) + 1) * PERIOD
        beyond = self.positions[-1] + passed[:, None] * velocity
        inside = np.logical_and.accumulate(np.all((beyond >= limits.lower) & (beyond <= limits.upper), axis=1))
        times, positions = self.points
        return Offer(
            np.append(times, times[-1] + passed[inside]), np.concatenate([positions, beyond[inside]]), begin=self.begin
        )

    def followed_by(self, positions: np.ndarray, limits: JointLimits) -> Offer:
        """Return it with more points (n, eta) [rad] after its end, at full speed."""
        times, before = self.points
        steps = np.diff(np.concatenate([before[-1:], positions]), axis=0)
        passed = np.cumsum(np.maximum(PERIOD, np.max(np.abs(steps) / limits.velocity, axis=1)))
        return Offer(np.append(times, times[-1] + passed), np.concatenate([before, positions]), begin=self.begin)

    def until(self, time: float) -> Offer:
        """Return it as far as its last point at or before a time [s]."""
        times, positions = self.points
        kept = times <= time
        return Offer(times[kept], positions[kept], begin=self.begin)

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (n,) [s] and positions (n, eta) [rad] that say how the arm moves: of the cubics between points that
        have velocities no more than a period apart, else its points.
        """
        if self.velocities is None or len(self.times) < 2:
            return self.times, self.positions
        steps = np.diff(self.times)
        pieces = np.maximum(1, np.ceil(steps / PERIOD - 1e-6).astype(int))
        inner = np.repeat(np.arange(len(pieces)), pieces)
        share = (np.arange(len(inner)) - np.repeat(np.cumsum(pieces) - pieces, pieces)) / pieces[inner]
        times = np.append(self.times[inner] + share * steps[inner], self.times[-1])
        # Of each step: how far it leads, and how much farther its velocities (2, m - 1, eta) alone would lead.
        far = np.diff(self.positions, axis=0)
        beyond = steps[:, None] * np.stack([self.velocities[:-1], self.velocities[1:]]) - far
        x, left = share[:, None], 1.0 - share[:, None]
        between = self.positions[inner] + x * (far[inner] + left * (left * beyond[0, inner] - x * beyond[1, inner]))
        return times, np.concatenate([between, self.positions[-1:]])

    def at(self, progress: float) -> np.ndarray:
        """Return the position (eta,) [rad] at a time [s] of it; before its first point as if it had begun sooner."""
        times, positions = self.points
        if progress < times[0] and len(times) > 1:
            return positions[0] + (progress - times[0]) / (times[1] - times[0]) * (positions[1] - positions[0])
        return interpolated(np.array([progress]), times, positions)[0]

    def nearest(self, position: np.ndarray, limits: JointLimits) -> float:
        """Return the time [s] of its place that the arm comes to soonest at full speed from a position (eta,) [rad]; of
        places that are about as near, within `ABOUT_AS_NEAR`, the first: a path may come back.
        """
        times, positions = self.points
        if len(times) == 1:
            return float(times[0])
        piece, share = _nearest_on(positions / limits.velocity, position / limits.velocity, ABOUT_AS_NEAR)
        return float(times[piece] + share * (times[piece + 1] - times[piece]))

    def before_first(self, position: np.ndarray, velocity: np.ndarray, limits: JointLimits) -> float:
        """Return the time [s] of it that an arm has come to which is before its first point: its beginning, where the
        arm stands; in motion so much before that point as the arm takes to come there at the speed of what follows.
        """
        first = float(self.times[0])
        if len(self.times) < 2 or not np.any(velocity):
            return 0.0
        speed = np.linalg.norm((self.positions[1] - self.positions[0]) / limits.velocity) / (self.times[1] - first)
        apart = np.linalg.norm((self.positions[0] - position) / limits.velocity)
        return first - float(np.clip(apart / max(speed, 1e-9), 0.0, first))


@numba.njit(cache=True, nogil=True)
def _nearest_on(path: np.ndarray, place: np.ndarray, about: float) -> tuple[int, float]:
    """The piece of a polyline (n, d) that is nearest to a place (d,), and the share of it: the first that is no farther
    than the nearest of all by more than `about`, or of those that follow on it as long as they are nearer.
    """
    pieces = len(path) - 1
    distances, shares = np.empty(pieces), np.empty(pieces)
    for i in range(pieces):
        ahead, length = 0.0, 0.0
        for j in range(len(place)):
            step = path[i + 1, j] - path[i, j]
            ahead, length = ahead + (place[j] - path[i, j]) * step, length + step * step
        share = min(max(ahead / max(length, 1e-18), 0.0), 1.0)
        apart = 0.0
        for j in range(len(place)):
            apart += (place[j] - path[i, j] - share * (path[i + 1, j] - path[i, j])) ** 2
        distances[i], shares[i] = math.sqrt(apart), share
    within, piece = np.min(distances) + about, 0
    while distances[piece] > within:
        piece += 1
    while piece + 1 < pieces and distances[piece + 1] < distances[piece]:
        piece += 1
    return piece, shares[piece]


def checked_offer(robot: Robot, limits: JointLimits, request: OfferRequest) -> Offer | Refusal:
    """Return a trajectory as an offer, or the refusal that names the first point, joint and number that are wrong.

    limits : [rad], [rad/s] that positions must keep, and that jumps are judged by.
    """
    joints, given, begin = len(robot.joint_names), request.velocities, request.begin
    try:
        at = real_array("times", request.times, ("m",))
        where = real_array("positions", request.positions, ("m", joints))
        speeds = None if given is None else real_array("velocities", given, ("m", joints))
        if begin is not None:
            check_time("begin", begin)
    except PlanningError as error:
        return _refused(str(error))
    objection = _shape_objection(at, where, speeds) or _number_objection(robot, at, where, speeds)
    if not objection:
        where = robot.unwrapped(where)
        objection = _limit_objection(robot, limits, at, where) or _speed_objection(robot, limits, speeds)
    return _refused(objection) if objection else Offer(at, where, speeds, begin)


def _shape_objection(at: np.ndarray, where: np.ndarray, speeds: np.ndarray | None) -> str:
    if not len(at):
        return "the trajectory has no points"
    for name, rows in (("positions", where), ("velocities", speeds)):
        if rows is not None and len(rows) != len(at):
            return f"the trajectory has {len(at)} times and {len(rows)} {name}"
    return ""


def _number_objection(robot: Robot, at: np.ndarray, where: np.ndarray, speeds: np.ndarray | None) -> str:
    for name, values in (("position", where), ("velocity", speeds)):
        wrong = np.empty((0, 2), dtype=int) if values is None else np.argwhere(~np.isfinite(values))
        for point, joint in wrong[:1]:
            assert values is not None
            return f"point {point}: the {name} of '{robot.joint_names[joint]}' is {values[point, joint]}"
    steps = np.diff(at, prepend=0.0)
    wrong_times = np.flatnonzero(~((steps > 0.0) | ((np.arange(len(at)) == 0) & (steps == 0.0))))
    if len(wrong_times):
        point = wrong_times[0]
        after = "" if point == 0 else f", not after point {point - 1} at {at[point - 1]:g} s"
        return f"point {point} comes at {at[point]:g} s{after}"
    return f"the trajectory lasts {at[-1]:.4g} s, at most {LONGEST:g} s may be" if at[-1] > LONGEST else ""


def _limit_objection(robot: Robot, limits: JointLimits, at: np.ndarray, where: np.ndarray) -> str:
    beyond = np.argwhere((where < limits.lower) | (where > limits.upper))
    if len(beyond):
        point, joint = beyond[0]
        value = where[point, joint]
        limit = limits.lower[joint] if value < limits.lower[joint] else limits.upper[joint]
        return f"point {point} takes '{robot.joint_names[joint]}' to {value:.3f} rad, beyond its limit of {limit:.3f}"
    if len(at) > 1:
        with np.errstate(over="ignore"):
            speeds = np.abs(np.diff(where, axis=0)) / np.diff(at)[:, None]
        jumps = np.argwhere(speeds > JUMP_FACTOR * limits.velocity)
        if len(jumps):
            point, joint = jumps[0]
            return (
                f"from point {point} to point {point + 1} '{robot.joint_names[joint]}' would move at "
                f"{speeds[point, joint]:.1f} rad/s, and its limit is {limits.velocity[joint]:.2f}: a jump"
            )
    return ""


def _speed_objection(robot: Robot, limits: JointLimits, speeds: np.ndarray | None) -> str:
    beyond = np.empty((0, 2)) if speeds is None else np.argwhere(np.abs(speeds) > JUMP_FACTOR * limits.velocity)
    if speeds is None or not len(beyond):
        return ""
    point, joint = beyond[0]
    return (
        f"point {point}: the velocity of '{robot.joint_names[joint]}' is {speeds[point, joint]:.4g} rad/s, and its "
        f"limit is {limits.velocity[joint]:.2f}"
    )


def joining_objection(
    robot: Robot, limits: JointLimits, offer: Offer, position: np.ndarray, progress: float
) -> str:
    """Return why the arm, at a position (eta,) [rad], cannot join an offer at a time [s] of it; "" where it can. Before
    the first point there is time to come to it.
    """
    left = float(offer.times[0]) - progress
    apart = np.abs(offer.at(max(progress, float(offer.times[0]))) - position)
    allowed = np.maximum(LARGEST_JUMP, JUMP_FACTOR * max(0.0, left) * limits.velocity)
    beyond = apart > allowed
    if not np.any(beyond):
        return ""
    joint = int(np.argmax(np.where(beyond, apart, 0.0)))
    what, far = "the trajectory begins" if offer.duration else "the target is", f"{apart[joint]:.2f} rad"
    after = f" in {left:.2f} s" if left > 0.0 else ""
    commanded = f"where '{robot.joint_names[joint]}' is commanded{after}"
    return f"{what} {far} from {commanded}, at most {allowed[joint]:.2g} may be: a jump"


def _refused(reason: str) -> Refusal:
    return Refusal(VerdictCode.BAD_INPUT, reason)
