"""Whether a URDF that somebody else publishes is of the arm that a skill was learned on, by where its links come."""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from geodesic_motion_ros.robot.kinematics import Robot, link_frames
from geodesic_motion_ros.robot.urdf import Chain, chain_of

#: Arms are the same up to this difference [m]: those of one type differ by some millimetres by their calibration, those
#: of two types by centimetres (UR5 and UR5e: over 5 cm).
SAME = 0.01
#: Orientations count by points at this distance [m] from the origin of a frame.
_LEVER = 0.1
_POSTURES = 16


@dataclass(frozen=True)
class ArmDifference:
    """How far the farthest link that two descriptions have in common is apart.

    Attributes
    ----------
    link : which one that is. joints : those before it in the other description.
    largest : over postures within the limits [m]; infinite where the joints are others.
    """

    link: str
    joints: tuple[str, ...]
    largest: float

    @property
    def is_same(self) -> bool:
        """Whether the arm is the same one, differently calibrated at most."""
        return self.largest <= SAME


def difference(robot: Robot, described: ElementTree.Element) -> ArmDifference | None:
    """Compare a robot with a URDF by the forward kinematics of the farthest link that both have.

    Returns
    -------
    None where they have no two links in common.

    Raises
    ------
    RobotError : the chain of the URDF cannot be read.
    """
    links = {link.get("name") for link in described.findall("link")}
    common = [place for place, name in enumerate(robot.link_names) if name in links]
    joint_index = robot.chain[3]
    if robot.base_link not in links or not common or not np.any(joint_index[: common[-1]] >= 0):
        return None
    place = common[-1]
    chain = chain_of(described, robot.base_link, robot.link_names[place], "robot_description")
    names = robot.joint_names[: int(np.max(joint_index[:place])) + 1]
    if chain.joint_names != names:
        return ArmDifference(robot.link_names[place], chain.joint_names, math.inf)
    postures = robot.sample(_POSTURES, np.random.default_rng(0))
    apart = [_points(robot, q, place) - _points_of(chain, q[: len(names)]) for q in postures]
    return ArmDifference(robot.link_names[place], names, float(np.max(np.linalg.norm(apart, axis=2))))


def _points(robot: Robot, joints: np.ndarray, place: int) -> np.ndarray:
    rotations, origins = robot.link_frames(joints)
    return _points_in(rotations[place], origins[place])


def _points_of(chain: Chain, joints: np.ndarray) -> np.ndarray:
    arrays = (chain.rotations, chain.translations, chain.axes, chain.joint_index, chain.prismatic)
    rotations, origins = link_frames(np.ascontiguousarray(joints), tuple(map(np.ascontiguousarray, arrays)))
    return _points_in(rotations[-1], origins[-1])


def _points_in(rotation: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """The origin of a frame, and a point on each of its axes (4, 3) [m]."""
    return np.vstack([origin, origin + _LEVER * rotation.T])
