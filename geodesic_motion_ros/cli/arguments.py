"""Arguments that several commands share, and how their values are read."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations
from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.readers import (
    METRES_PER_UNIT,
    holds_joints,
    read_demonstrations,
    read_joint_demonstrations,
)
from geodesic_motion_ros.demonstrations.recorded_tables import DEFAULT_COLUMNS
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError

if TYPE_CHECKING:
    from geodesic_motion_ros.skill.skill import Skill


@contextmanager
def needing(what: str, remedy: str) -> Iterator[None]:
    """Imports of what may not be installed: what needs it, and what to do then, is stated in one line."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name and error.name.startswith("geodesic_motion_ros"):
            raise
        raise GeodesicMotionError(f"{what} {error.name}, which is not installed: {remedy}") from error


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Descriptions keep their lines, and options show their defaults where there are any."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        if action.default in (None, False, (), argparse.SUPPRESS):
            return action.help
        if isinstance(action.default, tuple):  # as it is typed
            return f"{action.help} (default: {' '.join(map(str, action.default))})"
        return super()._get_help_string(action)


def add_recording(
    parser: argparse.ArgumentParser, required: bool = True, several: bool = False, joints: bool = False
) -> None:
    """--demos, --units, --columns and --rate; with `joints`, for recordings of joints too, --space and --robot."""
    group = parser.add_argument_group("recording")
    group.add_argument(
        "--demos", type=Path, required=required, metavar="FILE", nargs="+" if several else None,
        help="recorded demonstrations: .npy (N, T, columns), .npz, or .csv with a column `demonstration`",
    )  # fmt: skip
    group.add_argument(
        "--units", choices=tuple(METRES_PER_UNIT), required=required and not joints,
        help="of the positions; always required, a wrong guess would be off by a hundred",
    )  # fmt: skip
    group.add_argument(
        "--columns", metavar="NAMES",
        help="columns of the file in their order; `t` [s] where it has times, `qx,qy,qz,qw` at the end for quaternions "
        f"as in ROS messages, `px,py,pz` without orientation, `px,py` for a plane; {DEFAULT_COLUMNS} without it",
    )  # fmt: skip
    group.add_argument(
        "--rate", type=float, default=100.0, metavar="HZ", help="samples a second of files without times"
    )
    if joints:
        group.add_argument(
            "--space", choices=("task", "joint"),
            help="what the file holds: poses of the tool, or configurations of the whole arm [rad]; without it as the "
            "file says of itself",
        )  # fmt: skip
        group.add_argument("--robot", help="that was recorded, or is to do it: the name of a shipped one, or "
            f"the path of a folder that `geodesic-motion robot` made; {DEFAULT_ROBOT} without it")


def recorded_space(arguments: argparse.Namespace) -> Literal["task", "joint"]:
    """What the recording is of: what --space says, else what the file says of itself."""
    return arguments.space or ("joint" if holds_joints(arguments.demos) else "task")


def refuse_other_space(arguments: argparse.Namespace, space: str, options: dict[str, tuple[str, ...]]) -> None:
    """Refuse given options, by space, that belong to another space than the recording: ParameterError names one."""
    for other, names in options.items():
        given = [name for name in names if getattr(arguments, name) is not None]
        if other != space and given:
            option = f"--{given[0].replace('_', '-')}"
            raise ParameterError(
                f"{option} is for {_RECORDINGS[other]}; {arguments.demos} is taken for {_RECORDINGS[space]} "
                f"(--space {space})"
            )


def read_recording(arguments: argparse.Namespace, path: Path) -> Demonstrations:
    """The poses of one file; DemonstrationError says what is wrong with it."""
    if arguments.units is None:
        raise ParameterError(f"say the units of the positions in {path}: --units {', '.join(METRES_PER_UNIT)}")
    return read_demonstrations(path, arguments.units, arguments.columns or DEFAULT_COLUMNS, arguments.rate)


def read_joint_recording(arguments: argparse.Namespace, path: Path) -> JointDemonstrations:
    """The joints of one file; DemonstrationError says what is wrong with it."""
    return read_joint_demonstrations(path, arguments.robot or DEFAULT_ROBOT, arguments.rate)


#: Of recordings, by the space that is learned from them.
RECORDING_OPTIONS = {"task": ("units", "columns"), "joint": ()}
_RECORDINGS = {"task": "recordings of the tool", "joint": "recordings of joints"}

Recording = TypeVar("Recording", Demonstrations, JointDemonstrations)


def evenly_sampled(demonstrations: Recording) -> Recording:
    """Demonstrations with equally many samples each, as arrays in a file need: as many as the longest has."""
    return demonstrations.resampled(max(len(item) for item in demonstrations), by="time")


def add_json(parser: argparse.ArgumentParser) -> None:
    """--json."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to a file as well")


def given(arguments: argparse.Namespace, *names: str) -> dict[str, Any]:
    """The values of those options that were given."""
    return {name: getattr(arguments, name) for name in names if getattr(arguments, name) is not None}


def indices(text: str) -> tuple[int, ...]:
    """Whole numbers out of "0,3,6"."""
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a list of whole numbers like 0,3,6") from None


def name_list(separator: str) -> Callable[[str], tuple[str, ...]]:
    """What reads names out of "one,two": each of them once, in their order."""

    def read(text: str) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name.strip() for name in text.split(separator)))

    return read


def seed(text: str) -> int:
    """A seed of the random generators."""
    if not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 0 to {2**32 - 1}")
    return int(text)


def metres(text: str) -> tuple[float, ...]:
    """Numbers out of "0.02,0.04"."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a list of numbers like 0.02,0.04") from None


def writable(path: Path | None) -> None:
    """Refuse a file that cannot be written, before anything long is begun: ParameterError."""
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a"):
            pass
    except OSError as error:
        raise ParameterError(f"{path} cannot be written ({error.strerror}): give another file") from error


def pictured(skill: Skill, path: Path) -> None:
    """Draw a skill's latent space into a file, and say where it is."""
    if skill.space == "joint":
        from geodesic_motion_ros.visualization.joint_plots import joint_report as report
    else:
        from geodesic_motion_ros.visualization.plots import training_report as report

    report(skill, path)
    print(f"wrote its picture to {path}")
