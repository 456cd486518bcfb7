"""The tables of rows: what failed and what was skipped, and of each fault the worst."""

from __future__ import annotations

import math

from geodesic_motion_studies.faults.fault import Figure, Row
from geodesic_motion_studies.faults.report import markdown, table


def row(name: str, phase: str, passed: bool | None, *figures: float) -> Row:
    return Row(name, phase, 0, "c <= 1 | d", "m", passed, tuple(Figure("late", value, 0.1, "s") for value in figures))


def test_the_table_says_what_failed_and_what_was_skipped() -> None:
    rows = [row(name, "goal", passed) for name, passed in {"a": True, "b": False, "d": None}.items()]
    said = [line.split()[3] for line in table(rows).splitlines()[2:]]
    assert said == ["yes", "NO", "skipped"]
    assert rows[1].as_dict()["pass"] is False


def test_in_markdown_a_fault_has_a_line_with_the_worst_of_its_figures_and_what_failed_follows() -> None:
    rows = [
        row("stops", "start", True, 0.02, 0.05), row("goes", "start", None), row("stops", "motion", False, 0.2),
        row("waits", "start", True, 0.3, math.nan),
    ]  # fmt: skip
    lines = markdown(rows).splitlines()
    assert lines[2:5] == [
        "| `stops` | start, motion | c ≤ 1 \\| d | late 0.2 of 0.1 s | **1 of 2** |",
        "| `goes` | start | c ≤ 1 \\| d |  | skipped |",
        "| `waits` | start | c ≤ 1 \\| d | late nan of 0.1 s | 1 of 1 |",
    ]
    assert lines[6:] == ["- `goes`, start, seed 0: m", "- `stops`, motion, seed 0: did not pass: m"]


def test_rows_have_their_figures_in_the_file() -> None:
    figures = row("stops", "goal", True, 0.02).as_dict()["figures"]
    assert figures == [{"name": "late", "value": 0.02, "limit": 0.1, "unit": "s"}]
