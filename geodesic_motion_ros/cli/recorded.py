"""What `--demos` and `--bag` name, read as the other arguments say.

Readers load libraries: commands import this when they run.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, TypeVar

from geodesic_motion_ros.cli.arguments import RECORDING_OPTIONS
from geodesic_motion_ros.demonstrations.bags import BagTake
from geodesic_motion_ros.demonstrations.column_names import (
    DEFAULT_COLUMNS,
    METRES_PER_UNIT,
    POSITION,
    QUATERNION,
    is_of_poses,
    parse_mapping,
)
from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.quaternion_order import is_scalar_last
from geodesic_motion_ros.demonstrations.readers import (
    check_kind,
    is_mapped,
    is_of_joints,
    read_demonstrations,
    read_joint_demonstrations,
    read_joint_takes,
    read_pose_takes,
)
from geodesic_motion_ros.demonstrations.recordings import Recording
from geodesic_motion_ros.demonstrations.splitting import Split
from geodesic_motion_ros.demonstrations.takes import Take
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.utils.errors import ParameterError

_ROS_COLUMNS = ",".join((*POSITION, *QUATERNION[1:], QUATERNION[0]))
_RECORDINGS = {"task": "recordings of the tool", "joint": "recordings of joints"}


def read_recorded(
    arguments: argparse.Namespace,
    paths: Sequence[Path],
    of_bags: bool,
    options: dict[str, tuple[str, ...]] = RECORDING_OPTIONS,
) -> Recording:
    """What a file, or bags, hold, flaws found and repaired.

    options : names of those, by space, that are refused where they were given and the recording is of another space.

    Raises
    ------
    DemonstrationError : says what cannot be used. ParameterError : an option of another space, or that is missing.
    """
    if of_bags:
        if arguments.units in METRES_PER_UNIT and arguments.units != "m":
            raise ParameterError(f"--units {arguments.units}: messages have metres, nothing is scaled")
        how = Split.parse(arguments.split, arguments.pause, arguments.first)
        robot = arguments.robot or DEFAULT_ROBOT
        recording = Recording.of_bags(paths, arguments.topic, how, robot, arguments.units, arguments.closed)
        space = "joint" if recording.robot else "task"
        if arguments.space not in (None, space):
            raise ParameterError(f"--space {arguments.space}: {paths[0]} has {_RECORDINGS[space]}")
        refuse_other_space(arguments, space, options, paths[0])
        return recording
    (path,) = paths
    check_kind(path)
    space = recorded_space(arguments, path)
    columns = arguments.columns or DEFAULT_COLUMNS
    if is_mapped(path, columns):  # of joints too
        options = options | {"task": tuple(name for name in options["task"] if name != "columns")}
    refuse_other_space(arguments, space, options, path)
    robot, takes = _read_takes(arguments, path, space)
    if not takes[0].in_one_go:
        return Recording.of_files(takes, robot, arguments.closed)
    # nothing in the file says where a demonstration begins
    how = Split.parse(arguments.split, arguments.pause, arguments.first)
    if how.marker:
        raise ParameterError(f"--split {how.marker}: topics of markers are in bags; {path} is none")
    return Recording.of_long_takes([BagTake(take, ()) for take in takes], how, robot, arguments.closed)


def _read_takes(
    arguments: argparse.Namespace, path: Path, space: Literal["task", "joint"]
) -> tuple[str, list[Take]]:
    """Read the takes of a file, and name the robot of joints; poses have none, ""."""
    columns = arguments.columns or DEFAULT_COLUMNS
    if space == "task":
        return "", read_pose_takes(path, _units(arguments, path), columns, arguments.rate)
    if arguments.units in METRES_PER_UNIT:
        raise ParameterError(f"--units {arguments.units}: {path} has joints, in rad or deg (or: --space task)")
    robot = arguments.robot or DEFAULT_ROBOT
    return robot, read_joint_takes(path, robot, arguments.rate, columns, arguments.units)


def recorded_space(arguments: argparse.Namespace, path: Path) -> Literal["task", "joint"]:
    """What a file is a recording of: what --space says, else what the file says of itself."""
    columns = arguments.columns or DEFAULT_COLUMNS
    if is_mapped(path, columns):
        return arguments.space or ("task" if is_of_poses(parse_mapping(columns)) else "joint")
    return arguments.space or ("joint" if is_of_joints(path) else "task")


def refuse_other_space(
    arguments: argparse.Namespace, space: str, options: dict[str, tuple[str, ...]], path: Path
) -> None:
    """Refuse given options, by space, that belong to another space than the recording: ParameterError names one."""
    for other, names in options.items():
        given = [name for name in names if getattr(arguments, name) is not None]
        if other != space and given:
            option = f"--{given[0].replace('_', '-')}"
            raise ParameterError(
                f"{option} is for {_RECORDINGS[other]}; {path} is taken for {_RECORDINGS[space]} (--space {space})"
            )


def read_recording(arguments: argparse.Namespace, path: Path) -> Demonstrations:
    """The poses of one file, as they are; DemonstrationError says what is wrong with it."""
    return read_demonstrations(path, _units(arguments, path), arguments.columns or DEFAULT_COLUMNS, arguments.rate)


def refuse_unsaid_order(arguments: argparse.Namespace, path: Path, demonstrations: Demonstrations) -> None:
    """Refuse quaternions that look as if their scalar were last, while nothing says where it is: ParameterError.

    Not of an arm on a wall or ceiling: how its tool points in its base frame tells nothing.
    """
    # loaded here, for most commands do without
    from geodesic_motion_ros.robot.kinematics import Robot
    from geodesic_motion_ros.robot.mounting import is_upright

    unsaid = path.suffix.lower() in (".npy", ".npz") and arguments.columns is None
    if unsaid and is_scalar_last(demonstrations) and is_upright(Robot.named(arguments.robot or DEFAULT_ROBOT)):
        raise ParameterError(
            f"with the quaternions of {path.name} read as qw,qx,qy,qz the tool does not point down, as qx,qy,qz,qw it "
            f"does: in which order are they? In that of ROS: say --columns {_ROS_COLUMNS}; otherwise say --columns "
            f"{DEFAULT_COLUMNS}"
        )


def _units(arguments: argparse.Namespace, path: Path) -> Literal["m", "cm", "mm"]:
    if arguments.units not in METRES_PER_UNIT:
        raise ParameterError(f"say the units of the positions in {path}: --units {', '.join(METRES_PER_UNIT)}")
    return arguments.units


def read_joint_recording(arguments: argparse.Namespace, path: Path) -> JointDemonstrations:
    """The joints of one file, as they are; DemonstrationError says what is wrong with it."""
    return read_joint_demonstrations(path, arguments.robot or DEFAULT_ROBOT, arguments.rate)


def read_rounds(
    arguments: argparse.Namespace, path: Path, space: Literal["task", "joint"]
) -> Demonstrations | JointDemonstrations | None:
    """Read the rounds of one file, from which `train` learns a closed skill; None: its motions lead elsewhere."""
    robot, takes = _read_takes(arguments, path, space)
    recording = Recording.of_files(takes, robot)
    return None if recording.rounds is None else recording.demonstrations()


Demonstrated = TypeVar("Demonstrated", Demonstrations, JointDemonstrations)


def evenly_sampled(demonstrations: Demonstrated) -> Demonstrated:
    """Demonstrations with equally many samples each, as arrays in a file need: as many as the longest has."""
    return demonstrations.resample(max(len(item) for item in demonstrations), by="time")
