"""The rate under a moving goal is measured on the two real nodes, and impossible measurements are refused."""

from __future__ import annotations

import os

import pytest

from geodesic_motion_ros.errors import ParameterError
from geodesic_motion_ros.nodes.goal_rate import measure_goal_rate, table


@pytest.mark.realtime
def test_both_stretches_are_measured_and_the_goals_really_move(tmp_path):
    domain = int(os.environ["ROS_DOMAIN_ID"])
    stays, moves = measure_goal_rate("panda_pouring", tmp_path, seconds=1.5, goals_hz=10.0, obstacles=3, domain=domain)
    assert stays.goals == 1
    assert moves.goals >= 10
    for row in (stays, moves):
        assert row.rate > 0.0
        assert 0.0 < row.tick_p50 <= row.tick_p99
    # Beside the way obstacles are felt and block nothing.
    assert stays.ok_percent == 100.0
    assert stays.name in table([stays, moves])


@pytest.mark.parametrize("wrong", [{"seconds": 0.0}, {"goals_hz": -1.0}, {"obstacles": -1}])
def test_impossible_measurements_are_refused(tmp_path, wrong):
    with pytest.raises(ParameterError, match="must be positive"):
        measure_goal_rate("panda_pouring", tmp_path, **wrong)
