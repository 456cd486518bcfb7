"""Runs of the demo's sphere by the node `franka` on a simulated FR3 with all its reflexes, and faults in them."""

from __future__ import annotations

import math
import signal
import sys
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
#: For how long the network between driver and arm lets nothing pass [s].
STALLS = (0.02, 0.2, 2.0)


@dataclass(frozen=True)
class Row:
    """What came of one run.

    Attributes
    ----------
    arrived : after the goal [s], nan where not. stops : what the driver said of each reflex and of each connection that
        was lost. clearance : of the meshes at the measured joints [mm], nan without a sphere. tracking : largest
        difference of a measured from a commanded joint, at one time [mrad]. refused : trajectories. mode : of the
        driver, in the end. at_rest : whether the arm stands in the end. newest : status of the driver, or why the run
        was given up.
    """

    name: str
    seed: int
    time: str
    arrived: float
    stops: list[str]
    clearance: float
    tracking: float
    refused: int
    mode: str
    at_rest: bool
    newest: str

    def as_dict(self) -> dict[str, Any]:
        """The row for a file."""
        return asdict(self)


Fault = Callable[["ServedRun"], None]


@dataclass(frozen=True)
class Case:
    """A run that can be repeated: by whose time, with or without sphere and avoidance, with which fault in motion.

    stall : of the network between driver and arm, at each request [s]; None: there is no such network.
    """

    name: str
    speed: str
    sphere: bool = False
    avoidance: bool = True
    fault: Fault | None = None
    stall: float | None = None


class ServedRun:
    """The processes of one run of a case, and a probe of them."""

    def __init__(self, folder: Path, domain: int, demo: Demo, case: Case) -> None:
        self._folder, self._domain, self._demo, self._case = folder, domain, demo, case
        self._address = loopback_address()

    def row(self, seed: int) -> Row:
        """Run once; seed : of the moment of the fault."""
        case, scene = self._case, self._demo.scene
        with Processes(self._folder, isolated_environment(self._domain)) as self.processes:
            start_server(self.processes, FOLDER, self._address, SERVED_SKILL, case.speed)
            if case.stall is not None:
                self.start_network()
            self.start_driver()
            start_planner(
                self.processes, case.speed,
                {
                    "skill": SERVED_SKILL, "scene": SCENE, "avoidance": case.avoidance, "latent_view_rate": 0.0,
                    "obstacle_point_radius": scene.obstacle.radius, **scene.patience,
                },
            )  # fmt: skip
            obstacle, simulated = scene.obstacle if case.sphere else None, case.speed != REAL
            skill = Skill.load(SERVED_SKILL)
            with ServerProbe(self.processes, self._domain, skill, obstacle, _quiet, simulated, PATIENCE) as self.probe:
                newest = ""
                try:
                    if case.fault is None:
                        self.probe.run()
                    else:
                        self._disturbed(case.fault, np.random.default_rng(seed))
                except DemoError as error:
                    newest = str(error).splitlines()[0]
                return self._row(seed, newest)

    def start_network(self) -> None:
        """Start the network before the arm."""
        start_network(self.processes, self._address, self._case.stall)

    def start_driver(self) -> None:
        """Start the driver, on the arm or on the network before it."""
        address = self._address if self._case.stall is None else loopback_address(network=True)
        start_driver(self.processes, address, self._case.speed)

    def _disturbed(self, fault: Fault, random: np.random.Generator) -> None:
        probe = self.probe
        probe.prepare()
        probe.begin()
        probe.wait(lambda: probe.fastest() > MOVING, "the arm in motion")
        until = probe.now() + random.uniform(0.0, 1.0)
        probe.wait(lambda: probe.now() > until, "the moment of the fault")
        fault(self)
        # A lost connection stops the arm's own time.
        end, patience = probe.now() + WATCHED, time.monotonic() + 10.0 * WATCHED
        probe.wait(lambda: probe.now() > end or time.monotonic() > patience, "what comes of it")

    def _row(self, seed: int, newest: str) -> Row:
        probe, log = self.probe, self.processes.log("franka")
        record = probe.recording
        return Row(
            self._case.name, seed, "real" if self._case.speed == REAL else "own", record.arrived, probe.stops,
            1e3 * record.min_clearance if math.isfinite(record.min_clearance) else math.nan, _tracking(probe),
            log.count("refused a message on joint_trajectory"), probe.mode,
            probe.stands(), newest or probe.said,
        )  # fmt: skip


