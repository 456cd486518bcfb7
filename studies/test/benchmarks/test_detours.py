"""Detours among spheres: what the scenes are, and what the report holds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.contract.status import VerdictCode
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.benchmarks.detours import DetourBench, DetourTimes
from geodesic_motion_studies.benchmarks.detours_report import DetourBenchSettings, DetourReport, measure_detours

TINY = DetourBenchSettings(motions=1, scenes=2, plays=1)


@pytest.fixture(scope="module")
def bench() -> DetourBench:
    return DetourBench(Skill.load("panda_pouring"), motions=1, plays=2, seed=0)


@pytest.fixture(scope="module")
def report() -> DetourReport:
    return measure_detours([Skill.load("panda_reach_to_grasp")], (1, 3), TINY, show_progress=False)


@pytest.mark.parametrize("count", [1, 5])
def test_spheres_block_the_planner_and_leave_the_ends_free(bench: DetourBench, count: int) -> None:
    motion, planner = bench.motions[0], bench.planner
    obstacles = bench.spheres(motion, count, np.random.default_rng(0))
    assert len(obstacles.radii) == count
    assert np.all((obstacles.radii >= 0.03) & (obstacles.radii <= 0.06))
    for end in (motion.query.start, motion.query.goal):
        assert obstacle_clearance(planner.collision, planner.robot, end, obstacles)[0] > 2.0 * bench.margin
    planner.take_obstacles(obstacles)
    assert planner.set_detour(0.0).ok
    goal = planner.prepare_configuration(motion.query.goal).goal
    assert planner.plan_configurations(motion.query.start, goal).verdict.code is VerdictCode.NO_FEASIBLE_PATH


def test_the_same_seed_makes_the_same_spheres(bench: DetourBench) -> None:
    one, other = (bench.spheres(bench.motions[0], 3, np.random.default_rng(2)) for _ in range(2))
    np.testing.assert_array_equal(one.centres, other.centres)


def test_a_scene_counts_once_however_often_it_is_solved(bench: DetourBench) -> None:
    times, random = DetourTimes(), np.random.default_rng(1)
    for _ in range(2):
        bench.measure(bench.motions[0], bench.spheres(bench.motions[0], 1, random), times)
    assert times.found + times.refusals.total() == 2
    assert 0 < len(times.first.cpu) <= times.found
    assert 0 < len(times.band.cpu) <= len(times.gains) <= times.found
    assert 0.0 < max(times.gains) < 1.0


def test_the_report_has_every_number_of_spheres(report: DetourReport, tmp_path: Path) -> None:
    write_json(tmp_path / "bench.json", report.as_dict())
    content = json.loads((tmp_path / "bench.json").read_text())
    assert tuple(content) == ("panda_reach_to_grasp",)
    for figures in content.values():
        assert set(figures) == {"1", "3"}
        for row in figures.values():
            assert row["found"] + sum(row["refusals"].values()) == 2
            assert set(row["first_cpu_ms"]) == set(row["band_cpu_ms"]) == {"p50", "p99", "max"}


def test_the_table_fits_a_terminal(report: DetourReport) -> None:
    lines = report.table().splitlines()
    assert max(map(len, lines)) <= 120
    assert sum(line.startswith("panda_reach_to_grasp") for line in lines) == 2
