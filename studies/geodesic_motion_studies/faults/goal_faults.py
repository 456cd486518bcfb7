"""Faults of goals: what is no goal, what is one in another form, and what nobody has shown."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseStamped

from geodesic_motion_studies.faults.bench import Bench
from geodesic_motion_studies.faults.fault import PLANNER_ALONE, START, Fault, Findings
from geodesic_motion_studies.faults.state_faults import refused, require_only_ok, require_refused

#: How long a motion is watched that must not change [s].
_WATCHED = 0.3
#: The arrival of a motion that goes on is known to this [s].
_SHIFTED = 0.1
#: Paths this near to each other [m] are the same.
_SAME = 0.005
#: An orientation that turns by so much has no path [rad]; a place so far off has none either [m].
_FAR = 0.6


def require_unchanged(bench: Bench, findings: Findings, phase: str, since: float) -> None:
    """Since `since` [s, steady clock] the arm rests without a goal, or has been going on as if nothing was."""
    bench.wait(lambda: time.monotonic() > since + _WATCHED, "time to pass")
    after = bench.seen.since(since)
    if phase == START:
        findings.require(all(status.number("speed") == 0.0 for status in after), "the arm was set moving")
        return
    require_only_ok(findings, after)
    arrivals = [status.sent + status.number("time_to_goal") for status in after if status.code == "OK"]
    shifted = max(arrivals, default=0.0) - min(arrivals, default=0.0)
    findings.require(shifted <= _SHIFTED, f"the arrival was shifted by {shifted:.3f} s")


class GoalsRefused(Fault):
    """Goals that are none, each in a message of its own."""

    subjects = PLANNER_ALONE
    text: str

    def messages(self, bench: Bench, random: np.random.Generator) -> Sequence[PoseStamped]:
        """What is sent in the place of goals."""
        raise NotImplementedError

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        before, since = refused(bench, "goal_pose"), time.monotonic()
        sent = self.messages(bench, random)
        for message in sent:
            bench.asks.publish("goal_pose", message)
        require_refused(bench, findings, "goal_pose", len(sent), before, self.text)
        bench.verdict("BAD_INPUT", "goal_pose", since, of="goal_")
        require_unchanged(bench, findings, phase, since)
        bench.finish(findings)


class GoalNotFinite(GoalsRefused):
    name = "goal_not_finite"
    criterion = "NaN, Inf, 1e300 in a goal: dropped, counted, reference unchanged"
    text = "goal_pose"

    def messages(self, bench: Bench, random: np.random.Generator) -> Sequence[PoseStamped]:
        goals = []
        for value in (float("nan"), float("inf"), 1e300, -float("inf")):
            pose = bench.goal.copy()
            pose[random.integers(7)] = value
            goals.append(bench.asks.goal_message(pose))
        return goals


class GoalZeroQuaternion(GoalsRefused):
    name = "goal_zero_quaternion"
    criterion = "a goal with the zero quaternion: refused with the reason, reference unchanged"
    text = "zero quaternion"

    def messages(self, bench: Bench, random: np.random.Generator) -> Sequence[PoseStamped]:
        return [bench.asks.goal_message(np.append(bench.goal[:3], np.zeros(4)))]


class GoalUnknownFrame(GoalsRefused):
    name = "goal_unknown_frame"
    criterion = "a goal in a frame that nobody knows: refused, the frame named, reference unchanged"
    text = "nowhere"

    def messages(self, bench: Bench, random: np.random.Generator) -> Sequence[PoseStamped]:
        return [bench.asks.goal_message(bench.goal, "nowhere")]


class GoalOutside(Fault):
    subjects = PLANNER_ALONE
    name = "goal_outside"
    criterion = "a goal that nobody has shown: GOAL_OUT_OF_SUPPORT, its distance stated, reference unchanged"

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        direction = random.normal(size=3)
        pose = bench.goal.copy()
        pose[:3] += _FAR * direction / np.linalg.norm(direction)
        since = time.monotonic()
        bench.asks.send_goal(pose)
        said = bench.verdict("GOAL_OUT_OF_SUPPORT", "", since, of="goal_")
        reason = said.values["goal_reason"]
        findings.note(reason)
        findings.require(any(sign.isdigit() for sign in reason), "the reason states no size")
        require_unchanged(bench, findings, phase, since)
        bench.finish(findings)


class SameGoal(Fault):
    """The skill's goal in another form: the path stays the same."""

    subjects = PLANNER_ALONE
    def other_form(self, quaternion: np.ndarray) -> np.ndarray:
        """The goal's quaternion (4,) as it is sent."""
        raise NotImplementedError

    def run(self, bench: Bench, phase: str, random: np.random.Generator, findings: Findings) -> None:
        if phase == START:
            bench.set_out(phase)
            before = bench.seen.path
            bench.arrive()
            bench.judge(findings)
            bench.prepare(self.planner, self.twin)
        else:
            before = bench.seen.path
        bench.seen.path = np.zeros((0, 3))
        since = time.monotonic()
        bench.asks.publish(
            "goal_pose", bench.asks.goal_message(np.append(bench.goal[:3], self.other_form(bench.goal[3:])))
        )
        bench.verdict("OK", "", since + 0.05, of="goal_")
        bench.wait(lambda: len(bench.seen.path), "a path")
        apart = max(float(np.min(np.linalg.norm(before - point, axis=1))) for point in bench.seen.path)
        findings.at_most("paths apart", 1000.0 * apart, 1000.0 * _SAME, "mm")
        bench.finish(findings)


class GoalNotUnit(SameGoal):
    name = "goal_not_unit"
    criterion = "a goal with a quaternion of norm 3: normalised, the same path within 5 mm"

    def other_form(self, quaternion: np.ndarray) -> np.ndarray:
        return 3.0 * quaternion


class GoalSignFlipped(SameGoal):
    name = "goal_sign_flipped"
    criterion = "a goal with -q for q: the same path within 5 mm"

    def other_form(self, quaternion: np.ndarray) -> np.ndarray:
        return -quaternion


GOAL_FAULTS = (GoalNotFinite, GoalZeroQuaternion, GoalUnknownFrame, GoalOutside, GoalNotUnit, GoalSignFlipped)
