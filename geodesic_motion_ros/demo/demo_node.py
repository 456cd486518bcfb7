"""The demo: an arm does a skill three times, planner and twin as two processes over real ROS 2.

Once without an obstacle, once with a sphere that moves into its path and avoidance off (the control: it must hit), once
with the same sphere and avoidance on. What is printed was measured by the twin on the arm's real geometry. The scene is
the skill's: where its demonstrations have the elbow on either side the sphere is in the path of the elbow, with others
in that of the hand.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from geodesic_motion_ros.certification.declared_scene import DeclaredScene
from geodesic_motion_ros.demo.demo_options import SCENE, parsed
from geodesic_motion_ros.demo.demo_run import (
    DemoError,
    Probe,
    Processes,
    Recording,
    Tick,
    isolated_environment,
    termination_as_interrupt,
)
from geodesic_motion_ros.demo.demo_scene import DEFAULTS, DemoScene
from geodesic_motion_ros.demo.demo_view import show
from geodesic_motion_ros.demo.elbow_scene import ElbowScene
from geodesic_motion_ros.demo.hand_scene import HandScene
from geodesic_motion_ros.demo.joint_scene import JointScene
from geodesic_motion_ros.demo.server_probe import (
    FOLDER,
    ServerProbe,
    check_server,
    loopback_address,
    start_driver,
    start_planner,
    start_server,
)
from geodesic_motion_ros.geometry.quaternions import angle_between
from geodesic_motion_ros.simulation.scripted_spheres import LineObstacle
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import GeodesicMotionError, SkillError
from geodesic_motion_ros.utils.tables import write_json

#: What the demo promises; and the rate [Hz] below which it warns that the machine is busy.
LARGEST_ERROR_MM, LARGEST_ERROR_DEG, LEAST_RATE = 10.0, 3.0, 99.0
#: A planner's period [ms], and the causes of a deadline that is missed.
PERIOD_MS, CAUSES = 10.0, ("no path", "search", "machine")
#: The robot server lives in a time of its own, at most as fast as real.
_SERVER_SPEED = "1.0"
#: The run without avoidance ends this long after the first contact [s].
AFTER_CONTACT = 3.0

@dataclass(frozen=True)
class Run:
    """One of the three runs: its key in summary.json, what it is called, what is in it."""

    key: str
    title: str
    obstacle: bool
    avoidance: bool


RUNS = (
    Run("no_obstacle", "no obstacle", False, True),
    Run("avoidance_off", "moving obstacle, avoidance off", True, False),
    Run("avoidance_on", "moving obstacle, avoidance on", True, True),
)


class Demo:
    """Plays the runs of a demo with the nodes `planner` and `twin`, and measures them."""

    def __init__(self, skill: str, declared: str, out: Path, gui: bool, domain: int, served: bool = False) -> None:
        """skill : a folder, or the name of a shipped skill. declared : the parameter `scene` of both nodes; empty: what
        the skill was recorded in, or where it does not say `SCENE`. served : by the robot server, not the twin.

        Raises
        ------
        SkillError : there is nothing to show of the skill in that scene; says what else to give. ParameterError : the
            robot server is not installed.
        """
        loaded = Skill.load(skill)
        if served:
            check_server(FOLDER, loaded)
        self._declared = scene_around(loaded, declared)
        self._skill, self._out, self._gui, self._domain, self._served = skill, out, gui, domain, served
        around = DeclaredScene.from_name(self._declared) or DeclaredScene.of_skill(loaded)
        try:
            self.scene = scene_of(loaded, around)
        except SkillError as error:
            raise SkillError(
                f"{error}; give --scene, which is {self._declared or 'that of the skill'} here, as it is around your "
                "arm, none where nothing stands there, or another --skill"
            ) from error

    def run(self, run: Run, say: Callable[[str], None]) -> Recording:
        """Start both nodes, let the arm move, end the nodes; say : called with what is waited for."""
        environment = isolated_environment(self._domain)
        with Processes(self._out / run.key, environment) as processes:
            if self._served:
                return self._run_served(run, processes, say)
            processes.start("twin", self._twin_parameters(run))
            processes.start("planner", self._planner_parameters(run))
            with Probe(processes, self._domain, self.scene.skill.base_frame, self.scene.goal, say) as probe:
                # An arm that has hit the obstacle is stuck there: what follows shows nothing.
                return probe.run(math.inf if run.avoidance else AFTER_CONTACT)

    def _run_served(self, run: Run, processes: Processes, say: Callable[[str], None]) -> Recording:
        address, scene = loopback_address(), self.scene
        start_server(processes, FOLDER, address, self._skill, _SERVER_SPEED)
        start_driver(processes, address, _SERVER_SPEED)
        start_planner(processes, _SERVER_SPEED, self._planner_parameters(run))
        obstacle = scene.obstacle if run.obstacle else None
        with ServerProbe(processes, self._domain, scene.skill, obstacle, say, simulated=True) as probe:
            recording = probe.run()
            if probe.stops:
                raise DemoError(f"{run.key}: {probe.stops[0]}")
            return recording

    def _twin_parameters(self, run: Run) -> dict[str, Any]:
        spheres = yaml.safe_dump({"ball": describe(self.scene.obstacle)}) if run.obstacle else ""
        return {"skill": self._skill, "scene": self._declared, "spheres": spheres, "gui": self._gui}

    def _planner_parameters(self, run: Run) -> dict[str, Any]:
        # The pictures are drawn afterwards, from what was recorded.
        return {
            "skill": self._skill,
            "scene": self._declared,
            "avoidance": run.avoidance,
            "obstacle_point_radius": self.scene.obstacle.radius,
            "latent_view_rate": 0.0,
            **self.scene.patience,
        }


def scene_around(skill: Skill, declared: str) -> str:
    """Return the parameter `scene` of the nodes: as declared; where that is empty what the skill was recorded in, or
    `SCENE` where it does not say.
    """
    return declared or ("" if skill.scene is not None else SCENE)


def scene_of(skill: Skill, declared: DeclaredScene | None) -> DemoScene:
    """What the demo shows of a skill, where this is declared to stand around the arm."""
    whole_arm = ElbowScene if ElbowScene.suits(skill) else JointScene
    return (whole_arm if skill.space == "joint" else HandScene)(skill, declared)


def describe(obstacle: LineObstacle) -> dict[str, Any]:
    """The obstacle as the twin's parameter `spheres` wants it."""
    return {
        "kind": obstacle.kind,
        "start": [float(x) for x in obstacle.start],
        "end": [float(x) for x in obstacle.end],
        "speed": obstacle.speed,
        "radius": obstacle.radius,
        "start_time": float(obstacle.start_time),
    }


