"""RobotDescription: a folder that says all that the package has to know of a robot.

A shipped robot is such a folder in `robots/`, one of your own may be anywhere; `geodesic-motion robot` makes one out of
a URDF. In it are the URDF, the two files named below, meshes where there are any, and `robot.yaml`:

    name: arm                      what it is called
    urdf: arm.urdf                 positions and velocities of the joints are limited as this file says
    base_link, tool_link: ...      the two ends of the chain, as links of the URDF
    limits: joint_limits.yaml      what a URDF cannot say, in MoveIt's layout: max_acceleration [rad/s^2], max_jerk
                                   [rad/s^3]; max_velocity [rad/s] in the place of the URDF's, where that is wrong
    limits_source: ...             where these numbers are from
    ready: [0.0, ...]              a comfortable posture [rad]
    spheres: spheres.yaml          spheres, and which of them can meet: `CollisionModel.load`
    hand: hand                     the link whose spheres are the tool's, or
    tool_spheres: [[x, y, z, r]]   spheres in the frame of the tool link [m] in their place; these two may be left out
    inverse_kinematics: a.module   what solves it in closed form, `solutions.py`; without it that is done numerically
    simulation:                    for the twin, may be left out:
      urdf: arm_with_meshes.urdf     another URDF, with the same joints; pybullet_data/... is one that PyBullet brings
      joints: {finger: 0.02}         positions of joints beside the chain [rad, m]

Nothing of it is executed; a plug-in is a module that is installed.
"""

from __future__ import annotations

import difflib
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geodesic_motion_ros.utils.checked_files import brief, opened, read_yaml
from geodesic_motion_ros.utils.errors import FileError, RobotError

FILE = "robot.yaml"
SHIPPED = Path(__file__).parent / "robots"
#: The robot of the teachers, the demo and the commands where no other one is named.
DEFAULT_ROBOT = "panda"

_REMEDY = f"a folder with {FILE}; `geodesic-motion robot FILE --base LINK --tip LINK --out DIR` makes such a folder"
_TEXTS = ("name", "base_link", "tool_link", "limits_source")
_FILES = ("urdf", "limits", "spheres")
_OPTIONAL = ("hand", "tool_spheres", "inverse_kinematics", "simulation")
_KEYS = (*_TEXTS, *_FILES, "ready", *_OPTIONAL)
_LARGEST = 64 << 10


@dataclass(frozen=True)
class RobotDescription:
    """What a robot's folder says.

    Attributes
    ----------
    name, folder : what it is called, and where it was read from.
    urdf, limits, spheres : files of the folder.
    base_link, tool_link : the ends of the chain.
    limits_source : where acceleration and jerk limits are from.
    ready : (n,) [rad].
    hand : the link whose spheres are the tool's; None for none.
    tool_spheres : (K, 4) [m], in the frame of the tool link, in the place of the hand's; empty for these.
    inverse_kinematics : module of the closed form; None: it is solved numerically.
    simulated_urdf : URDF of the twin, a path, or pybullet_data/... for one that PyBullet brings.
    simulated_joints : positions [rad, m] of joints beside the chain, by name.
    """

    name: str
    folder: Path
    urdf: Path
    base_link: str
    tool_link: str
    limits: Path
    limits_source: str
    ready: tuple[float, ...]
    spheres: Path
    hand: str | None
    tool_spheres: tuple[tuple[float, ...], ...]
    inverse_kinematics: str | None
    simulated_urdf: str
    simulated_joints: Mapping[str, float]

    @classmethod
    def named(cls, name: str | Path) -> RobotDescription:
        """Of a shipped robot by its name, or of the folder at a path.

        Raises
        ------
        RobotError : there is neither; or as `read`.
        """
        return cls.read(robot_folder(name))

    @classmethod
    def read(cls, folder: Path) -> RobotDescription:
        """Read and check `robot.yaml` of a folder.

        Raises
        ------
        RobotError : names the file, the key, what is wrong with it and what would be right.
        """
        file = folder / FILE
        try:
            with opened(file, _LARGEST) as stream:
                table = read_yaml(stream.read())
            return cls._of(table, folder)
        except (OSError, FileError, RobotError) as error:
            reason = error.strerror if isinstance(error, OSError) else error
            remedy = f": a robot is {_REMEDY}" if isinstance(error, FileNotFoundError) else ""
            raise RobotError(f"{file}: {reason}{remedy}") from error

    @classmethod
    def _of(cls, table: Any, folder: Path) -> RobotDescription:
        if not isinstance(table, dict):
            raise RobotError(f"is {brief(table)}; it must hold {', '.join(_KEYS)}")
        for key in table:
            if key not in _KEYS:
                close = difflib.get_close_matches(str(key), _KEYS, n=1)
                raise RobotError(f"{brief(key)} is not known; {f'did you mean {close[0]}?' if close else _KEYS}")
        if missing := [key for key in _KEYS if key not in table and key not in _OPTIONAL]:
            raise RobotError(f"lacks {', '.join(missing)}")
        texts = {key: _text(key, table[key]) for key in _TEXTS}
        files = {key: _file(key, table[key], folder) for key in _FILES}
        rows = table.get("tool_spheres", [])
        if not isinstance(rows, list):
            raise RobotError(f"tool_spheres is {brief(rows)}; it must be a list of [x, y, z, radius] in metres")
        optional = {key: _text(key, table[key]) if key in table else None for key in ("hand", "inverse_kinematics")}
        simulated, joints = _simulation(table.get("simulation", {}), files["urdf"], folder)
        return cls(
            folder=folder, **texts, **files, **optional,
            ready=_numbers("ready", table["ready"]),
            tool_spheres=tuple(_numbers("tool_spheres", row, 4) for row in rows),
            simulated_urdf=simulated, simulated_joints=joints,
        )  # fmt: skip


