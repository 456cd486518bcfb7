"""Masses and strengths that a URDF leaves out, and what stands in for them in the twin.

A link without a mass has that of its collision bodies at `DENSITY`; a frame alone hardly any: simulators take what says
nothing for a kilogramme. A motor whose limit of effort is 0 or absent, as some exporters write it, is as strong as the
arm needs it: with levers L that are never too short (`lever_bounds`), masses m, gravity g and limits of acceleration a,

    tau_j = 2 sum_k L_jk m_k (g + sum_i L_ik a_i).
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from geodesic_motion_ros.robot.body_points import lever_bounds
from geodesic_motion_ros.robot.collision_bodies import carrier_of, parent_joints, shape_vertices
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.urdf import read_floats, read_origin

DENSITY = 1000.0
"""Of bodies whose masses are not given [kg/m^3]: about that of an arm, of motors and hollow castings."""
GRAVITY = 9.81
"""[m/s^2]"""
GIRTH = 0.1
"""Added to the levers of turning joints [m]: the mass of a link is not in one point."""
ACCELERATION = 10.0
"""Of joints without a limit [rad/s^2, m/s^2]."""
_LIGHTEST, _LEAST_INERTIA = 1e-3, 1e-6


def complete_inertials(root: ElementTree.Element, urdf: Path) -> tuple[str, ...]:
    """Give the links of a URDF that lack one an <inertial>, in place; the names of those of them that have bodies.

    urdf : the file, to which the paths of its meshes are relative.
    """
    named = []
    for link in root.findall("link"):
        collisions = link.findall("collision")
        inertial = link.find("inertial")
        if inertial is not None and (_mass(link) > 0.0 or not collisions):
            continue
        if inertial is not None:
            link.remove(inertial)
        link.append(_inertial(*_solid(link, collisions, urdf)))
        if collisions:
            named.append(link.get("name", ""))
    return tuple(named)


def joints_without_effort(robot: Robot, root: ElementTree.Element) -> tuple[str, ...]:
    """The joints of a robot's chain whose limit of effort is 0 or absent in a URDF."""
    efforts = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        text = "0" if limit is None else limit.get("effort", "0")
        efforts[joint.get("name")] = read_floats(text, 1, f"limit effort of joint '{joint.get('name')}'")[0]
    return tuple(name for name in robot.joint_names if not efforts.get(name, 0.0) > 0.0)


def holding_strengths(robot: Robot, root: ElementTree.Element) -> np.ndarray:
    """Strengths (n,) [N m; prismatic: N] that hold an arm in any posture and accelerate it, with the masses of a URDF
    that are complete.
    """
    to_parent = parent_joints(root)
    frames, offsets, masses = [], [], []
    for link in root.findall("link"):
        carried = carrier_of(link.get("name"), to_parent, {}, robot)
        if carried is not None:
            carrier, rotation, origin = carried
            frames.append(robot.link_names.index(carrier))
            offsets.append(rotation @ read_origin(link.find("inertial"), f"link '{link.get('name')}'")[1] + origin)
            masses.append(_mass(link))
    levers = lever_bounds(robot, np.array(frames), np.array(offsets))
    moved = np.cumsum(robot.chain[3] >= 0)
    turning = ~robot.chain[4][robot.chain[3] >= 0]
    carries = np.arange(len(levers))[:, None] < np.append(0, moved)[frames]
    levers += GIRTH * (carries & turning[:, None])
    accelerations = np.where(np.isfinite(robot.acceleration_limits), robot.acceleration_limits, ACCELERATION)
    return 2.0 * levers @ (np.array(masses) * (GRAVITY + accelerations @ levers))


def _mass(link: ElementTree.Element) -> float:
    mass = link.find("inertial/mass")
    return 0.0 if mass is None else read_floats(mass.get("value", "0"), 1, f"mass of link '{link.get('name')}'")[0]


def _solid(
    link: ElementTree.Element, collisions: list[ElementTree.Element], urdf: Path
) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass [kg], centre (3,) [m] and sides (3,) [m] of the box around a link's collision bodies, of DENSITY."""
    volume, corners = 0.0, [np.empty((0, 3))]
    for collision in collisions:
        turned, offset = read_origin(collision, f"a collision body of link '{link.get('name')}'")
        corners.append(shape_vertices(collision, link.get("name", ""), urdf) @ turned.T + offset)
        try:
            volume += ConvexHull(corners[-1]).volume
        except QhullError:  # flat
            continue
    placed = np.concatenate(corners)
    if not len(placed):
        return _LIGHTEST, np.zeros(3), np.zeros(3)
    lowest, highest = placed.min(axis=0), placed.max(axis=0)
    return max(DENSITY * volume, _LIGHTEST), 0.5 * (lowest + highest), highest - lowest


def _inertial(mass: float, centre: np.ndarray, sides: np.ndarray) -> ElementTree.Element:
    """The element of a box."""
    squares = sides**2
    moments = np.maximum(mass / 12.0 * (np.sum(squares) - squares), _LEAST_INERTIA)
    element = ElementTree.Element("inertial")
    ElementTree.SubElement(element, "origin", xyz=" ".join(f"{value:.6g}" for value in centre))
    ElementTree.SubElement(element, "mass", value=f"{mass:.6g}")
    named = zip(("ixx", "iyy", "izz"), moments, strict=True)
    ElementTree.SubElement(
        element, "inertia", {key: f"{value:.6g}" for key, value in named} | {"ixy": "0", "ixz": "0", "iyz": "0"}
    )
    return element
