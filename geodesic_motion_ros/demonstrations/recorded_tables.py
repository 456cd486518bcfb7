"""Files of numbers -> the columns of each demonstration by their names. Knows neither units nor what an arm can do.

Nothing is unpickled; what a file may hold is limited, and what it holds else is refused by its place.
"""

from __future__ import annotations

import csv
import io
import re
from array import array as numbers
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TypeVar

import numpy as np

from geodesic_motion_ros.demonstrations.column_names import (
    DEMONSTRATION,
    POSITION,
    TIME,
    check_complete,
    find_quaternion_order,
)
from geodesic_motion_ros.utils.checked_files import array_names, brief, opened, read_array, read_arrays
from geodesic_motion_ros.utils.errors import DemonstrationError, FileError

LARGEST_RECORDING = 128 << 20
"""Of a file [B]: half an hour of poses at 1 kHz."""
MOST_DEMONSTRATIONS, MOST_JOINTS = 10_000, 100
LONGEST_NAME, LONGEST_LINE = 200, 10_000
"""Of a demonstration and of a line of text, in characters."""

Table = dict[str, np.ndarray]
"""One demonstration as read: column name -> values (T,), positions still in the units of the file."""
Reader = Callable[[Path, tuple[str, ...]], dict[str, Table]]
"""From a file and the names of its columns to tables by the names of the demonstrations."""
Content = TypeVar("Content")


@contextmanager
def name_in_errors(path: Path) -> Iterator[None]:
    """Name the file in errors; those that do already stay as they are."""
    try:
        yield
    except DemonstrationError as error:
        if str(error).startswith(str(path)):
            raise
        raise DemonstrationError(f"{path}: {error}") from error


def read_pose_tables(path: Path, names: tuple[str, ...], rate_hz: float | None) -> dict[str, Table]:
    """Read the tables of a recording of poses, by the names of the demonstrations; names : of its columns, in order.

    rate_hz : samples a second of files that have no times; None: not known.

    Raises
    ------
    DemonstrationError : says which file, demonstration, sample and column cannot be used, and what would be right.
    """
    return _read_tables(path, {".npy": _read_npy, ".npz": _read_npz, ".csv": _read_csv}, names, rate_hz)


def read_joint_tables(path: Path, joint_names: tuple[str, ...], robot: str, rate_hz: float | None) -> dict[str, Table]:
    """Read the tables of a recording of a robot's joints, by the names of the demonstrations."""

    def read_npz(path: Path, names: tuple[str, ...]) -> dict[str, Table]:
        return _joint_arrays(_load(path, read_arrays), names, robot, path)

    def read_csv(path: Path, names: tuple[str, ...]) -> dict[str, Table]:
        return _read_csv(path, names, robot)

    return _read_tables(path, {".npz": read_npz, ".csv": read_csv}, joint_names, rate_hz)


def find_files(path: Path) -> list[Path]:
    """List the `.csv` files of a folder, by name, which are one recording together; [] of what is no folder."""
    return sorted(path.glob("*.csv")) if path.is_dir() else []


def read_names(path: Path) -> set[str]:
    """Read the names of the arrays of a `.npz`, or of the columns of a `.csv` or a folder's first; none of other files.
    Raises what cannot be read.
    """
    if files := find_files(path):
        return read_names(files[0])
    if path.suffix.lower() == ".npz":
        return set(_load(path, array_names))
    if path.suffix.lower() == ".csv":
        with opened(path, LARGEST_RECORDING) as stream:
            first = next(_lines(stream, path), "")
        return {cell.strip() for cell in re.split("[,;\t]", first)}
    return set()


