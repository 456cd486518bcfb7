"""Some quick faults on the real nodes, each of another family; all of them run by `geodesic-motion faults`."""

from __future__ import annotations

import os

import pytest

from geodesic_motion_ros.nodes.faults.catalogue import chosen
from geodesic_motion_ros.nodes.faults.suite import cases, run_cases

# What moves in real time does so evenly where it has the machine to itself.
pytestmark = pytest.mark.realtime

#: It moves slowly: an arm that a busy machine simulates can follow.
SKILL = "panda_pouring"
#: Faults, and the phase in which they are injected here.
QUICK = {
    "state_stops": "motion", "obstacles_silent": "motion", "all_blocked": "goal", "planner_stopped": "motion",
    "skill_altered": "start",
}  # fmt: skip


#: A machine that others share stands still for longer than criteria allow, now and then: then a fault is run again.
RUNS = 3


def test_quick_faults_pass(tmp_path) -> None:
    todo = [case for name, phase in QUICK.items() for case in cases(chosen([name], False), [phase], [0])]
    domain, said = int(os.environ["ROS_DOMAIN_ID"]), ""
    assert len(todo) == len(QUICK)
    for _ in range(RUNS):
        rows = list(run_cases(SKILL, tmp_path, domain, todo))
        said += "".join(f"{row.name}: {row.measured}\n" for row in rows if not row.passed)
        todo = [case for case, row in zip(todo, rows, strict=True) if not row.passed]
        if not todo:
            return
    pytest.fail(said)
