"""The continuous band: a detour found on a lattice, drawn tight.

Each point of the path moves, at its progress, half of the way to the middle of its neighbours and a little back to the
base path, against the gradient of phi (`detour_frame.py`). Where that brings the arm nearer to an obstacle than it is
to stay, the point slides along the obstacle instead: what of its step leads on against the gradient of the clearance is
taken off. No point becomes less clear than it is to stay, or than it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.graph.metric_field import evenly
from geodesic_motion_ros.joint_reference import interpolated
from geodesic_motion_ros.planning import settings as constants
from geodesic_motion_ros.planning.arm_in_scene import ArmInScene, clearance_at
from geodesic_motion_ros.planning.detour_frame import DetourFrame
from geodesic_motion_ros.planning.detour_search import LatticePath
from geodesic_motion_ros.planning.posture import hold_displaced
from geodesic_motion_ros.quaternions import normalise

#: Points of the band, so often [m]; it is drawn evenly so many times, each for so many rounds.
_SPACING, _DRAWN, _ROUNDS = 0.015, 3, 15
#: How far back to the base path a point moves in a round, in units of the narrowest spread's square.
_PULL = 0.01
#: Steps by which the gradient of the clearance is measured [m]; a point is pushed no farther off an obstacle at once.
_DIFFERENCE, _LARGEST_PUSH = 2e-3, 5e-3


@dataclass(frozen=True, eq=False)
class Band:
    """A detour of m points.

    Attributes
    ----------
    progress : (m,) number of the frame's sample, between two of them too. displacements : (m, 3) [m].
    swivels : (m,) [rad]. configurations : (m, eta) [rad]. latent : (m, d) of the base path there.
    deviations : (m,) Mahalanobis distances of the displacements from what was demonstrated.
    """

    progress: np.ndarray
    displacements: np.ndarray
    swivels: np.ndarray
    configurations: np.ndarray
    latent: np.ndarray
    deviations: np.ndarray


def drawn_tight(frame: DetourFrame, arm: ArmInScene, path: LatticePath, reach: float, keep: float) -> Band | None:
    """A path of the lattice made continuous, with displacements up to `reach` [m], which stays as clear as `keep` [m]
    where it can; None where the arm cannot hold it between the nodes.
    """
    # Lengths along all four axes [m].
    points = np.column_stack([
        frame.step * path.samples, path.displacements, constants.DETOUR_METRES_PER_SWIVEL * path.swivels
    ])
    configurations = path.configurations
    for _ in range(_DRAWN):
        pieces = max(len(points), math.ceil(_length(points) / _SPACING))
        points = evenly(points, pieces)
        held = _at(frame, points[:, 0] / frame.step)
        found = _hold(*held[:4], points, configurations[0], arm)
        if found is None or not len(found):
            return None
        configurations = found
        _draw(*held[:5], points, configurations, arm, reach, keep, _ROUNDS)
    progress = points[:, 0] / frame.step
    precisions, displacements = held[4], points[:, 1:4]
    deviations = np.sqrt(np.einsum("ma,mab,mb->m", displacements, precisions, displacements))
    return Band(
        progress, displacements, points[:, 4] / constants.DETOUR_METRES_PER_SWIVEL, configurations,
        interpolated(progress, np.arange(float(len(frame))), frame.latent), deviations,
    )  # fmt: skip


def _length(points: np.ndarray) -> float:
    return float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _at(frame: DetourFrame, progress: np.ndarray) -> tuple[np.ndarray, ...]:
    """Positions, quaternions, postures, null vectors and precisions at progress (m,), in numbers of samples."""
    samples = np.arange(float(len(frame)))
    positions, quaternions, postures, nulls, precisions = (
        interpolated(progress, samples, np.ascontiguousarray(np.reshape(table, (len(frame), -1))))
        for table in (frame.positions, frame.quaternions, frame.configurations, frame.nulls, frame.precisions)
    )
    lengths = np.linalg.norm(nulls, axis=1, keepdims=True)
    nulls = nulls / np.where(lengths > 0.0, lengths, 1.0)
    return positions, normalise(quaternions), postures, nulls, precisions.reshape(-1, 3, 3)


@numba.njit(cache=True, nogil=True)
def _hold_at(
    i: int,
    position: np.ndarray,
    quaternions: np.ndarray,
    postures: np.ndarray,
    nulls: np.ndarray,
    point: np.ndarray,
    q: np.ndarray,
    arm: ArmInScene,
) -> bool:
    """Solve for the configuration (eta,) of a point (4,), displacement and swivel [m], beside sample i, from q on."""
    displaced = np.empty(3)
    for a in range(3):
        displaced[a] = position[i, a] + point[a]
    swivel = point[3] / constants.DETOUR_METRES_PER_SWIVEL
    return hold_displaced(displaced, quaternions[i], nulls[i], postures[i], swivel, q, arm.chain)


@numba.njit(cache=True, nogil=True)
def _hold(
    positions: np.ndarray,
    quaternions: np.ndarray,
    postures: np.ndarray,
    nulls: np.ndarray,
    points: np.ndarray,
    start: np.ndarray,
    arm: ArmInScene,
) -> np.ndarray:
    """Configurations (m, eta) of points (m, 5), each from the one before; none where one is not held."""
    found, q = np.empty(postures.shape), start.copy()
    for i in range(len(points)):
        if not _hold_at(i, positions, quaternions, postures, nulls, points[i, 1:], q, arm):
            return np.empty((0, postures.shape[1]))
        found[i] = q
    return found


@numba.njit(cache=True, nogil=True)
def _draw(
    positions: np.ndarray,
    quaternions: np.ndarray,
    postures: np.ndarray,
    nulls: np.ndarray,
    precisions: np.ndarray,
    points: np.ndarray,
    configurations: np.ndarray,
    arm: ArmInScene,
    reach: float,
    keep: float,
    rounds: int,
) -> None:
    """Draw points (m, 5) with their configurations (m, eta) tight, in place; both ends stay."""
    count, joints = configurations.shape
    within = keep + 0.02
    clearance = np.empty(count)
    for i in range(count):
        clearance[i] = clearance_at(configurations[i], arm, within)
    step, gradient, trial, q = np.empty(4), np.empty(4), np.empty(4), np.empty(joints)
    scale = _PULL * constants.DETOUR_NARROWEST_SPREAD**2
    for _ in range(rounds):
        for i in range(1, count - 1):
            asked = min(keep, clearance[i])
            for a in range(4):
                step[a] = 0.25 * (points[i - 1, a + 1] + points[i + 1, a + 1]) - 0.5 * points[i, a + 1]
            for a in range(3):
                for b in range(3):
                    step[a] -= scale * precisions[i, a, b] * points[i, b + 1]
            step[3] -= _PULL * points[i, 4]
            for a in range(4):
                trial[a] = points[i, a + 1] + step[a]
            q[:] = configurations[i]
            reached = -math.inf
            if _hold_at(i, positions, quaternions, postures, nulls, trial, q, arm):
                reached = clearance_at(q, arm, within)
            if reached < keep:
                # Slide along the obstacle, and off it where it is nearer than it is to stay.
                squared, against = 0.0, 0.0
                for a in range(4):
                    gradient[a] = 0.0
                    if a == 3 and joints < 7:
                        continue
                    for b in range(4):
                        trial[b] = points[i, b + 1] + (_DIFFERENCE if a == b else 0.0)
                    q[:] = configurations[i]
                    if _hold_at(i, positions, quaternions, postures, nulls, trial, q, arm):
                        changed = clearance_at(q, arm, within) - clearance[i]
                        if math.isfinite(changed):
                            gradient[a] = changed / _DIFFERENCE
                    squared += gradient[a] * gradient[a]
                    against += gradient[a] * step[a]
                if squared == 0.0:
                    continue
                off = min(max(0.0, keep - clearance[i]), _LARGEST_PUSH)
                along = (off - min(against, 0.0)) / squared
                for a in range(4):
                    trial[a] = points[i, a + 1] + step[a] + along * gradient[a]
                q[:] = configurations[i]
                reached = -math.inf
                if _hold_at(i, positions, quaternions, postures, nulls, trial, q, arm):
                    reached = clearance_at(q, arm, within)
            within_reach = trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2 <= reach * reach
            if reached >= asked and within_reach:
                clearance[i] = reached
                configurations[i] = q
                for a in range(4):
                    points[i, a + 1] = trial[a]