def start_network(processes: Processes, arm: str, stall: float) -> None:
    """Start a network before an arm, which lets nothing pass for so long [s] at each SIGUSR1."""
    module = "geodesic_motion_studies.hardware.stalling_network"
    processes.run("network", [sys.executable, "-m", module, loopback_address(network=True), arm, str(stall)])


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


def kill_planner(run: ServedRun) -> None:
    """Kill the planner."""
    run.processes.end("planner", signal.SIGKILL)


def kill_driver(run: ServedRun) -> None:
    """Kill the node, not the process that it has started, and start another one."""
    run.processes.end("franka", signal.SIGKILL)
    run.probe.forget_driver()
    run.start_driver()
    run.probe.wait(lambda: run.probe.mode not in ("", "CONNECTING"), "a new driver that hears the arm")


def cut_network(run: ServedRun) -> None:
    """Take the network between driver and arm away, and bring it back once the driver has noticed."""
    run.processes.end("network", signal.SIGKILL)
    run.probe.wait(lambda: run.probe.mode == "CONNECTING", "the driver to notice")
    run.start_network()
    run.probe.wait(lambda: run.probe.mode != "CONNECTING", "the driver to hear the arm again")


def stall_network(run: ServedRun) -> None:
    """Let nothing pass between driver and arm for a while."""
    run.processes.send("network", signal.SIGUSR1)


FAULTS = (
    Case("planner killed", OWN, fault=kill_planner),
    Case("driver killed", OWN, fault=kill_driver),
    Case("connection lost", OWN, fault=cut_network, stall=0.0),
    *(Case(f"network stalled for {1e3 * each:g} ms", REAL, fault=stall_network, stall=each) for each in STALLS),
)


def cases(own: int, real: int, control: int, faults: int) -> list[tuple[Case, int]]:
    """Runs with their seeds: so many with the sphere by the arm's own time and by the machine's, without avoidance, and
    of each fault.
    """
    wanted = [
        (Case("sphere", OWN, sphere=True), own),
        (Case("sphere", REAL, sphere=True), real),
        (Case("sphere, avoidance off", OWN, sphere=True, avoidance=False), control),
        *((case, faults) for case in FAULTS),
    ]
    return [(case, seed) for case, count in wanted for seed in range(count)]


def run_cases(
    chosen: Sequence[tuple[Case, int]], out: Path, domain: int, ended: Callable[[Row], None]
) -> None:
    """Run one after the other; ended : called with what came of each."""
    demo = Demo(SERVED_SKILL, SCENE, out, False, domain, served=True)
    for number, (case, seed) in enumerate(chosen):
        folder = out / f"{number:03d}"
        ended(ServedRun(folder, domain, demo, case).row(seed))


def _short(stop: str) -> str:
    """The mode of a status, and what libfranka calls the reason, where it does."""
    mode, _, text = stop.partition(":")
    return " ".join([mode, *[word for word in text.replace(":", " ").split() if "_" in word][:1]])


def table(rows: Sequence[Row]) -> str:
    """The rows as a table in Markdown."""
    lines = [
        "| run | time | arrived [s] | stopped by | clearance [mm] | tracking [mrad] | refused | in the end |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        figures = (row.arrived, row.clearance, row.tracking)
        arrived, clearance, tracking = ("-" if math.isnan(figure) else f"{figure:.1f}" for figure in figures)
        stops = ", ".join(dict.fromkeys(_short(stop) for stop in row.stops)) or "-"
        end = f"{row.mode}, {'at rest' if row.at_rest else 'in motion'}"
        lines.append(
            f"| {row.name}, seed {row.seed} | {row.time} | {arrived} | {stops} | {clearance} | {tracking} | "
            f"{row.refused} | {end} |"
        )
    return "\n".join(lines)
