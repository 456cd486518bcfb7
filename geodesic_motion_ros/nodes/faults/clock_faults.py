"""Faults of the clock that the nodes run by: it jumps, pauses, and runs at another speed."""

from __future__ import annotations

import math
import time
from types import MappingProxyType

import numpy as np

from geodesic_motion_ros.joint_limits import JointLimits
from geodesic_motion_ros.nodes.faults.bench import Bench
from geodesic_motion_ros.nodes.faults.fault import START, Fault, Findings

#: How far the clock jumps, how long it is watched then, and how long it pauses [s].
_JUMP, _WATCHED, _PAUSE = 5.0, 1.0, 1.0
#: An arm that stands has moved by no more than this [rad]; it comes to rest so long after the clock has [s].
_STILL, _SETTLING = 0.02, 0.3
#: Joint speeds are told by positions so far apart [s], and are known to this share.
_APART, _KNOWN_TO = 0.05, 1.15


class ClockFault(Fault):
    """Nodes that run by a clock of the bench."""

    planner = MappingProxyType({"use_sim_time": True})

    def require_consistent(self, bench: Bench, findings: Findings, since: float, speed: float = 1.0) -> None:
        """Durations are numbers wherever there is a way, and the joints keep their speed limits [clock's seconds]."""
        after = [status for status in bench.statuses if status.sent > since]
        nan = sum(status.code == "OK" and math.isnan(status.number("time_to_goal")) for status in after)
        findings.require(not nan, f"{nan} times OK without a duration")
        fastest = _fastest(bench, since) / speed
        findings.note(f"fastest joint at {fastest:.2f} of its limit")
        findings.require(fastest <= _KNOWN_TO, f"a joint was {fastest:.2f} times as fast as it may be")


class ClockJumpsForward(ClockFault):
    name = "clock_jumps_forward"
    criterion = "the clock jumps 5 s ahead: no NaN durations, joints keep their limits, the goal is reached"
    jump = _JUMP

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        since = time.monotonic()
        bench.clock.jump(self.jump)
        if phase == START:
            bench.send_goal()
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
        before = bench.configuration
        bench.spend(_PAUSE - _SETTLING)
        moved = float(np.max(np.abs(bench.configuration - before)))
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
        since = time.monotonic() + _SETTLING
        if phase == START:
            bench.send_goal()
            bench.verdict("OK")
        bench.arrive()
        findings.note(f"goal reached {time.monotonic() - since:.1f} s after")
        self.require_consistent(bench, findings, since, 0.5)


def _fastest(bench: Bench, since: float) -> float:
    """Largest share of its speed limit that a joint has had, by the steady clock."""
    moments = np.array([moment for moment, _ in bench.joints])
    positions = np.array([configuration for _, configuration in bench.joints])
    limits = JointLimits.of(bench.robot).velocity
    fastest = 0.0
    for i in np.flatnonzero(moments > since + _APART):
        j = int(np.searchsorted(moments, moments[i] - _APART))
        if moments[i] - moments[j] > 0.5 * _APART:
            speeds = np.abs(positions[i] - positions[j]) / (moments[i] - moments[j])
            fastest = max(fastest, float(np.max(speeds / limits)))
    return fastest


CLOCK_FAULTS = (ClockJumpsForward, ClockJumpsBack, ClockPauses, ClockRunsSlowly)
