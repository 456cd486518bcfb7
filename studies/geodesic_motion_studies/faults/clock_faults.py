"""Faults of the clock that the nodes run by: it jumps, pauses, and runs at another speed."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import START, Fault, Findings
from geodesic_motion_studies.faults.record import ArmState

#: How far the clock jumps, how long it is watched then, and how long it pauses [s].
_JUMP, _WATCHED, _PAUSE = 5.0, 1.0, 1.0
#: An arm that stands has moved by no more than this [rad]; it comes to rest so long after the clock has [s].
_STILL, _SETTLING = 0.02, 0.3
#: Joint speeds are computed from positions so far apart [s], and are known to this share.
_APART, _KNOWN_TO = 0.05, 1.15
#: Two states whose stamps differ by more [s] are of a clock before a jump and of one after it.
_JUMPED = 1.0


class ClockFault(Fault):
    """Nodes that run by a clock of the bench."""

    planner = MappingProxyType({"use_sim_time": True})

    def require_consistent(self, bench: Bench, findings: Findings, since: float) -> None:
        """Durations are numbers wherever there is a path, and the joints keep their speed limits by the clock."""
        after = bench.seen.since(since)
        nan = sum(status.code == "OK" and math.isnan(status.number("time_to_goal")) for status in after)
        findings.require(not nan, f"{nan} times OK without a duration")
        states = [state for state in bench.seen.states if state.arrived > since]
        findings.at_most("fastest joint", fastest(states, bench.commands.limits.velocity), _KNOWN_TO, "of its limit")


class ClockJumpsForward(ClockFault):
    name = "clock_jumps_forward"
    criterion = "the clock jumps 5 s ahead: no NaN durations, joints keep their limits, the goal is reached"
    jump = _JUMP

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        since = time.monotonic()
        bench.clock.jump(self.jump)
        if phase == START:
            bench.asks.send_goal()
        bench.spend(_WATCHED)
        self.require_consistent(bench, findings, since)
        bench.finish(findings)


class ClockJumpsBack(ClockJumpsForward):
    name = "clock_jumps_back"
    criterion = "the clock jumps 5 s back: no NaN durations, joints keep their limits, the goal is reached"
    jump = -_JUMP


class ClockPauses(ClockFault):
    name = "clock_pauses"
    criterion = "the clock stands for 1 s: the arm stands too, and goes on with the clock"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        since = time.monotonic()
        bench.clock.set_speed(0.0)
        bench.spend(_SETTLING)
        before = bench.seen.configuration
        bench.spend(_PAUSE - _SETTLING)
        moved = float(np.max(np.abs(bench.seen.configuration - before)))
        findings.at_most("moved while it stood", moved, _STILL, "rad")
        bench.clock.set_speed(1.0)
        bench.spend(_WATCHED)
        self.require_consistent(bench, findings, since)
        bench.finish(findings)


class ClockRunsSlowly(ClockFault):
    name = "clock_half_speed"
    criterion = "the clock runs at half speed: joints keep their limits by the clock, the goal is reached"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        bench.clock.set_speed(0.5)
        since = time.monotonic()
        bench.set_out(phase)
        bench.arrive()
        findings.note(f"goal reached {time.monotonic() - since:.1f} s after")
        self.require_consistent(bench, findings, since)


def fastest(states: Sequence[ArmState], limits: np.ndarray) -> float:
    """Largest share of its speed limit (eta,) [rad/s] that a joint has had, by the stamps of states."""
    return max((_speed(states[: number + 1], limits) for number in range(len(states))), default=0.0)


def _speed(states: Sequence[ArmState], limits: np.ndarray) -> float:
    """The same at the last of the states; 0 where the clock has not run long enough since it was set."""
    newest = states[-1]
    for state in reversed(states):
        passed = newest.stamp - state.stamp
        if not 0.0 <= passed < _JUMPED:
            break
        if passed >= _APART:
            return float(np.max(np.abs(newest.configuration - state.configuration) / passed / limits))
    return 0.0


CLOCK_FAULTS = (ClockJumpsForward, ClockJumpsBack, ClockPauses, ClockRunsSlowly)
