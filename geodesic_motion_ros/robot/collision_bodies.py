"""What an arm collides with, out of its URDF: convex bodies, each fixed to a link of the chain.

Meshes are read by the library `trimesh`; of boxes, cylinders and spheres points are taken that hold them. Every body
stands for its convex hull; what is not convex is cut before (`convex_parts`). Links beside the chain, as fingers,
belong to the link that carries them, their joints at given positions (mimic joints follow theirs).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.urdf import MOVING, read_floats, read_origin, read_urdf
from geodesic_motion_ros.utils.errors import RobotError

SIDES = 24
"""Of the prism that stands for a cylinder, around it."""
LARGEST = 5.0
"""Of a body [m]."""


@dataclass(frozen=True, eq=False)
class Body:
    """A convex body.

    Attributes
    ----------
    name : its link in the URDF.
    link : the link of the chain that carries it: the same, or the one that it is mounted on.
    vertices : (V, 3) [m] in the frame of `link`.
    """

    name: str
    link: str
    vertices: np.ndarray


def collision_bodies(robot: Robot, beside: Mapping[str, float] | None = None) -> tuple[Body, ...]:
    """The bodies of a robot's URDF that its base link and its chain carry.

    Parameters
    ----------
    beside : positions [rad, m] of joints beside the chain, as of `beside_positions`.

    Raises
    ------
    RobotError : a mesh cannot be read, a shape is unknown or too large, or the URDF says nothing of what collides; or
        as `beside_positions`.
    """
    root, positions = read_urdf(robot.urdf), beside_positions(robot, beside)
    to_parent = parent_joints(root)
    found = []
    for link in root.findall("link"):
        carried = carrier_of(link.get("name"), to_parent, positions, robot)
        if carried is None:
            continue
        carrier, rotation, origin = carried
        for collision in link.findall("collision"):
            vertices = shape_vertices(collision, link.get("name"), robot.urdf)
            turned, offset = read_origin(collision, f"a collision body of link '{link.get('name')}'")
            in_link = vertices @ turned.T + offset
            if (size := float(np.max(np.ptp(in_link, axis=0)))) > LARGEST:
                raise RobotError(
                    f"a collision body of link '{link.get('name')}' is {size:.3g} m large, no arm is: a mesh in "
                    'millimetres needs scale="0.001 0.001 0.001"'
                )
            found.append(Body(link.get("name"), carrier, in_link @ rotation.T + origin))
    if not found:
        raise RobotError(f"{robot.urdf.name} has no <collision> on the chain: spheres need meshes or shapes")
    order = robot.link_names.index
    return tuple(sorted(found, key=lambda body: order(body.link)))


def beside_positions(robot: Robot, given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Where the moving joints stand [rad, m] that the chain carries beside it, by their names.

    As given; a mimic joint as it follows its own; the others where their limits allow it nearest to 0.

    Raises
    ------
    RobotError : what is given names no joint beside the chain, or is outside of the joint's limits.
    """
    root, given = read_urdf(robot.urdf), dict(given or {})
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    if unknown := [name for name in given if name not in joints or name in robot.joint_names]:
        there = ", ".join(name for name in joints if name not in robot.joint_names)
        raise RobotError(f"joint '{unknown[0]}' is not beside the chain in {robot.urdf.name}; there are {there}")
    to_parent, positions = parent_joints(root), {}
    for name, joint in joints.items():
        moves = joint.get("type") in MOVING and name not in robot.joint_names
        if not moves or carrier_of(joint.find("child").get("link"), to_parent, {}, robot) is None:
            continue
        lower, upper = joint_range(joint)
        positions[name] = given.get(name, min(max(0.0, lower), upper))
        if not lower <= positions[name] <= upper:
            raise RobotError(f"joint '{name}' is to stand at {given[name]:g}: its limits are [{lower:g}, {upper:g}]")
    for name in positions:
        mimic = joints[name].find("mimic")
        if mimic is not None and name not in given:
            multiplier, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
            positions[name] = multiplier * positions.get(mimic.get("joint"), 0.0) + offset
    return positions


def drawn_alone(robot: Robot) -> tuple[str, ...]:
    """The links of the chain, and beside it, that have a <visual> but no <collision>: spheres hold nothing of them."""
    root = read_urdf(robot.urdf)
    to_parent = parent_joints(root)
    return tuple(
        link.get("name")
        for link in root.findall("link")
        if link.find("visual") is not None and link.find("collision") is None
        and carrier_of(link.get("name"), to_parent, {}, robot) is not None
    )  # fmt: skip


