"""The continuous band: a detour found on a lattice, drawn tight.

The points of the path, at their progress, move down the gradient of what the path costs: by the same metric as in the
search, with the trapezoidal rule between points,

    J = sum_i (p_i + p_{i+1}) / 2 |x_{i+1} - x_i|,      p = phi m(c),

where x = (l, delta, lambda e), phi is the price of leaving the base path (`detour_frame.py`), and m(c) that of a
clearance c. The gradient of c is measured. A step is taken where it lowers J and keeps the margin. First there are few
points, which move far, then more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.certification.arm_in_scene import ArmInScene, clearance_at
from geodesic_motion_ros.contract import settings as constants
from geodesic_motion_ros.detours.detour_frame import DetourFrame, deviations
from geodesic_motion_ros.detours.detour_search import LatticePath, nearness_factor, stretch
from geodesic_motion_ros.geometry.quaternions import normalise
from geodesic_motion_ros.queries.posture import solve_displaced
from geodesic_motion_ros.trajectory.trajectory import interpolated

#: Distances between the points of the band [m], at first and then.
_SPACINGS = 0.05, 0.03, 0.015
#: Rounds in which each point is moved.
_ROUNDS = 15
#: A swivel counts as much as other turns of joints where points are spaced: between two of them nothing is judged.
_SPACED_BY = np.array([1.0, 1.0, 1.0, 1.0, constants.DETOUR_METRES_PER_RADIAN / constants.DETOUR_METRES_PER_SWIVEL])
#: A step by which the gradient of the clearance is measured [m].
_DIFFERENCE = 1e-3
#: A step is a share of that to the middle of both neighbours where the price is the same, and a shorter one is tried.
_SHARES = (0.5, 0.1)


@dataclass(frozen=True, eq=False)
class Band:
    """A detour drawn tight: m points beside the base path, each with its displacement, swivel and configuration.

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


def draw_tight(frame: DetourFrame, arm: ArmInScene, path: LatticePath, reach: float, margin: float) -> Band | None:
    """Return a path of the lattice made continuous, with displacements up to `reach` [m] and a clearance of `margin`
    [m], or of what it has between the nodes where that is less; None where the arm cannot hold it there.
    """
    # Lengths along all four axes [m].
    points = np.column_stack(
        [frame.step * path.samples, path.displacements, constants.DETOUR_METRES_PER_SWIVEL * path.swivels]
    )
    configurations = path.configurations
    for spacing in _SPACINGS:
        lengths = _lengths(points * _SPACED_BY)
        even = np.linspace(0.0, lengths[-1], max(len(frame), math.ceil(lengths[-1] / spacing) + 1))
        points, near = interpolated(even, lengths, points), interpolated(even, lengths, configurations)
        local = _at(frame, points[:, 0] / frame.step)
        positions, quaternions, on_path, nulls = local[:4]
        configurations = _solve_all(positions, quaternions, on_path, nulls, points, near, arm)
        if not len(configurations):
            return None
        _draw(*local, points, configurations, arm, reach, margin, _ROUNDS)
    progress = points[:, 0] / frame.step
    precisions, displacements = local[4], points[:, 1:4]
    return Band(
        progress, displacements, points[:, 4] / constants.DETOUR_METRES_PER_SWIVEL, configurations,
        interpolated(progress, np.arange(float(len(frame))), frame.latent),
        deviations(displacements, precisions),
    )  # fmt: skip


