"""Ticks among moving spheres: what the scenes are, that plays are alike, and what the report holds."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from geodesic_motion_ros.certification.arm_clearance import obstacle_clearance
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.benchmarks.moving import MovingBench, MovingTicks, NewGoals, recorded_searches
from geodesic_motion_studies.benchmarks.moving_report import MovingReport, MovingSettings, measure_moving
from geodesic_motion_studies.benchmarks.stopwatch import Stopwatch

SKILLS = ("panda_pouring", "panda_reach_to_grasp")
TINY = MovingSettings(motions=1, plays=1, compared=2)
PERCENTILES = {"p50", "p99", "max"}


@pytest.fixture(scope="module", params=SKILLS)
def bench(request: pytest.FixtureRequest) -> MovingBench:
    return MovingBench(Skill.load(request.param), motions=1, plays=2)


@pytest.fixture(scope="module")
def report() -> MovingReport:
    return measure_moving([Skill.load(name) for name in SKILLS], (0, 1), TINY, show_progress=False)


def test_spheres_cross_the_motion_at_the_promised_speeds(bench: MovingBench) -> None:
    motion = bench.motions[0]
    obstacles = bench.spheres(motion, 20, np.random.default_rng(0))
    speeds = np.linalg.norm(obstacles.velocities, axis=1)
    assert np.all((speeds >= 0.05) & (speeds <= 0.5))
    nearest = np.full(20, np.inf)
    for share, place in zip(np.linspace(0.0, 1.0, len(motion.tool)), motion.tool, strict=True):
        centres = obstacles.at(share * motion.duration, motion.duration).centres
        nearest = np.minimum(nearest, np.linalg.norm(centres - place, axis=1) - obstacles.radii)
    assert np.all(nearest < 0.0)


@pytest.mark.parametrize("count", [0, 5])
def test_nothing_is_at_the_arm_as_a_motion_begins(bench: MovingBench, count: int) -> None:
    motion = bench.motions[0]
    obstacles = bench.spheres(motion, count, np.random.default_rng(1))
    assert obstacle_clearance(bench.planner.collision, bench.planner.robot, motion.start, obstacles)[0] > 0.05
    assert not obstacles.is_static


def test_the_same_seed_makes_the_same_spheres(bench: MovingBench) -> None:
    one, other = (bench.spheres(bench.motions[0], 3, np.random.default_rng(2)) for _ in range(2))
    np.testing.assert_array_equal(one.centres, other.centres)


def test_ticks_are_counted_once_however_often_a_motion_is_played(bench: MovingBench) -> None:
    motion, ticks = bench.motions[0], MovingTicks()
    bench.ticks(motion, bench.spheres(motion, 0, np.random.default_rng(0)), ticks, 2)
    assert 100.0 * motion.duration * 0.8 < len(ticks.every.cpu) < 100.0 * (motion.duration + 3.0) + 1.0
    assert 0 < len(ticks.searched.cpu) < len(ticks.every.cpu)
    assert len(ticks.searches.cpu) == len(ticks.one_sided.cpu) == len(ticks.plain.cpu) == 2
    assert ticks.error < 1e-9


def test_every_new_goal_gets_a_reference(bench: MovingBench) -> None:
    goals = NewGoals()
    bench.new_goals(bench.motions[0], np.random.default_rng(0), goals)
    assert goals.without == 0
    assert len(goals.watch.cpu) == 3


def test_searches_are_recorded_inside_alone(bench: MovingBench) -> None:
    start, goal = bench.motions[0].start, bench.motions[0].goal
    pose = bench.planner.robot.forward(start)
    with recorded_searches() as searches:
        bench.planner.plan(*pose, goal[:3], goal[3:])
        count = len(searches)
        assert count > 0
    bench.planner.plan(*pose, goal[:3], goal[3:])
    assert len(searches) == count


def test_the_report_has_every_skill_and_number(report: MovingReport, tmp_path: Path) -> None:
    write_json(tmp_path / "bench.json", report.as_dict())
    content = json.loads((tmp_path / "bench.json").read_text())
    assert tuple(content) == SKILLS
    for figures in content.values():
        assert set(figures["moving"]) == {"0", "1"}
        for row in figures["moving"].values():
            assert set(row["cpu_ms"]) == set(row["searched_cpu_ms"]) == PERCENTILES
            assert row["cost_error_max"] < 1e-9
        assert set(figures["new_goal"]["cpu_ms"]) == PERCENTILES


def test_the_tables_fit_a_terminal(report: MovingReport) -> None:
    lines = report.table().splitlines()
    assert max(map(len, lines)) <= 120
    assert sum(line.startswith(SKILLS) for line in lines) == 4 * len(SKILLS)


def test_the_fastest_of_several_counts_each_time_by_itself() -> None:
    one, other = Stopwatch(), Stopwatch()
    one.wall, one.cpu = [1.0, 4.0], [0.5, 3.0]
    other.wall, other.cpu = [2.0, 3.0], [0.4, 3.5]
    fastest = Stopwatch.fastest([one, other])
    assert (fastest.wall, fastest.cpu) == ([1.0, 3.0], [0.4, 3.0])
