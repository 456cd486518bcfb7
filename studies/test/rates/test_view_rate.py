"""Drags on the page are answered by the real nodes, and impossible measurements are refused."""

from __future__ import annotations

import os

import pytest

from geodesic_motion_ros.utils.errors import ParameterError

pytest.importorskip("viser", reason="the page's library is not installed: `make view`")

from geodesic_motion_studies.rates import reaction_time, view_rate


@pytest.mark.realtime
def test_spheres_that_are_dragged_into_the_path_are_answered(tmp_path):
    (row,) = view_rate.measure_drags("panda_reach_to_grasp", tmp_path, drags=3, domain=int(os.environ["ROS_DOMAIN_ID"]))
    assert row.spheres == 3
    assert 0 < row.answered <= 3
    assert 0.0 < row.p50 <= row.p99 <= row.worst < 1e3 * reaction_time.SHOWN


def test_impossible_measurements_are_refused(tmp_path):
    with pytest.raises(ParameterError, match="must be positive"):
        view_rate.measure_view("panda_reach_to_grasp", tmp_path, seconds=0.0)
    with pytest.raises(ParameterError, match="must be positive"):
        view_rate.measure_drags("panda_reach_to_grasp", tmp_path, drags=0)