def parent_joints(root: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """The joint of a URDF above each link, by the link's name."""
    joints = [joint for joint in root.findall("joint") if joint.find("child") is not None]
    return {joint.find("child").get("link"): joint for joint in joints if joint.find("parent") is not None}


def read_mesh(path: Path) -> np.ndarray:
    """Triangles (T, 3, 3) of a mesh, of .dae in metres, of other formats that `trimesh` reads in the file's units.

    Raises
    ------
    RobotError : it cannot be read, or no body is in it.
    """
    # loaded here, for robots whose folders are made do without
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False, skip_materials=True)
        triangles = scene.to_mesh().triangles
        # as viewers of URDFs have it, .dae files count in their own unit, and which axis they call up does not
        in_metres = trimesh.units.unit_conversion(scene.units, "meters") if path.suffix.lower() == ".dae" else 1.0
    except Exception as error:  # each format's parser raises others
        # trimesh goes on to rarer kinds of a format that it cannot read, and to the libraries that these need
        reason = "damaged, or of an unknown kind" if isinstance(error, ImportError) else error
        raise RobotError(f"mesh {path} cannot be read ({reason}): convert it to STL") from error
    triangles = in_metres * triangles
    if len(triangles) < 2 or not np.all(np.isfinite(triangles)):
        raise RobotError(f"mesh {path} holds no body: it has {len(triangles)} triangles, or one that is not finite")
    return triangles


def write_mesh(triangles: np.ndarray, path: Path) -> None:
    """Triangles (T, 3, 3), seen from outside counterclockwise, as a binary STL file with normals."""
    import trimesh

    trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles), process=False).export(path, file_type="stl")


def carrier_of(
    link: str, to_parent: Mapping[str, ElementTree.Element], positions: Mapping[str, float], robot: Robot
) -> tuple[str, np.ndarray, np.ndarray] | None:
    """The link of the chain that carries a link, and the link's frame in its: rotation (3, 3), origin (3,) [m].

    None for what stands before the base link, or on another branch.
    """
    rotation, origin = np.eye(3), np.zeros(3)
    while link not in robot.link_names:
        joint = to_parent.get(link)
        if joint is None:
            return None
        turned, offset = read_origin(joint, f"joint '{joint.get('name')}'")
        moved, slid = joint_displacement(joint, positions.get(joint.get("name"), 0.0))
        rotation, origin = turned @ moved @ rotation, turned @ (moved @ origin + slid) + offset
        link = joint.find("parent").get("link")
    return link, rotation, origin


def joint_displacement(joint: ElementTree.Element, position: float) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and slide (3,) [m] of a joint beside the chain."""
    element = joint.find("axis")
    axis = np.array(read_floats("1 0 0" if element is None else element.get("xyz"), 3, f"axis of {joint.get('name')}"))
    if joint.get("type") == "prismatic":
        return np.eye(3), position * axis
    return Rotation.from_rotvec(position * axis).as_matrix(), np.zeros(3)


def joint_range(joint: ElementTree.Element) -> tuple[float, float]:
    """The limits [rad, m] of a joint; infinite where it has none."""
    limit = joint.find("limit")
    if joint.get("type") == "continuous" or limit is None:
        return -np.inf, np.inf
    lower, upper = (read_floats(limit.get(key, "0"), 1, f"limit {key} of joint '{joint.get('name')}'")[0]
                    for key in ("lower", "upper"))  # fmt: skip
    return (lower, upper) if lower <= upper else (-np.inf, np.inf)


def shape_vertices(collision: ElementTree.Element, link: str, urdf: Path) -> np.ndarray:
    """Vertices (V, 3) [m] of a collision body in its own frame."""
    geometry = collision.find("geometry")
    shape = None if geometry is None or not len(geometry) else geometry[0]
    subject = f"a collision body of link '{link}'"
    if shape is None:
        raise RobotError(f"{subject} has no geometry")
    if shape.tag == "mesh":
        triangles = read_mesh(urdf.parent / shape.get("filename", ""))
        vertices = np.unique(triangles.reshape(-1, 3), axis=0)
        return vertices * read_floats(shape.get("scale", "1 1 1"), 3, f"scale of {subject}")
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    if shape.tag == "box":
        return 0.5 * signs * read_floats(shape.get("size", ""), 3, f"size of {subject}")
    (radius,) = read_floats(shape.get("radius", ""), 1, f"radius of {subject}")
    if shape.tag == "sphere":
        around = np.random.default_rng(0).normal(size=(400, 3))
        # 400 directions: a hull 3 % larger than the sphere holds it
        return 1.03 * radius * around / np.linalg.norm(around, axis=1, keepdims=True)
    if shape.tag in ("cylinder", "capsule"):
        (length,) = read_floats(shape.get("length", ""), 1, f"length of {subject}")
        half = 0.5 * length + (radius if shape.tag == "capsule" else 0.0)
        angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
        ring = radius / np.cos(np.pi / SIDES) * np.column_stack([np.cos(angles), np.sin(angles)])
        return np.concatenate([np.column_stack([ring, np.full(SIDES, end)]) for end in (-half, half)])
    raise RobotError(f"{subject} is a <{shape.tag}>: known are mesh, box, cylinder, sphere and capsule")
