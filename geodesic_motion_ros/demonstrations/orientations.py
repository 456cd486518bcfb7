"""Conventions of orientations in files -> quaternions, scalar first."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from geodesic_motion_ros.demonstrations.column_names import (
    MATRIX,
    POSITION,
    QUATERNION,
    ROLL_PITCH_YAW,
    ROTATION_VECTOR,
)
from geodesic_motion_ros.geometry.quaternions import continuous_signs, from_rotation
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Rotation vectors of a controller are no longer than half a turn [rad], and a little for rounding.
LONGEST_VECTOR = np.pi + 0.01
#: Programs write angles of up to half a turn, or from none to a whole one [rad], and a little for rounding.
LARGEST_ANGLE = 2.0 * np.pi + 0.01
#: What numbers of a rotation matrix may be off.
_ROUNDING = 1e-2


def convert_rotation_vectors(vectors: np.ndarray, name: str) -> np.ndarray:
    """Convert rotation vectors (T, 3) [rad] in the base frame to quaternions (T, 4), neighbours in one hemisphere.

    A turn by about half a turn is written as one vector or as its opposite: where the sign flips nothing jumps.
    DemonstrationError: a vector is longer than half a turn, as degrees and Euler angles are.
    """
    lengths = np.linalg.norm(vectors, axis=1)
    long = np.flatnonzero(lengths > LONGEST_VECTOR)
    if len(long):
        degrees = np.all(lengths <= np.degrees(LONGEST_VECTOR)) and lengths.max() > 2.0 * np.pi
        kind = "degrees, or roll, pitch and yaw" if degrees else "roll, pitch and yaw"
        raise DemonstrationError(
            f"demonstration '{name}', sample {long[0]}: the rotation vector is {lengths[long[0]]:.4g} long, "
            f"more than half a turn [rad]: are these {kind}?"
        )
    return continuous_signs(from_rotation(Rotation.from_rotvec(vectors)))


def convert_roll_pitch_yaw(angles: np.ndarray, name: str) -> np.ndarray:
    """Convert angles (T, 3) [rad] of turns about the fixed axes x, then y, then z to quaternions (T, 4).

    DemonstrationError: one is larger than a whole turn, as degrees are.
    """
    large = np.argwhere(np.abs(angles) > LARGEST_ANGLE)
    if len(large):
        sample, column = large[0]
        raise DemonstrationError(
            f"demonstration '{name}', sample {sample}: {ROLL_PITCH_YAW[column]} is {angles[sample, column]:.4g}, more "
            f"than a whole turn [rad]: are these degrees? Say so in the header, as in {ROLL_PITCH_YAW[column]} [deg]"
        )
    return continuous_signs(from_rotation(Rotation.from_euler("xyz", angles)))


def convert_matrices(matrices: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Convert homogeneous matrices (T, 16) to positions (T, 3), in the unit of the file, and quaternions (T, 4).

    They are written in rows, or in columns as libfranka does: where the zeros and the one at the end are says which.
    DemonstrationError: neither, or no rotation.
    """
    square = matrices.reshape(-1, 4, 4)
    orders = [each for each in (square, square.transpose(0, 2, 1)) if np.allclose(each[:, 3], [0.0, 0.0, 0.0, 1.0])]
    if not orders:
        raise DemonstrationError(f"demonstration '{name}': the 16 columns are no homogeneous matrix of a pose")
    rotation, position = orders[0][:, :3, :3], orders[0][:, :3, 3]
    wrong = np.flatnonzero(
        (np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > _ROUNDING)
        | (np.linalg.det(rotation) < 0.0)
    )
    if len(wrong):
        handed = "a left-handed frame" if np.linalg.det(rotation[wrong[0]]) < 0.0 else "no rotation"
        raise DemonstrationError(f"demonstration '{name}', sample {wrong[0]}: its matrix is {handed}")
    return position, continuous_signs(from_rotation(Rotation.from_matrix(rotation)))


#: What makes quaternions of three columns.
_OF_THREE: dict[tuple[str, ...], Callable[[np.ndarray, str], np.ndarray]] = {
    ROTATION_VECTOR: convert_rotation_vectors, ROLL_PITCH_YAW: convert_roll_pitch_yaw,
}  # fmt: skip


def convert_to_quaternions(table: Mapping[str, np.ndarray], name: str) -> dict[str, np.ndarray]:
    """Convert the orientations of a demonstration's table to columns qw, qx, qy, qz."""
    converted = dict(table)
    if MATRIX in converted:
        position, quaternions = convert_matrices(converted.pop(MATRIX), name)
        return converted | dict(zip((*POSITION, *QUATERNION), np.hstack([position, quaternions]).T, strict=True))
    for names, quaternions_of in _OF_THREE.items():
        if names[0] in converted:
            quaternions = quaternions_of(np.stack([converted.pop(one) for one in names], axis=1), name)
            return converted | dict(zip(QUATERNION, quaternions.T, strict=True))
    return converted