def figures(recording: Recording, goal: np.ndarray, obstacle: bool) -> dict[str, Any]:
    """The figures of one run, as summary.json has them.

    Rate, tick durations and misses are the planner's own, from the first plan to the arrival; errors and clearance
    are the twin's. The goal error is that of the last pose measured.
    """
    ticks = recording.ticks
    if len(ticks) < 2 or not recording.positions:
        raise DemoError("the planner has never planned: see its log")
    first, last = ticks[0], ticks[-1]
    # A status is sent from within its tick, with the duration of the one before.
    p50, p99 = np.percentile([tick.duration for tick in ticks[1:]], [50.0, 99.0])
    distance = np.linalg.norm(recording.positions[-1] - goal[:3])
    angle = angle_between(recording.quaternions[-1], goal[3:])
    return {
        "rate_hz": (last.number - first.number) / (last.stamp - first.stamp),
        "tick_ms_p50": float(p50),
        "tick_ms_p99": float(p99),
        "deadline_misses": last.misses - first.misses,
        "misses_by_cause": misses_by_cause(ticks),
        "stolen_percent": recording.stolen_percent,
        "goal_error_mm": 1000.0 * float(distance),
        "goal_error_deg": math.degrees(float(angle)),
        "min_clearance_mm": 1000.0 * recording.min_clearance if obstacle else None,
        "contacts": recording.contacts,
        "seconds_to_goal": None if math.isnan(recording.arrived) else recording.arrived,
        "verdicts": dict(Counter(tick.code for tick in ticks)),
        "newest": recording.newest,
    }


