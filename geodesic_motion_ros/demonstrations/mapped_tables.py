"""Files of other programs, of which --columns says which column is which -> columns by our names, in our units."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from geodesic_motion_ros.demonstrations.breaks import find_changing_column, is_break
from geodesic_motion_ros.demonstrations.clocks import PER_UNIT, convert_to_seconds, split_runs
from geodesic_motion_ros.demonstrations.column_names import (
    DEMONSTRATION,
    MATRIX,
    OF_POSES,
    POSITION,
    QUATERNION,
    ROLL_PITCH_YAW,
    ROTATION_VECTOR,
    SECONDS,
    TIME,
    check_complete,
    check_known,
    expand_every_joint,
    find_demonstration_column,
    find_elements,
    find_place,
    parse_mapping,
    split_unit,
)
from geodesic_motion_ros.demonstrations.orientations import convert_to_quaternions
from geodesic_motion_ros.demonstrations.recorded_tables import Table, name_in_errors
from geodesic_motion_ros.demonstrations.takes import Action, Flaw
from geodesic_motion_ros.demonstrations.text_tables import CellTable, read_cells
from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Text with columns, by the endings of files.
TEXT_FILES = (".csv", ".txt", ".tsv", ".dat", ".log")
#: Orientations that are read as quaternions, by the first of their columns.
_WRITTEN = {
    MATRIX: "matrices", ROTATION_VECTOR[0]: "rotation vectors",
    ROLL_PITCH_YAW[0]: "angles of roll, pitch and yaw about fixed axes",
}  # fmt: skip
#: How programs write that there is no number, in small letters.
_NO_NUMBER = ("", "nan", "null", "none", "na", "n/a", "-")


@dataclass(frozen=True)
class MappedTables:
    """The tables of a file, by our names.

    Attributes
    ----------
    tables : columns by our names, by the names of the demonstrations; times [s], quaternions for orientations.
    found : how they were read.
    in_one_go : whether nothing says where a demonstration begins.
    unit : of the positions, or of the joints, as the file says; "": it says nothing.
    """

    tables: dict[str, Table]
    found: tuple[Flaw, ...] = ()
    in_one_go: bool = False
    unit: str = ""


def read_mapped_tables(path: Path, columns: str, joint_names: Sequence[str] = ()) -> MappedTables:
    """Read a file of another program.

    Parameters
    ----------
    columns : our names and those of the file, "t=stamp,px=x,py=y,pz=z"; columns that it does not name are passed over.
        A file that names none has its columns in this order.
    joint_names : (): the file has poses.

    Raises
    ------
    DemonstrationError : says which file, line and column cannot be used, and what is there.
    """
    mapping = expand_every_joint(parse_mapping(columns), joint_names)
    with name_in_errors(path):
        check_known(mapping, joint_names, has_header=False)
        if not joint_names and MATRIX not in mapping:
            check_complete([name for name in mapping if name in (TIME, *OF_POSES)], "--columns")
        cells = read_cells(path, list(mapping.values()))
        check_known(mapping, joint_names, has_header=bool(cells.names))
    found: list[Flaw] = []
    if DEMONSTRATION not in mapping and (called := find_demonstration_column(cells.names)) is not None:
        mapping[DEMONSTRATION] = called
        if called != DEMONSTRATION:
            found.append(_note(path, f"has a column {brief(called)}", "it says which demonstration a sample is of"))
    names = cells.names or tuple(mapping.values())
    known = (TIME, *SECONDS, *(joint_names or OF_POSES))
    places = {ours: _places(names, theirs, ours, path) for ours, theirs in mapping.items() if ours in known}
    numbers = {ours: _numbers(cells, own, ours, path) for ours, own in places.items()}
    units = {ours: _unit(cells, own[0]) for ours, own in places.items()}
    if not joint_names:
        turned = {*ROTATION_VECTOR, *ROLL_PITCH_YAW}
        numbers |= {ours: np.radians(numbers[ours]) for ours in turned & units.keys() if units[ours] == "deg"}
    whole = _whole_rows(numbers, cells, path, found)
    with name_in_errors(path):
        table = _with_times({ours: values[whole] for ours, values in numbers.items()}, units, path, found)
    if not joint_names:
        found += _notes_on_orientation(table, path)
    if TIME not in table:
        how = "as so many samples a second as --rate says; without it the path alone is learned"
        found.append(_note(path, "has no times, as --columns names none", how))
    labels = None
    if DEMONSTRATION in mapping:
        column = cells.columns[_places(names, mapping[DEMONSTRATION], DEMONSTRATION, path)[0]]
        labels = np.array([str(column[row]).strip() for row in np.flatnonzero(whole)])
    tables = _by_demonstration(table, labels, path, found)
    in_one_go = labels is None and len(tables) == 1
    moved = [ours for ours in (joint_names or (*POSITION, MATRIX)) if ours in table]
    if in_one_go:
        passed_over = set(range(len(names))).difference(*places.values())
        broken = is_break(np.column_stack([table[ours] for ours in moved]), table.get(TIME))
        _refuse_glued(broken, {names[place]: cells.columns[place] for place in sorted(passed_over)}, whole, cells, path)
    if not joint_names:
        with name_in_errors(path):
            tables = {name: convert_to_quaternions(table, name) for name, table in tables.items()}
    unit = _common_unit({units[ours] for ours in moved}, path)
    return MappedTables(tables, tuple(found), in_one_go, unit)


def _notes_on_orientation(table: Table, path: Path) -> list[Flaw]:
    written = next((called for ours, called in _WRITTEN.items() if ours in table), None)
    if written is not None:
        return [_note(path, f"has {written}", "as quaternions")]
    if QUATERNION[0] not in table:
        return [_note(path, "has positions alone", "the orientation of the tool is not learned")]
    return []


def _note(path: Path, what: str, how: str, action: Action = Action.READ) -> Flaw:
    return Flaw(path.stem, 0.0, what, action, how)


def _places(names: Sequence[str], theirs: str, ours: str, path: Path) -> list[int]:
    """Places of the columns of a name: one, or the 16 of a matrix."""
    place = find_place(names, theirs)
    found = find_elements(names, theirs) if place is None else [place]
    needed = 16 if ours == MATRIX else 1
    if len(found) != needed:
        raise DemonstrationError(f"{path}: column {brief(theirs)} is {len(found)} columns; {ours} needs {needed}")
    return found


def _numbers(cells: CellTable, places: list[int], ours: str, path: Path) -> np.ndarray:
    """Values (T,) of a column, or (T, 16) of a matrix; NaN where there is no number."""
    columns = []
    for place in places:
        cells_here = cells.columns[place]
        try:
            columns.append(np.array(cells_here, dtype=float))
        except (TypeError, ValueError):
            columns.append(np.array([_number(cell, ours, path, where) for cell, where in
                                     zip(cells_here, cells.places, strict=True)]))
    return columns[0] if len(columns) == 1 else np.stack(columns, axis=1)


def _number(cell: Any, ours: str, path: Path, where: str) -> float:
    text = str(cell).strip()
    if cell is None or text.lower() in _NO_NUMBER:
        return float("nan")
    try:
        return float(text)
    except ValueError:
        if ours == TIME and (seconds := _seconds_in(text)) is not None:
            return seconds
        raise DemonstrationError(f"{path}, {where}, column {ours}: {brief(text)} is not a number") from None


def _seconds_in(text: str) -> float | None:
    """Seconds of a date or of a time of day; None of other text."""
    clock = re.fullmatch(r"(\d{1,2}):(\d{2}):(\d{2}(?:[.,]\d+)?)", text)
    if clock is not None:
        return 3600.0 * float(clock[1]) + 60.0 * float(clock[2]) + float(clock[3].replace(",", "."))
    date = re.fullmatch(r"(\d{4}-\d{2}-\d{2})[T ](\d{2}:\d{2}:\d{2})(?:[.,](\d+))?(Z|[+-]\d{2}:?\d{2})?", text)
    if date is None:
        return None
    # of one recording all dates have the same zone, and times count from the first
    whole = datetime.fromisoformat(f"{date[1]}T{date[2]}").replace(tzinfo=timezone.utc).timestamp()
    return whole + float(f"0.{date[3] or 0}")


def _whole_rows(numbers: Mapping[str, np.ndarray], cells: CellTable, path: Path, found: list[Flaw]) -> np.ndarray:
    """Whether each row (T,) has a number in every column; rows with none of the values are of other topics."""
    finite = {ours: np.isfinite(values).reshape(len(values), -1).all(axis=1) for ours, values in numbers.items()}
    whole = np.all([*finite.values()], axis=0)
    some = np.any([finite[ours] for ours in finite if ours not in (TIME, *SECONDS)], axis=0)
    if not np.any(whole):
        raise DemonstrationError(f"{path}: holds no demonstrations: no row has a number in each of {', '.join(finite)}")
    if np.any(some & ~whole):
        first = cells.places[int(np.argmax(some & ~whole))]
        what = f"has {np.sum(some & ~whole)} of {np.sum(some)} rows without a number in each column, first in {first}"
        found.append(_note(path, what, "they are left out", Action.REPAIRED))
    return whole


def _unit(cells: CellTable, place: int) -> str:
    """Of a column, by the row of units or by its name; "" where neither says one."""
    if not cells.names:
        return ""
    return (cells.units[place] if cells.units else "") or split_unit(cells.names[place])[1]


def _common_unit(units: set[str], path: Path) -> str:
    """That of the positions, or of the joints, "" where none is said; DemonstrationError: they have several."""
    said = sorted(units - {""})
    if len(said) > 1:
        raise DemonstrationError(f"{path}: the columns are in {' and in '.join(said)}: use one unit")
    return said[0] if said else ""


def _with_times(table: Table, units: Mapping[str, str], path: Path, found: list[Flaw]) -> Table:
    """The table with its times [s], if it has any, in one column."""
    if SECONDS[0] in table:
        seconds, nanoseconds = (table.pop(name) for name in SECONDS)
        return table | {TIME: seconds - seconds[0] + 1e-9 * (nanoseconds - nanoseconds[0])}
    if TIME not in table:
        return table
    unit = units[TIME]
    if unit and unit not in PER_UNIT:
        raise DemonstrationError(f"column t is in {unit}; times are in {', '.join(PER_UNIT)}")
    seconds, notes = convert_to_seconds(table[TIME], unit, path.stem)
    found += notes
    return table | {TIME: seconds}


def _refuse_glued(
    broken: np.ndarray, others: Mapping[str, Sequence[Any]], whole: np.ndarray, cells: CellTable, path: Path
) -> None:
    """Refuse demonstrations that one of the other columns seems to keep apart: DemonstrationError.

    broken : between each of the whole rows and the next (T - 1,). others : their cells, of all rows.
    """
    rows = np.flatnonzero(whole)
    found = find_changing_column(broken, {name: [column[row] for row in rows] for name, column in others.items()})
    if found is not None:
        name, after = found
        before, behind = (cells.places[rows[sample]] for sample in (after - 1, after))
        raise DemonstrationError(
            f"{path}: the motion breaks off between {before} and {behind}, where column {brief(name)} changes: does "
            f"that say which demonstration a sample is of? Then say demonstration={name} in --columns, too; otherwise "
            "leave it out of the file"
        )


def _by_demonstration(table: Table, labels: np.ndarray | None, path: Path, found: list[Flaw]) -> dict[str, Table]:
    """The table by the names (T,) of the demonstrations; without names, by where its times begin again."""
    if labels is not None:
        parts = {name: labels == name for name in dict.fromkeys(labels.tolist())}
    else:
        runs = split_runs(table[TIME]) if TIME in table else [slice(None)]
        if len(runs) == 1:
            return {path.stem: table}
        parts = {f"{path.stem}_{number}": run for number, run in enumerate(runs)}
        what = f"has times that begin again {len(runs) - 1} times"
        found.append(_note(path, what, "each time a demonstration begins"))
    return {name: {ours: values[rows] for ours, values in table.items()} for name, rows in parts.items()}
