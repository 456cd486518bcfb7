"""Faults of `joint_states`: what the planner knows of the arm stops, is late, is spoiled."""

from __future__ import annotations

import time
from collections.abc import Iterable
from itertools import cycle

import numpy as np
from sensor_msgs.msg import JointState

from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import START, STATE_TIMEOUT, Fault, Findings
from geodesic_motion_studies.faults.record import Status

#: A hold comes this long [s] after an input has exceeded its timeout, and the arm rests this long after at most.
REACTION, STOP = 0.1, 1.0
#: How far off a joint state is that is wrong once [rad].
_GLITCH = 0.5


def require_hold(bench: Bench, findings: Findings, code: str, text: str, since: float) -> None:
    """The verdict is said within the reaction time after `since` [s, steady clock], and the commands come to rest."""
    status = bench.verdict(code, text, since)
    findings.at_most(f"{code} after", 1000.0 * (status.sent - since), 1000.0 * REACTION, "ms")
    findings.at_most("at rest after", bench.rest(), STOP)


def require_undisturbed(bench: Bench, findings: Findings, phase: str, since: float) -> None:
    """Nothing but OK is said from `since` on, or that there is no goal, until the goal is reached."""
    bench.set_out(phase)
    if phase == START:
        since = time.monotonic()
    bench.arrive()
    require_only_ok(findings, bench.seen.since(since))
    findings.note("goal reached")


def require_only_ok(findings: Findings, statuses: list[Status]) -> None:
    """Every status is OK."""
    others = [status for status in statuses if status.code != "OK"]
    if others:
        said = f"{others[0].code}: {others[0].reason}"
        findings.require(False, f"{len(others)} of {len(statuses)} statuses were not OK, the first {said}")


def require_refused(bench: Bench, findings: Findings, topic: str, at_least: int, before: int, text: str = "") -> None:
    """Messages on a topic are refused and counted, and the newest reason holds a text."""
    bench.wait(lambda: refused(bench, topic) >= before + at_least, f"{at_least} messages of {topic} refused")
    findings.note(f"{refused(bench, topic) - before} refused")
    said = bench.seen.status.values["refused_input"]
    findings.require(text in said, f"the reason {said!r} does not name {text!r}")


def refused(bench: Bench, topic: str) -> int:
    """How many messages of a topic the planner has refused so far."""
    return int(bench.seen.status.values.get(f"refused_{topic}", 0))


class StateStops(Fault):
    name = "state_stops"
    criterion = "STALE_STATE <= 100 ms after state_timeout, stop; resumes when joint_states are back"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        relay = bench.relays["joint_states"]
        relay.passing = False
        require_hold(bench, findings, "STALE_STATE", "joint_states", relay.last_passed + STATE_TIMEOUT)
        relay.release()
        bench.finish(findings)


class StateLate(Fault):
    name = "state_late_200"
    criterion = "joint_states 200 ms late: STALE_STATE <= 100 ms after state_timeout, stop; resumes"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        relay = bench.relays["joint_states"]
        relay.delay = lambda: 0.2
        require_hold(bench, findings, "STALE_STATE", "joint_states", relay.last_passed + STATE_TIMEOUT)
        # Late messages arrive by now, and must not be taken for new ones.
        since = time.monotonic() + 0.2
        bench.wait(lambda: bench.seen.status.sent > since + 0.2, "late messages")
        codes = {status.code for status in bench.seen.since(since)}
        findings.require(codes == {"STALE_STATE"}, f"with late messages the planner said {', '.join(sorted(codes))}")
        relay.release()
        bench.finish(findings)


class StateLittleLate(Fault):
    name = "state_late_50"
    criterion = "joint_states 50 ms late: motion goes on to the goal"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        since = time.monotonic()
        bench.relays["joint_states"].delay = lambda: 0.05
        require_undisturbed(bench, findings, phase, since)


class StateJitter(Fault):
    name = "state_jitter"
    criterion = "joint_states 0 to 50 ms late by chance: motion goes on to the goal"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        since = time.monotonic()
        bench.relays["joint_states"].delay = lambda: float(random.uniform(0.0, 0.05))
        require_undisturbed(bench, findings, phase, since)


class StateReordered(Fault):
    name = "state_reordered"
    criterion = "joints in any order, and fingers among them: no effect"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        def shuffled(message: JointState) -> Iterable[JointState]:
            names = [*message.name, "panda_finger_joint1", "panda_finger_joint2"]
            positions, velocities = [*message.position, 0.02, 0.02], [*message.velocity, 0.0, 0.0]
            order = random.permutation(len(names))
            message.name = [names[i] for i in order]
            message.position, message.velocity = [positions[i] for i in order], [velocities[i] for i in order]
            return [message]

        since = time.monotonic()
        bench.relays["joint_states"].change = shuffled
        require_undisturbed(bench, findings, phase, since)


class StateLacksJoint(Fault):
    name = "state_lacks_joint"
    criterion = "a joint is missing: STALE_STATE <= 100 ms after state_timeout, the joint named, stop; resumes"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        lost = int(random.integers(len(bench.robot.joint_names)))

        def lacking(message: JointState) -> Iterable[JointState]:
            for values in (message.name, message.position, message.velocity):
                del values[lost]
            return [message]

        relay = bench.relays["joint_states"]
        since = relay.last_passed + STATE_TIMEOUT
        relay.change = lacking
        # The others may come in other messages.
        require_hold(bench, findings, "STALE_STATE", bench.robot.joint_names[lost], since)
        relay.release()
        bench.finish(findings)


class StateNotFinite(Fault):
    name = "state_not_finite"
    criterion = "NaN, Inf, 1e300 among the joint states: dropped, counted, motion unchanged"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        spoils = cycle([float("nan"), float("inf"), 1e300, -float("inf")])

        def spoiled(message: JointState) -> Iterable[JointState]:
            bad = JointState(header=message.header, name=message.name, position=list(message.position))
            bad.position[int(random.integers(len(bad.position)))] = next(spoils)
            return [message, bad]

        relay, before, since = bench.relays["joint_states"], refused(bench, "joint_states"), time.monotonic()
        relay.change = spoiled
        require_refused(bench, findings, "joint_states", 20, before, "joint_states")
        require_undisturbed(bench, findings, phase, since)
        relay.release()


class StateGlitch(Fault):
    name = "state_glitch"
    criterion = "one joint state among good ones is 0.5 rad off: no command begins where the arm never was"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        joint, changed = int(random.integers(len(bench.robot.joint_names))), []

        def wrong_once(message: JointState) -> Iterable[JointState]:
            if not changed:
                centre = 0.5 * (bench.robot.lower[joint] + bench.robot.upper[joint])
                message.position[joint] += _GLITCH if message.position[joint] < centre else -_GLITCH
                changed.append(message)
            return [message]

        relay = bench.relays["joint_states"]
        relay.change = wrong_once
        bench.wait(lambda: changed, "a joint state")
        bench.spend(0.3)
        relay.release()
        bench.finish(findings)


STATE_FAULTS = (
    StateStops, StateLate, StateLittleLate, StateJitter, StateReordered, StateLacksJoint, StateNotFinite, StateGlitch,
)  # fmt: skip
