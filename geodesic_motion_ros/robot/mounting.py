"""How an arm is mounted: upright, as on a table, or turned, as on a wall or a ceiling.

The root link of a URDF stands upright in the world, its z axis up; the joints between it and the base link stand at 0.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geodesic_motion_ros.robot.collision_bodies import parent_joints
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.robot.urdf import read_origin, read_urdf

UPRIGHT = np.cos(np.radians(10.0))
"""Of the angle up to which an arm counts as upright."""


def upward(urdf: Path, base_link: str) -> np.ndarray:
    """The world's vertical (3,), upward, in the frame of the base link."""
    to_parent, rotation, link = parent_joints(read_urdf(urdf)), np.eye(3), base_link
    while (joint := to_parent.get(link)) is not None:
        rotation = read_origin(joint, f"joint '{joint.get('name')}'")[0] @ rotation
        link = joint.find("parent").get("link")
    return rotation[2]


def mount(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and origin (3,) [m] of the link that the first joint turns against, in the base frame."""
    first = int(np.flatnonzero(robot.chain[3] >= 0)[0])
    rotations, origins = robot.link_frames(robot.ready)
    return rotations[first], origins[first]


def is_upright(robot: Robot) -> bool:
    """Whether the base frame and the link that the first joint turns against have their z axes up in the world."""
    up = upward(robot.urdf, robot.base_link)
    return bool(min(up[2], up @ mount(robot)[0][:, 2]) > UPRIGHT)
