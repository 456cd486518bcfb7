"""Recordings on disk -> Demonstrations, JointDemonstrations. Units are given, never guessed; nothing is unpickled."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from geodesic_motion_ros.demonstrations.checks import check_samples
from geodesic_motion_ros.demonstrations.column_names import (
    ANGLES,
    DEFAULT_COLUMNS,
    DEMONSTRATION,
    METRES_PER_UNIT,
    POSITION,
    QUATERNION,
    TIME,
    parse_columns,
)
from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations, check_norms
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.demonstrations.mapped_tables import TEXT_FILES, MappedTables, read_mapped_tables
from geodesic_motion_ros.demonstrations.recorded_tables import (
    Table,
    name_in_errors,
    read_joint_tables,
    read_names,
    read_pose_tables,
)
from geodesic_motion_ros.demonstrations.takes import POSE, Take
from geodesic_motion_ros.demonstrations.turns import align_turns, unwrap_turns
from geodesic_motion_ros.geometry.curves import arc_length
from geodesic_motion_ros.geometry.quaternions import continuous_signs
from geodesic_motion_ros.utils.checked_numbers import ARM_REACH
from geodesic_motion_ros.utils.errors import DemonstrationError, FileError

Units = Literal["m", "cm", "mm"]
ASSUMED_RATE = 100.0
"""Samples a second of files that do not say when they were recorded: speeds that are checked need some."""
SHORTEST_MOTION = 0.01
"""When no demonstration of a file moves this far [m], its units were taken for too small ones."""


def read_demonstrations(
    path: str | Path, units: Units, columns: str = DEFAULT_COLUMNS, rate_hz: float | None = None
) -> Demonstrations:
    """Read a recording of poses, in metres.

    Parameters
    ----------
    path : one of
        `.npy`: an array (N, T, C), or (T, C) for a single demonstration, columns as `columns` says;
        `.npz`: the same array alone under any key, or keys `positions` (N, T, 3 or 2), `quaternions` (N, T,
        4), in the order of `columns`, and `times` (N, T) or (T,); without `quaternions` it holds positions alone;
        `.csv`: a header, then one row a sample; column `demonstration` says which one it belongs to, the
        others are those of `columns`, in any order; `t` may always be among them;
        a folder with `.csv` files of this kind.
    units : "m", "cm" or "mm", of the positions.
    columns : names of the columns, separated by commas, in the order of the file: `px,py,pz,qw,qx,qy,qz`, with `t` [s]
        where the file has times. `px,py,pz` alone: no orientation. `px,py` alone: planar, at z = 0. Of text with any
        header (`.txt`, `.csv`) our names and those of the file: `t=stamp,px=x,py=y,pz=z`.
    rate_hz : samples a second of files that have no times; None: not known, ASSUMED_RATE is taken.

    Returns
    -------
    Demonstrations in metres, signs of quaternions as recorded but continuous inside each demonstration;
    `has_orientation` is False (and the orientation the identity) where the file has none.

    Raises
    ------
    DemonstrationError
        Says which file, demonstration, sample and column cannot be used, and what would be right.
    """
    path = Path(path)
    takes = read_pose_takes(path, units, columns, rate_hz)
    with name_in_errors(path):
        return make_demonstrations(takes)


def read_pose_takes(
    path: Path, units: Units, columns: str = DEFAULT_COLUMNS, rate_hz: float | None = None
) -> list[Take]:
    """Read poses as they were recorded, in metres: one take for each demonstration, its times not checked."""
    scale = _metres_per(units)
    if is_mapped(path, columns):
        mapped = read_mapped_tables(path, columns)
        if mapped.unit not in ("", units):
            raise DemonstrationError(f"{path}: its columns are in {mapped.unit}, by their names; --units says {units}")
    else:
        mapped = MappedTables(read_pose_tables(path, parse_columns(columns), rate_hz))
    tables = mapped.tables
    _check_reach(tables, scale, units, path)
    with name_in_errors(path):
        takes = [_pose_take(name, table, scale, rate_hz) for name, table in tables.items()]
        for take in takes:
            check_samples(len(take), take.name)
            check_norms(take.values[:, 3:], take.name)
    _check_motion(takes, scale, units, path)
    return _as_found(takes, mapped)


def make_demonstrations(takes: Sequence[Take]) -> Demonstrations:
    """Make demonstrations of takes of poses, one each; DemonstrationError names what cannot be used."""
    oriented = all(len(take.names) == len(POSE) for take in takes)
    timed = all(take.has_times for take in takes)
    return Demonstrations(tuple(map(_demonstration, takes)), has_orientation=oriented, has_times=timed)


def read_joint_demonstrations(path: str | Path, robot: str, rate_hz: float | None = None) -> JointDemonstrations:
    """Read a recording of an arm's joints, in radians.

    Parameters
    ----------
    path : one of
        `.npz`: keys `configurations` (N, T, eta) [rad] and `joint_names` (eta,), in the order of the columns; where it
        has them also `times` (N, T) or (T,) [s], `names` (N,) and `robot`;
        `.csv`: a header, then one row a sample; column `demonstration` says which one it belongs to, the others are
        called like the joints, in any order; `t` [s] may be among them;
        a folder with `.csv` files of this kind.
    robot : name of the arm, as `Robot.named` knows it; the joints of the file must be its joints.
    rate_hz : samples a second of files that have no times; None: not known, ASSUMED_RATE is taken.

    Returns
    -------
    JointDemonstrations, their joints in the order of the robot.

    Raises
    ------
    RobotError : there is no such robot.
    DemonstrationError
        Says which file, demonstration, sample and joint cannot be used, and what would be right: joints of another
        robot, joints outside their limits (degrees are), and what `read_demonstrations` refuses.
    """
    path = Path(path)
    takes = read_joint_takes(path, robot, rate_hz)
    with name_in_errors(path):
        return make_joint_demonstrations(takes, robot)


def read_joint_takes(
    path: Path, robot: str, rate_hz: float | None = None, columns: str = DEFAULT_COLUMNS, units: str | None = None
) -> list[Take]:
    """Read joints as they were recorded, in the robot's order: one take for each demonstration, times not checked.

    columns : of files of other programs, our names and those of the file; of our own nothing.
    units : "rad" or "deg"; None: as the file says, radians where it does not.
    """
    # compiled kernels, which readers of poses and the help of the command line do without
    from geodesic_motion_ros.robot.kinematics import Robot

    names = Robot.named(robot).joint_names
    if is_mapped(path, columns):
        mapped = read_mapped_tables(path, columns, names)
        if units and mapped.unit not in ("", units):
            raise DemonstrationError(f"{path}: its columns are in {mapped.unit}, by their names; --units says {units}")
    else:
        mapped = MappedTables(read_joint_tables(path, names, robot, rate_hz))
    with name_in_errors(path):
        takes = [
            _timed_take(name, table, np.array([table[one] for one in names]).T, names, rate_hz)
            for name, table in mapped.tables.items()
        ]
    return _as_found(convert_to_radians(takes, units or mapped.unit), mapped)


def convert_to_radians(takes: Sequence[Take], units: str | None) -> list[Take]:
    """Convert takes of joints that were recorded in `units` to radians: "deg", "rad", or "" and None, radians.

    Raises
    ------
    DemonstrationError : there is no such unit, or no joint comes farther than radians do.
    """
    if units not in (*ANGLES, "", None):
        raise DemonstrationError(f"joints in {units}: they are in {' or '.join(ANGLES)}")
    if units != "deg":
        return [*takes]
    farthest = max(float(np.nanmax(np.abs(take.values), initial=0.0)) for take in takes)
    if farthest <= 2.0 * np.pi:
        raise DemonstrationError(
            f"no joint comes farther than {farthest:.3g} deg from 0: are these radians? Joints are read in radians "
            "where neither --units nor the header says deg"
        )
    return [replace(take, values=np.radians(take.values)) for take in takes]


def _as_found(takes: list[Take], mapped: MappedTables) -> list[Take]:
    """The takes of a file; what was found in the whole file is the first one's."""
    return [replace(takes[0], found=mapped.found, in_one_go=mapped.in_one_go), *takes[1:]]


