"""Faults that take minutes: floods of goals and of nonsense, many lives, and a long day."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from typing import Any

import numpy as np

from geodesic_motion_studies.faults.bench import RELAYED, Bench
from geodesic_motion_studies.faults.fault import (
    MOTION,
    PLANNER_ALONE,
    START,
    Fault,
    FaultSkipped,
    Findings,
    NotSeenError,
)
from geodesic_motion_studies.faults.fuzz import INPUTS, Fuzzer
from geodesic_motion_studies.faults.obstacle_faults import coming_to
from geodesic_motion_studies.faults.state_faults import refused

#: New goals a second, for how long [s], on a circle so large [m]; memory may grow by so much [MB].
_GOALS_HZ, _FLOOD, _CIRCLE, _FLOOD_MEMORY = 10.0, 60.0, 0.01, 5.0
#: What is kept of goals is there after so long [s]; then memory is looked at the first time.
_SETTLING = 60.0
#: Messages of each input, so many at once; a status comes within this [s].
_MESSAGES, _AT_ONCE, _ANSWER = 10_000, 10, 5.0
#: A life may take so long [s]; so may a motion on two hosts, its nodes' start included.
_LIVES, _LIVES_MEMORY, _LIFE, _JOINED = 100, 20.0, 60.0, 150.0
_SOAK_MEMORY, _DRIFT = 50.0, 0.10
#: The soak's sphere comes to a place so far ahead on the tool's path [m].
_AHEAD = 0.30


class GoalsFlood(Fault):
    subjects = PLANNER_ALONE
    name = "goals_10_hz"
    criterion = "goals at 10 Hz: every command as promised; after 60 s, memory grows by less than 5 MB in 60 s"
    phases = (MOTION,)
    long = True

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        before, began, sent = math.nan, time.monotonic(), 0
        while (passed := time.monotonic() - began) < _SETTLING + _FLOOD:
            angle = 2.4 * sent
            goal = bench.goal.copy()
            goal[:3] += _CIRCLE * np.array([math.cos(angle), math.sin(angle), 0.0])
            bench.asks.send_goal(goal)
            sent += 1
            bench.spend(max(0.0, sent / _GOALS_HZ - passed))
            if math.isnan(before) and passed >= _SETTLING:
                before = bench.memory("planner")
        findings.at_most("memory grown by", bench.memory("planner") - before, _FLOOD_MEMORY, "MB")
        findings.note(f"{sent} goals")
        bench.asks.send_goal()
        bench.finish(findings)


class FuzzedMessages(Fault):
    subjects = PLANNER_ALONE
    name = "fuzzed_messages"
    criterion = "10,000 messages of nonsense on each input: no exception escapes, the status still answers"
    phases = (MOTION,)
    long = True
    fresh = True
    messages = _MESSAGES

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        fuzzer = Fuzzer(random)
        for topic, make in INPUTS.items():
            target = f"relayed/{topic}" if topic in RELAYED else topic
            for _ in range(self.messages // _AT_ONCE):
                for _ in range(_AT_ONCE):
                    bench.asks.publish(target, make(fuzzer))
                bench.spend(0.005)
            since = time.monotonic()
            bench.wait(lambda since=since: bench.seen.status.sent > since, f"a status after {topic}", _ANSWER)
        findings.note(f"{sum(refused(bench, topic) for topic in INPUTS)} refused")
        said = bench.processes.log("planner")
        findings.require("Traceback" not in said, "the planner's log has a traceback")
        findings.require("internal error" not in said, "the planner's log has an internal error")


class ManyLives(Fault):
    subjects = PLANNER_ALONE
    name = "created_100_times"
    criterion = "nodes created and destroyed 100 times in a process: no more threads or descriptors, less than 20 MB"
    phases = (START,)
    long = True
    lives = _LIVES

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        leaked = _answer(bench, "many_lives", bench.skill_name, str(self.lives), patience=self.lives * _LIFE)
        for name in ("threads", "descriptors"):
            findings.at_most(f"{name} more:", leaked[name], 0.0, "")
        findings.at_most("memory grown by", leaked["memory"], _LIVES_MEMORY, "MB")


class Soak(Fault):
    """Attributes: minutes, how long it takes."""

    subjects = PLANNER_ALONE
    name = "soak"
    criterion = "moving spheres and changing goals: no contact, p99 drifts < 10 %, memory grows < 50 MB"
    phases = (START,)
    long = True
    minutes = 30.0

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        end = time.monotonic() + 60.0 * self.minutes
        ticks: list[list[float]] = []
        contacts, grown, begun, restarts = 0, 0.0, math.nan, len(bench.restarts)
        while time.monotonic() < end:
            self._episode(bench, random)
            ticks.append([status.number("last_tick_ms") for status in bench.seen.statuses])
            contacts += bench.seen.contacts
            bench.judge(findings)
            begun = bench.memory("planner") if math.isnan(begun) else begun
            grown = max(grown, bench.memory("planner") - begun)
            lives = len(bench.restarts)
            bench.prepare(self.planner, self.twin)
            begun = begun if len(bench.restarts) == lives else math.nan
        third = max(1, len(ticks) // 3)
        first, last = (float(np.nanpercentile(np.concatenate(part), 99.0)) for part in (ticks[:third], ticks[-third:]))
        findings.measured[:] = [f"{len(ticks)} episodes in {self.minutes:g} min"]
        findings.measured += [f"nodes started again, as {reason}" for reason in bench.restarts[restarts:]]
        findings.at_most("contacts:", contacts, 0, "")
        findings.at_most(f"p99 of ticks from {first:.1f} ms by", last / first - 1.0, _DRIFT, "of it")
        findings.at_most("memory grown by", grown, _SOAK_MEMORY, "MB")

    def _episode(self, bench: Bench, random: np.random.Generator) -> None:
        """A motion to a goal near the skill's, and a sphere that comes to rest on its path."""
        goal = bench.goal.copy()
        goal[:3] += random.uniform(-_CIRCLE, _CIRCLE, 3)
        bench.asks.send_goal(goal)
        bench.spend(float(random.uniform(0.0, 2.0)))
        bench.wait(lambda: len(bench.seen.path), "a path")
        bench.asks.show_scene(coming_to(bench.seen.ahead(_AHEAD)))
        bench.spend(5.0)


