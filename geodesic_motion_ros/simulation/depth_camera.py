"""DepthCamera: what a depth camera sees of an arm, spheres and the declared scene, by PyBullet's software renderer.

Bodies are seen that collide, and not the ones that are drawn: the picture shows what the judge of contacts knows, and
takes a tenth of the time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.certification.declared_scene import MASSIVE, DeclaredScene
from geodesic_motion_ros.geometry.quaternions import from_rotation, rotate
from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.kinematics import Robot
from geodesic_motion_ros.simulation.loading import joint_numbers, load_arm, standing_beside
from geodesic_motion_ros.simulation.physics_client import PhysicsClient
from geodesic_motion_ros.simulation.world import SMOOTH_SPHERE, add_solid
from geodesic_motion_ros.utils.errors import ParameterError

#: Nearer and farther [m] nothing is seen.
NEAREST, FARTHEST = 0.1, 5.0
#: What is as deep [m] is where the renderer has drawn nothing.
_NOTHING = 0.999 * FARTHEST
_UP = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class DepthCameraSettings:
    """How a depth camera stands, and what it is: by default every fourth row and column of an Intel RealSense D435, of
    848 x 480 pixels that see 87 x 58 degrees (Intel, "RealSense D400 Series Product Family Datasheet").

    Attributes
    ----------
    place, target : where it stands, and what is in the middle of its picture (3,) [m], in the base frame.
    width, height : of a picture [pixels]. field_of_view : of its height [deg].
    noise : standard deviation of a depth of 1 m [m]; it grows with the square of the depth.
    """

    place: tuple[float, float, float] = (1.4, -0.8, 1.2)
    target: tuple[float, float, float] = (0.3, 0.0, 0.35)
    width: int = 212
    height: int = 120
    field_of_view: float = 58.0
    noise: float = 0.002

    def __post_init__(self) -> None:
        look = np.subtract(self.target, self.place)
        if np.linalg.norm(np.cross(look, _UP)) < 1e-3 * np.linalg.norm(look) + 1e-9:
            raise ParameterError(
                f"a camera at {list(self.place)} m looks at {list(self.target)} m: its line of sight must not be "
                "upright, nor have no length"
            )

    @property
    def turn(self) -> np.ndarray:
        """Its axes in the base frame, the columns of (3, 3): x to the right of the picture, y down, z along the line of
        sight.
        """
        look = np.subtract(self.target, self.place)
        look = look / np.linalg.norm(look)
        right = np.cross(look, _UP)
        right /= np.linalg.norm(right)
        return np.column_stack([right, np.cross(look, right), look])

    @property
    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Its frame in the base frame: position (3,) [m], quaternion (4,), scalar first."""
        return np.array(self.place), from_rotation(Rotation.from_matrix(self.turn))


class DepthCamera:
    """A camera in a world of its own, in which everything stands where it is said to be."""

    def __init__(self, robot: str | Path, settings: DepthCameraSettings, scene: DeclaredScene | None = None) -> None:
        """robot : name of a shipped one, or a folder. scene : what always stands around it; None: nothing.

        Raises
        ------
        RobotError : PyBullet cannot read the URDF or a mesh.
        """
        self.settings = settings
        self._robot, described = Robot.named(robot), RobotDescription.named(robot)
        client = self._client = PhysicsClient()
        scene = scene or DeclaredScene.empty()
        for solid, kind in zip(scene.solids, scene.kinds, strict=True):
            if kind in MASSIVE:
                add_solid(client, solid, kind)
        self._arm = load_arm(client, described, bodies_shown=True)
        numbers = joint_numbers(client, self._arm)
        self._joints = [numbers[name] for name in self._robot.joint_names]
        beside = standing_beside([client.getJointInfo(self._arm, i) for i in numbers.values()], self._joints)
        beside |= {numbers[name]: position for name, position in described.simulated_joints.items()}
        for number, position in beside.items():
            client.resetJointState(self._arm, number, position)
        self._spheres: dict[str, tuple[int, float]] = {}
        width, height, view = settings.width, settings.height, settings.field_of_view
        self._view = client.computeViewMatrix(settings.place, settings.target, _UP)
        self._projection = client.computeProjectionMatrixFOV(view, width / height, NEAREST, FARTHEST)
        tangent = np.tan(np.radians(0.5 * view))
        # The renderer samples a pixel in its left lower corner.
        across = tangent * width / height * (2.0 * np.arange(width) / width - 1.0)
        down = tangent * (2.0 * (np.arange(height) + 1.0) / height - 1.0)
        self._rays = np.stack([*np.meshgrid(across, down), np.ones((height, width))], axis=-1).reshape(-1, 3)

    def points(
        self, joints: np.ndarray, spheres: Mapping[str, tuple[np.ndarray, float]], random: np.random.Generator
    ) -> np.ndarray:
        """Take a picture: points (n, 3) [m] in the frame of the camera, one of each pixel that sees something.

        joints : (eta,) [rad]. spheres : centres (3,), radii [m]. random : the noise is drawn from it.
        """
        self._place(joints, spheres)
        shape = self.settings.width, self.settings.height
        client = self._client
        _, _, _, depths, _ = client.getCameraImage(
            *shape, self._view, self._projection, shadow=0, renderer=client.ER_TINY_RENDERER,
            flags=client.ER_NO_SEGMENTATION_MASK,
        )  # fmt: skip
        # PyBullet builds without numpy return the pixels as a flat tuple.
        buffer = np.asarray(depths, dtype=float).reshape(-1)
        depth = FARTHEST * NEAREST / (FARTHEST - (FARTHEST - NEAREST) * buffer)
        seen = depth < _NOTHING
        depth = depth[seen]
        # Drawn for all pixels: what one sees changes nothing of the noise of the next picture.
        noise = random.normal(size=len(buffer))[seen]
        return self._rays[seen] * (depth + self.settings.noise * depth**2 * noise)[:, None]

    def to_base(self, points: np.ndarray) -> np.ndarray:
        """Carry points (n, 3) [m] from its frame to the base frame."""
        place, quaternion = self.settings.pose
        return place + rotate(quaternion, points)

    def close(self) -> None:
        """End the physics server; a second call does nothing."""
        if self._client.isConnected():
            self._client.disconnect()

    def _place(self, joints: np.ndarray, spheres: Mapping[str, tuple[np.ndarray, float]]) -> None:
        client = self._client
        for number, position in zip(self._joints, joints, strict=True):
            client.resetJointState(self._arm, number, position)
        for name, (body, radius) in list(self._spheres.items()):
            if name not in spheres or spheres[name][1] != radius:
                client.removeBody(body)
                del self._spheres[name]
        for name, (centre, radius) in spheres.items():
            if name not in self._spheres:
                look = client.createVisualShape(client.GEOM_MESH, fileName=str(SMOOTH_SPHERE), meshScale=[radius] * 3)
                self._spheres[name] = client.createMultiBody(0.0, -1, look), radius
            client.resetBasePositionAndOrientation(self._spheres[name][0], centre, (0.0, 0.0, 0.0, 1.0))
