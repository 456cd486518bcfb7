"""Canonical form of joint-space demonstrations: where a task begins and ends taken out, the way of doing it left.

As in `canonical`, y(s) = theta(s) - (1 - s) d0 - s d1 with s in [0, 1] the fraction of the arc and d0, d1 the offsets
of start and goal. They are counted from the mean of those demonstrations alone that start (end) in the same family of
configurations: two configurations that hold the tool in one pose with the elbow on two sides are never averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.demonstrations.joint_demonstrations import JointDemonstrations
from geodesic_motion_ros.demonstrations.modes import cluster_modes
from geodesic_motion_ros.errors import DemonstrationError

#: Starts and goals may lie this far [rad], over all joints, from the mean of their group.
LARGEST_OFFSET = 1.5


@dataclass(frozen=True)
class CanonicalJointDemonstrations:
    """Demonstrations (N) in canonical form at the same fractions s (T,) of their arcs.

    Attributes
    ----------
    configurations : (N, T, eta) [rad].
    start_offsets, goal_offsets : (N, eta) [rad], from the pole of the demonstration's group.
    start_groups, goal_groups : (N,) numbers of the groups; start_poles, goal_poles : (G, eta) their means [rad].
    """

    configurations: np.ndarray
    start_offsets: np.ndarray
    goal_offsets: np.ndarray
    start_groups: np.ndarray
    goal_groups: np.ndarray
    start_poles: np.ndarray
    goal_poles: np.ndarray


def canonical_joint_form(demonstrations: JointDemonstrations, samples: int) -> CanonicalJointDemonstrations:
    """Resample demonstrations along their arcs and take their start and goal offsets out.

    Raises
    ------
    DemonstrationError : a demonstration starts or ends far from all others of its group.
    """
    configurations = demonstrations.resampled(samples).configurations_array()
    start_groups, start_poles, start_offsets = _grouped(configurations[:, 0])
    goal_groups, goal_poles, goal_offsets = _grouped(configurations[:, -1])
    for verb, offsets in (("starts", start_offsets), ("ends", goal_offsets)):
        sizes = np.linalg.norm(offsets, axis=1)
        if np.any(sizes > LARGEST_OFFSET):
            told = ", ".join(f"{item.name} {size:.2f}" for item, size in zip(demonstrations, sizes, strict=True))
            raise DemonstrationError(
                f"demonstration '{demonstrations[int(np.argmax(sizes))].name}' {verb} further than "
                f"{LARGEST_OFFSET:g} rad from the others like it: one skill is learned from demonstrations of one "
                f"task; distances [rad] from the mean are {told}"
            )
    s = np.linspace(0.0, 1.0, samples)[:, None]
    blend = (1.0 - s) * start_offsets[:, None] + s * goal_offsets[:, None]
    return CanonicalJointDemonstrations(
        configurations - blend, start_offsets, goal_offsets, start_groups, goal_groups, start_poles, goal_poles
    )


def _grouped(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Groups (N,) of configurations (N, eta), the groups' means (G, eta), and the offsets (N, eta) from them."""
    groups = cluster_modes(ends[:, None])
    poles = np.stack([ends[groups == group].mean(axis=0) for group in range(groups.max() + 1)])
    return groups, poles, ends - poles[groups]
