"""Names of columns: ours, those of files as --columns maps them, and the units that headers have beside them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from geodesic_motion_ros.utils.checked_files import brief
from geodesic_motion_ros.utils.errors import DemonstrationError

TIME = "t"
POSITION = ("px", "py", "pz")
QUATERNION = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR = ("rotvec_x", "rotvec_y", "rotvec_z")
"""In place of QUATERNION in files of other programs: the axis of a rotation times its angle [rad]."""
ROLL_PITCH_YAW = ("roll", "pitch", "yaw")
"""The same: angles [rad] of turns about the fixed axes x, then y, then z."""
ORIENTATIONS = (QUATERNION, ROTATION_VECTOR, ROLL_PITCH_YAW)
#: What some programs call a rotation vector, and others roll, pitch and yaw: one of the two is to be said.
_UNSAID = ("rx", "ry", "rz")
SHORT = {"x": "px", "y": "py", "z": "pz"}
"""What positions may be called beside."""
DEFAULT_COLUMNS = "px,py,pz,qw,qx,qy,qz"
DEMONSTRATION = "demonstration"

SECONDS = ("sec", "nanosec")
"""A stamp in two columns, in place of TIME."""
MATRIX = "matrix"
"""In place of positions and QUATERNION: 16 columns, a homogeneous matrix in rows or in columns."""
OF_POSES = (*POSITION, *QUATERNION, *ROTATION_VECTOR, *ROLL_PITCH_YAW, MATRIX)
EVERY_JOINT = "*"
"""Stands for the name of each joint, on both sides of a mapping."""
METRES_PER_UNIT: dict[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
"""Units of positions."""
ANGLES = ("rad", "deg")
"""Units of joints."""
#: What recorders call the number of a demonstration.
_CALLED_DEMONSTRATION = re.compile(
    r"(demo|demonstration|episode|trial|take|trajectory|traj)[ _.-]?(id|idx|index|nr|no|num|number|name)?",
    re.IGNORECASE,
)
#: Units as they stand in headers, by their usual spelling; degrees are written with a sign, too.
_UNITS = {
    "s": "s sec secs second seconds", "ms": "ms msec millis milliseconds", "us": "us µs μs usec micros microseconds",
    "ns": "ns nsec nanos nanoseconds", "m": "m meter meters metre metres", "cm": "cm", "mm": "mm",
    "rad": "rad radian radians", "deg": "deg degree degrees °",
}  # fmt: skip
_SPELLED = {spelling: unit for unit, spellings in _UNITS.items() for spelling in spellings.split()}


def parse_columns(columns: str) -> tuple[str, ...]:
    """Read column names from "px,py,...". DemonstrationError names unknown, repeated and missing ones."""
    names = tuple(SHORT.get(name.strip(), name.strip()) for name in columns.split(","))
    known = (TIME, *POSITION, *QUATERNION)
    unknown = [name for name in names if name not in known]
    if unknown:
        raise DemonstrationError(
            f"unknown column '{unknown[0]}' in '{columns}'; known are {', '.join(known)}"
        )
    repeated = [name for name in names if names.count(name) > 1]
    if repeated:
        raise DemonstrationError(f"column {repeated[0]} stands more than once in '{columns}'")
    check_complete(names, f"'{columns}'")
    return names


def find_quaternion_order(names: tuple[str, ...]) -> tuple[str, ...]:
    """Find the order of qw, qx, qy, qz in names of columns; scalar first where they are not among them."""
    return tuple(name for name in names if name in QUATERNION) or QUATERNION


def check_complete(names: Sequence[str], where: str) -> None:
    """Refuse other columns than px,py - px,py,pz - px,py,pz and one whole orientation; each with or without t."""
    begun = [orientation for orientation in ORIENTATIONS if set(names) & set(orientation)]
    if len(begun) > 1:
        raise DemonstrationError(f"{where} has {' and '.join(map(','.join, begun))}: name one orientation")
    needed = POSITION[:2] if set(names) <= {TIME, *POSITION[:2]} else POSITION
    if begun:
        needed = POSITION + begun[0]
    missing = [name for name in needed if name not in names]
    if missing:
        raise DemonstrationError(
            f"{where} lacks {', '.join(missing)}; needed are px,py,pz,qw,qx,qy,qz, or px,py,pz, or px,py, "
            f"each with or without t; in place of the quaternion {','.join(ROTATION_VECTOR)} is a rotation vector "
            f"[rad], as of UR, and {','.join(ROLL_PITCH_YAW)} are turns [rad] about fixed axes"
        )


def parse_mapping(columns: str) -> dict[str, str]:
    """Read names of columns in the file, by our names, from "t=stamp,px=x,py"; a name alone is the same in the file.

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


