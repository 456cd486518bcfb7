"""What doc/controller.md shows of controllers is so."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from geodesic_motion_ros.robot.swivel import elbow_position

PAGES = Path(__file__).resolve().parents[1] / "doc"


@pytest.fixture(scope="module")
def plots() -> ModuleType:
    spec = importlib.util.spec_from_file_location("controller_plots", PAGES / "controller_plots.py")
    module = sys.modules["controller_plots"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def planner(plots: ModuleType) -> Any:
    return plots.Planner()


@pytest.fixture(scope="module")
def free(plots: ModuleType, planner: Any) -> Any:
    return planner.run(9.0)


@pytest.fixture(scope="module")
def elbow(plots: ModuleType, planner: Any, free: Any) -> np.ndarray:
    return elbow_position(planner.robot, free[round(plots.ELBOW_AT / plots.TICK)].configuration)


@pytest.fixture(scope="module")
def avoiding(planner: Any, elbow: np.ndarray) -> Any:
    return planner.run(3.0, elbow)


def test_trajectories_take_over_in_motion_without_a_step(plots, planner, avoiding):
    motion, steps = plots.controlled(planner.start, plots.messages(avoiding), 3.0)
    assert steps == []
    assert len([time for time, _ in plots.messages(avoiding) if time >= plots.APPEARS - 1e-9]) >= 2
    moving = motion.states[np.searchsorted(motion.times, plots.APPEARS), 1]
    assert np.max(np.abs(moving)) > 0.2
    assert np.max(np.abs(np.diff(motion.states[:, 2], axis=0))) < 1e-3 * np.max(planner.planner.limits.jerk)


def test_a_late_one_is_a_step_or_refused_and_an_expected_one_neither(plots, planner, elbow, avoiding):
    arrivals = plots.late_stop(avoiding)
    _, steps = plots.controlled(planner.start, arrivals, 2.0)
    assert len(steps) == 1
    motion, refused = plots.driven(planner, arrivals, 6.0)
    assert len(refused) == 1
    assert "does not continue" in refused[0]
    assert not np.any(motion.states[-1, 1:])

    foreseen = plots.late_stop(planner.run(2.0, elbow, transit=plots.LATE))
    assert plots.controlled(planner.start, foreseen, 2.0)[1] == []
    assert plots.driven(planner, foreseen, 2.0)[1] == []


def test_after_silence_the_arm_comes_to_rest(plots, planner, free):
    heard = [cycle for cycle in free if cycle.now < plots.SILENT]
    going, resting = (
        plots.controlled(planner.start, plots.messages(heard), until)[0].states[-1, 1]
        for until in (plots.SILENT + 0.5, plots.SILENT + plots.PLANNER["horizon"] + 1.0)
    )
    assert np.max(np.abs(going)) > 0.1
    assert not np.any(resting)


def test_the_page_shows_every_plot_and_they_are_small(plots):
    shown = {file.name for file in (PAGES / "controller").iterdir()}
    page = (PAGES / "controller.md").read_text()
    assert shown
    assert [name for name in shown if f"(controller/{name})" not in page] == []
    assert all((PAGES / "controller" / name).stat().st_size < 100_000 for name in shown)
