"""Clouds that show the arm: what is measured is the product's filter, and what the report holds."""

from __future__ import annotations

import json

import pytest

from geodesic_motion_studies.benchmarks.clouds import STEPS, CloudReport, measure_clouds

COUNTS, CLOUDS = (500, 4000), 6


@pytest.fixture(scope="module", params=["panda", "ur5"])
def report(request: pytest.FixtureRequest) -> CloudReport:
    return measure_clouds(request.param, COUNTS, CLOUDS, show_progress=False)


def test_all_of_the_arm_is_dropped_and_the_rest_is_kept(report):
    for count, times in report.times.items():
        # The wall is far from the arm, the table is near its base alone.
        assert 1.0 <= times.dropped < 1.1
        assert 0.7 * count < times.kept < 0.75 * count + times.remembered


def test_each_step_of_each_cloud_has_its_time(report):
    for times in report.times.values():
        assert set(times.watches) == set(STEPS)
        assert {len(watch.cpu) for watch in times.watches.values()} == {CLOUDS}
        assert times.share > 0.0


def test_the_report_is_a_table_and_can_be_written(report):
    written = json.loads(json.dumps(report.as_dict()))
    assert set(written["clouds"]) == set(map(str, COUNTS))
    lines = report.table().splitlines()
    assert [line.split()[0] for line in lines[-len(COUNTS) :]] == list(map(str, COUNTS))
