"""What a manifold has to beat: predictors that know training demonstrations and both end poses, no more.

Each predictor maps (training demonstrations, start pose, goal pose) to a curve of poses. It is kept as the
method made it and with its ends moved exactly to the demanded poses: what is compared is the second. DMP and
ProMP come from the library movement_primitives, an optional extra.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.geometry.curves import Pose, PoseCurve
from geodesic_motion_ros.geometry.quaternions import (
    continuous_signs,
    mean_rotation,
    normalise,
    rotate_by,
    rotation_vector_between,
    slerp,
)
from geodesic_motion_ros.queries.path_smoothing import correct_ends
from geodesic_motion_ros.utils.errors import GeodesicMotionError

SAMPLES = 200
DMP_WEIGHTS = 50
PROMP_WEIGHTS = 10
PROMP_NOISE = 1e-4
"""Variance of the ends a ProMP is conditioned on: [m^2], and of the quaternion's components; of joints [rad^2]."""


class PeersMissingError(GeodesicMotionError):
    """The optional library that DMP and ProMP are taken from is not installed."""


@dataclass(frozen=True)
class Prediction:
    """A predicted motion, with the ends that the method gave it and with the demanded ones.

    Attributes
    ----------
    uncorrected, corrected : `corrected` is `uncorrected` with its ends moved; both offsets, of position and of rotation
        vector, fade linearly in arc length.
    """

    uncorrected: PoseCurve
    corrected: PoseCurve

    @classmethod
    def between(cls, curve: PoseCurve, start: Pose, goal: Pose) -> Prediction:
        """Move the ends of a curve to the demanded poses."""
        return cls(curve, PoseCurve(*correct_ends(curve.positions, curve.quaternions, start, goal)))


Predictor = Callable[[Demonstrations, Pose, Pose], Prediction]


def task_line(train: Demonstrations, start: Pose, goal: Pose) -> Prediction:
    """Straight line in position, great circle in orientation; knows no demonstration."""
    s = np.linspace(0.0, 1.0, SAMPLES)
    line = PoseCurve(start[0] + s[:, None] * (goal[0] - start[0]), slerp(start[1], goal[1], s))
    return Prediction.between(line, start, goal)


def mean_demonstration(train: Demonstrations, start: Pose, goal: Pose) -> Prediction:
    """Mean of the demonstrations at equal fractions of arc length; rotations by `quaternions.mean_rotation`."""
    curves = [item.curve.resample(SAMPLES) for item in train]
    positions = np.mean([curve.positions for curve in curves], axis=0)
    quaternions = mean_rotation(np.stack([curve.quaternions for curve in curves]))
    return Prediction.between(PoseCurve(positions, continuous_signs(quaternions)), start, goal)


def nearest_demonstration(train: Demonstrations, start: Pose, goal: Pose) -> Prediction:
    """The demonstration that begins and ends nearest."""
    return Prediction.between(nearest(train, start, goal).curve.resample(SAMPLES), start, goal)


def dmp_nearest(train: Demonstrations, start: Pose, goal: Pose) -> Prediction:
    """Cartesian DMP of the nearest demonstration, start and goal replaced (A. Ude et al., ICRA 2014)."""
    _, dmp_type = require_peers()
    shown = nearest(train, start, goal).resample(SAMPLES, by="time")
    # q and -q are one rotation, but the library would take the longer turn between opposite signs.
    ends = [
        np.hstack([pose[0], rotate_by(rotation_vector_between(quaternion, pose[1]), quaternion)])
        for pose, quaternion in ((start, shown.quaternions[0]), (goal, shown.quaternions[-1]))
    ]
    poses = dmp_motion(dmp_type, np.hstack([shown.positions, shown.quaternions]), *ends)
    curve = PoseCurve(poses[:, :3], continuous_signs(normalise(poses[:, 3:])))
    return Prediction.between(curve, start, goal)