def band_cost(frame: DetourFrame, arm: ArmInScene, band: Band) -> float:
    """Return J of a band. A path of the lattice whose nodes are the points of a band costs the same."""
    points = np.column_stack([
        frame.step * band.progress, band.displacements, constants.DETOUR_METRES_PER_SWIVEL * band.swivels
    ])
    precisions = _at(frame, band.progress)[4]
    clearances = np.array([clearance_at(q, arm, constants.DETOUR_FELT_CLEARANCE) for q in band.configurations])
    parts = zip(points[:, 1:], precisions, clearances, strict=True)
    prices = np.array([_price(point, precision, clearance) for point, precision, clearance in parts])
    return float(np.sum(0.5 * (prices[1:] + prices[:-1]) * np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _lengths(points: np.ndarray) -> np.ndarray:
    """Length (m,) of a polyline (m, d) up to each of its points."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _at(frame: DetourFrame, progress: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
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
def _solve_at(
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
    return solve_displaced(displaced, quaternions[i], nulls[i], postures[i], swivel, q, arm.chain)


@numba.njit(cache=True, nogil=True)
def _solve_all(
    positions: np.ndarray,
    quaternions: np.ndarray,
    postures: np.ndarray,
    nulls: np.ndarray,
    points: np.ndarray,
    near: np.ndarray,
    arm: ArmInScene,
) -> np.ndarray:
    """Configurations (m, eta) of points (m, 5), each from one that is near (m, eta); none where one has no solution."""
    found = near.copy()
    for i in range(len(points)):
        if not _solve_at(i, positions, quaternions, postures, nulls, points[i, 1:], found[i], arm):
            return np.empty((0, postures.shape[1]))
    return found


@numba.njit(cache=True, nogil=True)
def _price(point: np.ndarray, precision: np.ndarray, clearance: float) -> float:
    """p at a point (4,), displacement and swivel [m], and a clearance [m]."""
    swivel = point[3] / constants.DETOUR_METRES_PER_SWIVEL
    return nearness_factor(clearance) * stretch(precision, point[0], point[1], point[2], swivel)


@numba.njit(cache=True, nogil=True)
def _local_cost(points: np.ndarray, prices: np.ndarray, i: int, point: np.ndarray, price: float) -> float:
    """The two terms of J that point i of (m, 5) is in, if it were at (4,) with a price."""
    total = 0.0
    for other in (i - 1, i + 1):
        squared = (points[other, 0] - points[i, 0]) ** 2
        for a in range(4):
            squared += (points[other, a + 1] - point[a]) ** 2
        total += 0.5 * (prices[other] + price) * math.sqrt(squared)
    return total


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
    margin: float,
    rounds: int,
) -> None:
    """Move points (m, 5) with their configurations (m, eta) down the gradient of J, in place; both ends stay."""
    count, joints = configurations.shape
    felt = max(constants.DETOUR_FELT_CLEARANCE, margin) + _DIFFERENCE
    clearances, prices = np.empty(count), np.empty(count)
    for i in range(count):
        clearances[i] = clearance_at(configurations[i], arm, felt)
        prices[i] = _price(points[i, 1:], precisions[i], clearances[i])
    here, trial, slope, q = np.empty(4), np.empty(4), np.empty(4), np.empty(joints)
    for _ in range(rounds):
        for i in range(1, count - 1):
            here[:] = points[i, 1:]
            # The two terms of J, by differences of the price and of the lengths.
            cost, length = _local_cost(points, prices, i, here, prices[i]), 0.0
            for other in (i - 1, i + 1):
                length += 0.5 * math.sqrt(np.sum((points[other] - points[i]) ** 2))
            if length == 0.0:
                continue
            for a in range(4):
                slope[a] = 0.0
                if a == 3 and joints < 7:
                    continue
                trial[:] = here
                trial[a] += _DIFFERENCE
                clearance = clearances[i]
                if clearance < felt:
                    q[:] = configurations[i]
                    if _solve_at(i, positions, quaternions, postures, nulls, trial, q, arm):
                        clearance = max(clearance_at(q, arm, felt), clearance - _DIFFERENCE)
                price = _price(trial, precisions[i], clearance)
                slope[a] = (_local_cost(points, prices, i, trial, price) - cost) / _DIFFERENCE
            for share in _SHARES:
                scale = 0.5 * share * length / prices[i]
                for a in range(4):
                    trial[a] = here[a] - scale * slope[a]
                if trial[0] ** 2 + trial[1] ** 2 + trial[2] ** 2 > reach * reach:
                    continue
                q[:] = configurations[i]
                if not _solve_at(i, positions, quaternions, postures, nulls, trial, q, arm):
                    continue
                clearance = clearance_at(q, arm, felt)
                price = _price(trial, precisions[i], clearance)
                if clearance >= min(margin, clearances[i]) and _local_cost(points, prices, i, trial, price) < cost:
                    points[i, 1:], configurations[i] = trial, q
                    clearances[i], prices[i] = clearance, price
                    break
