"""The benchmark's page and what others repeat of it: rows are those of the code, totals the sums of their parts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from geodesic_motion_studies.comparison.catalogue import ROWS
from geodesic_motion_studies.comparison.report import wilson

REPOSITORY = Path(__file__).resolve().parents[3]
Table = dict[str, dict[str, str]]


def tables(file: str, corner: str) -> list[Table]:
    """The tables of a Markdown file whose first head matches: cells by their row's first cell and by their head, the
    first of two that are called alike.
    """
    found = []
    for lines in re.findall(r"(?:^\|.*\n)+", (REPOSITORY / file).read_text(), flags=re.MULTILINE):
        head, _, *rows = [[cell.strip(" *") for cell in line.strip("|\n").split("|")] for line in lines.splitlines()]
        if re.fullmatch(corner, head[0]):
            columns = {name: head.index(name) for name in head[1:]}
            found.append({row[0]: {name: row[column] for name, column in columns.items()} for row in rows})
    return found


PAGE = "studies/geodesic_motion_studies/comparison/README.md"
TOTALS, FAMILIES = tables(PAGE, r"all \d+ scenes"), tables(PAGE, "successes: half or more free, fewer")
PARTS = [table for table in tables(PAGE, "") if "success %" in next(iter(table.values()))]


def test_the_methods_are_those_of_the_catalogue() -> None:
    (methods,) = [table for table in tables(PAGE, "row") if "ours" in table]
    assert list(methods) == list(ROWS)


def counted(number: int, name: str) -> tuple[int, int]:
    """Successes and scenes of a method, over all families of a table."""
    counts = [pair.split("/") for cell in FAMILIES[number][name].values() for pair in cell.split(", ") if pair != "-"]
    return tuple(sum(map(int, column)) for column in zip(*counts, strict=True))


def interval(successes: int, scenes: int) -> str:
    return "..".join(f"{100.0 * bound:.1f}" for bound in wilson(successes, scenes))


@pytest.mark.parametrize("number", range(len(TOTALS)))
def test_totals_are_the_sums_of_their_parts(number: int) -> None:
    total, (half, fewer) = TOTALS[number], PARTS[2 * number : 2 * number + 2]
    names = [name for name in ROWS if name in total]
    assert list(total) == list(half) == list(fewer) == list(FAMILIES[number]) == names
    for name, row in total.items():
        successes, scenes = counted(number, name)
        assert (row["successes"], row["success %"], row["95 %"]) == (
            str(successes), f"{100.0 * successes / scenes:.1f}", interval(successes, scenes),
        )  # fmt: skip
        for end in row.keys() - {"successes", "success %", "95 %"}:
            assert int(row[end]) == int(half[name][end]) + int(fewer[name][end])
        ends = ("touched, moving", "touched, standing", "refused", "lost")
        assert successes + sum(int(row[end]) for end in ends) == scenes


def repeated() -> dict[str, list[str]]:
    """Cells by method of the table that the page of figures has of all scenes."""
    (table,) = tables("doc/figures.md", "success %")
    return {name.partition(":")[0]: list(cells.values()) for name, cells in table.items()}


def test_the_page_of_figures_has_the_names_and_the_figures_of_the_benchmark() -> None:
    rows = repeated()
    assert list(rows) == list(TOTALS[0])
    for name, cells in rows.items():
        assert cells[:3] == [total[name]["success %"] for total in TOTALS[:3]]
        successes, scenes = (sum(column) for column in zip(*(counted(skill, name) for skill in range(3)), strict=True))
        assert cells[3] == f"{100.0 * successes / scenes:.1f} ({interval(successes, scenes)})"
        touched = [[int(total[name][f"touched, {how}"]) for total in TOTALS[:3]] for how in ("moving", "standing")]
        assert cells[4] == ", ".join(str(sum(counts)) for counts in touched)


def test_what_is_measured_in_short_has_the_same_figures() -> None:
    (table,) = tables("doc/figures.md", "measured")
    success, touched, distance = (" ".join(cells.values()) for cells in list(table.values())[:3])
    rows = repeated()
    of_all = [rows[name] for name in ("ours", "RRT-Connect", "mean demonstration + detour", "barriers")]
    assert re.findall(r"[\d.]+ \([\d.]+\)", success) == [
        cells[3] for cells in (of_all[0], rows["ours, detour 0"], *of_all[1:])
    ]
    assert re.findall(r"\d+ and \d+", touched) == [cells[4].replace(", ", " and ") for cells in of_all]
    assert re.findall(r"\d+, \d+, \d+ mm", distance) == [cells[5].partition(";")[0] for cells in of_all[:3]]
