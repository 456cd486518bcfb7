"""Canonical, that is endpoint-normalised, form of demonstrations: where a task begins and ends is taken out.

With s in [0, 1] the fraction of a demonstration's arc, start offset d0 = x(0) - m(0) and goal offset d1 = x(1) - m(1)
from the mean first and last pose m(0), m(1) of all demonstrations, the canonical curve is

    y(s) = x(s) - (1 - tau) d0 - tau d1,      1 - tau = (1 - s)^fade     (see `demonstrations.fade`),

with rotations likewise: d0 and d1 are rotation vectors in the base frame, exp(d) m = x, and the curve is turned back by
exp(-(1 - tau) d0 - tau d1). Every canonical curve runs from m(0) to m(1); adding the offsets again gives the
demonstration back exactly, and adding the offsets of another start and goal carries it there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstration, Demonstrations
from geodesic_motion_ros.demonstrations.fade import FADE_SAMPLES, likeliest_fade, scatter_within
from geodesic_motion_ros.demonstrations.modes import cluster_modes
from geodesic_motion_ros.geometry.curves import interpolate, pose_arc_length
from geodesic_motion_ros.geometry.quaternions import mean_rotation, rotate_by, rotation_vector_between
from geodesic_motion_ros.manifold.transport import faded
from geodesic_motion_ros.skill.sheet import RotationCurves
from geodesic_motion_ros.utils.errors import DemonstrationError

#: Starts and goals may lie this share of the demonstrations' length from their mean; further apart there is no task
#: that they have in common, only straight lines between places.
LARGEST_SHARE = 0.5
#: The same for orientations [rad]: rotation vectors of half a turn have no direction.
LARGEST_TURN = 2.0


@dataclass(frozen=True)
class CanonicalDemonstrations:
    """Demonstrations (N) in canonical form at the same fractions s (T,) of their arcs.

    Attributes
    ----------
    positions : (N, T, 3) [m]; quaternions : (N, T, 4), all in one hemisphere at equal s.
    start_offsets, goal_offsets : (N, 6) translation [m] and rotation vector [rad] from `start` and `goal`.
    start, goal : (7,) mean first and last pose: x, y, z [m], w, x, y, z.
    fade : exponent with which start offsets were taken out.
    """

    positions: np.ndarray
    quaternions: np.ndarray
    start_offsets: np.ndarray
    goal_offsets: np.ndarray
    start: np.ndarray
    goal: np.ndarray
    fade: float

    def blended(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weighted means of the curves: positions (B, T, 3) and quaternions (B, T, 4), for weights (B, N)."""
        positions = np.einsum("bn,ntj->btj", weights, self.positions)
        return positions, RotationCurves.of(self.quaternions).blended(weights)


