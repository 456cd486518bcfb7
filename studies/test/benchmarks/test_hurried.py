"""Ticks with a deadline against those without."""

from __future__ import annotations

import pytest

from geodesic_motion_studies.benchmarks import hurried
from geodesic_motion_studies.benchmarks.engine import mark, search
from geodesic_motion_studies.benchmarks.hurried import HurriedTicks
from geodesic_motion_studies.benchmarks.scenes import scenes_of, spheres_on_path
from geodesic_motion_studies.benchmarks.synthetic import synthetic_problem


def test_with_time_enough_every_tick_is_decided_and_no_path_could_be_cheaper() -> None:
    problem = synthetic_problem((9, 9, 9))
    for scene in scenes_of(problem):
        ticks = HurriedTicks.of(problem, scene, 3)
        without = sum(search(problem, mark(problem, scene.at(tick))).cost == float("inf") for tick in range(3))
        assert ticks.undecided == pytest.approx(0.0)
        assert round(3 * ticks.refused) == without
        assert len(ticks.gaps) == 3 - without
        assert not any(ticks.gaps)


def test_without_time_what_is_found_has_a_gap_and_the_rest_is_undecided(monkeypatch) -> None:
    monkeypatch.setattr(hurried, "_ALLOWANCE", 1.0)
    problem = synthetic_problem((25, 25, 25))
    ticks = HurriedTicks.of(problem, spheres_on_path(problem, 10), 3)
    assert ticks.refused == 0.0
    assert ticks.undecided > 0.0 or ticks.gap > 0.0
