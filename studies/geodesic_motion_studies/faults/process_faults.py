"""Faults of the processes: nodes are killed, stopped, starved, and come back."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from geodesic_motion_ros.nodes.parameter_tables import PLANNER, TWIN
from geodesic_motion_studies.faults.bench import START_PATIENCE, Bench
from geodesic_motion_studies.faults.fault import MOTION, START, STATE_TIMEOUT, Fault, Findings
from geodesic_motion_studies.faults.obstacle_faults import require_no_contact
from geodesic_motion_studies.faults.state_faults import REACTION, STOP

_COMMAND_TIMEOUT = next(parameter.default for parameter in TWIN if parameter.name == "command_timeout")
_HORIZON = next(parameter.default for parameter in PLANNER if parameter.name == "horizon")
_RATE = next(parameter.default for parameter in PLANNER if parameter.name == "rate")
#: Graphs of nodes are looked at once a second.
_CONFLICT = 2.5
#: Length of a stop [s]; more ticks than this in a row at once are a burst, in a time that normally holds one.
_STOPPED, _BURST = 1.0, 3
#: A busy process has begun to work after so long [s].
_BUSY = 0.5
#: What it does, with the priority of any other process.
_WORK = """
import os
os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
os.setpriority(os.PRIO_PROCESS, 0, 0)
while True:
    sum(range(100_000))
