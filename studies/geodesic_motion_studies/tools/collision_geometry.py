"""An arm's collision meshes as PyBullet uses them: convex hulls, where they are and how far apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.certification.declared_scene import MASSIVE, DeclaredScene
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.loading import load_arm
from geodesic_motion_ros.simulation.physics_client import PhysicsClient
from geodesic_motion_ros.simulation.world import add_solid
from geodesic_motion_ros.utils.errors import RobotError


@dataclass(frozen=True, eq=False)
class Part:
    """One collision mesh.

    Attributes
    ----------
    name : its link in the URDF.
    link : the link of the robot's chain that carries it: the same, or the one that it is mounted on, as a finger.
    index : PyBullet's number of its link.
    vertices : (V, 3) [m] of its convex hull in the frame of `link`; none of a box, a cylinder or a sphere.
    """

    name: str
    link: str
    index: int
    vertices: np.ndarray


class CollisionGeometry:
    """The collision meshes of an arm in a physics server of their own, without physics.

    Parameters
    ----------
    name : of a shipped robot, or the path of a folder; the base frame is the world's.
    opened : positions [rad or m] of joints beside the chain, as of fingers; None: those of the folder.

    Raises
    ------
    RobotError : the URDF lacks a joint of the chain or of `opened`.
    """

    def __init__(self, name: str | Path, opened: Mapping[str, float] | None = None) -> None:
        described = RobotDescription.named(name)
        opened = described.simulated_joints if opened is None else opened
        self.robot = robot = Robot.named(name)
        self._client = PhysicsClient()
        self._arm = load_arm(self._client, described)
        self._spheres: dict[float, int] = {}
        self._surroundings: list[int] = []
        infos = [self._client.getJointInfo(self._arm, index) for index in range(self._client.getNumJoints(self._arm))]
        joints = {info[1].decode(): info[0] for info in infos}
        missing = [name for name in (*robot.joint_names, *opened) if name not in joints]
        if missing:
            raise RobotError(f"joint '{missing[0]}' is not in {described.simulated_urdf}; it has {', '.join(joints)}")
        self._joints = [joints[name] for name in robot.joint_names]
        for name, position in opened.items():
            self._client.resetJointState(self._arm, joints[name], position)
        self._names = {-1: robot.base_link} | {info[0]: info[12].decode() for info in infos}
        self._parents = {info[0]: info[16] for info in infos}
        self.parts = tuple(
            self._part(index) for index in self._names if self._client.getCollisionShapeData(self._arm, index)
        )
        self._carriers = {part.index: part.link for part in self.parts}
        first_joint = int(np.flatnonzero(robot.chain[3] >= 0)[0])
        self._moved = frozenset(robot.link_names[first_joint + 1 :])

    def place(self, joint_positions: np.ndarray) -> None:
        """Put the arm at joint positions (n,) [rad], inside the limits or not."""
        for joint, position in zip(self._joints, joint_positions, strict=True):
            self._client.resetJointState(self._arm, joint, position)

    def distance(self, one: Part, other: Part, cutoff: float = 2.0) -> float:
        """Signed distance [m] between two parts where the arm is; negative: penetration; inf beyond `cutoff` [m]."""
        points = self._client.getClosestPoints(self._arm, self._arm, cutoff, one.index, other.index)
        return min((point[8] for point in points), default=np.inf)

    def sphere_distance(self, part: Part, centre: np.ndarray, radius: float, cutoff: float = 2.0) -> float:
        """Signed distance [m] of a part from a sphere where the arm is; inf beyond `cutoff` [m]."""
        points = self._client.getClosestPoints(self._arm, self._sphere(centre, radius), cutoff, part.index)
        return min((point[8] for point in points), default=np.inf)

    def clearance(self, centre: np.ndarray, radius: float, cutoff: float = 2.0) -> float:
        """Signed distance [m] of the links that joints move from a sphere; inf beyond `cutoff` [m]."""
        return min(self.clearances(centre, radius, cutoff).values(), default=np.inf)

    def clearances(self, centre: np.ndarray, radius: float, cutoff: float = 2.0) -> dict[str, float]:
        """The same of each of these links that comes nearer than `cutoff`, with what is mounted on it."""
        return self._clearances([self._sphere(centre, radius)], cutoff)

    def surround(self, scene: DeclaredScene) -> None:
        """Let the bodies of a declared scene stand around the arm, in the place of those that stood there before."""
        for body in self._surroundings:
            self._client.removeBody(body)
        pairs = zip(scene.solids, scene.kinds, strict=True)
        self._surroundings = [add_solid(self._client, solid, kind) for solid, kind in pairs if kind in MASSIVE]

    def surrounding_clearances(self, cutoff: float = 2.0) -> dict[str, float]:
        """As `clearances`, from the bodies of the declared scene."""
        return self._clearances(self._surroundings, cutoff)

    def _clearances(self, bodies: Sequence[int], cutoff: float) -> dict[str, float]:
        nearest: dict[str, float] = {}
        for body in bodies:
            for point in self._client.getClosestPoints(self._arm, body, cutoff):
                link = self._carriers[point[3]]
                if link in self._moved:
                    nearest[link] = min(nearest.get(link, np.inf), point[8])
        return nearest

    def _sphere(self, centre: np.ndarray, radius: float) -> int:
        if radius not in self._spheres:
            shape = self._client.createCollisionShape(self._client.GEOM_SPHERE, radius=radius)
            self._spheres[radius] = self._client.createMultiBody(0.0, shape)
        body = self._spheres[radius]
        self._client.resetBasePositionAndOrientation(body, centre, (0.0, 0.0, 0.0, 1.0))
        return body

    def close(self) -> None:
        """End the physics server; a second call does nothing."""
        if self._client.isConnected():
            self._client.disconnect()

    def __enter__(self) -> CollisionGeometry:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _part(self, index: int) -> Part:
        carrier = index
        while self._names[carrier] not in self.robot.link_names:
            carrier = self._parents[carrier]
        _, mesh = self._client.getMeshData(self._arm, index, flags=self._client.MESH_DATA_SIMULATION_MESH)
        # the mesh is given in the frame of the centre of mass
        inertial = self._client.getDynamicsInfo(self._arm, index)
        vertices = Rotation.from_quat(inertial[4]).apply(np.reshape(mesh, (-1, 3))) + inertial[3]
        (turned, origin), (carrier_turned, carrier_origin) = self._frame(index), self._frame(carrier)
        placed = turned.apply(vertices) + origin
        in_carrier = carrier_turned.inv().apply(placed - carrier_origin)
        return Part(self._names[index], self._names[carrier], index, in_carrier)

    def _frame(self, index: int) -> tuple[Rotation, np.ndarray]:
        """Link frame to base frame, where the arm is."""
        if index < 0:
            return Rotation.identity(), np.zeros(3)
        state = self._client.getLinkState(self._arm, index, computeForwardKinematics=True)
        return Rotation.from_quat(state[5]), np.array(state[4])
