"""Faults of the messages about obstacles: lost, overtaking each other, seldom, late, or with wrong stamps."""

from __future__ import annotations

import time
from abc import abstractmethod
from typing import Any

import numpy as np
from visualization_msgs.msg import MarkerArray

from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import GOAL, MOTION, Fault, Findings
from geodesic_motion_studies.faults.obstacle_faults import (
    AHEAD,
    coming_to,
    outwards,
    require_no_contact,
    set_out_beside_an_obstacle,
)
from geodesic_motion_studies.faults.relay import Relay
from geodesic_motion_studies.faults.state_faults import require_hold

#: Time between messages of a slow detector [s], and how long ago a late one saw what it tells of [s].
_SLOW, _LATE = 0.2, 2.0
#: One stamp of so many is so far in the future [s]; after so long the sender's clock is set back by so much [s].
_WRONG, _FUTURE, _RIGHT_FOR, _SET_BACK = 10, 0.95, 1.0, 0.4


def _later(message: MarkerArray, by: float) -> MarkerArray:
    """A message with stamps that are so much later [s]."""
    for marker in message.markers:
        stamp = marker.header.stamp
        whole, parts = divmod(stamp.sec * 10**9 + stamp.nanosec + round(1e9 * by), 10**9)
        stamp.sec, stamp.nanosec = int(whole), int(parts)
    return message


class ObstaclesLag(Fault):
    name = "obstacles_lag"
    criterion = "an obstacle topic goes on, with stamps 2 s old: STALE_OBSTACLES, named, <= 100 ms, stop; resumes"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        relay = set_out_beside_an_obstacle(bench, phase)
        relay.change, since = lambda message: [_later(message, -_LATE)], time.monotonic()
        require_hold(bench, findings, "STALE_OBSTACLES", "stamps lag: obstacles", since)
        relay.release()
        bench.finish(findings)


class _PublishedBadly(Fault):
    """A sphere comes to the path and stops there, or beside the goal, and is published badly."""

    @abstractmethod
    def spoil(self, relay: Relay, random: np.random.Generator) -> None:
        """Begin to publish badly."""

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        relay = bench.relays["obstacles"]
        bench.relays["obstacle_point"].passing = False
        self.spoil(relay, random)
        bench.set_out(phase)
        # Near the goal it stays beside it: what runs into an arm that stands is not evaded.
        place = bench.seen.ahead(AHEAD) if phase != GOAL else bench.goal[:3] + 0.25 * outwards(bench.goal[:3])
        bench.asks.show_scene(coming_to(place))
        bench.spend(3.0)
        findings.note(f"smallest clearance {1000.0 * bench.seen.least_clearance:.0f} mm")
        require_no_contact(bench, findings)
        relay.release()
        bench.asks.show_scene({})
        bench.finish(findings)


class ObstaclesLossy(_PublishedBadly):
    name = "obstacles_lossy"
    criterion = "30 % of obstacle messages lost, others overtaking each other: no contact with a sphere that comes"

    def spoil(self, relay: Relay, random: np.random.Generator) -> None:
        relay.delay = lambda: float(random.uniform(0.0, 0.06))
        relay.overtaking = True
        relay.change = lambda message: [message] if random.uniform() > 0.3 else []


class ObstaclesSlow(_PublishedBadly):
    name = "obstacles_five_a_second"
    criterion = (
        "obstacles are published five times a second alone: no contact with a sphere that comes to the path and stops"
    )
    phases = (MOTION,)

    def spoil(self, relay: Relay, random: np.random.Generator) -> None:
        last = -np.inf

        def thinned(message: Any) -> list[Any]:
            nonlocal last
            now = time.monotonic()
            if now < last + _SLOW:
                return []
            last = now
            return [message]

        relay.change = thinned


class ObstaclesMisstamped(_PublishedBadly):
    name = "obstacles_misstamped"
    criterion = (
        "one stamp of ten is 0.95 s ahead, then the sender's clock is 0.4 s behind: no contact with a sphere that comes"
    )
    phases = (MOTION,)

    def spoil(self, relay: Relay, random: np.random.Generator) -> None:
        begin, count = time.monotonic(), 0

        def misstamped(message: MarkerArray) -> list[MarkerArray]:
            nonlocal count
            count += 1
            late = -_SET_BACK if time.monotonic() > begin + _RIGHT_FOR else 0.0
            return [_later(message, late if count % _WRONG else late + _FUTURE)]

        relay.change = misstamped


MESSAGE_FAULTS = (ObstaclesLag, ObstaclesLossy, ObstaclesSlow, ObstaclesMisstamped)