def misses_by_cause(ticks: Sequence[Tick]) -> dict[str, int]:
    """How many deadlines were missed, by what the tick was about that missed them.

    machine : it had less than a period of work, and waited for the rest. no path : it had more, and came to no path.
    search : it had more, and came to one.
    """
    counted = Counter(dict.fromkeys(CAUSES, 0))
    for before, after in pairwise(ticks):
        cause = "machine" if after.work <= PERIOD_MS else "search" if before.code == "OK" else "no path"
        counted[cause] += after.misses - before.misses
    return dict(counted)


def missed_bars(summary: Mapping[str, Any]) -> list[str]:
    """What the demo promises and did not do, as sentences; empty when it has passed."""
    missed = []
    off, on = summary["avoidance_off"], summary["avoidance_on"]
    if off["contacts"] == 0 and off["min_clearance_mm"] >= 0.0:
        missed.append("avoidance_off: the arm did not touch the obstacle, so this scene proves nothing")
    if on["contacts"] > 0 or on["min_clearance_mm"] <= 0.0:
        missed.append(f"avoidance_on: contact in {on['contacts']} steps, clearance {on['min_clearance_mm']:.1f} mm")
    families = summary.get("families")
    if families and set(families["avoidance_on"]) <= set(families["no_obstacle"]):
        missed.append(f"avoidance_on: the arm stayed in the families {families['no_obstacle']} of demonstrations")
    for run in RUNS:
        millimetres, degrees = summary[run.key]["goal_error_mm"], summary[run.key]["goal_error_deg"]
        if run.avoidance and (millimetres > LARGEST_ERROR_MM or degrees > LARGEST_ERROR_DEG):
            missed.append(
                f"{run.key}: the goal was missed by {millimetres:.1f} mm and {degrees:.1f} deg, allowed are "
                f"{LARGEST_ERROR_MM:g} mm and {LARGEST_ERROR_DEG:g} deg"
            )
    return missed


def slow_runs(summary: Mapping[str, Any]) -> list[str]:
    """Runs in which the planner did not reach its rate, as sentences: the machine is to blame rather than the demo."""
    load, cores = os.getloadavg()[0], os.cpu_count()
    return [
        f"{run.key}: the planner ran at {summary[run.key]['rate_hz']:.1f} Hz instead of 100; "
        f"the machine's load is {load:.1f} on {cores} cores, and its host took "
        f"{summary[run.key]['stolen_percent']:.1f} % of its time meanwhile"
        for run in RUNS
        if summary[run.key]["rate_hz"] < LEAST_RATE
    ]


def table(summary: Mapping[str, Any]) -> str:
    """The figures as a table, one row a run, and with which planner parameters other than the defaults."""
    head = ("", "rate", "tick p50", "tick p99", "missed deadlines:", "goal error", "smallest", "steps with")
    units = ("", "Hz", "ms", "ms", " / ".join(CAUSES), "mm / deg", "clearance mm", "contact")
    rows = [head, units]
    for run in RUNS:
        row = summary[run.key]
        clearance = "-" if row["min_clearance_mm"] is None else f"{row['min_clearance_mm']:.1f}"
        misses = " / ".join(str(row["misses_by_cause"][cause]) for cause in CAUSES)
        error = f"{row['goal_error_mm']:.2f} / {row['goal_error_deg']:.2f}"
        ticks = (f"{row[name]:.1f}" for name in ("rate_hz", "tick_ms_p50", "tick_ms_p99"))
        rows.append((run.title, *ticks, misses, error, clearance, str(row["contacts"])))
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    lines = ["  ".join(f"{cell:>{width}}" if i else f"{cell:<{width}}" for i, (cell, width) in
             enumerate(zip(row, widths, strict=True))) for row in rows]  # fmt: skip
    rule = "-" * len(lines[0])
    changed = [f"{name} {value:g} (default {DEFAULTS[name]:g})" for name, value in summary["parameters"].items()]
    note = [f"planner parameters other than the defaults: {', '.join(changed)}"] if changed else []
    return "\n".join([*lines[:2], rule, *lines[2:], *note])


