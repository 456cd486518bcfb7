"""The held-out table, of invented measurements."""

import json
import math

import pytest

from geodesic_motion_ros.utils.tables import write_json
from geodesic_motion_studies.experiments.crossing import GRAPHS, Crossing, Judged
from geodesic_motion_studies.experiments.imitation_report import COLUMNS, ROWS, ImitationReport, Measurement


def measured(row: str, *dtw_mm: float) -> list[Measurement]:
    return [Measurement(row, number, 0, {"dtw_mm": value}) for number, value in enumerate(dtw_mm)]


@pytest.fixture
def report() -> ImitationReport:
    """Two held-out demonstrations; the planner refused the second on the raw sheet."""
    measurements = [
        *measured("geodesic", 10.0, 14.0), *measured("conditional_mean", 9.0, 11.0),
        *measured("sheet_oracle", 3.0, 4.0), *measured("promp", 5.0, math.nan), *measured("geodesic_raw", 20.0),
        Measurement("geodesic_raw", 1, 0, {"off_manifold": 1.0}, "NO_FEASIBLE_PATH: all blocked"),
    ]  # fmt: skip
    people = {"dtw_mm": 8.0, "frechet_mm": 16.0, "orientation_deg": math.nan}
    return ImitationReport("cup", ((0, 1),), (0,), people, tuple(measurements))


def test_a_row_is_the_mean_of_its_measurements_that_have_a_value(report):
    rows = report.rows
    assert tuple(rows) == ROWS
    assert rows["geodesic"]["dtw_mm"] == pytest.approx(12.0)
    assert rows["promp"]["dtw_mm"] == pytest.approx(5.0)
    assert rows["latent_line"]["dtw_mm"] is None
    assert (rows["people"]["dtw_mm"], rows["people"]["orientation_deg"]) == (8.0, None)


def test_a_refusal_is_counted_and_in_no_mean_but_that_of_the_support(report):
    raw = report.rows["geodesic_raw"]
    assert (raw["unanswered"], raw["dtw_mm"], raw["off_manifold"]) == (1, 20.0, 1.0)
    assert "geodesic_raw: 1 prediction(s) without an answer, not in the means" in report.table().splitlines()


def test_json_is_valid_and_round_trips(report, tmp_path):
    write_json(tmp_path / "deep" / "cup.json", report.as_dict())

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    read = json.loads((tmp_path / "deep" / "cup.json").read_text(), parse_constant=refuse)
    assert read["task"] == "cup"
    assert read["seeds"] == [0]
    assert read["folds"] == [[0, 1]]
    assert read["rows"] == report.rows
    assert read["crossing"] is None
    assert [item["refusal"] for item in read["held_out"] if item["row"] == "geodesic_raw"] == [
        None, "NO_FEASIBLE_PATH: all blocked",
    ]  # fmt: skip
    assert [item["dtw_mm"] for item in read["held_out"] if item["row"] == "promp"] == [5.0, None]


def test_the_table_has_a_line_a_row(report):
    lines = report.table().splitlines()
    assert lines[0] == "cup: held out 0,1, seeds 0"
    for row in ROWS:
        (line,) = [line for line in lines if line.startswith(f"{row} ")]
        shown = report.rows[row]["dtw_mm"]
        assert line.split()[1] == ("-" if shown is None else f"{shown:.2f}")
        assert len(line.split()) == 1 + len(COLUMNS)


def test_the_table_says_where_the_error_comes_from(report):
    (words,) = [line for line in report.table().splitlines() if line.startswith("where the geodesic's")]
    for number in ("12.0 mm come from", "3.5 mm no path", "10.0 mm the demonstrations' mean", "+2.0 mm"):
        assert number in words


def test_crossings_are_reported_by_their_median_and_how_many_are_refused(report):
    crossings = tuple(
        Crossing(1.0, ratio, 1.0, 1.0, True, judged_within={}, judged_across={GRAPHS[0]: Judged(True, 1, refused)})
        for ratio, refused in ((4.0, True), (8.0, True), (2.0, False))
    )
    crossed = ImitationReport(report.task, report.folds, report.seeds, report.people, report.measurements, crossings)
    assert "4 times the energy within (median), refused for its energy 2 of 3" in crossed.table()
    assert crossed.as_dict()["crossing"] == {"median_energy_ratio": 4.0, "refused_for_energy": pytest.approx(2.0 / 3.0)}
