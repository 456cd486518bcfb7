"""The whole demos, with real processes: they hit without avoidance, and pass with it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from geodesic_motion_ros.demo import demo_node

FIGURES = {
    "rate_hz", "tick_ms_p50", "tick_ms_p99", "deadline_misses", "goal_error_mm", "goal_error_deg", "min_clearance_mm",
    "contacts",
}  # fmt: skip


@pytest.mark.realtime
@pytest.mark.parametrize("skill", [None, "panda_pouring"], ids=["the elbow", "the hand"])
def test_a_demo_hits_without_avoidance_and_passes_with_it(tmp_path: Path, skill: str | None) -> None:
    command = [sys.executable, "-m", "geodesic_motion_ros.demo.demo_node", "--no-pictures", "--out", str(tmp_path)]
    command += ["--domain", os.environ["ROS_DOMAIN_ID"], *(["--skill", skill] if skill else [])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280.0)
    assert done.returncode == 0, done.stderr
    assert all(run.title in done.stdout for run in demo_node.RUNS)
    summary = json.loads((tmp_path / "summary.json").read_text())
    of_the_arm = set() if skill else {"families"}
    runs = {run.key for run in demo_node.RUNS}
    assert set(summary) == {"skill", "parameters", "passed", "warnings"} | of_the_arm | runs
    assert all(set(summary[run]) >= FIGURES for run in runs)
    assert summary["passed"], done.stderr
    assert summary["no_obstacle"]["min_clearance_mm"] is None
    assert summary["avoidance_off"]["contacts"] > 0 or summary["avoidance_off"]["min_clearance_mm"] < 0.0
    assert summary["avoidance_on"]["contacts"] == 0
    assert summary["avoidance_on"]["min_clearance_mm"] > 0.0
    assert {file.name for file in tmp_path.iterdir() if file.is_file()} == {"summary.json"}
