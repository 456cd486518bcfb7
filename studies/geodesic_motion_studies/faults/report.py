"""Rows as tables: plain text with a line for each, Markdown with a line for each fault. Knows nothing of ROS."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from geodesic_motion_ros.utils.tables import text_table
from geodesic_motion_studies.faults.fault import Figure, Row

_SAID = {True: "yes", False: "NO", None: "skipped"}


def table(rows: Sequence[Row]) -> str:
    """The rows as plain text."""
    cells = [(row.name, row.phase, row.seed, _SAID[row.passed], row.criterion, row.measured) for row in rows]
    return text_table(("fault", "phase", "seed", "pass", "criterion", "measured"), cells, left=(0, 1, 4, 5))


def markdown(rows: Sequence[Row]) -> str:
    """A table in Markdown: of each fault the worst of every figure, over phases and seeds; then what did not pass."""
    faults: dict[str, list[Row]] = {}
    for row in rows:
        faults.setdefault(row.name, []).append(row)
    lines = ["| fault | phases | criterion | worst measured | passed |", "|---|---|---|---|---|"]
    for name, of in faults.items():
        phases = ", ".join(dict.fromkeys(row.phase for row in of))
        cells = (f"`{name}`", phases, of[0].criterion, _worst(row.figures for row in of), _passed(of))
        lines.append(f"| {' | '.join(map(_cell, cells))} |")
    others = [
        f"- `{row.name}`, {row.phase}, seed {row.seed}: {'did not pass: ' if row.passed is False else ''}{row.measured}"
        for row in rows
        if not row.passed
    ]
    return "\n".join([*lines, *(["", *others] if others else [])]) + "\n"


def _passed(rows: Sequence[Row]) -> str:
    run = [row for row in rows if row.passed is not None]
    if not run:
        return _SAID[None]
    passed = sum(bool(row.passed) for row in run)
    return f"{passed} of {len(run)}" if passed == len(run) else f"**{passed} of {len(run)}**"


def _worst(figures: Iterable[Sequence[Figure]]) -> str:
    worst: dict[str, Figure] = {}
    for figure in (figure for of in figures for figure in of):
        before = worst.get(figure.name)
        if before is None or math.isnan(figure.value) or figure.value > before.value:
            worst[figure.name] = figure
    return "; ".join(
        f"{figure.name} {figure.value:.3g} of {figure.limit:g} {figure.unit}".rstrip() for figure in worst.values()
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<=", "≤")
