"""Faults of what is offered to a filter: trajectories that are none, and a stream of chunks that falls silent."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from geodesic_motion_ros.trajectory.trajectory import JointReference
from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import FILTER_ALONE, MOTION, Fault, Findings
from geodesic_motion_studies.faults.goal_faults import require_unchanged
from geodesic_motion_studies.faults.offering import Offering
from geodesic_motion_studies.faults.state_faults import STOP

#: A stamp of another clock is so old [s].
_OLD = 5.0
#: Chunks: how many a second, and how much of the motion each holds [s].
_CHUNKS_HZ, _CHUNK = 10.0, 0.5


class OffersRefused(Fault):
    """Trajectories that are none, each in a message of its own."""

    subjects = FILTER_ALONE
    text: str

    def spoiled(self, motion: JointReference, random: np.random.Generator) -> list[tuple[JointReference, float]]:
        """What is offered in the place of a motion, with how old its stamp is [s]; 0: none, at once."""
        raise NotImplementedError

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        assert isinstance(bench.asks, Offering)
        motion = bench.asks.newest or bench.asks.motion()
        since = time.monotonic()
        for spoiled, age in self.spoiled(motion, random):
            sent = time.monotonic()
            now = 1e-9 * bench.node.get_clock().now().nanoseconds
            bench.asks.offer(spoiled, now - age if age else 0.0)
            said = bench.verdict("BAD_INPUT", self.text, sent, of="goal_")
            findings.note(said.values["goal_reason"])
        require_unchanged(bench, findings, phase, since)
        bench.finish(findings)


class OfferNotFinite(OffersRefused):
    name = "offer_not_finite"
    criterion = "NaN, Inf in a trajectory: refused, point and joint named, reference unchanged"
    text = "of 'panda_joint"

    def spoiled(self, motion: JointReference, random: np.random.Generator) -> list[tuple[JointReference, float]]:
        offers = []
        for value in (float("nan"), float("inf"), -float("inf")):
            positions = motion.positions.copy()
            positions[random.integers(len(positions)), random.integers(positions.shape[1])] = value
            offers.append((replace(motion, positions=positions), 0.0))
        return offers


class OfferJumps(OffersRefused):
    name = "offer_jumps"
    criterion = "a trajectory begins 0.5 rad from the arm, or jumps within: refused as a jump, reference unchanged"
    text = "a jump"

    def spoiled(self, motion: JointReference, random: np.random.Generator) -> list[tuple[JointReference, float]]:
        elsewhere, within = motion.positions.copy(), motion.positions.copy()
        elsewhere[:, 0] += 0.5
        within[len(within) // 2 :, 0] += 0.5
        return [(replace(motion, positions=positions), 0.0) for positions in (elsewhere, within)]


class OfferBeyondLimits(OffersRefused):
    name = "offer_beyond_limits"
    criterion = "a trajectory leaves the limits of a joint: refused, the joint and its limit named, reference unchanged"
    text = "beyond its limit"

    def spoiled(self, motion: JointReference, random: np.random.Generator) -> list[tuple[JointReference, float]]:
        positions = motion.positions.copy()
        positions[-1, int(random.integers(positions.shape[1]))] = 4.0
        return [(replace(motion, positions=positions), 0.0)]


class OfferOld(OffersRefused):
    name = "offer_old"
    criterion = "a trajectory whose stamp is so old that it is over: refused with how long, reference unchanged"
    text = "was over"

    def spoiled(self, motion: JointReference, random: np.random.Generator) -> list[tuple[JointReference, float]]:
        return [(motion, motion.duration + _OLD)]


class ChunksFallSilent(Fault):
    name = "chunks_silent"
    criterion = "a stream of chunks falls silent in motion: the arm rests within the last chunk and a stop; resumes"
    subjects, phases = FILTER_ALONE, (MOTION,)

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        assert isinstance(bench.asks, Offering)
        # The arm is on this motion.
        motion = bench.asks.motion()
        held, sent = round(1.0 / _CHUNKS_HZ, 3), time.monotonic()
        for _ in range(8):
            passed = time.monotonic() - sent
            inside = (motion.times >= passed) & (motion.times <= passed + _CHUNK)
            if np.count_nonzero(inside) < 2:
                break
            rows = {name: getattr(motion, name)[inside] for name in ("positions", "velocities", "accelerations")}
            latent = motion.latent[inside]
            bench.asks.offer(replace(motion, times=motion.times[inside] - passed, latent=latent, **rows))
            bench.spend(held)
        bench.verdict("OK", "", sent)
        findings.at_most("at rest after", bench.rest(), _CHUNK + STOP)
        bench.finish(findings)


OFFER_FAULTS = (OfferNotFinite, OfferJumps, OfferBeyondLimits, OfferOld, ChunksFallSilent)
