"""What a manifold of the whole arm has to beat: predictors that know demonstrations of joints and both ends, no more.

Each predictor maps (demonstrations of one family, first and last configuration (eta,) [rad]) to configurations
(SAMPLES, eta), as the method made them: their ends are moved afterwards. The methods are those of `baselines`, joint
angles in the place of poses.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstration, JointDemonstrations
from geodesic_motion_studies.experiments.baselines import (
    SAMPLES,
    dmp_motion,
    nearest_ends,
    promp_mean,
    require_peers,
)

JointPredictor = Callable[[JointDemonstrations, np.ndarray, np.ndarray], np.ndarray]


def joint_line(train: JointDemonstrations, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Straight line in joint space; knows no demonstration."""
    return start + np.linspace(0.0, 1.0, SAMPLES)[:, None] * (goal - start)


def nearest_demonstration(train: JointDemonstrations, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """The demonstration that begins and ends nearest in joint space."""
    return nearest(train, start, goal).resample(SAMPLES).configurations


def dmp_nearest(train: JointDemonstrations, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """DMP of the nearest demonstration, start and goal replaced (A. Ijspeert et al., Neural Computation 2013)."""
    require_peers()
    from movement_primitives.dmp import DMP

    shown = nearest(train, start, goal).resample(SAMPLES, by="time").configurations
    return dmp_motion(partial(DMP, n_dims=len(start)), shown, start, goal)


def promp(train: JointDemonstrations, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Probabilistic movement primitive over time scaled to [0, 1], conditioned on start and goal."""
    return promp_mean(train.resample(SAMPLES, by="time").configurations_array(), start, goal)


JOINT_PREDICTORS: dict[str, JointPredictor] = {
    "joint_line": joint_line,
    "nearest_demonstration": nearest_demonstration,
    "dmp_nearest": dmp_nearest,
    "promp": promp,
}
"""The predictors by the names of their rows in the table."""


def nearest(train: JointDemonstrations, start: np.ndarray, goal: np.ndarray) -> JointDemonstration:
    """The demonstration whose first and last configurations are together nearest to the demanded ones."""
    ends = np.stack([item.configurations[[0, -1]] for item in train])
    return train[nearest_ends(ends, start, goal)]