def _read_tables(
    path: Path, readers: Mapping[str, Reader], names: tuple[str, ...], rate_hz: float | None
) -> dict[str, Table]:
    if rate_hz is not None and not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise DemonstrationError(f"rate_hz is {rate_hz}; it must be a positive number of samples a second")
    if files := find_files(path):
        return _merged([(file, _read_tables(file, readers, names, rate_hz)) for file in files])
    if path.is_dir():
        raise DemonstrationError(f"{path}: is a directory without .csv files; it holds no recording, and is no bag")
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise DemonstrationError(f"{path}: cannot read '{path.suffix}' files, only {', '.join(readers)}")
    try:
        tables = reader(path, names)
    except OSError as error:
        raise DemonstrationError(f"{path}: cannot be read ({error.strerror or error})") from error
    except FileError as error:
        raise DemonstrationError(f"{path}: {error}") from error
    if not tables:
        raise DemonstrationError(f"{path}: holds no demonstrations")
    return tables


def _merged(tables_of: Sequence[tuple[Path, dict[str, Table]]]) -> dict[str, Table]:
    """All tables; DemonstrationError: two files have a demonstration of the same name."""
    merged: dict[str, Table] = {}
    for file, tables in tables_of:
        for name, table in tables.items():
            if name in merged:
                raise DemonstrationError(f"{file}: another file of the folder has a demonstration {brief(name)}, too")
            merged[name] = table
    return merged


def _read_npy(path: Path, names: tuple[str, ...]) -> dict[str, Table]:
    return _split_array(_load(path, read_array), names, path)


def _read_npz(path: Path, names: tuple[str, ...]) -> dict[str, Table]:
    arrays = _load(path, read_arrays)
    if "positions" in arrays:
        return _named_arrays(arrays, find_quaternion_order(names), path)
    if len(arrays) != 1:
        keys = brief(", ".join(arrays)) if arrays else "nothing"
        raise DemonstrationError(
            f"{path}: holds {keys}; it needs keys positions (and quaternions, times), or one array alone"
        )
    return _split_array(next(iter(arrays.values())), names, path)


def _load(path: Path, read: Callable[[IO[bytes]], Content]) -> Content:
    """What `read` makes of a regular file; DemonstrationError: it cannot."""
    with opened(path, LARGEST_RECORDING) as stream:
        try:
            return read(stream)
        except FileError as error:
            raise DemonstrationError(f"{path}: not a {path.suffix} file of plain numbers: {error}") from error


def _numbers(array: np.ndarray, what: str, path: Path) -> np.ndarray:
    if array.dtype.kind not in "iuf":
        raise DemonstrationError(f"{path}: {what} has dtype {array.dtype}; real numbers are needed")
    with np.errstate(over="ignore"):  # what is too large becomes infinite, and is refused by its place
        return array.astype(float, copy=False)


def _split_array(array: np.ndarray, names: tuple[str, ...], path: Path) -> dict[str, Table]:
    array = _numbers(array, "the array", path)
    array = array[None] if array.ndim == 2 else array
    if array.ndim != 3:
        raise DemonstrationError(f"{path}: shape {array.shape}; needed is (demonstrations, samples, columns)")
    if len(array) > MOST_DEMONSTRATIONS:
        raise DemonstrationError(f"{path}: {len(array)} demonstrations; at most {MOST_DEMONSTRATIONS} are read")
    if array.shape[2] != len(names):
        other = [axis for axis in (0, 1) if array.shape[axis] == len(names)]
        transposed = f"; columns are the last axis: are they axis {other[0]} of {array.shape}?" if other else ""
        raise DemonstrationError(
            f"{path}: {array.shape[2]} columns, but {len(names)} were announced: {','.join(names)}; name the "
            f"columns of the file in their order{transposed}"
        )
    return {
        f"{path.stem}_{index}": {name: sheet[:, column] for column, name in enumerate(names)}
        for index, sheet in enumerate(array)
    }


