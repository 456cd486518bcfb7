"""Reading a serial chain out of a URDF file: joints, offsets, axes and limits between two named links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.utils.errors import RobotError

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Chain:
    """The m joints from a base link to a tool link, n of them moving.

    Attributes
    ----------
    link_names : m + 1 names, base first, tool last.
    joint_names : names of the n moving joints.
    rotations, translations : (m, 3, 3), (m, 3) [m], joint frame in its parent link's frame at zero.
    axes : (m, 3), unit, in the joint frame; zero for fixed joints.
    joint_index : (m,), index into the n moving joints, -1 for fixed ones.
    prismatic : (m,) bool.
    lower, upper, velocity : (n,) limits [rad, rad/s; prismatic: m, m/s]; positions infinite if continuous.
    """

    link_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    rotations: np.ndarray
    translations: np.ndarray
    axes: np.ndarray
    joint_index: np.ndarray
    prismatic: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray


def read_chain(path: str | Path, base_link: str, tool_link: str) -> Chain:
    """Read the chain between two links of a URDF file.

    Raises
    ------
    RobotError : the file cannot be read, a link is missing or not below the base, or a joint lacks a limit.
    """
    joints = _joints_from_base(read_urdf(path), base_link, tool_link, Path(path).name)
    moving = [joint for joint in joints if joint.get("type") in MOVING]
    if not moving:
        raise RobotError(f"no moving joint lies between '{base_link}' and '{tool_link}' in {Path(path).name}")
    names = tuple(joint.get("name", "") for joint in moving)
    limits = np.array([_limits(joint) for joint in moving]).T.copy()
    origins = [read_origin(joint, f"joint '{joint.get('name')}'") for joint in joints]
    return Chain(
        link_names=(base_link, *(joint.find("child").get("link") for joint in joints)),
        joint_names=names,
        rotations=np.array([rotation for rotation, _ in origins]),
        translations=np.array([translation for _, translation in origins]),
        axes=np.array([_axis(joint) for joint in joints]),
        joint_index=np.array([names.index(joint.get("name")) if joint in moving else -1 for joint in joints]),
        prismatic=np.array([joint.get("type") == "prismatic" for joint in joints]),
        lower=limits[0],
        upper=limits[1],
        velocity=limits[2],
    )


def read_dynamic_limits(path: str | Path, joint_names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Acceleration [rad/s^2] and jerk limits [rad/s^3], both (n,), from a joint_limits.yaml as MoveIt's.

    Raises
    ------
    RobotError : a joint or one of its two limits is missing, or a limit is not a positive number.
    """
    table = _joint_limits(path)
    limits = [[_positive(table, joint, key, path) for joint in joint_names] for key in ("max_acceleration", "max_jerk")]
    return np.array(limits[0]), np.array(limits[1])


def read_velocity_limits(path: str | Path, joint_names: tuple[str, ...], otherwise: np.ndarray) -> np.ndarray:
    """Velocity limits (n,) [rad/s] of a joint_limits.yaml, for joints without one there those of (n,) `otherwise`.

    Raises
    ------
    RobotError : a limit is not a positive number.
    """
    table = _joint_limits(path)
    key = "max_velocity"
    has_one = [isinstance(table.get(joint), Mapping) and key in table[joint] for joint in joint_names]
    pairs = zip(joint_names, has_one, otherwise, strict=True)
    return np.array([_positive(table, joint, key, path) if here else limit for joint, here, limit in pairs])


def _joint_limits(path: str | Path) -> Mapping:
    """The mapping of a joint_limits.yaml, by joint."""
    try:
        table = yaml.safe_load(Path(path).read_text())["joint_limits"]
    except (OSError, yaml.YAMLError, TypeError, KeyError) as error:
        raise RobotError(f"{path} must be a YAML file with a mapping `joint_limits`: {error}") from error
    if not isinstance(table, Mapping):
        raise RobotError(f"{path}: joint_limits is {table}; it must hold joints with their limits")
    return table


