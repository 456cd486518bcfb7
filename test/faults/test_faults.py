"""Some quick faults on the real nodes, each of another family; all of them run by `geodesic-motion faults`."""

from __future__ import annotations

import os

import pytest

from geodesic_motion_ros.nodes.faults.catalogue import chosen
from geodesic_motion_ros.nodes.faults.suite import cases, run_cases

# What moves in real time does so evenly where it has the machine to itself.
pytestmark = pytest.mark.realtime

#: Faults, and the phase in which they are injected here.
QUICK = {
    "state_stops": "motion", "state_lacks_joint": "start", "goal_unknown_frame": "motion", "all_blocked": "motion",
    "planner_stopped": "motion", "skill_altered": "start",
}  # fmt: skip


def test_quick_faults_pass(tmp_path) -> None:
    todo = [case for name, phase in QUICK.items() for case in cases(chosen([name], False), [phase], [0])]
    rows = list(run_cases("panda_reach_to_grasp", tmp_path, int(os.environ["ROS_DOMAIN_ID"]), todo))
    assert len(rows) == len(QUICK)
    assert all(row.passed for row in rows), "\n".join(f"{row.name}: {row.measured}" for row in rows)
