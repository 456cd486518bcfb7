"""How commands follow a path that changes again and again: as a critically damped mass behind a leading point.

The leading point moves along the decoded path at full speed. What is commanded is drawn to it and damped,

    x'' = w^2 (lead - x) - 2 w x',

so that a path which jumps, as shortest paths on a grid do, makes no jump of the command.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.trajectory.trajectory import interpolated

#: w [1/s]: what is commanded is 2 / w = 0.2 s behind the leading point.
STIFFNESS = 10.0
#: Where what is commanded is this near to the end of the path, and so slow, it has arrived [m] or [rad], and a second.
_ARRIVED = 1e-5
#: Pieces of a path last at least so long, also where nothing moves [s].
_SHORTEST_STEP = 1e-9


@dataclass(frozen=True)
class TimedPath:
    """A decoded path, and when the leading point passes it.

    Attributes
    ----------
    times : (n,) [s] from 0, increasing.
    places : (n, p) poses (x, y, z [m], w, x, y, z) in one hemisphere, or configurations [rad].
    latent : (n, d) points that they were decoded from.
    """

    times: np.ndarray
    places: np.ndarray
    latent: np.ndarray

    @classmethod
    def of(cls, steps: np.ndarray, places: np.ndarray, latent: np.ndarray) -> TimedPath:
        """The path whose pieces take so long (n - 1,) [s]."""
        return cls(np.append(0.0, np.cumsum(np.maximum(steps, _SHORTEST_STEP))), places, latent)

    @classmethod
    def standing(cls, place: np.ndarray, latent: np.ndarray) -> TimedPath:
        """Stay at a place (p,), whose latent point is (d,)."""
        return cls.of(np.zeros(1), np.stack([place, place]), np.stack([latent, latent]))

    @property
    def stands(self) -> bool:
        """Whether it leads nowhere."""
        return self.duration <= _SHORTEST_STEP * (len(self.times) - 1)

    @property
    def duration(self) -> float:
        """Time [s] of the leading point."""
        return float(self.times[-1])

    def latent_at(self, time: float) -> np.ndarray:
        """Latent point (d,) of the leading point at a time [s], constant beyond both ends."""
        return interpolated(np.array([time]), self.times, self.latent)[0]

    def place_at(self, time: float) -> np.ndarray:
        """Place (p,) of the leading point at a time [s], constant beyond both ends."""
        return interpolated(np.array([time]), self.times, self.places)[0]


@numba.njit(cache=True, nogil=True)
def followed(
    times: np.ndarray,
    places: np.ndarray,
    begin: float,
    position: np.ndarray,
    velocity: np.ndarray,
    period: float,
    most: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and accelerations (k + 1, p) after every period [s], until rest or for `most` periods.

    Each period is the exact solution for a leading point that stands where it is at the period's end.

    begin : time [s] of the leading point on the path (n,), (n, p). position, velocity : (p,) of what is commanded.
    """
    dimensions = len(position)
    states = np.empty((3, most + 1, dimensions))
    states[0, 0], states[1, 0] = position, velocity
    decay, count, segment = np.exp(-STIFFNESS * period), 0, 0
    for k in range(most + 1):
        time = begin + k * period
        while segment < len(times) - 2 and times[segment + 1] < time:
            segment += 1
        span = times[segment + 1] - times[segment]
        share = min(1.0, max(0.0, (time - times[segment]) / span)) if span > 0.0 else 1.0
        rests = time >= times[-1]
        for a in range(dimensions):
            lead = places[segment, a] + share * (places[segment + 1, a] - places[segment, a])
            if k > 0:
                off = states[0, k - 1, a] - lead
                rate = states[1, k - 1, a] + STIFFNESS * off
                states[0, k, a] = lead + (off + rate * period) * decay
                states[1, k, a] = (states[1, k - 1, a] - STIFFNESS * rate * period) * decay
            off = states[0, k, a] - lead
            states[2, k, a] = -(STIFFNESS**2) * off - 2.0 * STIFFNESS * states[1, k, a]
            rests = rests and abs(off) < _ARRIVED and abs(states[1, k, a]) < _ARRIVED
        count = k
        if rests and k > 0:
            break
    return states[0, : count + 1], states[1, : count + 1], states[2, : count + 1]
