"""The same ticks with a deadline: what is answered by then, and how good that is.

The deadline is of processor time, so that other work on the machine does not change what is found.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.utils.deadline import Deadline
from geodesic_motion_studies.benchmarks.engine import SearchProblem, mark, search
from geodesic_motion_studies.benchmarks.scenes import Scene
from geodesic_motion_studies.benchmarks.stopwatch import no_garbage_collection

DEADLINE_MS = 10.0
"""A tick that takes no longer than this counts as answered in time."""
#: The search gets a deadline so much sooner [s]: it reads the clock now and then.
_ALLOWANCE = 1.5e-3


@dataclass(frozen=True)
class HurriedTicks:
    """Ticks of one scene.

    Attributes
    ----------
    cpu : [s] of every tick.
    gaps : of every tick with a path, how much more it may cost than the cheapest one at most, as a share of that.
    found, refused : share of the ticks that found a path; that proved that there is none below the limit.
    """

    cpu: list[float]
    gaps: list[float]
    found: float
    refused: float

    @property
    def in_time(self) -> float:
        """Share of the ticks within the deadline."""
        return float(np.mean(np.array(self.cpu) <= 1e-3 * DEADLINE_MS))

    @property
    def undecided(self) -> float:
        """Share of the ticks with neither a path nor that proof: the planner keeps its path, or stops."""
        return 1.0 - self.found - self.refused

    @property
    def gap(self) -> float:
        """The largest; nan without a path."""
        return max(self.gaps, default=math.nan)

    @classmethod
    def of(cls, problem: SearchProblem, scene: Scene, ticks: int) -> HurriedTicks:
        """Run so many ticks."""
        cpu, gaps, refused = [], [], 0
        with no_garbage_collection():
            for tick in range(ticks):
                obstacles = scene.at(tick)
                begin = time.thread_time()
                deadline = Deadline(begin + 1e-3 * DEADLINE_MS - _ALLOWANCE, time.thread_time)
                answer = search(problem, mark(problem, obstacles), deadline=deadline)
                cpu.append(time.thread_time() - begin)
                if math.isfinite(answer.cost):
                    gaps.append(max(0.0, answer.cost / answer.bound - 1.0))
                else:
                    refused += answer.bound >= problem.cost_limit
        return cls(cpu, gaps, len(gaps) / ticks, refused / ticks)