def robot_folder(name: str | Path, *bases: Path) -> Path:
    """The folder of a shipped robot by its name, or that at a path.

    bases : what a relative path may start from, in this order; without them the working directory.

    Raises
    ------
    RobotError : there is neither; the message says where the folder was looked for.
    """
    if str(name) in shipped_robots():
        return SHIPPED / str(name)
    path = Path(name).expanduser()
    folders = [base / path for base in bases or (Path(),)]
    for folder in folders:
        if path.name and folder.is_dir():
            return folder
    what, looked = "is a file", ""
    if not path.is_file():
        places = " nor ".join(dict.fromkeys(os.path.abspath(folder) for folder in folders))
        what, looked = "is not known here", f"; there is no folder {places}"
    names = ", ".join(map(repr, shipped_robots()))
    raise RobotError(f"robot {str(name)!r} {what}; known: {names}{looked}; or give the path of {_REMEDY}")


def shipped_robots() -> tuple[str, ...]:
    """Names of the robots that this package ships."""
    return tuple(sorted(file.parent.name for file in SHIPPED.glob(f"*/{FILE}")))


def _text(key: str, value: Any) -> str:
    if not (isinstance(value, str) and value and value.isprintable()):
        raise RobotError(f"{key} is {brief(value)}; it must be a text of one line")
    return value


def _file(key: str, value: Any, folder: Path) -> Path:
    path = folder / _text(key, value)
    if not path.is_file():
        raise RobotError(f"{key} is {value!r}; there is no such file in the folder")
    return path


def _numbers(key: str, value: Any, count: int | None = None) -> tuple[float, ...]:
    wanted = f"{count} numbers" if count else "a list of numbers"
    good = isinstance(value, list) and value and (count is None or len(value) == count) and all(map(_is_number, value))
    if not good:
        raise RobotError(f"{key} is or holds {brief(value)}; expected {wanted}, finite")
    return tuple(map(float, value))


def _simulation(value: Any, urdf: Path, folder: Path) -> tuple[str, dict[str, float]]:
    if not isinstance(value, dict) or not value.keys() <= {"urdf", "joints"}:
        raise RobotError(f"simulation is {brief(value)}; it may hold urdf and joints")
    joints = value.get("joints", {})
    if not isinstance(joints, dict) or not all(isinstance(key, str) for key in joints):
        raise RobotError(f"simulation.joints is {brief(joints)}; it must hold joints with their positions")
    wrong = [key for key, position in joints.items() if not _is_number(position)]
    if wrong:
        raise RobotError(f"simulation.joints.{wrong[0]} is {brief(joints[wrong[0]])}; it must be a finite number")
    named = _text("simulation.urdf", value.get("urdf", urdf.name))
    simulated = named if named.startswith("pybullet_data/") else str(_file("simulation.urdf", named, folder))
    return simulated, {key: float(position) for key, position in joints.items()}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
