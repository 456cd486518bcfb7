"""How far the velocity of an obstacle may be off, by how it has changed of late.

What moves straight on is expected to go on so. What has turned may turn again, and meet an arm that passes it on its
straight line: where it may be grows with time, by a multiple of what its velocity has changed, and no faster than it
moves.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

#: Positions are remembered every so often [s], so many of them: two seconds.
INTERVAL, REMEMBERED = 0.1, 21
#: Velocities of before are means over so many of these intervals.
_AVERAGED = 3
#: A velocity may change by so many times what it has changed, before an arm is past.
CHANGE_FACTOR = 4.0


class VelocityHistory:
    """Where one obstacle was in the last two seconds.

    Example
    -------
    >>> history = VelocityHistory()
    >>> history.see(centre, time)  # every time that it is detected
    >>> history.error(velocity)  # [m/s], 0 as long as it moves straight on
    """

    def __init__(self, noise: float = 0.0) -> None:
        """noise : changes up to this [m/s] may come from noise of the positions alone."""
        self._noise = noise
        self._seen: deque[tuple[float, Sequence[float]]] = deque(maxlen=REMEMBERED)

    def see(self, centre: Sequence[float], time: float) -> None:
        """Take a position (3,) [m] at a time [s] that is not before the last."""
        if not self._seen or time >= self._seen[-1][0] + INTERVAL - 1e-6:
            self._seen.append((time, tuple(centre)))

    def error(self, velocity: Sequence[float]) -> float:
        """How far the present velocity (3,) [m/s] may be off soon [m/s]."""
        if len(self._seen) <= _AVERAGED:
            return 0.0
        times, places = np.array([time for time, _ in self._seen]), np.array([place for _, place in self._seen])
        means = (places[_AVERAGED:] - places[:-_AVERAGED]) / (times[_AVERAGED:] - times[:-_AVERAGED])[:, None]
        change = float(np.max(np.linalg.norm(means - velocity, axis=1)))
        return min(CHANGE_FACTOR * max(0.0, change - self._noise), float(np.linalg.norm(velocity)))
