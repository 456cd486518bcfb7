"""Runs of the demo's sphere by the node `franka` on a simulated FR3 with all its reflexes, and faults in them."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.demo.demo_node import Demo
from geodesic_motion_ros.demo.demo_options import SCENE, SERVED_SKILL
from geodesic_motion_ros.demo.demo_run import DemoError, Processes, isolated_environment
from geodesic_motion_ros.demo.server_probe import (
    FOLDER,
    ServerProbe,
    loopback_address,
    start_driver,
    start_planner,
    start_server,
)
from geodesic_motion_ros.skill.skill import Skill

#: Own time of the arm, at most as fast as real; and the machine's.
OWN, REAL = "1.0", "real"
#: A joint is in motion from here on [rad/s]; the longest wait for the nodes [s]; a fault is watched for so long [s].
MOVING, PATIENCE, WATCHED = 0.2, 300.0, 6.0
#: How long the process that commands the arm is stopped [s]: to the arm it is a network that stalls.
STALLS = (0.02, 0.2, 2.0)


@dataclass(frozen=True)
class Row:
    """What came of one run.

    Attributes
    ----------
    arrived : after the goal [s], nan where not. reflexes : how many. clearance : of the meshes at the measured joints
        [mm], nan without a sphere. tracking : largest difference of a measured from a commanded joint, at one time
        [mrad]. refused : trajectories. lost : milliseconds in which the arm had no answer. mode : of the driver, in the
        end. at_rest : whether nothing is commanded to move in the end. newest : of the driver's log, or why not.
    """

    name: str
    seed: int
    time: str
    arrived: float
    reflexes: int
    clearance: float
    tracking: float
    refused: int
    mode: str
    at_rest: bool
    newest: str

    def as_dict(self) -> dict[str, Any]:
        """The row for a file."""
        return asdict(self)


Fault = Callable[["ServedRun", np.random.Generator], None]


class ServedRun:
    """The processes of one run and a probe of them."""

    def __init__(self, folder: Path, domain: int, speed: str, demo: Demo, sphere: bool, avoidance: bool) -> None:
        self._folder, self._domain, self._speed, self._demo = folder, domain, speed, demo
        self._sphere, self._avoidance = sphere, avoidance

    def row(self, name: str, seed: int, fault: Fault | None) -> Row:
        """Run once, with a fault in motion."""
        address, scene = loopback_address(), self._demo.scene
        with Processes(self._folder, isolated_environment(self._domain)) as self.processes:
            start_server(self.processes, FOLDER, address, SERVED_SKILL, self._speed)
            start_driver(self.processes, address, self._speed)
            start_planner(
                self.processes, self._speed,
                {
                    "skill": SERVED_SKILL, "scene": SCENE, "avoidance": self._avoidance, "latent_view_rate": 0.0,
                    "obstacle_point_radius": scene.obstacle.radius, **scene.patience,
                },
            )  # fmt: skip
            obstacle, simulated = scene.obstacle if self._sphere else None, self._speed != REAL
            skill = Skill.load(SERVED_SKILL)
            with ServerProbe(self.processes, self._domain, skill, obstacle, _quiet, simulated, PATIENCE) as self.probe:
                newest = ""
                try:
                    if fault is None:
                        self.probe.run()
                    else:
                        self._disturbed(fault, np.random.default_rng(seed))
                except DemoError as error:
                    newest = str(error).splitlines()[0]
                return self._row(name, seed, newest)

    def _disturbed(self, fault: Fault, random: np.random.Generator) -> None:
        probe = self.probe
        probe.prepare()
        probe.begin()
        probe.wait(lambda: np.abs(probe.drive[7:]).max() > MOVING, "the arm in motion")
        until = probe.now() + random.uniform(0.0, 1.0)
        probe.wait(lambda: probe.now() > until, "the moment of the fault")
        fault(self, random)
        # A lost connection stops the arm's own time.
        end, patience = probe.now() + WATCHED, time.monotonic() + 10.0 * WATCHED
        probe.wait(lambda: probe.now() > end or time.monotonic() > patience, "what comes of it")

    def _row(self, name: str, seed: int, newest: str) -> Row:
        probe, log = self.probe, self.processes.log("franka")
        record = probe.recording
        return Row(
            name, seed, "real" if self._speed == REAL else "own", record.arrived, len(probe.reflexes),
            1e3 * record.min_clearance if math.isfinite(record.min_clearance) else math.nan, _tracking(probe),
            log.count("refused a message on joint_trajectory"), probe.mode,
            not probe.drive[7:].any(), newest or probe.said,
        )  # fmt: skip

    def arm_process(self) -> int:
        """The number of the process that commands the arm."""
        driver = self.processes.number("franka")
        return int(Path(f"/proc/{driver}/task/{driver}/children").read_text().split()[0])


def _tracking(probe: ServerProbe) -> float:
    """Both are sent together, with one stamp."""
    commanded = dict(zip(probe.commanded_times, probe.commanded, strict=True))
    pairs = [
        (measured, commanded[at])
        for at, measured in zip(probe.recording.joint_times, probe.measured, strict=True)
        if at in commanded
    ]
    return 1e3 * max((float(np.abs(one - other)[:7].max()) for one, other in pairs), default=math.nan)


def _quiet(text: str) -> None:
    """What is waited for is not said."""


def kill_planner(run: ServedRun, random: np.random.Generator) -> None:
    """Kill the planner."""
    run.processes.end("planner", signal.SIGKILL)


def kill_driver(run: ServedRun, random: np.random.Generator) -> None:
    """Kill the node, not the process that it has started, and start another one."""
    run.processes.end("franka", signal.SIGKILL)
    run.probe.mode = ""
    start_driver(run.processes, loopback_address(), OWN)
    run.probe.wait(lambda: run.probe.mode not in ("", "CONNECTING"), "a new driver that hears the arm")


def stall(duration: float) -> Fault:
    """The fault that stops who commands the arm for so long [s]."""

    def fault(run: ServedRun, random: np.random.Generator) -> None:
        process = run.arm_process()
        os.kill(process, signal.SIGSTOP)
        time.sleep(duration)
        os.kill(process, signal.SIGCONT)

    return fault


@dataclass(frozen=True)
class Case:
    """A run that can be repeated: by whose time, with or without sphere and avoidance, with which fault."""

    name: str
    speed: str
    sphere: bool = False
    avoidance: bool = True
    fault: Fault | None = None


FAULTS = (
    Case("planner killed", OWN, fault=kill_planner),
    Case("driver killed", OWN, fault=kill_driver),
    *(Case(f"network stalled for {1e3 * each:g} ms", REAL, fault=stall(each)) for each in STALLS),
)


def cases(own: int, real: int, control: int, faults: bool) -> list[tuple[Case, int]]:
    """Runs with their seeds: so many with the sphere by the arm's own time and by the machine's, without avoidance."""
    wanted = [
        (Case("sphere", OWN, sphere=True), own),
        (Case("sphere", REAL, sphere=True), real),
        (Case("sphere, avoidance off", OWN, sphere=True, avoidance=False), control),
        *((case, 1) for case in FAULTS if faults),
    ]
    return [(case, seed) for case, count in wanted for seed in range(count)]


def run_cases(
    chosen: Sequence[tuple[Case, int]], out: Path, domain: int, ended: Callable[[Row], None]
) -> None:
    """Run one after the other; ended : called with what came of each."""
    demo = Demo(SERVED_SKILL, SCENE, out, False, domain, served=True)
    for number, (case, seed) in enumerate(chosen):
        folder = out / f"{number:03d}"
        ended(ServedRun(folder, domain, case.speed, demo, case.sphere, case.avoidance).row(case.name, seed, case.fault))


def table(rows: Sequence[Row]) -> str:
    """The rows as a table in Markdown."""
    lines = [
        "| run | time | arrived [s] | reflexes | clearance [mm] | tracking [mrad] | refused | in the end |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        figures = (row.arrived, row.clearance, row.tracking)
        arrived, clearance, tracking = ("-" if math.isnan(figure) else f"{figure:.1f}" for figure in figures)
        end = f"{row.mode}, {'at rest' if row.at_rest else 'in motion'}"
        lines.append(
            f"| {row.name}, seed {row.seed} | {row.time} | {arrived} | {row.reflexes} | {clearance} | {tracking} | "
            f"{row.refused} | {end} |"
        )
    return "\n".join(lines)
