"""From a curve of poses to a reference: bend its beginning, give it a time law, follow it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.graph.transport import carried
from geodesic_motion_ros.motion_curve import SHORTEST_STEP, MotionCurve, MotionLimits
from geodesic_motion_ros.pose_smoothing import PoseSmoothing
from geodesic_motion_ros.time_law import fastest_law

#: A new way may turn off the present direction of motion by no more than 60 degrees: the cosine.
_LARGEST_BEND = 0.5
#: 4 |D| / L is half of the acceleration at L = 8 |D| / a.
_BEND_SHARE = 8.0
#: A bend takes at least and at most so long at full speed [s].
_SHORTEST_BEND, _LONGEST_BEND = 0.1, 1.5


def bent_to(
    positions: np.ndarray, quaternions: np.ndarray, velocity: np.ndarray, limits: MotionLimits
) -> tuple[np.ndarray, np.ndarray] | None:
    """Bend the beginning of a pose curve (n, 3), (n, 4) so that it continues a `velocity` (6,) [m/s], [rad/s].

    Within the first L seconds poses move by D u (1 - u / L)^2, where D is the difference of the velocities. L is chosen
    so that the bend takes half of the acceleration that is allowed, 4 |D| / L at most. None where the directions differ
    by more than 60 degrees, or where there is not enough way left: then one must stop first.
    """
    curve = MotionCurve.through(positions, quaternions, limits)
    scale = np.repeat([limits.speed, limits.angular_speed], 3)
    wanted, found = velocity / scale, curve.tangents[0] / scale
    rate = float(np.linalg.norm(wanted))
    length = float(np.linalg.norm(found))
    if wanted @ found < _LARGEST_BEND * rate * length:
        return None
    difference = wanted * length / rate - found
    strength = rate**2 * scale * difference
    needed = max(
        float(np.linalg.norm(strength[:3])) / limits.acceleration,
        float(np.linalg.norm(strength[3:])) / limits.angular_acceleration,
    )
    span = max(_BEND_SHARE * needed, _SHORTEST_BEND)
    if span > min(_LONGEST_BEND, 0.7 * curve.knots[-1]):
        return None
    fade = curve.knots * np.maximum(0.0, 1.0 - curve.knots / span) ** 2
    return carried(positions, quaternions, fade[:, None] * difference * scale)


@dataclass(frozen=True)
class TaskSpaceReference:
    """A timed, certified curve of tool poses in the base frame, from the asked start to the goal, ending at rest.

    Attributes
    ----------
    times : (n,) [s] from 0, not decreasing. rates : (n,) derivative u' of the curve's parameter with respect to time;
        its square is linear in u between samples.
    curve : the poses, and what is between them. limits : that its time law keeps.
    latent : (n, d) latent points the poses were decoded from.
    clearance : (n - 1,) guaranteed clearance [m] of each stretch between samples, inf without obstacles.
    strain : accelerations in multiples of the limits; more than 1 only where an initial speed asked for it.
    """

    times: np.ndarray
    rates: np.ndarray
    curve: MotionCurve
    limits: MotionLimits
    latent: np.ndarray
    clearance: np.ndarray
    strain: float = 1.0

    @property
    def positions(self) -> np.ndarray:
        """Positions (n, 3) [m] at `times`."""
        return self.curve.positions

    @property
    def quaternions(self) -> np.ndarray:
        """Quaternions (n, 4) at `times`, in one hemisphere along the curve."""
        return self.curve.quaternions

    @property
    def duration(self) -> float:
        """Time [s] until rest."""
        return float(self.times[-1])

    def moved(
        self, move: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    ) -> TaskSpaceReference:
        """The same reference with its poses (n, 3), (n, 4) moved by a rigid motion: times and clearances stay."""
        return replace(self, curve=self.curve.moved(move))

    def sample(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] and quaternion (4,) at `time` [s], held at both ends."""
        return self.curve.pose(*self.locate(time))

    def velocity(self, time: float) -> np.ndarray:
        """Velocity [m/s] and angular velocity [rad/s, base frame] at `time` [s], (6,)."""
        segment, share = self.locate(time)
        return self.rate_at(segment, share) * self.curve.velocity(segment, share)

    def rate(self, time: float) -> float:
        """Speed over full speed at `time` [s]: of the tool or of its rotation, whichever is nearer to its limit."""
        velocity = self.velocity(time)
        return float(self.limits.fraction(velocity[:3], velocity[3:]))

    def rate_at(self, segment: int, share: float) -> float:
        """u' at a share of a segment."""
        first, last = self.rates[segment], self.rates[segment + 1]
        return math.sqrt(first**2 + share * (last**2 - first**2))

    def rest(self, segment: int, share: float) -> TaskSpaceReference:
        """What is left of the reference from a share of a segment on: the same motion."""
        rate = self.rate_at(segment, share)
        curve, at = self.curve.from_share(segment, share)
        latent = np.concatenate([self._latent_at(segment, share)[None], self.latent[at + 1 :]])
        if curve.knots[-1] <= SHORTEST_STEP:
            # Two thousandths of a millimetre at full speed: arrived.
            return TaskSpaceReference(
                np.zeros(2), np.zeros(2), curve, self.limits, latent, self.clearance[at:], self.strain
            )
        if at > segment:
            rate = float(self.rates[at])
        ahead = slice(at + 1, None)
        first = 2.0 * curve.knots[1] / (rate + self.rates[at + 1])
        times = np.concatenate([[0.0], first + self.times[ahead] - self.times[at + 1]])
        return replace(
            self, times=times, rates=np.concatenate([[rate], self.rates[ahead]]), curve=curve,
            latent=latent, clearance=self.clearance[at:],
        )  # fmt: skip

    def _latent_at(self, segment: int, share: float) -> np.ndarray:
        return self.latent[segment] + share * (self.latent[segment + 1] - self.latent[segment])

    def locate(self, time: float) -> tuple[int, float]:
        """Segment that holds `time`, and the share of it passed under constant rate change."""
        i = int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2))
        span = self.times[i + 1] - self.times[i]
        if span <= 0.0:
            return i, 1.0
        x = min(1.0, max(0.0, (time - self.times[i]) / span))
        first, last = self.rates[i], self.rates[i + 1]
        return i, float(x * (2.0 * first + (last - first) * x) / (first + last))


