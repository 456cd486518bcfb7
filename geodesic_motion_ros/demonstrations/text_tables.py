"""Text files with any header, or none -> the columns of each demonstration by their names, as --columns maps them.

A line is a sample; cells stand apart by commas, semicolons, tabs or blanks, as in the first line. Lines that begin with
# are passed over, but for a header that the first one may hold.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from geodesic_motion_ros.demonstrations.recorded_tables import (
    DEMONSTRATION,
    LARGEST_RECORDING,
    LONGEST_LINE,
    POSITION,
    QUATERNION,
    SHORT,
    TIME,
    Table,
    check_complete,
)
from geodesic_motion_ros.utils.checked_files import brief, opened
from geodesic_motion_ros.utils.errors import DemonstrationError, FileError

_SEPARATORS = (",", ";", "\t")


def parse_mapping(columns: str) -> dict[str, str]:
    """Names of columns in the file by our names, out of "t=stamp,px=x,py"; a name alone is called the same in the file.

    DemonstrationError: a name is missing or stands twice.
    """
    mapping: dict[str, str] = {}
    for part in columns.split(","):
        short, _, theirs = (cell.strip() for cell in part.partition("="))
        ours = SHORT.get(short, short)
        if not ours or ("=" in part and not theirs) or ours in mapping:
            raise DemonstrationError(
                f"column {brief(part)} in {brief(columns)}: give our names and those of the file, each once, as "
                "t=stamp,px=x,py=y,pz=z"
            )
        mapping[ours] = theirs or short
    return mapping


def of_poses(mapping: Mapping[str, str]) -> bool:
    """Whether the columns are positions, and not joints."""
    return not {*POSITION, *QUATERNION}.isdisjoint(mapping)


def text_tables(path: Path, mapping: Mapping[str, str], needed: tuple[str, ...] = ()) -> dict[str, Table]:
    """Those of a text file, by the names of the demonstrations: one of the file's name where no column says which.

    Parameters
    ----------
    mapping : as `parse_mapping` returns it. Columns that it does not name are passed over; a file whose first line has
        numbers alone has the columns in the order of the mapping.
    needed : names of joints; (): the file has poses.

    Raises
    ------
    DemonstrationError : says which file, line and column cannot be used, and what is there.
    """
    known = {TIME, DEMONSTRATION, *(needed or (*POSITION, *QUATERNION))}
    unknown = [name for name in mapping if name not in known]
    missing = [name for name in needed if name not in mapping]
    if unknown or missing:
        what = f"{brief(unknown[0])} is none of ours" if unknown else f"{', '.join(missing)} are not mapped"
        raise DemonstrationError(f"{path}: --columns: {what}; ours are {', '.join((*sorted(known),))}")
    if not needed:
        check_complete([name for name in mapping if name != DEMONSTRATION], "--columns")
    lines = _lines(path)
    if not lines:
        raise DemonstrationError(f"{path}: holds no demonstrations")
    first = lines[0][1].lstrip("#").strip()
    separator = next((each for each in _SEPARATORS if each in first), None)
    header = _cells(first, separator)
    if all(map(_is_number, header)):
        if len(header) != len(mapping):
            raise DemonstrationError(
                f"{path}: no header, and {len(header)} columns; --columns names {len(mapping)}: {', '.join(mapping)}"
            )
        header, rows = list(mapping.values()), lines
    else:
        rows = [line for line in lines[1:] if not line[1].startswith("#")]
    places = {ours: _place(header, theirs, path) for ours, theirs in mapping.items()}
    return _tables(rows, separator, len(header), places, path)


def _tables(
    rows: list[tuple[int, str]], separator: str | None, width: int, places: Mapping[str, int], path: Path
) -> dict[str, Table]:
    numeric = [ours for ours in places if ours != DEMONSTRATION]
    samples: dict[str, list[list[float]]] = {}
    for number, line in rows:
        cells = _cells(line, separator)
        if len(cells) != width:
            raise DemonstrationError(f"{path}, line {number}: {len(cells)} cells under {width} columns")
        wrong = [ours for ours in numeric if not _is_number(cells[places[ours]])]
        if wrong:
            cell = brief(cells[places[wrong[0]]])
            raise DemonstrationError(f"{path}, line {number}, column {wrong[0]}: {cell} is not a number")
        name = cells[places[DEMONSTRATION]] if DEMONSTRATION in places else path.stem
        samples.setdefault(name, []).append([float(cells[places[ours]]) for ours in numeric])
    return {name: dict(zip(numeric, np.array(table).T, strict=True)) for name, table in samples.items()}


def _lines(path: Path) -> list[tuple[int, str]]:
    """Numbers and texts of the lines that are not empty."""
    try:
        with opened(path, LARGEST_RECORDING) as stream:
            text = stream.read().decode("utf-8-sig")
    except OSError as error:
        raise DemonstrationError(f"{path}: cannot be read ({error.strerror or error})") from error
    except (FileError, UnicodeDecodeError) as error:
        raise DemonstrationError(f"{path}: not a text file ({error})") from error
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    long = [number for number, line in lines if len(line) > LONGEST_LINE]
    if long:
        raise DemonstrationError(f"{path}, line {long[0]}: longer than {LONGEST_LINE} characters; one sample a line")
    return lines


def _cells(line: str, separator: str | None) -> list[str]:
    cells = re.split(r"\s+", line) if separator is None else line.split(separator)
    return [cell.strip().strip('"') for cell in cells]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _place(header: list[str], name: str, path: Path) -> int:
    if header.count(name) != 1:
        many = "not" if name not in header else "more than once"
        there = brief(", ".join(header), 300)
        raise DemonstrationError(f"{path}: column {brief(name)} is {many} there; there are {there}")
    return header.index(name)
