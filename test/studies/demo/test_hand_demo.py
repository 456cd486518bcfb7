"""The demo of a skill of the tool, with real processes: `make demo ARGS='--skill panda_pouring'`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from geodesic_motion_ros.demo import demo_node


@pytest.mark.realtime
def test_the_hand_hits_without_avoidance_and_passes_with_it(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "geodesic_motion_ros.demo.demo_node", "--skill", "panda_pouring", "--no-pictures"]
    command += ["--out", str(tmp_path), "--domain", os.environ["ROS_DOMAIN_ID"]]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280.0)
    assert done.returncode == 0, done.stderr
    assert all(run.title in done.stdout for run in demo_node.RUNS)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["passed"], done.stderr
    assert "families" not in summary
    assert summary["avoidance_off"]["contacts"] > 0 or summary["avoidance_off"]["min_clearance_mm"] < 0.0
    assert summary["avoidance_on"]["contacts"] == 0
    assert summary["avoidance_on"]["min_clearance_mm"] > 0.0
