"""The experiment with two modes past a pillar, on a small skill and with controls that must fail."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from geodesic_motion_ros.contract.settings import PlannerSettings
from geodesic_motion_ros.geometry.curves import PoseCurve
from geodesic_motion_ros.learning.settings import TrainingSettings
from geodesic_motion_ros.simulation.teacher import PILLAR, two_mode_demonstrations
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments import modes
from geodesic_motion_studies.experiments.modes import (
    NEAR,
    Answer,
    Modes,
    ModesReport,
    cases_of,
    pillar_clearance,
)

SMALL = TrainingSettings(
    steps=1000, hidden=(64, 32), samples=80, kernels=100, precision_samples=2, precision_iterations=60
)
SETTINGS = Modes(shown=3, cases=4, seeds=(2,), training=SMALL)


@pytest.fixture(scope="module")
def measured(stored_in, tmp_path_factory) -> tuple[ModesReport, Skill]:
    """The report, and the skill that was measured."""
    with stored_in(modes) as taken:
        report = SETTINGS.measure(tmp_path_factory.mktemp("modes"))
    (skill,) = taken
    return report, skill


@pytest.fixture(scope="module")
def report(measured) -> ModesReport:
    return measured[0]


@pytest.fixture(scope="module")
def skill(measured) -> Skill:
    return measured[1]


def test_a_mode_is_followed_and_the_other_taken_when_it_is_blocked(report) -> None:
    assert report.found(2)
    assert len(report.cases) == 4
    for case in report.cases:
        assert case.free.follows
        assert case.blocked.own_free == 0.0
        assert case.blocked.other_free == 1.0
        assert case.blocked.answer.side not in ("", case.free.side)
        assert case.blocked.clearance > 0.0
        assert case.switched


def test_the_mean_of_all_runs_into_the_pillar(report) -> None:
    figures = report.summary()
    assert figures["mean_through_pillar_percent"] == 100.0
    assert figures["mean_follows_percent"] == 0.0
    for case in report.cases:
        assert case.mean.distance > 0.4 * case.mean.between


def test_without_avoidance_nothing_switches(skill) -> None:
    blind = replace(SETTINGS, cases=2, planner=PlannerSettings(avoidance=False))
    for item in cases_of(skill, two_mode_demonstrations(3, 2), 2, blind):
        assert item.case.free.follows
        assert item.case.blocked.clearance < 0.0
        assert not item.case.switched


def test_without_answers_nothing_counts_as_followed(report) -> None:
    silent = replace(report.cases[0], free=Answer("NO_FEASIBLE_PATH", "no path", False), blocked=None)
    figures = replace(report, cases=(silent, *report.cases[1:])).summary()
    assert figures["follow_percent"] == figures["switch_percent"] == 75.0
    assert "seed 2, case 0: NO_FEASIBLE_PATH: no path" in replace(report, cases=(silent,)).table()


def test_what_lies_between_the_modes_or_in_the_pillar_follows_none() -> None:
    followed = Answer("OK", "", True, "left", 0.01, 0.2, pillar=0.05)
    assert followed.follows
    assert not replace(followed, distance=0.2 * NEAR + 0.001).follows
    assert not replace(followed, pillar=-0.001).follows


def test_distance_from_the_pillar_is_that_of_the_tools_spheres() -> None:
    share = np.linspace(0.0, 1.0, 50)[:, None]
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (50, 1))
    middle = np.array([*PILLAR.centre[:2], 0.1])
    past = middle + [0.1, 0.0, 0.0] + (2.0 * share - 1.0) * [0.0, 0.3, 0.0]
    tool = PlannerSettings(tool_radii=(0.02,))
    assert pillar_clearance(PoseCurve(past, upright), tool) == pytest.approx(0.1 - PILLAR.radius - 0.02, abs=1e-3)
    assert pillar_clearance(PoseCurve(past - [0.1, 0.0, 0.0], upright), tool) == pytest.approx(-0.02)
    above = past + [-0.1, 0.0, PILLAR.centre[2] + 0.5 * PILLAR.height + 0.05 - 0.1]
    assert pillar_clearance(PoseCurve(above, upright), tool) == pytest.approx(0.03, abs=1e-3)


def test_what_is_handed_over_is_complete(report, tmp_path) -> None:
    content = json.loads(write_json(tmp_path / "modes.json", report.as_dict()).read_text())
    assert len(content["cases"]) == content["summary"]["cases"] == 4
    assert content["seeds"]["2"]["modes_found"] is True
    assert content["summary"]["switch_percent"] == 100.0
    assert "follow %" in report.table()
    report.draw(tmp_path / "modes.png")
    assert (tmp_path / "modes.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [({"shown": 1}, "at least 2"), ({"cases": 0}, "at least 1"), ({"seeds": ()}, "at least one")],
)
def test_impossible_settings_are_refused(wrong, message) -> None:
    with pytest.raises(ParameterError, match=message):
        Modes(**wrong)