def _named_arrays(arrays: dict[str, np.ndarray], order: tuple[str, ...], path: Path) -> dict[str, Table]:
    """positions (N, T, 2 or 3), quaternions (N, T, 4) in an order of qw, qx, qy, qz, times (N, T) or (T,)."""
    unknown = [key for key in arrays if key not in ("positions", "quaternions", "times")]
    if unknown:
        raise DemonstrationError(
            f"{path}: unknown key {brief(unknown[0])}; known are positions, quaternions, times"
        )
    positions = _numbers(arrays["positions"], "positions", path)
    if positions.ndim != 3 or positions.shape[2] not in (2, 3):
        raise DemonstrationError(
            f"{path}: positions have shape {positions.shape}, not (N, T, 3) or (N, T, 2)"
        )
    names = POSITION[: positions.shape[2]]
    stacked = [positions]
    if "quaternions" in arrays:
        stacked.append(_shaped(arrays["quaternions"], (*positions.shape[:2], 4), "quaternions", path))
        names = (*names, *order)
    if "times" in arrays:
        stacked.append(_times_of_each(arrays["times"], positions.shape[:2], path)[..., None])
        names = (*names, TIME)
    check_complete(names, str(path))
    return _split_array(np.concatenate(stacked, axis=2), names, path)


def _shaped(array: np.ndarray, shape: tuple[int, ...], what: str, path: Path) -> np.ndarray:
    if array.shape != shape:
        raise DemonstrationError(f"{path}: {what} have shape {array.shape}; beside the positions: {shape}")
    return _numbers(array, what, path)


def _times_of_each(times: np.ndarray, shape: tuple[int, ...], path: Path) -> np.ndarray:
    """Times (N, T) of all demonstrations, given as such or once for all of them (T,)."""
    return _shaped(np.broadcast_to(times, shape) if times.shape == shape[1:] else times, shape, "times", path)


def _read_csv(path: Path, names: tuple[str, ...], robot: str = "") -> dict[str, Table]:
    """robot : whose joints the names are, if they are joints."""
    samples: dict[str, numbers] = {}
    with opened(path, LARGEST_RECORDING) as stream:
        rows = csv.reader(_lines(stream, path))
        try:
            header = [cell.strip() for cell in next(rows, [])]
            if robot and DEMONSTRATION in header and set(header).isdisjoint(names):
                raise _other_arm([name for name in header if name not in (DEMONSTRATION, TIME)], names, robot, path)
            _check_header(header, names, path)
            for row in rows:
                if row:
                    _add_sample(samples, row, header, f"{path}, line {rows.line_num}")
        except (UnicodeDecodeError, csv.Error) as error:
            raise DemonstrationError(f"{path}: not a csv text file ({error})") from error
    values = [name for name in header if name != DEMONSTRATION]
    return {
        name: dict(zip(values, np.frombuffer(table).reshape(-1, len(values)).T, strict=True))
        for name, table in samples.items()
    }


def _lines(stream: IO[bytes], path: Path) -> Iterator[str]:
    """Lines of a text file; DemonstrationError: one is longer than LONGEST_LINE."""
    text = io.TextIOWrapper(stream, encoding="utf-8-sig", newline="")
    number = 0
    while line := text.readline(LONGEST_LINE + 1):
        number += 1
        if len(line) > LONGEST_LINE:
            raise DemonstrationError(
                f"{path}, line {number}: longer than {LONGEST_LINE} characters; a csv file has one sample a line"
            )
        yield line


def _add_sample(samples: dict[str, numbers], row: list[str], header: list[str], where: str) -> None:
    """Append the numbers of a row, in the order of the header, to those of the demonstration that it names."""
    if len(row) != len(header):
        raise DemonstrationError(f"{where}: {len(row)} cells under {len(header)} columns")
    at = header.index(DEMONSTRATION)
    name = row[at].strip()
    if name not in samples:
        _check_name(name, where)
        if len(samples) == MOST_DEMONSTRATIONS:
            raise DemonstrationError(f"{where}: more than {MOST_DEMONSTRATIONS} demonstrations")
    table = samples.setdefault(name, numbers("d"))
    table.extend(_number(cell, where, key) for key, cell in zip(header, row, strict=True) if key != DEMONSTRATION)


def _check_name(name: str, where: str) -> None:
    """Refuse names of demonstrations that do not fit into a message: DemonstrationError."""
    if len(name) > LONGEST_NAME or not name.isprintable():
        raise DemonstrationError(
            f"{where}: a demonstration is called {brief(name)}; names are one line of at most {LONGEST_NAME} characters"
        )