def make_joint_demonstrations(takes: Sequence[Take], robot: str) -> JointDemonstrations:
    """Make demonstrations of takes of a robot's joints, one each; DemonstrationError names what cannot be used."""
    from geodesic_motion_ros.robot.kinematics import Robot

    arm = Robot.named(robot)
    motions, _ = align_turns([unwrap_turns(take, arm)[0] for take in takes], arm)
    items = tuple(JointDemonstration(motion.values, motion.times, motion.name) for motion in motions)
    timed = all(take.has_times for take in takes)
    demonstrations = JointDemonstrations(items, arm.joint_names, robot, has_times=timed)
    demonstrations.check_robot(arm)
    return demonstrations


def check_kind(path: Path) -> None:
    """Refuse a file that is not there, or of a kind that is not read: DemonstrationError, with what makes one that is.
    """
    kinds = (".npy", ".npz", *TEXT_FILES)
    if not path.exists():
        raise DemonstrationError(f"{path}: cannot be read (No such file or directory)")
    if path.is_file() and path.suffix.lower() not in kinds:
        raise DemonstrationError(
            f"{path}: cannot read '{path.suffix}' files, only bags and {', '.join(kinds)}: export it as .csv (with "
            "pandas: read_parquet, read_excel or read_json, then to_csv)"
        )


