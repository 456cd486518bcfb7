"""The moment from which on a tick begins nothing new."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Deadline:
    """A time [s] of a clock. What has been begun before is ended: the caller allows for that."""

    at: float = math.inf
    clock: Callable[[], float] = time.monotonic

    @property
    def passed(self) -> bool:
        return self.clock() > self.at

    @property
    def halfway(self) -> Deadline:
        """After half of the time that is left until this one."""
        return Deadline(0.5 * (self.clock() + self.at), self.clock)


NEVER = Deadline()
