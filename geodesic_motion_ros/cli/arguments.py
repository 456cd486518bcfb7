"""Arguments that several commands share, and how their values are read."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Any, Literal

from geodesic_motion_ros.demonstrations.column_names import ANGLES, DEFAULT_COLUMNS, METRES_PER_UNIT
from geodesic_motion_ros.demonstrations.splitting import PAUSE
from geodesic_motion_ros.robot.description import DEFAULT_ROBOT
from geodesic_motion_ros.utils.checked_numbers import LARGEST_DIMENSION
from geodesic_motion_ros.utils.errors import GeodesicMotionError, ParameterError

if TYPE_CHECKING:
    from geodesic_motion_ros.skill.skill import Skill


#: Of recordings, by the space that is learned from them.
RECORDING_OPTIONS = {"task": ("columns",), "joint": ()}
#: The distribution and its extra that bring a library.
_EXTRAS = {
    "torch": "geodesic_motion_ros[learn]", "pytorch_kinematics": "geodesic_motion_ros[learn]",
    "pybullet": "geodesic_motion_ros[simulation]", "pybullet_data": "geodesic_motion_ros[simulation]",
    "movement_primitives": "geodesic_motion_studies[peers]", "pytransform3d": "geodesic_motion_studies[peers]",
}  # fmt: skip


@contextmanager
def needing(what: str, remedy: str = "") -> Iterator[None]:
    """State in one line what needs a library that is not installed, and what to do then.

    remedy : "": to install the extra that brings it; what no extra brings is raised as it is.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        extra = _EXTRAS.get((error.name or "").partition(".")[0])
        if extra is not None:
            remedy = remedy or f"pip install '{extra}'"
        if not remedy or (error.name and error.name.startswith("geodesic_motion_")):
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
    parser: argparse.ArgumentParser,
    required: bool = True,
    several: bool = False,
    joints: bool = False,
    bags: bool = False,
) -> None:
    """--demos, and how it is read (`add_formats`); with `bags`, --bag in its place and how that is read."""
    group = parser.add_argument_group("recording")
    source = group.add_mutually_exclusive_group(required=required)
    source.add_argument(
        "--demos", type=Path, metavar="FILE", nargs="+" if several else None,
        help="recorded demonstrations: .npy (N, T, columns), .npz, .csv with a column `demonstration`, a "
        "folder of such .csv files, or text with any header, see --columns",
    )  # fmt: skip
    if bags:
        source.add_argument(
            "--bag", type=Path, nargs="+", metavar="PATH",
            help="bags with one or more demonstrations each: folders of ROS 2, or files .db3, .mcap, .bag (ROS 1)",
        )  # fmt: skip
    add_formats(group, required and not joints, joints)
    if bags:
        add_bag_options(group)


def add_formats(group: argparse._ArgumentGroup, required: bool = False, joints: bool = False) -> None:
    """--units, --columns and --rate; with `joints`, for recordings of joints too, --space and --robot."""
    group.add_argument(
        "--units", choices=(*METRES_PER_UNIT, *ANGLES), required=required,
        help="m, cm or mm of the positions, required for files: a wrong guess would be off by a hundred; rad or deg of "
        "joints, without it as the header says, or rad",
    )  # fmt: skip
    group.add_argument(
        "--columns", metavar="NAMES",
        help="columns of the file in their order; `t` [s] where it has times, `qx,qy,qz,qw` at the end for quaternions "
        f"as in ROS messages, `px,py,pz` without orientation, `px,py` for a plane; {DEFAULT_COLUMNS} without it. Of "
        "files of other programs our names and those of the file, the rest is passed over: t=stamp,px=x,py=y,pz=z, or "
        "t=stamp,panda_joint1=q0,...; sec,nanosec for a stamp in two columns, rotvec_x,rotvec_y,rotvec_z "
        "for a rotation vector, roll,pitch,yaw for turns about fixed axes, matrix=NAME for 16 columns, "
        "demonstration=NAME; *=NAME_* for all joints. Without a header all, in their order",
    )  # fmt: skip
    group.add_argument(
        "--rate", type=float, metavar="HZ",
        help="samples a second of files without times; without it nothing is learned of how fast a motion is",
    )
    if joints:
        group.add_argument(
            "--space", choices=("task", "joint"),
            help="what the file holds: poses of the tool, or configurations of the whole arm [rad]; without it as the "
            "file says of itself",
        )  # fmt: skip
        group.add_argument("--robot", help="that was recorded, or is to do it: the name of a shipped one, or "
            f"the path of a folder that `geodesic-motion robot` made; {DEFAULT_ROBOT} without it")


def add_bag_options(group: argparse._ArgumentGroup) -> None:
    """Add what bags have beside files: --topic, --split, --pause and --first; --strict and --closed, for both."""
    group.add_argument(
        "--topic", metavar="TOPIC",
        help="of a bag: one of sensor_msgs/JointState or geometry_msgs/PoseStamped, or for transforms "
        "/tf:BASE_FRAME:TOOL_FRAME; not needed where the bag has one of the first two alone",
    )  # fmt: skip
    group.add_argument(
        "--split", metavar="HOW", default="standstill",
        help="of a bag into demonstrations: `standstill`; a topic of markers, as /mark: std_msgs/Empty begins and ends "
        "by turns, Bool begins with true and ends with false, String begins one of that name and ends with an empty "
        "one; or the beginning and end of each [s], as `inspect` shows them: 3.2-9.8,14-20.5",
    )  # fmt: skip
    group.add_argument(
        "--pause", type=float, default=PAUSE, metavar="SECONDS", help="standstills this long are between demonstrations"
    )
    group.add_argument(
        "--first", type=int, default=1, metavar="NUMBER",
        help="motion between standstills that is the first demonstration; those that lead back are passed over",
    )  # fmt: skip
    group.add_argument("--strict", action="store_true", help="refuse every flaw of a recording, repair none")
    group.add_argument(
        "--closed", action=argparse.BooleanOptionalAction, default=None,
        help="demonstrations are rounds, which end where they began, or several one after the other: wiping, stirring; "
        "without it as is found: at least half of them are",
    )  # fmt: skip


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


def latent_dimension(text: str) -> int | Literal["auto"]:
    """A number of latent dimensions, or that the data choose it."""
    if text == "auto":
        return "auto"
    if text not in tuple(map(str, range(1, LARGEST_DIMENSION + 1))):
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1 to {LARGEST_DIMENSION}, nor auto")
    return int(text)


def seconds(text: str) -> float:
    """A time for argparse [s], positive and finite."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a positive number of seconds")
    return value


def metres(text: str) -> tuple[float, ...]:
    """Numbers out of "0.02,0.04"."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a list of numbers like 0.02,0.04") from None


def writable(path: Path | None) -> None:
    """Refuse a file that cannot be written, before anything long is begun: ParameterError. Leaves no file there."""
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            path.open("a").close()
        else:
            TemporaryFile(dir=path.parent).close()
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
