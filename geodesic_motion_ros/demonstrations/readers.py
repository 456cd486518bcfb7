"""Recordings on disk -> Demonstrations, JointDemonstrations. Units are given, never guessed; nothing is unpickled."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_ros.demonstrations.recorded_tables import (
    DEFAULT_COLUMNS,
    DEMONSTRATION,
    POSITION,
    QUATERNION,
    TIME,
    Table,
    joint_tables,
    names_in,
    parse_columns,
    pose_tables,
)
from geodesic_motion_ros.utils.checked_numbers import ARM_REACH
from geodesic_motion_ros.utils.errors import DemonstrationError, FileError

if TYPE_CHECKING:
    from geodesic_motion_ros.robot.kinematics import Robot

Units = Literal["m", "cm", "mm"]
METRES_PER_UNIT: dict[str, float] = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
SHORTEST_MOTION = 0.01
"""When no demonstration of a file moves this far [m], its units were taken for too small ones."""


def read_demonstrations(
    path: str | Path, units: Units, columns: str = DEFAULT_COLUMNS, rate_hz: float = 100.0
) -> Demonstrations:
    """Read a recording.

    Parameters
    ----------
    path : one of
        `.npy`: an array (N, T, C), or (T, C) for a single demonstration, columns as `columns` says;
        `.npz`: the same array alone under any key, or keys `positions` (N, T, 3 or 2), `quaternions` (N, T,
        4), in the order of `columns`, and `times` (N, T) or (T,); without `quaternions` it holds positions alone;
        `.csv`: a header, then one row a sample; column `demonstration` says which one it belongs to, the
        others are those of `columns`, in any order; `t` may always be among them.
    units : "m", "cm" or "mm", of the positions.
    columns : names of the columns, separated by commas, in the order of the file: `px,py,pz,qw,qx,qy,qz`, with `t` [s]
        where the file has times. `px,py,pz` alone: no orientation. `px,py` alone: planar, at z = 0.
    rate_hz : samples a second of files that have no times.

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
    scale = _metres_per(units)
    tables = pose_tables(path, parse_columns(columns), rate_hz)
    _check_reach(tables, scale, units, path)
    try:
        items = tuple(_demonstration(name, table, scale, rate_hz) for name, table in tables.items())
    except DemonstrationError as error:
        raise DemonstrationError(f"{path}: {error}") from error
    _check_motion(items, scale, units, path)
    return Demonstrations(items, has_orientation=all(QUATERNION[0] in table for table in tables.values()))


def read_joint_demonstrations(path: str | Path, robot: str, rate_hz: float = 100.0) -> JointDemonstrations:
    """Read a recording of an arm's joints, in radians.

    Parameters
    ----------
    path : one of
        `.npz`: keys `configurations` (N, T, eta) [rad] and `joint_names` (eta,), in the order of the columns; where it
        has them also `times` (N, T) or (T,) [s], `names` (N,) and `robot`;
        `.csv`: a header, then one row a sample; column `demonstration` says which one it belongs to, the others are
        called like the joints, in any order; `t` [s] may be among them.
    robot : name of the arm, as `Robot.named` knows it; the joints of the file must be its joints.
    rate_hz : samples a second of files that have no times.

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
    # compiled kernels, which readers of poses and the help of the command line do without
    from geodesic_motion_ros.robot.kinematics import Robot

    path = Path(path)
    arm = Robot.named(robot)
    tables = joint_tables(path, arm.joint_names, robot, rate_hz)
    try:
        items = tuple(_joint_demonstration(name, table, arm, rate_hz) for name, table in tables.items())
        demonstrations = JointDemonstrations(items, arm.joint_names, robot)
        demonstrations.check_robot(arm)
    except DemonstrationError as error:
        raise DemonstrationError(f"{path}: {error}") from error
    return demonstrations


def holds_joints(path: str | Path) -> bool:
    """Whether a file says of itself that it is a recording of joints, for `read_joint_demonstrations`.

    A `.npz` with the key `configurations`, or a `.csv` with a column `demonstration` and none of positions. False for
    what cannot be read.
    """
    path = Path(path)
    try:
        names = names_in(path)
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


def _demonstration(name: str, table: Table, scale: float, rate_hz: float) -> Demonstration:
    positions = _positions(table, scale)
    samples = len(positions)
    if QUATERNION[0] in table:
        quaternions = np.stack([table[column] for column in QUATERNION], axis=1)
    else:
        quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (samples, 1))
    return Demonstration(positions, quaternions, _times(table, samples, rate_hz), name)


def _times(table: Table, samples: int, rate_hz: float) -> np.ndarray:
    return table[TIME] if TIME in table else np.arange(samples) / rate_hz


def _joint_demonstration(name: str, table: Table, robot: Robot, rate_hz: float) -> JointDemonstration:
    configurations = np.stack([table[joint] for joint in robot.joint_names], axis=1)
    return JointDemonstration(configurations, _times(table, len(configurations), rate_hz), name)


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


def _check_motion(items: tuple[Demonstration, ...], scale: float, units: str, path: Path) -> None:
    """Refuse units under which the whole task shrinks to a few millimetres."""
    longest = max(item.length for item in items)
    if longest < SHORTEST_MOTION:
        farthest = max(float(np.linalg.norm(item.positions, axis=1).max()) for item in items)
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