def read_urdf(path: str | Path) -> ElementTree.Element:
    """The root of a URDF file. RobotError: it cannot be read, or is none."""
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError) as error:
        raise RobotError(f"cannot read the URDF {path}: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"{path} is no URDF: its root element is <{root.tag}>, expected <robot>")
    return root


def _joints_from_base(
    root: ElementTree.Element, base_link: str, tool_link: str, file_name: str
) -> list[ElementTree.Element]:
    links = [link.get("name") for link in root.findall("link")]
    for link in (base_link, tool_link):
        if link not in links:
            raise RobotError(f"link '{link}' is not in {file_name}; it has {', '.join(map(str, links))}")
    parent_joint = {
        joint.find("child").get("link"): joint
        for joint in root.findall("joint")
        if joint.find("child") is not None and joint.find("parent") is not None
    }
    chain: list[ElementTree.Element] = []
    link = tool_link
    while link != base_link:
        joint = parent_joint.get(link)
        if joint is None or len(chain) > len(links):
            raise RobotError(f"no chain of joints leads from '{base_link}' to '{tool_link}' in {file_name}")
        if joint.get("type") not in (*MOVING, "fixed"):
            raise RobotError(
                f"joint '{joint.get('name')}' is of type '{joint.get('type')}'; "
                f"a chain may have {', '.join(MOVING)} and fixed joints"
            )
        if (mimic := joint.find("mimic")) is not None:
            raise RobotError(
                f"joint '{joint.get('name')}' mimics '{mimic.get('joint')}': a chain may not have mimic joints"
            )
        chain.append(joint)
        link = joint.find("parent").get("link")
    return chain[::-1]


def _limits(joint: ElementTree.Element) -> tuple[float, float, float]:
    limit, name = joint.find("limit"), joint.get("name")
    wanted = ["velocity"] if joint.get("type") == "continuous" else ["lower", "upper", "velocity"]
    missing = wanted if limit is None else [key for key in wanted if limit.get(key) is None]
    if missing:
        raise RobotError(
            f"joint '{name}' lacks the limit {', '.join(missing)}: "
            f'write <limit lower=".." upper=".." velocity=".." effort=".."/> with all of {", ".join(wanted)}'
        )
    values = {key: read_floats(limit.get(key), 1, f"limit {key} of joint '{name}'")[0] for key in wanted}
    lower, upper = values.get("lower", -np.inf), values.get("upper", np.inf)
    if not (lower < upper and values["velocity"] > 0.0):
        raise RobotError(
            f"joint '{name}' has limits lower {lower}, upper {upper}, velocity {values['velocity']}: "
            "lower must be below upper and velocity positive"
        )
    return lower, upper, values["velocity"]


def read_origin(element: ElementTree.Element, subject: str) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and translation (3,) [m] of an element's <origin>; none is the identity."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    angles = read_floats(origin.get("rpy", "0 0 0"), 3, f"origin rpy of {subject}")
    translation = read_floats(origin.get("xyz", "0 0 0"), 3, f"origin xyz of {subject}")
    return Rotation.from_euler("xyz", angles).as_matrix(), np.array(translation)


def _axis(joint: ElementTree.Element) -> np.ndarray:
    if joint.get("type") not in MOVING:
        return np.zeros(3)
    element, name = joint.find("axis"), joint.get("name")
    text = "1 0 0" if element is None else element.get("xyz", "1 0 0")
    axis = np.array(read_floats(text, 3, f"axis of joint '{name}'"))
    if not np.linalg.norm(axis) > 0.0:
        raise RobotError(f"the axis of joint '{name}' is zero: it must be a direction")
    return axis / np.linalg.norm(axis)


def read_floats(text: str, count: int, what: str) -> list[float]:
    """Finite numbers out of an attribute; RobotError: there are others, or another number of them."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise RobotError(f"{what} is '{text}': expected {count} finite number{'s' if count > 1 else ''}")
    return values


def _positive(table: Mapping, joint: str, key: str, path: str | Path) -> float:
    entry = table.get(joint)
    value = entry.get(key) if isinstance(entry, Mapping) else None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value < np.inf:
        raise RobotError(f"{key} of joint '{joint}' in {Path(path).name} is {value}: expected a positive number")
    return float(value)
