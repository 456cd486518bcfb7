"""An arm that lags: it passes where it was sent, later, and methods that count that are given the measured joints."""

from __future__ import annotations

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_studies.comparison.arena import Arena
from geodesic_motion_studies.comparison.execution import Stage
from geodesic_motion_studies.comparison.lag import LateStage
from geodesic_motion_studies.comparison.methods.geodesic import Geodesics
from geodesic_motion_studies.comparison.methods.replay import Replay
from geodesic_motion_studies.comparison.report import Report
from geodesic_motion_studies.comparison.results import Played
from geodesic_motion_studies.comparison.run import BenchmarkSettings
from geodesic_motion_studies.comparison.scene import draw_scene

#: So late is the arm [s]: so many of the postures that the judge keeps, 50 a second.
LAG, POSTURES = 0.1, 5
COARSE = PlannerSettings(grid_shape=(30, 30, 30))


@pytest.fixture(scope="module")
def arena(reach_skill: Skill) -> Arena:
    return Arena.of(reach_skill)


def test_an_arm_that_lags_passes_where_it_was_sent_later(arena) -> None:
    scene, replay = draw_scene(arena, "none", 0, 0), Replay(arena)
    prompt, sent = Stage(arena).play(scene, replay)
    late, lagging = LateStage(arena, LAG).play(scene, replay)
    assert prompt.success
    assert late.success
    assert late.duration == pytest.approx(prompt.duration + LAG, abs=0.02)
    count = len(sent) - 1
    np.testing.assert_allclose(lagging[POSTURES : POSTURES + count], sent[:count], atol=2e-3)
    # As far behind as the fastest of its spheres moves in that time.
    body = arena.body(sent[:count])
    moved = np.linalg.norm(body[POSTURES:] - body[:-POSTURES], axis=-1)
    assert late.lag == pytest.approx(np.max(moved), abs=3e-3)
    assert prompt.lag == 0.0


def test_ours_is_given_the_measured_joints_and_counts_them(arena) -> None:
    scene, tracked = draw_scene(arena, "none", 0, 0), []

    class Listening(Geodesics):
        def track(self, measured: np.ndarray, now: float) -> None:
            super().track(measured, now)
            tracked.append((now, measured))

    outcome, _ = LateStage(arena, LAG).play(scene, Listening(arena, planner=COARSE))
    assert outcome.success
    assert len(tracked) == outcome.ticks
    np.testing.assert_allclose(tracked[0][1], scene.start, atol=1e-6)


def test_results_of_an_arm_that_lags_are_kept_apart_and_said(reach_skill, tmp_path, arena) -> None:
    folders = {
        BenchmarkSettings(("replay",), lag=lag).results_folder(tmp_path, reach_skill) for lag in (0.0, 0.1, 0.12)
    }
    assert len(folders) == 3
    outcome, _ = LateStage(arena, LAG).play(draw_scene(arena, "none", 0, 0), Replay(arena))
    report = Report("reach", 0, [Played("replay", "none", 0, {}, outcome)], {"replay": "the control"}, lag=LAG)
    assert f"0.1 s late, up to {1e3 * outcome.lag:.0f} mm behind" in report.plain()
    assert report.as_dict()["largest_lag_mm"] == 1e3 * outcome.lag


@pytest.mark.parametrize("lag", [-0.1, 0.005, 2.0, np.nan])
def test_a_lag_that_is_none_is_refused(lag: float) -> None:
    with pytest.raises(ParameterError, match="must be a multiple"):
        BenchmarkSettings(("ours",), lag=lag)
