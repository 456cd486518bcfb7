"""Pictures of a PyBullet world, by its software renderer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geodesic_motion_ros.simulation.physics_client import PhysicsClient
from geodesic_motion_ros.utils.errors import ParameterError


@dataclass(frozen=True)
class View:
    """Where a camera looks (target [m]) and from where: distance [m], yaw about z and pitch [deg]."""

    target: tuple[float, float, float]
    distance: float
    yaw: float
    pitch: float
    field_of_view: float = 35.0

    def facing(self, point: np.ndarray) -> View:
        """The view turned about the base by whole quarters, from the side of +x to that of a point (3,) [m]."""
        quarters = int(np.round(np.arctan2(point[1], point[0]) / (0.5 * np.pi)))
        x, y, z = self.target
        for _ in range(quarters % 4):
            x, y = -y, x
        return replace(self, target=(x, y, z), yaw=self.yaw + 90.0 * quarters)


SKY = ((236.0, 240.0, 245.0), (206.0, 214.0, 222.0))  # colours at the upper and the lower edge

VIEWS = {
    "front": View((0.26, -0.15, 0.35), 1.55, 60.0, -22.0),
    "elbow": View((0.30, 0.03, 0.36), 1.95, 105.0, -30.0),
    "side": View((0.24, -0.12, 0.36), 1.75, 20.0, -18.0),
    "top": View((0.28, -0.12, 0.25), 1.9, 90.0, -70.0),
}


def view_named(name: str) -> View:
    """A preset of `VIEWS`.

    Raises
    ------
    ParameterError : there is no such view; the message lists those there are.
    """
    if name not in VIEWS:
        raise ParameterError(f"there is no view '{name}': the views are {', '.join(VIEWS)}")
    return VIEWS[name]


def take_picture(client: PhysicsClient, view: View, width: int, height: int, oversampling: int) -> np.ndarray:
    """uint8 picture (height, width, 3); each pixel is the mean of oversampling^2 rendered ones."""
    columns, rows = width * oversampling, height * oversampling
    looking = client.computeViewMatrixFromYawPitchRoll(view.target, view.distance, view.yaw, view.pitch, 0.0, 2)
    projecting = client.computeProjectionMatrixFOV(view.field_of_view, width / height, 0.05, 8.0)
    _, _, picture, _, owners = client.getCameraImage(
        columns,
        rows,
        looking,
        projecting,
        lightDirection=(1.2, -0.8, 2.5),
        lightColor=(1.0, 0.98, 0.95),
        lightAmbientCoeff=0.66,
        lightDiffuseCoeff=0.42,
        lightSpecularCoeff=0.12,
        shadow=1,
        renderer=client.ER_TINY_RENDERER,
    )
    # PyBullet builds without numpy return the pixels as a flat tuple
    pixels = np.array(picture, dtype=np.uint8).reshape(rows, columns, 4)[:, :, :3]
    nothing = np.asarray(owners).reshape(rows, columns) < 0
    sky = np.linspace(*SKY, rows)[:, None, :].repeat(columns, axis=1)
    pixels[nothing] = sky[nothing]
    blocks = pixels.reshape(height, oversampling, width, oversampling, 3)
    return np.round(blocks.mean(axis=(1, 3))).astype(np.uint8)
