"""JointSheet: what a joint-space skill knows, beside codes, of the demonstrations that it was learned from.

These are canonical: endpoint-normalised, with start and goal offsets taken out (`demonstrations.joint_canonical`).

One difference from `sheet.CanonicalSheet`: several families of configurations may start from, or end at, different
configurations that hold the tool in the same pose. No mean is taken over them. Starts and goals are grouped, and each
group has a mean of its own, its *pole*, from which offsets are counted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.manifold.joint_decoder import JointSpaceDecoder
from geodesic_motion_ros.manifold.mean_path import MeanPaths
from geodesic_motion_ros.skill.sheet import DemonstratedEnds


@dataclass(frozen=True)
class JointSheet(DemonstratedEnds):
    """The N endpoint-normalised demonstrations of a skill of configurations, and how far each was moved for that.

    They are sampled at S equally spaced fractions of their arcs, as their codes are. Offsets are displacements of the
    eta joints [rad], from the pole of the demonstration's group.

    Attributes
    ----------
    configurations : (N, S, eta) canonical configurations [rad].
    start_groups, goal_groups : (N,) number of the group that each demonstration starts from and ends in, from 0.
    start_poles, goal_poles : (G, eta) mean configurations of the groups [rad].
    """

    configurations: np.ndarray
    start_groups: np.ndarray
    goal_groups: np.ndarray
    start_poles: np.ndarray
    goal_poles: np.ndarray

    def check(self, count: int, samples: int) -> None:
        """Refuse arrays that do not belong to codes of `count` demonstrations with `samples` each (SkillError)."""
        joints = (0, *self.configurations.shape)[-1]
        self.check_arrays({
            "configurations": (count, samples, joints),
            "start_offsets": (count, joints), "goal_offsets": (count, joints),
        })  # fmt: skip
        self.check_numbers("modes")
        for end in ("start", "goal"):
            self.check_numbers(f"{end}_groups")
            groups = len(set(getattr(self, f"{end}_groups").tolist()))
            self.check_arrays({f"{end}_poles": (groups, joints)})

    def corrections(self, decoder: JointSpaceDecoder, mean_paths: MeanPaths, weights: np.ndarray) -> np.ndarray:
        """What the decoder lacks on the mean paths to be the demonstrations' weighted means, (K, S, eta) [rad]."""
        means = np.einsum("kn,nsj->ksj", weights, self.configurations)
        count, samples, dimension = mean_paths.centres.shape
        return means - decoder.configurations(mean_paths.centres.reshape(-1, dimension)).reshape(count, samples, -1)