def is_of_poses(mapping: Mapping[str, str]) -> bool:
    """Tell whether the columns are poses, and not joints, which may be called like angles."""
    return not (set(OF_POSES) - set(ROLL_PITCH_YAW)).isdisjoint(mapping)


def expand_every_joint(mapping: Mapping[str, str], joint_names: Sequence[str]) -> dict[str, str]:
    """Expand EVERY_JOINT in a mapping to the names of all joints."""
    pattern = mapping.get(EVERY_JOINT)
    every = {} if pattern is None else {name: pattern.replace(EVERY_JOINT, name) for name in joint_names}
    return every | {ours: theirs for ours, theirs in mapping.items() if ours != EVERY_JOINT}


def split_unit(name: str) -> tuple[str, str]:
    """Split a name from the unit behind it, "" where none is known: "q1 [deg]", "time_ms", "x (mm)"."""
    found = re.fullmatch(r"(.*?)\s*(?:[\[(]\s*(\S+?)\s*[\])]|_([a-zµμ]+))", name.strip())
    if found is None:
        return name.strip(), ""
    unit = _SPELLED.get((found[2] or found[3]).lower(), "")
    return (found[1], unit) if unit else (name.strip(), "")


def read_unit(cell: str) -> str:
    """Read the unit of a cell in a row of units; "" where it is none."""
    return _SPELLED.get(cell.strip().strip("[]()").lower(), "")


def find_place(names: Sequence[str], wanted: str) -> int | None:
    """Find the place of a column: by its name, or without the unit behind it; None where none or several are."""
    for spelled in (list(names), [split_unit(name)[0] for name in names]):
        if wanted in spelled:
            return spelled.index(wanted) if spelled.count(wanted) == 1 else None
    return None


def find_elements(names: Sequence[str], wanted: str) -> list[int]:
    """Find the places of the numbered columns of one name: NAME[0], NAME_1 or NAME0, from the lowest number on."""
    pattern = re.compile(rf"{re.escape(wanted)}(?:\[(\d+)\]|[_.]?(\d+))")
    found = {int(match[1] or match[2]): place for place, name in enumerate(names) if (match := pattern.fullmatch(name))}
    return [found[number] for number in sorted(found)]


def find_demonstration_column(names: Sequence[str]) -> str | None:
    """Find the only column that is called as recorders call the number of a demonstration; None: none or several."""
    called = [name for name in names if name == DEMONSTRATION]
    called = called or [name for name in names if _CALLED_DEMONSTRATION.fullmatch(name)]
    return called[0] if len(called) == 1 else None


def check_known(mapping: Mapping[str, str], joint_names: Sequence[str], has_header: bool) -> None:
    """Refuse names that are none of ours, and joints that are not mapped: DemonstrationError.

    joint_names : (): the file has poses.
    has_header : without one, names alone count the columns that are passed over.
    """
    known = {TIME, *SECONDS, DEMONSTRATION, *(joint_names or OF_POSES)}
    unknown = [ours for ours, theirs in mapping.items() if ours not in known and (has_header or ours != theirs)]
    stamp = [name for name in SECONDS if name not in mapping]
    if len(stamp) == 1 or (not stamp and TIME in mapping):
        what = f"lacks {stamp[0]}" if stamp else f"names {TIME} beside {' and '.join(SECONDS)}"
        raise DemonstrationError(f"--columns {what}: a stamp is {' and '.join(SECONDS)}, or {TIME}")
    if not joint_names and not mapping.keys().isdisjoint(_UNSAID):
        _ask_for_the_orientation(mapping)
    missing = [name for name in joint_names if name not in mapping]
    if unknown or missing:
        what = f"{brief(unknown[0])} is none of ours" if unknown else f"{', '.join(missing)} are not mapped"
        euler = "; of angles roll,pitch,yaw are read, about fixed axes: convert others to qw,qx,qy,qz"
        hint = euler if not joint_names and unknown and re.search("euler|rpy|angle", unknown[0]) else ""
        raise DemonstrationError(f"--columns: {what}; ours are {', '.join(sorted(known))}{hint}")


def _ask_for_the_orientation(mapping: Mapping[str, str]) -> None:
    """Refuse names that are a rotation vector in some programs and angles in others: DemonstrationError."""
    vector, angles = (
        ",".join(f"{ours}={mapping.get(unsaid, unsaid)}" for ours, unsaid in zip(names, _UNSAID, strict=True))
        for names in (ROTATION_VECTOR, ROLL_PITCH_YAW)
    )
    raise DemonstrationError(
        f"--columns: is {','.join(_UNSAID)} a rotation vector, as of UR? Then say {vector}. Or is it roll, pitch and "
        f"yaw, turns about the fixed axes x, y and z? Then say {angles}. Convert others to qw,qx,qy,qz"
    )
