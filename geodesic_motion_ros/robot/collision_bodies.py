"""What an arm collides with, out of its URDF: convex bodies, each fixed to a link of the chain.

Meshes are read from STL (binary or ASCII) and OBJ files; of boxes, cylinders and spheres points are taken that hold
them. Every body stands for its convex hull; what is not convex is cut before (`convex_parts`). Links beside the chain,
as fingers, belong to the link that carries them, their joints at given positions (mimic joints follow theirs).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.urdf import read_floats, read_origin, read_urdf
from geodesic_motion_ros.utils.errors import RobotError

SIDES = 24
"""Of the prism that stands for a cylinder, around it."""
_STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("colour", "<u2")])


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
    beside : positions [rad, m] of joints beside the chain; zero for the others.

    Raises
    ------
    RobotError : a mesh is missing or of another format, a shape is unknown, `beside` names no joint, or the URDF says
        nothing of what collides.
    """
    root, positions = read_urdf(robot.urdf), dict(beside or {})
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    if unknown := [name for name in positions if name not in joints or name in robot.joint_names]:
        there = ", ".join(name for name in joints if name not in robot.joint_names)
        raise RobotError(f"joint '{unknown[0]}' is not beside the chain in {robot.urdf.name}; there are {there}")
    to_parent = {joint.find("child").get("link"): joint for joint in joints.values() if joint.find("child") is not None}
    found = []
    for link in root.findall("link"):
        carried = _carried(link.get("name"), to_parent, positions, robot)
        if carried is None:
            continue
        carrier, rotation, origin = carried
        for collision in link.findall("collision"):
            vertices = _vertices(collision, link.get("name"), robot.urdf)
            turned, offset = read_origin(collision, f"a collision body of link '{link.get('name')}'")
            in_link = vertices @ turned.T + offset
            found.append(Body(link.get("name"), carrier, in_link @ rotation.T + origin))
    if not found:
        raise RobotError(f"{robot.urdf.name} has no <collision> on the chain: spheres need meshes or shapes")
    order = robot.link_names.index
    return tuple(sorted(found, key=lambda body: order(body.link)))


def mesh_path(name: str, urdf: Path) -> Path:
    """Where the file of a mesh is: relative to the URDF, or `package://` below one of the folders around it.

    Raises
    ------
    RobotError : it is in none of these places.
    """
    bare = re.sub(r"^(package://|model://|file://)", "", name)
    places = [Path(bare), urdf.parent / bare]
    if name.startswith(("package://", "model://")):
        inside = bare.partition("/")[2]
        places += [folder / part for folder in urdf.resolve().parents for part in (bare, inside)]
    for place in places:
        if place.is_file():
            return place
    raise RobotError(f"mesh {name!r} of {urdf.name} is neither beside the URDF nor in a folder above")


def read_mesh(path: Path) -> np.ndarray:
    """Triangles (T, 3, 3) of an STL or OBJ file, in its units. RobotError: another format, or no body in it."""
    content, kind = path.read_bytes(), path.suffix.lower()
    try:
        if kind == ".obj":
            triangles = _obj_triangles(content.decode(errors="replace"))
        elif kind == ".stl" and len(content) == 84 + 50 * int.from_bytes(content[80:84], "little"):
            triangles = np.frombuffer(content[84:], _STL_TRIANGLE)["vertices"].astype(float)
        elif kind == ".stl":
            rows = re.findall(r"vertex\s+(\S+)\s+(\S+)\s+(\S+)", content.decode(errors="replace"))
            triangles = np.array(rows, dtype=float).reshape(-1, 3, 3)
        else:
            raise RobotError(f"mesh {path} is of the format {kind or 'unknown'}: convert it to STL or OBJ")
    except (ValueError, IndexError) as error:
        raise RobotError(f"mesh {path} cannot be read: {error}") from error
    if len(triangles) < 2 or not np.all(np.isfinite(triangles)):
        raise RobotError(f"mesh {path} holds no body: it has {len(triangles)} triangles, or one that is not finite")
    return triangles


def write_mesh(triangles: np.ndarray, path: Path) -> None:
    """Triangles (T, 3, 3), seen from outside counter-clockwise, as a binary STL file."""
    rows = np.zeros(len(triangles), dtype=_STL_TRIANGLE)
    rows["vertices"] = triangles
    # PyBullet draws a mesh without normals in black
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    rows["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    path.write_bytes(bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes())


def _obj_triangles(text: str) -> np.ndarray:
    """Triangles (T, 3, 3) of the faces of an OBJ file; corners count from 1, or back from the last vertex so far."""
    vertices: list[list[float]] = []
    corners: list[tuple[int, int, int]] = []
    for word, *rest in filter(None, map(str.split, text.splitlines())):
        if word == "v":
            vertices.append([float(value) for value in rest[:3]])
        elif word == "f":
            numbers = [int(corner.partition("/")[0]) for corner in rest]
            face = [number - 1 if number > 0 else len(vertices) + number for number in numbers]
            corners += [(face[0], one, other) for one, other in pairwise(face[1:])]
    return np.array(vertices).reshape(-1, 3)[np.array(corners, dtype=int).reshape(-1, 3)]


def _carried(
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
        moved, slid = _displacement(joint, positions)
        rotation, origin = turned @ moved @ rotation, turned @ (moved @ origin + slid) + offset
        link = joint.find("parent").get("link")
    return link, rotation, origin


def _displacement(joint: ElementTree.Element, positions: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and slide (3,) [m] of a joint beside the chain."""
    position, mimic = positions.get(joint.get("name"), 0.0), joint.find("mimic")
    if mimic is not None and joint.get("name") not in positions:
        multiplier, offset = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
        position = multiplier * positions.get(mimic.get("joint"), 0.0) + offset
    element = joint.find("axis")
    axis = np.array(read_floats("1 0 0" if element is None else element.get("xyz"), 3, f"axis of {joint.get('name')}"))
    if joint.get("type") == "prismatic":
        return np.eye(3), position * axis
    return Rotation.from_rotvec(position * axis).as_matrix(), np.zeros(3)


def _vertices(collision: ElementTree.Element, link: str, urdf: Path) -> np.ndarray:
    """Vertices (V, 3) [m] of a collision body in its own frame."""
    geometry = collision.find("geometry")
    shape = None if geometry is None or not len(geometry) else geometry[0]
    subject = f"a collision body of link '{link}'"
    if shape is None:
        raise RobotError(f"{subject} has no geometry")
    if shape.tag == "mesh":
        triangles = read_mesh(mesh_path(shape.get("filename", ""), urdf))
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
