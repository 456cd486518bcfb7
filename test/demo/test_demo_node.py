"""The demo: its figures mean what they say, and with real processes it does what it promises."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.demo import demo_node, demo_run
from geodesic_motion_ros.demo.demo_run import DemoError, Probe, Processes, Recording, Tick, isolated_environment
from geodesic_motion_ros.demo.elbow_scene import ElbowScene

DOMAIN = int(os.environ["ROS_DOMAIN_ID"])
GOAL = np.array([0.4, -0.3, 0.2, 1.0, 0.0, 0.0, 0.0])


def recorded() -> Recording:
    """A second of a made-up motion that ends 3 mm and 2 degrees from the goal; every tenth tick is missed."""
    half = math.radians(1.0)
    tilted = np.array([math.cos(half), math.sin(half), 0.0, 0.0])
    ticks = [Tick(0.01 * (k + k // 9), k, 4.0 if k % 10 else 9.0, 3.0, k // 9, "OK") for k in range(1, 91)]
    return Recording(
        pose_times=[0.0, 1.0], positions=[GOAL[:3], GOAL[:3] + [0.003, 0.0, 0.0]], quaternions=[GOAL[3:], tilted],
        ticks=ticks, min_clearance=0.012, arrived=0.9,
    )  # fmt: skip


def good_summary() -> dict:
    row = demo_node.figures(recorded(), GOAL, obstacle=True) | {"rate_hz": 100.0}
    off = row | {"contacts": 12, "min_clearance_mm": -4.0}
    free = row | {"min_clearance_mm": None}
    return {"parameters": {}, "no_obstacle": free, "avoidance_off": off, "avoidance_on": row}


def test_figures_are_those_of_the_recording() -> None:
    row = demo_node.figures(recorded(), GOAL, obstacle=True)
    assert row["rate_hz"] == pytest.approx(90.0, rel=0.01)
    assert row["tick_ms_p50"] == 4.0
    assert row["tick_ms_p99"] == 9.0
    assert row["deadline_misses"] == 10
    assert row["goal_error_mm"] == pytest.approx(3.0)
    assert row["goal_error_deg"] == pytest.approx(2.0)
    assert row["min_clearance_mm"] == pytest.approx(12.0)
    assert row["contacts"] == 0


def test_every_missed_deadline_has_a_cause() -> None:
    """A status has the work of the tick before it, and its own code: the tick between two of them has missed."""
    rows = [
        # work [ms] of the tick before, misses so far, code of this tick
        (1.0, 0, "OK"),
        (15.0, 1, "NO_FEASIBLE_PATH"),  # search: the tick before came to a path, and worked for more than 10 ms
        (25.0, 3, "OK"),  # no path, two periods late
        (3.0, 7, "OK"),  # machine: 3 ms of work, and four periods late
        (15.0, 7, "OK"),  # more work than a period, and none missed
    ]
    ticks = [Tick(0.01 * k, k, 40.0, *row) for k, row in enumerate(rows)]
    assert demo_node.misses_by_cause(ticks) == {"no path": 2, "search": 1, "machine": 4}
    row = demo_node.figures(Recording(positions=[GOAL[:3]], quaternions=[GOAL[3:]], ticks=ticks), GOAL, True)
    assert row["deadline_misses"] == 7 == sum(row["misses_by_cause"].values())
    summary = good_summary()
    summary["avoidance_on"] |= row | {"contacts": 0}
    assert "2 / 1 / 4" in demo_node.table(summary)
    assert "no path / search / machine" in demo_node.table(summary)


def test_a_run_that_does_not_arrive_says_why() -> None:
    row = demo_node.figures(replace(recorded(), arrived=math.nan, newest="NO_GOAL: goal dropped"), GOAL, True)
    assert demo_node._outcome(row) == "the goal was not reached; the planner says: NO_GOAL: goal dropped"
    assert demo_node._outcome(row | {"contacts": 3}) == "the goal was not reached, after hitting the obstacle"


def test_a_run_without_obstacle_has_no_clearance() -> None:
    assert demo_node.figures(recorded(), GOAL, obstacle=False)["min_clearance_mm"] is None


def test_a_planner_that_never_planned_is_an_error() -> None:
    with pytest.raises(DemoError, match="never planned"):
        demo_node.figures(Recording(positions=[GOAL[:3]], quaternions=[GOAL[3:]]), GOAL, obstacle=True)


def test_all_bars_are_met_by_a_good_summary() -> None:
    assert demo_node.missed_bars(good_summary()) == []


@pytest.mark.parametrize(
    ("run", "change", "complaint"),
    [
        ("avoidance_off", {"contacts": 0, "min_clearance_mm": 5.0}, "proves nothing"),
        ("avoidance_on", {"contacts": 1}, "contact in 1 steps"),
        ("avoidance_on", {"min_clearance_mm": -0.1}, "clearance -0.1 mm"),
        ("avoidance_on", {"goal_error_mm": 10.1}, "10.1 mm"),
        ("no_obstacle", {"goal_error_deg": 3.1}, "3.1 deg"),
    ],
)
def test_every_bar_is_named_when_it_is_missed(run: str, change: dict, complaint: str) -> None:
    summary = good_summary()
    summary[run] |= change
    missed = demo_node.missed_bars(summary)
    assert len(missed) == 1
    assert missed[0].startswith(run)
    assert complaint in missed[0]


def test_an_arm_that_never_changes_its_family_has_not_shown_it() -> None:
    families = {"no_obstacle": [0], "avoidance_off": [0], "avoidance_on": [0, 1]}
    assert demo_node.missed_bars(good_summary() | {"families": families}) == []
    (missed,) = demo_node.missed_bars(good_summary() | {"families": families | {"avoidance_on": [0]}})
    assert missed.startswith("avoidance_on: the arm stayed in the families [0]")


def test_a_busy_machine_is_warned_of_and_fails_nothing() -> None:
    summary = good_summary()
    assert demo_node.slow_runs(summary) == []
    summary["no_obstacle"] |= {"rate_hz": 98.0, "stolen_percent": 12.34}
    (warning,) = demo_node.slow_runs(summary)
    assert warning.startswith("no_obstacle: the planner ran at 98.0 Hz")
    assert "load" in warning
    assert "its host took 12.3 % of its time" in warning
    assert demo_node.missed_bars(summary) == []


def test_parameters_that_are_not_the_defaults_stand_beside_the_figures() -> None:
    loosened = demo_node.table(good_summary() | {"parameters": dict(ElbowScene.patience)})
    assert "latency 0.1 (default 0.03)" in loosened
    assert "tracking_tolerance_joint 0.3 (default 0.1)" in loosened
    assert "default" not in demo_node.table(good_summary())


def test_negative_clearance_is_a_hit_without_contact_points() -> None:
    summary = good_summary()
    summary["avoidance_off"] |= {"contacts": 0, "min_clearance_mm": -0.5}
    assert demo_node.missed_bars(summary) == []


def test_a_process_that_ends_is_named_with_its_log(tmp_path: Path) -> None:
    with Processes(tmp_path, isolated_environment(DOMAIN)) as processes:
        processes.start("planner", {"skill": "no_such_skill"})
        os.waitid(os.P_PID, processes.number("planner"), os.WEXITED | os.WNOWAIT)
        with pytest.raises(DemoError, match=r"(?s)the planner has ended with exit code 1.*no_such_skill"):
            processes.check()


def test_processes_that_start_are_waited_for_as_long_as_they_live(tmp_path: Path, monkeypatch) -> None:
    """The planner of a skill that does not exist ends; a stopped one lives, and is waited for until it goes on."""
    monkeypatch.setattr(demo_run, "_SAID_EVERY", 0.2)
    with Processes(tmp_path, isolated_environment(DOMAIN)) as processes:
        processes.start("planner", {"skill": "no_such_skill"})
        processes.send("planner", signal.SIGSTOP)
        said: list[str] = []

        def say(line: str) -> None:
            said.append(line)
            if len(said) == 5:
                processes.send("planner", signal.SIGCONT)

        with (
            Probe(processes, DOMAIN, "panda_link0", GOAL, say) as probe,
            pytest.raises(DemoError, match="the planner has ended with exit code 1"),
        ):
            probe.run()
    assert len(said) >= 5
    assert said[0] == "  waiting for planner and twin to start; the planner says: nothing yet"


def test_a_signal_in_the_moment_a_process_begins_ends_that_one_too(tmp_path: Path, monkeypatch) -> None:
    begin, begun = subprocess.Popen, []

    def begin_and_interrupt(*arguments, **options) -> subprocess.Popen:
        begun.append(begin(*arguments, **options))
        os.kill(os.getpid(), signal.SIGINT)
        return begun[-1]

    # A program that another test ran in this process may have left its own handler.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(subprocess, "Popen", begin_and_interrupt)
    with pytest.raises(KeyboardInterrupt), Processes(tmp_path, isolated_environment(DOMAIN)) as processes:
        processes.start("twin", {})
    (process,) = begun
    assert process.poll() is not None


def demo_process(out: Path, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-u", "-m", "geodesic_motion_ros.demo.demo_node", "--out", str(out), *options]
    command += ["--domain", str(DOMAIN)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_scene_that_does_not_exist_is_named(tmp_path: Path) -> None:
    process = demo_process(tmp_path, "--scene", "nowhere")
    _, errors = process.communicate(timeout=120.0)
    assert process.returncode == 2
    assert errors.startswith("demo: there is no scene 'nowhere': give none, table, or a file like nowhere.yaml")


def running_with(text: str) -> list[int]:
    """Processes whose command line holds a text."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit() and text in (folder / "cmdline").read_text():
                found.append(int(folder.name))
        except OSError:  # it has ended meanwhile
            continue
    return found


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_demo_with_its_processes(tmp_path: Path, number: int) -> None:
    process = demo_process(tmp_path)
    assert process.stdout is not None
    for line in process.stdout:
        if "run 1 of 3" in line:
            break
    os.kill(process.pid, number)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 130, errors
    assert "interrupted" in errors
    assert "Traceback" not in errors
    assert running_with(str(tmp_path)) == []
