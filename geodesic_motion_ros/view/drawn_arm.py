"""An arm on the page, out of the text of its URDF: its links in a tree that the browser moves by their joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import trimesh
import viser
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.geometry.quaternions import from_rotation
from geodesic_motion_ros.robot.collision_bodies import joint_displacement, joint_range, parent_joints
from geodesic_motion_ros.robot.robot_file import mesh_path
from geodesic_motion_ros.robot.urdf import MOVING, parse_urdf, read_floats, read_origin
from geodesic_motion_ros.utils.errors import RobotError

#: Of what has no material, and of joints that rest: they are not moved on the page [rad, m].
_COLOUR, _RESTS = (0.88, 0.89, 0.91, 1.0), 1e-4
#: Formats whose meshes have their own colours.
_COLOURED = (".obj", ".dae", ".glb", ".gltf")


class _Hinge(NamedTuple):
    """A moving joint: its frame on the page, where that stands at 0, and which reported joint it follows."""

    frame: viser.FrameHandle
    element: ElementTree.Element
    rotation: np.ndarray
    origin: np.ndarray
    followed: str
    multiplier: float
    offset: float


class DrawnArm:
    """The links of a URDF with what is drawn of them.

    Attributes
    ----------
    missing : what could not be drawn, a line each.
    reach : about how far the arm reaches [m]: the sum of the offsets of the joints between its farthest links.
    """

    def __init__(self, scene: viser.SceneApi, urdf: str, base_frame: str) -> None:
        """base_frame : of all that is shown; where the URDF has no such link that is its root.

        Raises
        ------
        RobotError : the URDF cannot be read.
        """
        root = parse_urdf(urdf, "robot_description")
        self._scene, self._hinges, self._placed = scene, list[_Hinge](), dict[str, float]()
        self._colours = {
            one.get("name"): _colour(one) for one in root.iterfind(".//material") if one.find("color") is not None
        }
        self.missing: list[str] = []
        self.reach = 0.0
        above = parent_joints(root)
        to_base = _base_in_root(base_frame, above)
        inverse = to_base[0].T
        self._top = scene.add_frame(
            "/arm", show_axes=False, wxyz=_quaternion(inverse), position=-inverse @ to_base[1]
        )
        links = {link.get("name", ""): link for link in root.findall("link")}
        for name in links.keys() - above.keys():
            self._draw_link(links, above, name, "/arm", 0.0)
        self.place({})

    def place(self, positions: Mapping[str, float]) -> None:
        """Move the joints to positions [rad, m], by name; those that are not named stay, at first as near to 0 as their
        limits allow.
        """
        for hinge in self._hinges:
            name = hinge.element.get("name", "")
            if hinge.followed in positions:
                position = hinge.multiplier * positions[hinge.followed] + hinge.offset
            else:
                position = self._placed.get(name, _rest(hinge.element))
            if abs(position - self._placed.get(name, np.inf)) < _RESTS:
                continue
            self._placed[name] = position
            turned, slid = joint_displacement(hinge.element, position)
            hinge.frame.wxyz = _quaternion(hinge.rotation @ turned)
            hinge.frame.position = hinge.origin + hinge.rotation @ slid

    def remove(self) -> None:
        """Take the arm from the page."""
        self._top.remove()

    def _draw_link(
        self,
        links: Mapping[str, ElementTree.Element],
        above: Mapping[str, ElementTree.Element],
        name: str,
        parent: str,
        reach: float,
    ) -> None:
        """Draw a link and those below it, under a node of the page; reach : from the base to its parent [m]."""
        node = f"{parent}/{name.replace('/', '_')}"
        if (joint := above.get(name)) is not None:
            rotation, origin = read_origin(joint, f"joint '{joint.get('name')}'")
            reach += float(np.linalg.norm(origin))
            frame = self._scene.add_frame(node, show_axes=False, wxyz=_quaternion(rotation), position=origin)
            if joint.get("type") in MOVING:
                self._hinges.append(_hinge(frame, joint, rotation, origin))
        else:
            self._scene.add_frame(node, show_axes=False)
        self.reach = max(self.reach, reach)
        for number, visual in enumerate(links[name].findall("visual") if name in links else ()):
            try:
                self._draw_visual(visual, name, f"{node}/drawn_{number}")
            except RobotError as error:
                self.missing.append(str(error))
        for child, joint in above.items():
            if joint.find("parent").get("link") == name:
                self._draw_link(links, above, child, node, reach)

    def _draw_visual(self, visual: ElementTree.Element, link: str, node: str) -> None:
        geometry, subject = visual.find("geometry"), f"what is drawn of link '{link}'"
        if geometry is None or not len(geometry):
            raise RobotError(f"{subject} has no geometry")
        rotation, origin = read_origin(visual, subject)
        pose = {"wxyz": _quaternion(rotation), "position": origin}
        *colour, opacity = self._colour_of(visual)
        look = {"color": tuple(colour), "opacity": None if opacity >= 1.0 else opacity}
        shape = geometry[0]
        if shape.tag == "mesh":
            path = mesh_path(shape.get("filename", ""), Path("robot_description"), {})
            scale = read_floats(shape.get("scale", "1 1 1"), 3, f"scale of {subject}")
            self._draw_mesh(path, tuple(scale), node, pose, look)
        elif shape.tag == "box":
            size = read_floats(shape.get("size", ""), 3, f"size of {subject}")
            self._scene.add_box(node, dimensions=tuple(size), **pose, **look)
        elif shape.tag == "sphere":
            (radius,) = read_floats(shape.get("radius", ""), 1, f"radius of {subject}")
            self._scene.add_icosphere(node, radius, **pose, **look)
        elif shape.tag == "cylinder":
            radius, length = (
                read_floats(shape.get(key, ""), 1, f"{key} of {subject}")[0] for key in ("radius", "length")
            )
            self._scene.add_cylinder(node, radius, length, **pose, **look)
        else:
            raise RobotError(f"{subject} is a <{shape.tag}>: known are mesh, box, sphere and cylinder")

    def _draw_mesh(self, path: Path, scale: tuple[float, ...], node: str, pose: dict, look: dict) -> None:
        try:
            loaded = trimesh.load_scene(path)
            # As viewers of URDFs have it, .dae files count in their own unit.
            unit = trimesh.units.unit_conversion(loaded.units, "meters") if path.suffix.lower() == ".dae" else 1.0
            size = tuple(unit * one for one in scale)
            if path.suffix.lower() in _COLOURED:
                self._scene.add_glb(node, loaded.export(file_type="glb"), scale=size, **pose)
                return
            # Its edges are sharp, and what is round is round.
            mesh = trimesh.graph.smooth_shade(loaded.to_mesh(), angle=0.5)
            self._scene.add_mesh_simple(node, mesh.vertices, mesh.faces, scale=size, side="double", **pose, **look)
        except Exception as error:  # each format's parser raises others
            raise RobotError(f"mesh {path} cannot be read ({error})") from error

    def _colour_of(self, visual: ElementTree.Element) -> tuple[float, ...]:
        material = visual.find("material")
        if material is None or material.find("color") is None:
            return _COLOUR if material is None else self._colours.get(material.get("name"), _COLOUR)
        return _colour(material)


def _colour(material: ElementTree.Element) -> tuple[float, ...]:
    return tuple(read_floats(material.find("color").get("rgba", ""), 4, f"color of material '{material.get('name')}'"))


def _hinge(frame: viser.FrameHandle, joint: ElementTree.Element, rotation: np.ndarray, origin: np.ndarray) -> _Hinge:
    mimic = joint.find("mimic")
    if mimic is None:
        return _Hinge(frame, joint, rotation, origin, joint.get("name", ""), 1.0, 0.0)
    factors = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
    return _Hinge(frame, joint, rotation, origin, mimic.get("joint", ""), *factors)


def _rest(joint: ElementTree.Element) -> float:
    """Where a joint stands of which nothing is reported: as near to 0 as its limits allow."""
    lower, upper = joint_range(joint)
    return min(max(0.0, lower), upper)


def _base_in_root(base_frame: str, above: Mapping[str, ElementTree.Element]) -> tuple[np.ndarray, np.ndarray]:
    """Where a link stands in the root of its URDF, all joints at 0: rotation (3, 3), origin (3,) [m]."""
    rotation, origin = np.eye(3), np.zeros(3)
    while (joint := above.get(base_frame)) is not None:
        turned, offset = read_origin(joint, f"joint '{joint.get('name')}'")
        rotation, origin = turned @ rotation, turned @ origin + offset
        base_frame = joint.find("parent").get("link")
    return rotation, origin


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    return from_rotation(Rotation.from_matrix(rotation))
