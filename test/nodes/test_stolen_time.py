"""The share of time that a host has taken, by a table of counters like the kernel's."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from geodesic_motion_ros.nodes import stolen_time
from geodesic_motion_ros.nodes.stolen_time import StolenTime


def test_it_is_the_share_of_what_the_counters_have_grown_by(tmp_path, monkeypatch):
    counters = tmp_path / "stat"
    monkeypatch.setattr(stolen_time, "_COUNTERS", counters)
    counters.write_text("cpu  1000 20 300 4000 50 6 7 80 0 0\ncpu0 1 2 3 4 5 6 7 8 0 0\n")
    stolen = StolenTime()
    assert math.isnan(stolen.percent())
    counters.write_text("cpu  1100 20 340 4040 50 6 7 100 0 0\ncpu0 1 2 3 4 5 6 7 8 0 0\n")
    assert stolen.percent() == pytest.approx(10.0)


def test_where_the_system_does_not_tell_it_is_not_known(tmp_path, monkeypatch):
    monkeypatch.setattr(stolen_time, "_COUNTERS", tmp_path / "none")
    assert math.isnan(StolenTime().percent())


@pytest.mark.skipif(not Path("/proc/stat").exists(), reason="only Linux has these counters")
def test_this_machine_tells():
    stolen = StolenTime()
    while math.isnan(stolen.percent()):
        pass
    assert 0.0 <= stolen.percent() <= 100.0
