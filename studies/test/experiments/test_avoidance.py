from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.avoidance import (
    Avoidance,
    carried,
    measured_clearance,
)
from geodesic_motion_studies.experiments.trained import Trained


@pytest.fixture(scope="module")
def reaches(fan_skill) -> Demonstrations:
    """What the fan was trained on, as it has learned it."""
    items = []
    for number, code in enumerate(fan_skill.codes[: len(fan_skill.codes) // 2]):
        decoded = fan_skill.decoder.decode(code)
        times = np.linspace(0.0, 4.0, len(code))
        items.append(Demonstration(decoded.positions, continuous_signs(decoded.quaternions), times, f"reach {number}"))
    return Demonstrations(tuple(items))


@pytest.fixture(scope="module")
def trained(fan_skill, reaches) -> Trained:
    """The fan, queried for two motions it was trained on."""
    return Trained("fan", (1, 4), 0, fan_skill, reaches, Demonstrations((reaches[1], reaches[4])))


@pytest.fixture(scope="module")
def settings() -> Avoidance:
    return Avoidance(radii=(0.02, 0.25), scenes=3)


@pytest.fixture(scope="module")
def report(trained, settings):
    return settings.measured([trained])


def test_small_spheres_are_passed_and_what_covers_everything_is_declared_infeasible(report) -> None:
    small = [scene for scene in report.scenes if scene.radius == 0.02]
    large = [scene for scene in report.scenes if scene.radius == 0.25]
    assert len(small) == 6
    assert large
    assert {scene.freedom for scene in small} == {"half free"}
    assert {scene.freedom for scene in large} == {"none free"}
    assert sum(scene.answered for scene in small) >= 5
    assert not any(scene.answered for scene in large)
    assert not any(scene.through for scene in report.scenes)
    assert all(scene.measured > 0.0 for scene in small if scene.answered)


def test_the_planner_never_promises_more_clearance_than_is_measured(report) -> None:
    for scene in report.scenes:
        if scene.answered:
            assert scene.certified <= scene.measured + 1e-9


def test_without_avoidance_the_same_scenes_are_run_through(trained, settings) -> None:
    off = replace(settings, radii=(0.02,), planner=replace(settings.planner, avoidance=False))
    scenes = off.measured([trained]).scenes
    assert len(scenes) == 6
    assert all(scene.through for scene in scenes)


def test_a_tool_counts_like_a_larger_sphere(trained, report) -> None:
    with_tool = Avoidance(radii=(0.01,), tool_radius=0.01, scenes=3)
    scenes = with_tool.measured([trained]).scenes
    without = [scene for scene in report.scenes if scene.radius == 0.02]
    assert [scene.free_share for scene in scenes] == [scene.free_share for scene in without]
    assert not any(scene.through for scene in scenes)


def test_the_same_seed_makes_the_same_scenes(trained, settings, report) -> None:
    again = settings.measured([trained]).scenes
    assert [scene.centre for scene in again] == [scene.centre for scene in report.scenes]
    other = replace(settings, seed=1).measured([trained]).scenes
    assert other[0].centre != report.scenes[0].centre


def test_clearance_is_measured_between_samples_and_at_the_tools_points() -> None:
    upright = np.array([[1.0, 0.0, 0.0, 0.0]] * 2)
    curve = PoseCurve(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), upright)
    ball = (np.array([0.4, 0.1, 0.0]), 0.03)
    assert measured_clearance(curve, *ball, PlannerSettings(tool_radii=(0.02,))) == pytest.approx(0.05, abs=1e-6)
    tip = PlannerSettings(tool_points=((0.0, 0.1, 0.0),), tool_radii=(0.0,))
    assert measured_clearance(curve, *ball, tip) == pytest.approx(-0.03, abs=1e-4)
    still = PoseCurve(np.zeros((2, 3)), upright)
    assert measured_clearance(still, np.array([0.0, 0.0, 0.5]), 0.1, tip) == pytest.approx(np.hypot(0.5, 0.1) - 0.1)


def test_carried_demonstrations_meet_both_ends(reaches) -> None:
    start, goal = reaches[0].curve.start, reaches[6].curve.goal
    for curve in carried(reaches, (start[0] + 0.01, start[1]), goal):
        np.testing.assert_allclose(curve.positions[[0, -1]], [start[0] + 0.01, goal[0]], atol=1e-12)


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "avoidance.json", report.as_dict()).read_text())
    assert len(content["scenes"]) == len(report.scenes)
    counted = [figures["scenes"] for figures in content["summary"].values()]
    assert sum(counted) == len(report.scenes)
    assert content["summary"]["none free"]["infeasible_percent"] == 100.0
    assert "fan, 20 mm" in report.table()
    report.draw(tmp_path / "avoidance.png")
    assert (tmp_path / "avoidance.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"radii": ()}, "at least one"), ({"radii": (0.0,)}, "all positive"), ({"tool_radius": -0.1}, "tool_radius"),
     ({"scenes": 0}, "at least 1")],
)  # fmt: skip
def test_impossible_settings_are_refused(wrong, message) -> None:
    with pytest.raises(ParameterError, match=message):
        Avoidance(**wrong)