def timed_reference(
    curve: MotionCurve,
    latent: np.ndarray,
    limits: MotionLimits,
    initial_speed: float = 0.0,
) -> TaskSpaceReference:
    """The fastest reference along a curve within the limits, from a speed (over full speed) until rest at its end.

    Its clearance is not known yet: inf.
    """
    times, rates, strain = fastest_law(curve, limits, initial_rate(curve, limits, initial_speed))
    return TaskSpaceReference(times, rates, curve, limits, latent, np.full(len(times) - 1, np.inf), strain)


def initial_rate(curve: MotionCurve, limits: MotionLimits, speed: float) -> float:
    """u' at the begin of a curve at a speed over full speed."""
    full = float(limits.fraction(curve.tangents[0, :3], curve.tangents[0, 3:]))
    return speed / full if full > 0.0 else 0.0


class ReferenceFollower:
    """The pacing of a stream: where the reference is followed to, how fast it moves there, and what is commanded.

    One follower belongs to one arm. `accept` switches to a new reference, which must begin at `position` and
    `quaternion` with `speed`; `slow_down` and `hold` stop; `advance` moves on by one control period and returns the
    commanded pose, which is that of the reference without its steps of acceleration (`pose_smoothing`).
    """

    def __init__(self, full_speed: float) -> None:
        """full_speed [m/s]: the planner's `speed`, to which rates of a reference are relative."""
        self._full_speed = full_speed
        self._reference: TaskSpaceReference | None = None
        self._time, self._pace, self._braking_time = 0.0, 1.0, math.inf
        self._smoothing = PoseSmoothing()
        self.position = np.full(3, np.nan)
        self.quaternion = np.full(4, np.nan)
        self.commanded = self.position, self.quaternion
        self.speed = 0.0

    @property
    def ready(self) -> bool:
        """Whether a pose to command is known."""
        return bool(np.all(np.isfinite(self.position)))

    @property
    def at_end(self) -> bool:
        """Whether the accepted reference has been followed to its end."""
        return self._reference is not None and self._time >= self._reference.duration

    def reset(self, position: np.ndarray, quaternion: np.ndarray) -> None:
        """Stand at a pose, (3,) [m] and (4,), at rest and without a reference."""
        self.hold()
        self.position, self.quaternion = np.array(position, dtype=float), np.array(quaternion, dtype=float)
        self.commanded = self.position, self.quaternion
        self._smoothing.reset(self.position, self.quaternion)

    def accept(self, reference: TaskSpaceReference) -> None:
        """Follow a reference from its beginning."""
        self._reference = reference
        self._time, self._pace, self._braking_time = 0.0, 1.0, math.inf

    def slow_down(self, braking_time: float) -> None:
        """Come to rest on the accepted reference: its time runs ever slower, and stands after a time [s].

        Full speed over that time is the deceleration, to which that of the reference itself is added.
        """
        self._braking_time = braking_time

    def hold(self) -> None:
        """Stay where the reference is now."""
        self._reference, self.speed = None, 0.0

    def advance(self, period: float) -> tuple[np.ndarray, np.ndarray]:
        """Move on by `period` [s]; returns the commanded position (3,) and quaternion (4,), sign-continuous."""
        if self._reference is not None:
            before, self._pace = self._pace, max(0.0, self._pace - period / self._braking_time)
            self._time += 0.5 * (before + self._pace) * period
            self.position, quaternion = self._reference.sample(self._time)
            self.quaternion = quaternion if quaternion @ self.quaternion >= 0.0 else -quaternion
            self.speed = self._full_speed * self._pace * self._reference.rate(self._time)
        self.commanded = self._smoothing.add(period, self.position, self.quaternion)
        return self.commanded
