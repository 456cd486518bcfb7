"""One obstacle, two detours: without one the arm stops in front of it, with one it comes to its goal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from geodesic_motion_ros.utils.errors import ParameterError
from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.detours import Detours, DetoursReport


@pytest.fixture(scope="module")
def report() -> DetoursReport:
    return Detours("panda_pouring", (0.0, 0.2), 0.04, 0.5, 0.2).measure(Path())


def test_it_stops_without_a_detour_and_passes_with_one(report: DetoursReport) -> None:
    stopped, passed = report.runs
    assert not stopped.reached
    assert stopped.reason
    assert stopped.displacement == 0.0
    assert passed.reached
    assert 0.0 < passed.displacement <= 0.2
    assert min(stopped.clearance, passed.clearance) > 0.0


def test_what_is_handed_over_is_complete(report: DetoursReport, tmp_path: Path) -> None:
    content = json.loads(write_json(tmp_path / "figures.json", report.as_dict()).read_text())
    assert [run["reached"] for run in content["runs"]] == [False, True]
    assert len(report.table().splitlines()) == 5
    report.draw(tmp_path / "detours.png")
    assert (tmp_path / "detours.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("detours", "radius", "place", "appears"),
    [((), 0.04, 0.5, 0.2), ((0.31,), 0.04, 0.5, 0.2), ((0.1,), 0.0, 0.5, 0.2), ((0.1,), 0.04, 0.5, 0.6)],
)
def test_what_cannot_be_played_is_refused(detours, radius: float, place: float, appears: float) -> None:
    with pytest.raises(ParameterError):
        Detours("panda_pouring", detours, radius, place, appears)
