"""DetourFrame: coordinates in which an arm may leave a path that was demonstrated, and what leaving it costs.

Along the base path of a query, at progress tau, demonstrations held the tool at x(tau), R(tau) and the arm at q^(tau).
A displacement delta (3,) [m] of the tool and a swivel e [rad] of the arm are reached by the configuration q that solves

    FK(q) = (x(tau) + delta, R(tau)),      n(tau) . (q - q^(tau)) = e,

with n the unit null vector of the tool's Jacobian at q^ (`posture.py`): the orientation stays the demonstrated one.
Arms of six joints or fewer have no swivel; those of fewer than six turn the tool as little as they can, so that what
the search expects of a hand that is displaced alone is no strict bound for them. A displaced path is longer by phi,

    ds^2 = phi^2 (dl^2 + |d delta|^2 + lambda^2 de^2),
    phi  = 1 + delta^T (C(tau) + s^2 I)^-1 delta + (e / rho)^2,

where l is the length of the base path and C(tau) the covariance of the demonstrated positions about their mean: to
leave the path is cheap where people varied, and dear where they did not. The metric is a product one with its minimum
at delta = 0, e = 0: no bend is cut short, and without obstacles the base path is the shortest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.geometry.quaternions import angle_between, continuous_signs
from geodesic_motion_ros.queries.output_space import OutputSpace
from geodesic_motion_ros.queries.posture import null_vectors
from geodesic_motion_ros.robot.body_points import end_effector_poses
from geodesic_motion_ros.robot.kinematics import Robot, contiguous
from geodesic_motion_ros.skill.skill import Skill
from geodesic_motion_ros.trajectory.trajectory import interpolated

#: Covariances are smoothed over this share of the path.
_SMOOTHING = 0.05
#: Samples of a frame, at least and at most.
_FEWEST, _MOST = 12, 48


@dataclass(frozen=True)
class DemonstratedSpread:
    """Covariances (K, S, 3, 3) [m^2] of the demonstrated tool positions of K modes, at S fractions of the arc."""

    covariances: np.ndarray

    @classmethod
    def of(cls, skill: Skill, robot: Robot) -> DemonstratedSpread:
        """Return the spread of the demonstrations on which a skill was trained, as it decodes them; in the skill's
        frame.
        """
        codes = skill.codes.reshape(-1, skill.codes.shape[-1])
        positions = OutputSpace.of(skill).tool_positions(skill.decoder, codes, robot)
        positions = positions.reshape(*skill.codes.shape[:2], 3)
        modes = np.zeros(len(positions), dtype=int) if skill.canonical is None else skill.canonical.modes
        members = [positions[modes == mode] for mode in range(int(modes.max()) + 1)]
        scatter = [np.einsum("isa,isb->sab", own - own.mean(axis=0), own - own.mean(axis=0)) for own in members]
        # What only one demonstration shows is as wide as the other modes are.
        pooled = sum(scatter) / max(1, len(positions) - len(members))
        spread = [s / (len(own) - 1) if len(own) > 1 else pooled for s, own in zip(scatter, members, strict=True)]
        samples = positions.shape[1]
        return cls(gaussian_filter1d(np.stack(spread), _SMOOTHING * samples, axis=1, mode="nearest"))

    def at(self, progress: np.ndarray, mode: int) -> np.ndarray:
        """Return covariances (m, 3, 3) at progress (m,) from 0 to 1 of the skill, of one mode."""
        samples = self.covariances.shape[1]
        table = self.covariances[mode].reshape(samples, 9)
        return interpolated(progress, np.linspace(0.0, 1.0, samples), table).reshape(-1, 3, 3)


def demonstrated_mode(shares: np.ndarray) -> int:
    """Return the mode with the largest of shares (m, K) in the mean; the only one where K is 0."""
    return int(np.argmax(shares.mean(axis=0))) if shares.shape[1] else 0


@dataclass(frozen=True)
class DetourFrame:
    """The coordinates (tau, delta, e) along one base path of m samples.

    Attributes
    ----------
    configurations : (m, eta) q^ [rad]; nulls : (m, eta) n, zeros for six joints or fewer.
    positions, quaternions : (m, 3) [m], (m, 4) of the tool.
    latent : (m, d) latent points of the samples.
    step : length dl of the base path between two samples [m], in which turns count as well.
    precisions : (m, 3, 3) [1/m^2] (C + s^2 I)^-1.
    """

    configurations: np.ndarray
    nulls: np.ndarray
    positions: np.ndarray
    quaternions: np.ndarray
    latent: np.ndarray
    step: float
    precisions: np.ndarray

    @classmethod
    def of_base_path(cls, robot: Robot, path: np.ndarray, latent: np.ndarray, covariances: np.ndarray) -> DetourFrame:
        """Return the frame of a base path (k, eta) with latent points (k, d) and covariances (k, 3, 3) of positions."""
        positions, quaternions = end_effector_poses(contiguous(path), robot.chain)
        turned = angle_between(quaternions[1:], quaternions[:-1])
        moved = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        joints = np.linalg.norm(np.diff(path, axis=0), axis=1)
        turns = constants.DETOUR_METRES_PER_RADIAN * np.hypot(turned, joints)
        length = np.append(0.0, np.cumsum(np.hypot(moved, turns)))
        count = min(max(math.ceil(length[-1] / constants.DETOUR_SPACING), _FEWEST), _MOST) + 1
        at = np.linspace(0.0, length[-1], count)
        chosen, points, spread = (
            interpolated(at, length, np.reshape(table, (len(path), -1))) for table in (path, latent, covariances)
        )
        positions, quaternions = end_effector_poses(contiguous(chosen), robot.chain)
        narrowest = constants.DETOUR_NARROWEST_SPREAD**2 * np.eye(3)
        precisions = np.linalg.inv(spread.reshape(-1, 3, 3) + narrowest)
        return cls(
            chosen, null_vectors(chosen, robot.chain), positions, continuous_signs(quaternions), points,
            float(length[-1] / (count - 1)), np.ascontiguousarray(precisions),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.positions)


def deviations(displacements: np.ndarray, precisions: np.ndarray) -> np.ndarray:
    """Return Mahalanobis distances (m,) of displacements (m, 3) [m] from what was demonstrated, with (m, 3, 3) [1/m^2].
    """
    return np.sqrt(np.einsum("ma,mab,mb->m", displacements, precisions, displacements))