def is_mapped(path: Path, columns: str) -> bool:
    """Tell whether a file is one of another program, of which `columns` says which column is which."""
    suffix = path.suffix.lower()
    if suffix != ".csv" or path.is_dir():
        return suffix in TEXT_FILES and not path.is_dir()
    plain = {name.strip() for name in columns.split(",")} <= {TIME, *POSITION, *QUATERNION}
    if plain and columns != DEFAULT_COLUMNS:
        with suppress(OSError, UnicodeDecodeError, FileError, DemonstrationError):
            return DEMONSTRATION not in read_names(path)
    return not plain


def is_of_joints(path: str | Path) -> bool:
    """Tell whether a file says of itself that it is a recording of joints, for `read_joint_demonstrations`.

    A `.npz` with the key `configurations`, or a `.csv`, or a folder of them, with a column `demonstration` and none of
    positions. False for what cannot be read.
    """
    path = Path(path)
    try:
        names = read_names(path)
    except (OSError, UnicodeDecodeError, FileError, DemonstrationError):
        return False
    if path.suffix.lower() == ".npz":
        return "configurations" in names
    return DEMONSTRATION in names and not names & {*POSITION, *QUATERNION}


def _metres_per(units: str) -> float:
    if units not in METRES_PER_UNIT:
        raise DemonstrationError(f"unknown units '{units}'; use one of {', '.join(METRES_PER_UNIT)}")
    return METRES_PER_UNIT[units]


def _positions(table: Table, scale: float) -> np.ndarray:
    """(T, 3) [m], planar recordings at z = 0."""
    zeros = np.zeros(len(table["px"]))
    return scale * np.stack([table.get(name, zeros) for name in POSITION], axis=1)


def _pose_take(name: str, table: Table, scale: float, rate_hz: float | None) -> Take:
    columns = [_positions(table, scale)]
    if QUATERNION[0] in table:
        columns.append(continuous_signs(np.stack([table[column] for column in QUATERNION], axis=1)))
    values = np.hstack(columns)
    return _timed_take(name, table, values, POSE[: values.shape[1]], rate_hz)


def _demonstration(take: Take) -> Demonstration:
    quaternions = take.values[:, 3:]
    if not quaternions.shape[1]:
        quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (len(take), 1))
    return Demonstration(take.values[:, :3], quaternions, take.times, take.name)


def _timed_take(
    name: str, table: Table, values: np.ndarray, names: tuple[str, ...], rate_hz: float | None
) -> Take:
    """A take of values (T, C) with the times of a table, or at a rate."""
    times = table[TIME] if TIME in table else np.arange(len(values)) / (rate_hz or ASSUMED_RATE)
    return Take(name, times, values, names, has_times=TIME in table or rate_hz is not None)


def _check_reach(tables: dict[str, Table], scale: float, units: str, path: Path) -> None:
    """Refuse units under which no arm reaches the tool; values that are not finite are named elsewhere."""
    for name, table in tables.items():
        distances = np.linalg.norm(_positions(table, scale), axis=1)
        distances[~np.isfinite(distances)] = 0.0
        farthest = float(distances.max(initial=0.0))
        if farthest > ARM_REACH:
            raise DemonstrationError(
                f"{path}: demonstration '{name}', sample {np.argmax(distances)}: read in {units}, the tool "
                f"is {farthest:.4g} m from the base and no arm reaches {ARM_REACH:g} m; "
                f"{_other_units(farthest / scale, units)}"
            )


def _check_motion(takes: Sequence[Take], scale: float, units: str, path: Path) -> None:
    """Refuse units under which the whole task shrinks to a few millimetres."""
    longest = max(float(arc_length(take.values[:, :3])[-1]) for take in takes)
    if longest < SHORTEST_MOTION:
        farthest = max(float(np.linalg.norm(take.values[:, :3], axis=1).max()) for take in takes)
        raise DemonstrationError(
            f"{path}: read in {units}, no demonstration moves more than {longest * 1e3:.3g} mm; "
            f"{_other_units(farthest / scale, units)}"
        )


def _other_units(farthest_in_file: float, units: str) -> str:
    """Suggest the largest other unit under which the farthest position lies within an arm's reach."""
    for name, metres in METRES_PER_UNIT.items():
        if name != units and SHORTEST_MOTION < farthest_in_file * metres <= ARM_REACH:
            return f"did you mean --units {name}?"
    return "check the units and the order of the columns"