"""
#: A guest is given so long [s], its share of the start of their process included.
PATIENCE_WITH_GUESTS = 5.0
#: Participants one after the other, each with a node that listens to the planner and the twin for a while.
_GUESTS = """
import sys, time
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
for number in range(int(sys.argv[1])):
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(f"guest_{number}", context=context)
    for kind, topic in ((JointState, "joint_states"), (DiagnosticArray, "planner/status")):
        node.create_subscription(kind, topic, lambda message: None, 10)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    end = time.monotonic() + 0.3
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)
"""


class PlannerKilled(Fault):
    name = "planner_killed"
    criterion = (
        "SIGKILL of the planner: the twin rests within the planner's horizon (of a stream of poses: command_timeout) "
        "and a stop; a new planner begins where the arm is"
    )

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        bench.processes.end("planner", signal.SIGKILL)
        bench.spend(0.1)
        allowed = (_COMMAND_TIMEOUT if bench.commands.topic == "target_pose" else _HORIZON) + STOP
        rested = 0.1 + bench.wait(lambda: bench.seen.rests, "the twin's rest")
        findings.at_most("twin at rest after", rested, allowed)
        bench.judge(findings)
        killed = time.monotonic()
        bench.restart("planner")
        bench.commands.begin_anew()
        bench.verdict("NO_GOAL", "", killed, START_PATIENCE)
        bench.finish(findings)


class TwinKilled(Fault):
    name = "twin_killed"
    criterion = "SIGKILL of the twin: STALE_STATE <= 100 ms after state_timeout; goes on only after fresh states"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        bench.processes.end("twin", signal.SIGKILL)
        since = bench.seen.states[-1].arrived + STATE_TIMEOUT
        status = bench.verdict("STALE_STATE", "joint_states", since)
        findings.at_most("STALE_STATE after", 1000.0 * (status.sent - since), 1000.0 * REACTION, "ms")
        bench.spend(STOP)
        killed = time.monotonic()
        bench.restart("twin")
        bench.wait(lambda: bench.seen.states[-1].arrived > killed, "the twin", START_PATIENCE)
        fresh = bench.seen.states[-1].arrived
        early = {status.code for status in bench.seen.statuses if killed < status.sent < fresh} - {"STALE_STATE"}
        findings.require(not early, f"without an arm the planner said {', '.join(sorted(early))}")
        # It stands at its start again, and is not where it was sent: the goal is to be sent again.
        bench.verdict("NO_GOAL", "", killed)
        bench.finish(findings)


class PlannerStopped(Fault):
    name = "planner_stopped"
    criterion = "SIGSTOP of the planner for 1 s: no burst of ticks, misses counted, nothing with an old stamp"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        misses = bench.seen.status.number("deadline_misses")
        bench.processes.send("planner", signal.SIGSTOP)
        bench.spend(_STOPPED)
        resumed = time.monotonic()
        bench.processes.send("planner", signal.SIGCONT)
        bench.wait(lambda: bench.seen.status.sent > resumed + 0.5, "the planner")
        sent = np.array([status.sent for status in bench.seen.since(resumed)])
        most = max(int(np.sum((sent >= moment) & (sent < moment + 1.0 / _RATE))) for moment in sent)
        findings.at_most("ticks in a period", most, _BURST, "")
        missed = bench.seen.status.number("deadline_misses") - misses
        findings.note(f"{missed:.0f} misses")
        findings.require(missed >= 0.9 * _STOPPED * _RATE, f"only {missed:.0f} misses were counted")
        bench.finish(findings)


class CoresLoaded(Fault):
    name = "cores_loaded"
    criterion = "two busy processes on each core: >= 95 ticks a second or DEGRADED said, misses counted, no contact"
    phases = (START, MOTION)

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        with _busy_cores(2):
            bench.spend(_BUSY)
            bench.set_out(phase)
            since, before = bench.seen.status, len(bench.seen.health)
            bench.spend(3.0)
            now = bench.seen.status
            rate = (now.number("tick") - since.number("tick")) / (now.sent - since.sent)
            misses = now.number("deadline_misses") - since.number("deadline_misses")
            # How the loop has been doing until now is published within a second.
            heard = len(bench.seen.health)
            bench.wait(lambda: len(bench.seen.health) > heard, "the loop's health")
            degraded = any("DEGRADED" in text for text in bench.seen.health[before:])
            findings.note(f"{rate:.1f} ticks a second, {misses:.0f} misses{', DEGRADED said' if degraded else ''}")
            findings.require(rate >= 0.95 * _RATE or degraded, f"{rate:.1f} ticks a second and nothing was said")
            findings.require(misses > 0 or rate > 0.99 * _RATE, "no misses were counted")
        require_no_contact(bench, findings)
        bench.finish(findings)


class SecondCommander(Fault):
    name = "second_commander"
    criterion = "a second publisher on the topic of the commands: CONFLICT, both named, stop"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        since = time.monotonic()
        rival = bench.node.create_publisher(bench.commands.kind, bench.commands.topic, 1)
        status = bench.verdict("CONFLICT", bench.node.get_name(), since)
        findings.at_most("CONFLICT after", status.sent - since, _CONFLICT)
        findings.at_most("at rest after", bench.rest(), STOP)
        bench.node.destroy_publisher(rival)
        bench.verdict("NO_GOAL")
        bench.finish(findings)


class ParticipantsJoin(Fault):
    """Attributes: guests, how many join; most, the longest time [s] between two ticks."""

    name = "participants_join"
    criterion = "50 participants join and leave, one after the other: no STALE_STATE, at most 60 ms between two ticks"
    phases = (START, MOTION)
    guests, most = 50, 0.060

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        bench.set_out(phase)
        since = time.monotonic()
        guests = subprocess.Popen([sys.executable, "-c", _GUESTS, str(self.guests)], env=bench.environment)
        try:
            bench.wait(lambda: guests.poll() is not None, "the guests to leave", PATIENCE_WITH_GUESTS * self.guests)
        finally:
            guests.kill()
            guests.wait()
        findings.require(guests.returncode == 0, f"the guests ended with exit code {guests.returncode}")
        seen = bench.seen.since(since)
        gaps = np.diff([status.sent for status in seen])
        findings.at_most("between two ticks", 1000.0 * float(np.max(gaps)), 1000.0 * self.most, "ms")
        stale = sum(status.code == "STALE_STATE" for status in seen)
        findings.at_most("ticks with STALE_STATE", stale, 0, "")
        bench.finish(findings)


@contextmanager
def _busy_cores(each: int) -> Iterator[None]:
    """So many processes on each core that do nothing but work, no more important than others."""
    workers = []
    try:
        for _ in range(each * len(os.sched_getaffinity(0))):
            # In a session of its own, which is no group of processes that go first; without libraries, whose loading
            # would go first as well.
            workers.append(subprocess.Popen([sys.executable, "-I", "-S", "-c", _WORK], start_new_session=True))
        yield
    finally:
        for worker in workers:
            worker.kill()
            worker.wait()


PROCESS_FAULTS = (PlannerKilled, TwinKilled, PlannerStopped, CoresLoaded, SecondCommander, ParticipantsJoin)
