"""Text files with any header, or none -> columns of cells.

A line is a sample; cells stand apart by tabs, semicolons, commas or blanks. Before the header there may be other lines;
lines that begin with # or % are passed over, but for a header that one may hold. Decimals have points, or commas where
no comma separates cells.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geodesic_motion_ros.demonstrations.column_names import find_elements, find_place, read_unit
from geodesic_motion_ros.demonstrations.recorded_tables import LARGEST_RECORDING
from geodesic_motion_ros.utils.checked_files import brief, opened
from geodesic_motion_ros.utils.errors import DemonstrationError, FileError

_SEPARATORS = ("\t", ";", ",", None)
_COMMENTS = ("#", "%")
#: Exports of all topics of a robot have thousands of columns.
LONGEST_LINE = 100_000
#: A header stands within so many lines.
LONGEST_PREAMBLE = 50
_DECIMAL_COMMA = re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class CellTable:
    """Columns of a file as they are written in it.

    Attributes
    ----------
    names : of the columns; (): the file names none.
    units : of the columns, as a row below the header says; (): there is none.
    columns : the cells of each, text or numbers.
    places : what messages call each row, as "line 3".
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: Sequence[Sequence[Any]]
    places: Sequence[str]


def read_cells(path: Path, wanted: Collection[str]) -> CellTable:
    """Read the cells of a text file.

    wanted : names of columns that are needed; the header is the first line that has them all.

    Raises
    ------
    DemonstrationError : it cannot be read, lacks a column (the others are named), or has lines of several lengths.
    """
    lines = _lines(path)
    if not lines:
        raise DemonstrationError(f"{path}: holds no demonstrations")
    found = _header(lines, wanted)
    if found is None:
        separator = max(_SEPARATORS, key=lambda each: len(_cells(lines[0][1].lstrip("#"), each)))
        first = _cells(lines[0][1], separator)
        if sum(map(_is_number, first)) < 0.5 * len(first):
            _refuse_absent(_cells(lines[0][1].lstrip("#"), separator), wanted, path)
        if len(first) != len(wanted):
            raise DemonstrationError(
                f"{path}: no header, and {len(first)} columns; --columns names {len(wanted)}: {', '.join(wanted)}"
            )
        names, units, rows = (), (), lines
    else:
        at, separator, names = found
        rows = lines[at + 1 :]
        units = tuple(map(read_unit, _cells(rows[0][1], separator))) if rows else ()
        if any(units) and not any(map(_is_number, _cells(rows[0][1], separator))):
            rows = rows[1:]
        else:
            units = ()
    width = len(names) or len(wanted)
    rows = [(number, line) for number, line in rows if not line.startswith(_COMMENTS)]
    cells = [_fitting(_cells(line, separator), width, f"{path}, line {number}") for number, line in rows]
    if separator != ",":
        cells = _with_points(cells, path)
    columns = list(zip(*cells, strict=True)) or [()] * width
    return CellTable(names, units, columns, [f"line {number}" for number, _ in rows])


def _header(
    lines: list[tuple[int, str]], wanted: Collection[str]
) -> tuple[int, str | None, tuple[str, ...]] | None:
    """Place, separator and names of the first line that has the wanted names; None where none has."""
    for at, (_, line) in enumerate(lines[:LONGEST_PREAMBLE]):
        # a mark of a comment may also be a part of the first name, as in %time
        for text in dict.fromkeys((line.lstrip("#").strip(), line.lstrip("#%").strip(), line)):
            for separator in _SEPARATORS:
                names = _cells(text, separator)
                if all(find_place(names, name) is not None or find_elements(names, name) for name in wanted):
                    while names and not names[-1]:
                        names.pop()
                    return at, separator, tuple(names)
    return None


def _refuse_absent(names: list[str], wanted: Collection[str], path: Path) -> None:
    absent = next(name for name in wanted if find_place(names, name) is None)
    many = "more than once" if absent in names else "not"
    raise DemonstrationError(
        f"{path}: column {brief(absent)} is {many} there; there are {brief(', '.join(names), 300)}"
    )


def _lines(path: Path) -> list[tuple[int, str]]:
    """Numbers and texts of the lines that are not empty."""
    try:
        with opened(path, LARGEST_RECORDING) as stream:
            text = _decoded(stream.read())
    except OSError as error:
        raise DemonstrationError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (FileError, UnicodeDecodeError) as error:
        raise DemonstrationError(f"{path}: not a text file ({error})") from error
    lines = [(number, line.strip(" \r\n")) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    long = [number for number, line in lines if len(line) > LONGEST_LINE]
    if long:
        raise DemonstrationError(f"{path}, line {long[0]}: longer than {LONGEST_LINE} characters; one sample a line")
    return lines[1:] if lines and lines[0][1].lower().startswith("sep=") else lines


def _decoded(content: bytes) -> str:
    """UTF-8, or the encodings that spreadsheets write: UTF-16 with its mark, and that of western Windows."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        if b"\x00" in content:
            raise
        return content.decode("cp1252")


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return [cell.strip('"') for cell in line.split()]
    if '"' not in line:
        return [cell.strip() for cell in line.split(separator)]
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _fitting(cells: list[str], width: int, where: str) -> list[str]:
    """As many cells as there are columns; empty ones at the end do not count."""
    while len(cells) > width and not cells[-1]:
        cells.pop()
    if len(cells) != width:
        raise DemonstrationError(f"{where}: {len(cells)} cells under {width} columns")
    return cells


def _with_points(rows: list[list[str]], path: Path) -> list[list[str]]:
    """Decimal commas as points; DemonstrationError: there are both, and one of them separates thousands."""
    commas = [any(map(_DECIMAL_COMMA.fullmatch, row)) for row in rows]
    if not any(commas):
        return rows
    both = [cell for row in rows for cell in row if re.fullmatch(r"[-+]?\d[\d.]*\.\d+(,\d+)?", cell)]
    if both:
        raise DemonstrationError(f"{path}: numbers with decimal commas, and {brief(both[0])}: write one kind")
    return [[cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in rows]


def _is_number(cell: str) -> bool:
    try:
        float(cell.replace(",", "."))
    except ValueError:
        return False
    return True