def perform(skill: str, declared: str, out: Path, gui: bool, domain: int, pictures: bool, served: bool) -> int:
    """Run the demo; returns the exit code."""
    began = time.monotonic()

    def say(text: str) -> None:
        print(f"[{time.monotonic() - began:5.1f} s] {text}", flush=True)

    out.mkdir(parents=True, exist_ok=True)
    say(f"loading the skill {skill}")
    demo = Demo(skill, declared, out, gui, domain, served)
    scene = demo.scene
    recordings: dict[str, Recording] = {}
    families: dict[str, list[int]] = {}
    summary: dict[str, Any] = {"skill": scene.skill.name, "parameters": dict(scene.patience)}
    for number, run in enumerate(RUNS, 1):
        say(f"run {number} of {len(RUNS)}: {run.title}")
        recordings[run.key] = demo.run(run, say)
        summary[run.key] = figures(recordings[run.key], scene.goal, run.obstacle)
        say(f"  {_outcome(summary[run.key])}")
        taken = scene.families(recordings[run.key])
        if taken is not None:
            families[run.key] = taken
            say(f"  as in the demonstrations of family {', then '.join(map(str, taken))}")
    if families:
        summary["families"] = families
    missed = missed_bars(summary)
    summary["passed"] = not missed
    summary["warnings"] = slow = slow_runs(summary)
    write_json(out / "summary.json", summary)
    if pictures:
        say("drawing the pictures")
        scene.draw(recordings, out)
    say(f"done; figures{' and pictures' if pictures else ''} in {out}")
    print(f"\n{table(summary)}\n")
    for sentence in slow:
        print(f"warning: {sentence}", file=sys.stderr)
    for sentence in missed:
        print(f"NOT as promised: {sentence}", file=sys.stderr)
    return 1 if missed else 0


def _outcome(row: Mapping[str, Any]) -> str:
    arrived = row["seconds_to_goal"]
    text = "the goal was not reached" if arrived is None else f"at the goal after {arrived:.1f} s"
    if row["contacts"]:
        return f"{text}, after hitting the obstacle"
    if arrived is None:
        return f"{text}; the planner says: {row['newest']}"
    if row["min_clearance_mm"] is None:
        return text
    return f"{text}, past the obstacle with {row['min_clearance_mm']:.0f} mm to spare"


def main(args: Sequence[str] | None = None) -> int:
    """Run the demo with command line arguments; returns the exit code."""
    options = parsed(args)
    try:
        with termination_as_interrupt():
            if options.view:
                declared = scene_around(Skill.load(options.skill), options.scene)
                show(options.skill, declared, options.out, options.domain)
            return perform(
                options.skill, options.scene, options.out, options.gui, options.domain, not options.no_pictures,
                options.robot_server,
            )  # fmt: skip
    except KeyboardInterrupt:
        print("interrupted; planner and twin are stopped", file=sys.stderr)
        return 0 if options.view else 130
    except GeodesicMotionError as error:
        print(f"demo: {error}", file=sys.stderr)
        return 1 if isinstance(error, DemoError) else 2


if __name__ == "__main__":
    sys.exit(main())