def _check_header(header: list[str], names: tuple[str, ...], path: Path) -> None:
    allowed = {DEMONSTRATION, TIME, *names}
    missing = [name for name in (DEMONSTRATION, *names) if name not in header]
    unknown = [name for name in header if name not in allowed]
    repeated = [name for name in header if header.count(name) > 1]
    expected = f"expected are {', '.join((DEMONSTRATION, *names))} in any order"
    of_others = f"; of other programs' files say which column is which: --columns {names[0]}=NAME,..."
    if not any(header):
        raise DemonstrationError(f"{path}: empty; it needs a header {','.join((DEMONSTRATION, *names))}")
    for separator, called in ((";", "semicolons"), ("\t", "tabs")):
        if separator in header[0]:
            raise DemonstrationError(f"{path}: the header has {called} between its columns{of_others}")
    if unknown:
        raise DemonstrationError(f"{path}: unknown column {brief(unknown[0])} in the header; {expected}{of_others}")
    if missing:
        raise DemonstrationError(f"{path}: the header lacks {', '.join(missing)}; {expected}{of_others}")
    if repeated:
        raise DemonstrationError(f"{path}: column {repeated[0]} stands more than once in the header")


def _number(cell: str, where: str, column: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise DemonstrationError(f"{where}, column {column}: {brief(cell)} is not a number") from None


def _joint_arrays(
    arrays: dict[str, np.ndarray], joint_names: tuple[str, ...], robot: str, path: Path
) -> dict[str, Table]:
    """configurations (N, T, eta), joint_names (eta,), perhaps times (N, T) or (T,), names (N,) and robot."""
    missing = [key for key in ("configurations", "joint_names") if key not in arrays]
    unknown = [key for key in arrays if key not in ("configurations", "joint_names", "times", "names", "robot")]
    if missing or unknown:
        what = f"lacks {missing[0]}" if missing else f"has the unknown key {brief(unknown[0])}"
        raise DemonstrationError(
            f"{path}: {what}; a recording of joints has the keys configurations and joint_names, and may have times, "
            "names and robot"
        )
    if "robot" in arrays and str(arrays["robot"]) != robot:
        raise DemonstrationError(f"{path}: recorded with the robot {brief(str(arrays['robot']))}, not with '{robot}'")
    configurations = _numbers(arrays["configurations"], "configurations", path)
    for key, most in (("joint_names", MOST_JOINTS), ("names", MOST_DEMONSTRATIONS)):
        if key in arrays and (arrays[key].ndim > 1 or arrays[key].size > most):
            raise DemonstrationError(
                f"{path}: {key} have shape {brief(arrays[key].shape)}; at most {most} in a row are read"
            )
    present = tuple(map(str, np.atleast_1d(arrays["joint_names"])))
    if sorted(present) != sorted(joint_names):
        raise _other_arm(present, joint_names, robot, path)
    if configurations.ndim != 3 or configurations.shape[2] != len(present):
        raise DemonstrationError(
            f"{path}: configurations have shape {configurations.shape}, not (N, T, {len(present)}) for the joints named"
        )
    tables = _split_array(configurations, present, path)
    names = tuple(map(str, np.atleast_1d(arrays.get("names", list(tables)))))
    for name in names:
        _check_name(name, str(path))
    if len(set(names)) != len(configurations) or len(names) != len(configurations):
        raise DemonstrationError(f"{path}: {len(set(names))} different names for {len(configurations)} demonstrations")
    if "times" in arrays:
        times = _times_of_each(arrays["times"], configurations.shape[:2], path)
        tables = {name: table | {TIME: row} for (name, table), row in zip(tables.items(), times, strict=True)}
    return dict(zip(names, tables.values(), strict=True))


def _other_arm(present: Sequence[str], joint_names: Sequence[str], robot: str, path: Path) -> DemonstrationError:
    return DemonstrationError(
        f"{path}: its joints are {brief(', '.join(present), 200)}; expected are those of '{robot}', in any order: "
        f"{', '.join(joint_names)}. Of another arm? Say whose they are: --robot"
    )