def along_arc(
    demonstration: Demonstration, samples: int, rotation_length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (samples, 3) and quaternions (samples, 4), equally spaced along the arc of a demonstration.

    The arc counts sqrt(|dx|^2 + (rotation_length * angle)^2), see `curves.pose_arc_length`.
    """
    arc = pose_arc_length(demonstration.positions, demonstration.quaternions, rotation_length)
    at = np.linspace(0.0, arc[-1], samples)
    return interpolate(arc, demonstration.positions, demonstration.quaternions, at)


def canonical_form(
    demonstrations: Demonstrations, samples: int, rotation_length: float, fade: float | None = None
) -> CanonicalDemonstrations:
    """Resample demonstrations along their arcs and take their start and goal offsets out.

    Parameters
    ----------
    demonstrations : signs of whole demonstrations do not matter.
    rotation_length : length that a turn of one radian counts in the arc [m].
    fade : exponent with which start offsets fade; None: the likeliest.

    Raises
    ------
    DemonstrationError : a demonstration starts or ends where the others do not, so that they have no form in common.
    """
    aligned = demonstrations.in_one_hemisphere()
    positions, quaternions = _all_along_arc(aligned, samples, rotation_length)
    start, goal = (mean_pose(positions[:, end], quaternions[:, end]) for end in (0, -1))
    start_offsets = offsets_between(start, positions[:, 0], quaternions[:, 0])
    goal_offsets = offsets_between(goal, positions[:, -1], quaternions[:, -1])
    lengths = [item.length for item in demonstrations]
    _refuse_strangers([item.name for item in demonstrations], "starts", start_offsets, lengths)
    _refuse_strangers([item.name for item in demonstrations], "ends", goal_offsets, lengths)
    offsets = np.stack([start_offsets, goal_offsets], axis=1)
    if fade is None:
        few = _all_along_arc(aligned, FADE_SAMPLES, rotation_length)
        modes = cluster_modes(_without_offsets(*few, offsets, 1.0)[0])

        def scatter(tried: float) -> float:
            moved, turned = _without_offsets(*few, offsets, tried)
            turns = rotation_length * RotationCurves.of(turned).turns
            return scatter_within(np.concatenate([moved, turns], axis=-1), modes)

        fade = likeliest_fade(scatter, len(offsets))
    canonical = _without_offsets(positions, quaternions, offsets, fade)
    return CanonicalDemonstrations(*canonical, start_offsets, goal_offsets, start, goal, fade)


def _all_along_arc(
    demonstrations: Demonstrations, samples: int, rotation_length: float
) -> tuple[np.ndarray, np.ndarray]:
    curves = [along_arc(item, samples, rotation_length) for item in demonstrations]
    return np.stack([curve[0] for curve in curves]), np.stack([curve[1] for curve in curves])


def _without_offsets(
    positions: np.ndarray, quaternions: np.ndarray, offsets: np.ndarray, fade: float
) -> tuple[np.ndarray, np.ndarray]:
    """y of curves (N, T, 3), (N, T, 4), for the offsets (N, 2, 6) of their starts and goals."""
    tau = faded(np.linspace(0.0, 1.0, positions.shape[1]), fade)[:, None]
    blend = (1.0 - tau) * offsets[:, :1] + tau * offsets[:, 1:]
    return positions - blend[..., :3], rotate_by(-blend[..., 3:], quaternions)


def _refuse_strangers(names: list[str], verb: str, offsets: np.ndarray, lengths: list[float]) -> None:
    """Offsets (N, 6) of starts or goals are refused beyond LARGEST_SHARE of the path and beyond LARGEST_TURN."""
    distances, turns = np.linalg.norm(offsets[:, :3], axis=1), np.linalg.norm(offsets[:, 3:], axis=1)
    allowed = LARGEST_SHARE * float(np.median(lengths))
    strange = (distances > allowed) | (turns > LARGEST_TURN)
    if not np.any(strange):
        return
    listed = ", ".join(
        f"{name} {1e3 * distance:.0f} mm and {np.degrees(turn):.0f} deg"
        for name, distance, turn in zip(names, distances, turns, strict=True)
    )
    raise DemonstrationError(
        f"demonstration '{names[int(np.argmax(strange))]}' {verb} where the others do not: from the mean it is "
        f"further than {1e3 * allowed:.0f} mm ({LARGEST_SHARE:g} of the path) or {np.degrees(LARGEST_TURN):.0f} deg. "
        f"One skill is learned from demonstrations of one task; these are {listed} from their mean"
    )


def offsets_between(pose: np.ndarray, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Translations [m] and rotation vectors [rad], (n, 6), from a pose (7,) to poses (n, 3), (n, 4)."""
    turned = rotation_vector_between(np.broadcast_to(pose[3:], quaternions.shape), quaternions)
    return np.concatenate([positions - pose[:3], turned], axis=-1)


def mean_pose(positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
    """Mean position and mean rotation (7,) of poses (N, 3), (N, 4), the rotation on the first one's hemisphere."""
    rotation = mean_rotation(quaternions)
    return np.concatenate([positions.mean(axis=0), rotation if rotation @ quaternions[0] >= 0.0 else -rotation])
