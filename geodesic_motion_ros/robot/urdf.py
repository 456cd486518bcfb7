"""Reading a serial chain out of a URDF file: joints, offsets, axes and limits between two named links."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeGuard
from xml.etree import ElementTree

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.robot.position_based_velocity import PositionBasedVelocity
from geodesic_motion_ros.utils.checked_files import load_yaml
from geodesic_motion_ros.utils.errors import RobotError

MOVING = ("revolute", "continuous", "prismatic")
#: What a joint's `position_based_velocity` holds.
_APPROACH = ("deceleration", "offset", "lower", "upper")


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
    return chain_of(read_urdf(path), base_link, tool_link, Path(path).name)


def chain_of(root: ElementTree.Element, base_link: str, tool_link: str, source: str) -> Chain:
    """The chain between two links of a URDF, by its root element, that came from a source; errors as of `read_chain`.
    """
    joints = _joints_from_base(root, base_link, tool_link, source)
    moving = [joint for joint in joints if joint.get("type") in MOVING]
    if not moving:
        raise RobotError(f"no moving joint lies between '{base_link}' and '{tool_link}' in {source}")
    names = tuple(joint.get("name", "") for joint in moving)
    limits = _limits(moving)
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


def moving_joints(path: str | Path, base_link: str, tool_link: str) -> tuple[str, ...]:
    """Names of the moving joints between two links of a URDF file, whatever limits they have.

    Raises
    ------
    RobotError : the file cannot be read, or a link is missing or not below the base.
    """
    joints = _joints_from_base(read_urdf(path), base_link, tool_link, Path(path).name)
    return tuple(joint.get("name", "") for joint in joints if joint.get("type") in MOVING)


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


def read_position_based_velocity(path: str | Path, joint_names: tuple[str, ...]) -> PositionBasedVelocity | None:
    """Limits of the speeds towards stops of a joint_limits.yaml, infinite for joints without; None where no joint has
    any.

    Raises
    ------
    RobotError : one lacks a number, has another one besides, or has one that cannot be.
    """
    table, key = _joint_limits(path), "position_based_velocity"
    rows = np.tile([1.0, 0.0, -np.inf, np.inf], (len(joint_names), 1))
    for row, joint in zip(rows, joint_names, strict=True):
        entry = table.get(joint)
        if isinstance(entry, Mapping) and key in entry:
            row[:] = _approach(entry[key], f"{key} of joint '{joint}' in {Path(path).name}")
    return PositionBasedVelocity(*rows.T) if np.any(np.isfinite(rows[:, 2:])) else None


def _approach(value: object, what: str) -> list[float]:
    """Deceleration, offset, lower and upper stop of a joint; RobotError states what is wrong with them."""
    numbers = [value.get(key) for key in _APPROACH] if isinstance(value, Mapping) else []
    if not isinstance(value, Mapping) or set(value) != set(_APPROACH) or not all(map(_is_finite, numbers)):
        raise RobotError(f"{what} is {value}: expected finite numbers {', '.join(_APPROACH)}, and nothing else")
    deceleration, offset, lower, upper = map(float, numbers)
    if not deceleration > 0.0:
        raise RobotError(f"{what} has deceleration {deceleration:g}: expected a positive one [rad/s^2]")
    if not offset >= 0.0:
        raise RobotError(f"{what} has offset {offset:g}: expected 0 or a positive one [rad/s]")
    if not lower < upper:
        raise RobotError(f"{what} has stops {lower:g} and {upper:g}: expected lower below upper")
    return [deceleration, offset, lower, upper]


def read_largest_speed_scale(path: str | Path) -> float:
    """The largest share of the velocity limits that commands may use, `max_speed_scale` of a joint_limits.yaml; 1
    without one. RobotError: it is not in (0, 1].
    """
    scale = _limits_file(path).get("max_speed_scale", 1.0)
    if not _is_finite(scale) or not 0.0 < scale <= 1.0:
        raise RobotError(f"max_speed_scale in {Path(path).name} is {scale}: expected a number in (0, 1]")
    return float(scale)


def _joint_limits(path: str | Path) -> Mapping:
    """The mapping of a joint_limits.yaml, by joint."""
    table = _limits_file(path)["joint_limits"]
    if not isinstance(table, Mapping):
        raise RobotError(f"{path}: joint_limits is {table}; it must hold joints with their limits")
    return table


def _limits_file(path: str | Path) -> Mapping:
    """All of a joint_limits.yaml."""
    try:
        content = load_yaml(Path(path).read_text())
    except (OSError, yaml.YAMLError) as error:
        raise RobotError(f"{path} must be a YAML file with a mapping `joint_limits`: {error}") from error
    if not isinstance(content, Mapping) or "joint_limits" not in content:
        raise RobotError(f"{path} must be a YAML file with a mapping `joint_limits`")
    return content


def read_urdf(path: str | Path) -> ElementTree.Element:
    """The root of a URDF file. RobotError: it cannot be read, or is none."""
    try:
        return parse_urdf(Path(path).read_text(), path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise RobotError(f"cannot read the URDF {path}: {reason}") from error


def parse_urdf(text: str, path: str | Path) -> ElementTree.Element:
    """The root of a URDF, which came out of a file. RobotError: it is none."""
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise RobotError(f"{path} is no URDF: {error if text.strip() else 'it is empty'}") from error
    if root.tag != "robot":
        raise RobotError(f"{path} is no URDF: its root element is <{root.tag}>, expected <robot>")
    return root


def _joints_from_base(
    root: ElementTree.Element, base_link: str, tool_link: str, file_name: str
) -> list[ElementTree.Element]:
    links = [link.get("name") for link in root.findall("link")]
    for kind in ("link", "joint"):
        names = [element.get("name") for element in root.findall(kind)]
        if repeated := {name for name in names if names.count(name) > 1}:
            raise RobotError(f"{file_name} has more than one {kind} called {', '.join(map(str, sorted(repeated)))}")
    for link in (base_link, tool_link):
        if link not in links:
            raise RobotError(f"link '{link}' is not in {file_name}; it has {', '.join(map(str, links)) or 'no links'}")
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
            above = ", ".join(step.find("parent").get("link") for step in chain) or "no links"
            raise RobotError(
                f"no chain of joints leads from '{base_link}' to '{tool_link}' in {file_name}: above '{tool_link}' are "
                f"{above}"
            )
        if joint.get("type") not in (*MOVING, "fixed"):
            raise RobotError(
                f"joint '{joint.get('name')}' is of type '{joint.get('type')}'; "
                f"a chain may have {', '.join(MOVING)} and fixed joints"
            )
        if (mimic := joint.find("mimic")) is not None:
            raise RobotError(
                f"joint '{joint.get('name')}' mimics '{mimic.get('joint')}': a chain may not have mimic joints, "
                "end it before"
            )
        chain.append(joint)
        link = joint.find("parent").get("link")
    return chain[::-1]


def _limits(joints: Sequence[ElementTree.Element]) -> np.ndarray:
    """Lower and upper positions and velocities (3, n) of moving joints; RobotError names all that lack one.

    Where a <limit> does not say lower or upper these are 0, as URDF has it.
    """
    limits = np.array([[_limit(joint, key) for joint in joints] for key in ("lower", "upper", "velocity")])
    continuous = np.array([joint.get("type") == "continuous" for joint in joints])
    limits[:2, continuous] = [[-np.inf], [np.inf]]
    names = np.array([joint.get("name", "") for joint in joints])
    if np.any(without := ~(limits[0] < limits[1])):
        raise RobotError(
            f"no range of positions is given for {', '.join(names[without])}: write lower below upper, "
            '<limit lower=".." upper=".." velocity=".." effort=".."/>, or type="continuous" for a joint without an end'
        )
    if np.any(without := ~(limits[2] > 0.0)):
        raise RobotError(
            f"no positive limit of velocity is given for {', '.join(names[without])}: write it into <limit>, or give "
            f"--velocity [rad/s, m/s], one number for all joints or one for each of {', '.join(names)}"
        )
    return limits


def _limit(joint: ElementTree.Element, key: str) -> float:
    limit = joint.find("limit")
    text = "0" if limit is None else limit.get(key, "0")
    return read_floats(text, 1, f"limit {key} of joint '{joint.get('name')}'")[0]


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
    if not _is_finite(value) or not value > 0.0:
        raise RobotError(f"{key} of joint '{joint}' in {Path(path).name} is {value}: expected a positive number")
    return float(value)


def _is_finite(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