class TwoHosts(Fault):
    subjects = PLANNER_ALONE
    name = "two_hosts"
    criterion = "planner and twin on two hosts, 5 ms and 1 % loss between them: runs as on one, promises hold"
    phases = (START,)
    long = True

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        domain = str(_other_domain(bench))
        answer = _answer(bench, "two_hosts", bench.skill_name, str(bench.folder / self.name), domain, patience=_JOINED)
        if "skipped" in answer:
            raise FaultSkipped(answer["skipped"])
        findings.measured += answer["measured"]
        findings.failures += answer["failures"]


def _other_domain(bench: Bench) -> int:
    """A domain for nodes that would be second ones beside the bench's own."""
    return bench.domain % 101 + 1


def _answer(bench: Bench, module: str, *arguments: str, patience: float) -> dict[str, Any]:
    """What a module of this folder prints as JSON when it runs as a process of its own, at most so long [s]."""
    bench.stop_nodes()
    command = [sys.executable, "-m", f"{__package__}.{module}", *arguments]
    environment = bench.environment | {"ROS_DOMAIN_ID": str(_other_domain(bench))}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        said, complaint = process.communicate(timeout=patience)
    except subprocess.TimeoutExpired as error:
        raise NotSeenError(f"{module} has not ended within {patience:g} s") from error
    finally:
        process.terminate()
        process.wait()
    if process.returncode != 0:
        raise NotSeenError(f"{module} ended with exit code {process.returncode}: {complaint.strip()[-300:]}")
    return json.loads(said.splitlines()[-1])


LONG_FAULTS = (GoalsFlood, FuzzedMessages, ManyLives, TwoHosts, Soak)