def promp(train: Demonstrations, start: Pose, goal: Pose) -> Prediction:
    """Probabilistic movement primitive conditioned on start and goal (A. Paraschos et al., NIPS 2013).

    Seven dimensions over time scaled to [0, 1]: position and quaternion components, renormalised afterwards.
    The conditioned mean misses the ends by what PROMP_NOISE allows. More noise draws it towards the mean
    demonstration.
    """
    aligned = train.align_hemispheres().resample(SAMPLES, by="time")
    shown = np.concatenate([aligned.positions_array(), aligned.quaternions_array()], axis=2)
    # q and -q are one rotation: the sign is that of the demonstrations.
    ends = [
        np.hstack([pose[0], pose[1] if pose[1] @ reference >= 0.0 else -pose[1]])
        for pose, reference in ((start, shown[0, 0, 3:]), (goal, shown[0, -1, 3:]))
    ]
    predicted = promp_mean(shown, *ends)
    curve = PoseCurve(predicted[:, :3], continuous_signs(normalise(predicted[:, 3:])))
    return Prediction.between(curve, start, goal)


PREDICTORS: dict[str, Predictor] = {
    "task_line": task_line,
    "nearest_demonstration": nearest_demonstration,
    "mean_demonstration": mean_demonstration,
    "dmp_nearest": dmp_nearest,
    "promp": promp,
}
"""The predictors by the names of their rows in the table."""


def nearest(train: Demonstrations, start: Pose, goal: Pose) -> Demonstration:
    """The demonstration whose first and last positions are together nearest to the demanded ones."""
    ends = np.stack([item.positions[[0, -1]] for item in train])
    return train[nearest_ends(ends, start[0], goal[0])]


def nearest_ends(ends: np.ndarray, start: np.ndarray, goal: np.ndarray) -> int:
    """Which of first and last points (N, 2, D) are together nearest to a start (D,) and a goal (D,)."""
    off = np.linalg.norm(ends - np.stack([start, goal]), axis=-1)
    return int(np.argmin(off.sum(axis=1)))


def dmp_motion(dmp_type: Callable[..., Any], shown: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """The motion (SAMPLES, D) of a primitive that has learned one (SAMPLES, D), equally spaced in time, between a start
    (D,) and a goal (D,).

    dmp_type : makes one of the library's, of keywords that they have in common.
    """
    times = np.linspace(0.0, 1.0, SAMPLES)
    dmp = dmp_type(execution_time=1.0, dt=times[1], n_weights_per_dim=DMP_WEIGHTS, int_dt=0.001)
    dmp.imitate(times, shown)
    dmp.configure(start_y=start, goal_y=goal)
    return dmp.open_loop()[1]


def promp_mean(shown: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """The mean (T, D) of a primitive that has learned motions (N, T, D), equally spaced in time, conditioned on a start
    (D,) and a goal (D,) with PROMP_NOISE.
    """
    promp_type, _ = require_peers()
    _, samples, size = shown.shape
    phase = np.linspace(0.0, 1.0, samples)
    primitive = promp_type(n_dims=size, n_weights_per_dim=PROMP_WEIGHTS)
    primitive.imitate(np.tile(phase, (len(shown), 1)), shown)
    for at, end in ((0.0, start), (1.0, goal)):
        primitive = primitive.condition_position(end, y_cov=PROMP_NOISE * np.eye(size), t=at, t_max=1.0)
    return primitive.mean_trajectory(phase)


def require_peers() -> tuple[Any, Any]:
    """Classes ProMP and CartesianDMP of movement_primitives; PeersMissingError names how to install them."""
    try:
        from movement_primitives.dmp import CartesianDMP
        from movement_primitives.promp import ProMP
    except ImportError as error:
        raise PeersMissingError(
            f"the rows dmp_nearest and promp need an optional library ({error}): "
            "pip install movement_primitives pytransform3d"
        ) from error
    return ProMP, CartesianDMP
