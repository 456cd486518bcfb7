"""Motions that return to their start, or go over their own path: wiping, stirring, shaking, a lap.

A skill leads from a start to a goal. Of a motion that ends where it began nothing is left but its ends.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.distance import cdist

from geodesic_motion_ros.demonstrations.flaws import ROTATION_LENGTH
from geodesic_motion_ros.demonstrations.splitting import LOOP
from geodesic_motion_ros.demonstrations.takes import Action, Flaw, Take
from geodesic_motion_ros.geometry.curves import arc_length

#: A motion goes over its own path if more than this share of it comes within NEAR of parts of it that are more than
#: APART further along, in shares of its length: 13 % at most of a letter e, 88 to 100 % where people shake or wipe.
RETRACED, NEAR, APART = 0.5, 0.03, 0.25
_SAMPLES = 120


def find_returns(motions: Sequence[Take]) -> list[Flaw]:
    """Find the first motion that returns, where at least half do: refused; else those that retrace their path."""
    returning = [motion for motion in motions if _returns(motion)]
    if returning and len(returning) >= 0.5 * len(motions):
        how = "a skill leads from a start to another goal: end demonstrations where they turn back (--split)"
        what = f"returns to its start ({len(returning)} of {len(motions)} do), and ends"
        return [_flaw(returning[0], what, Action.REFUSED, how)]
    what, how = "goes over its own path, and ends", "a skill leads to the goal once: it may leave rounds out"
    return [_flaw(motion, what, Action.KEPT, how) for motion in motions if _is_retraced(motion)]


def _flaw(motion: Take, what: str, action: Action, how: str) -> Flaw:
    values, unit = (motion.values, "rad") if motion.is_of_joints else (motion.values[:, :3], "m")
    apart, length = float(np.linalg.norm(values[-1] - values[0])), float(arc_length(values)[-1])
    what = f"{what} {apart:.3f} {unit} from its start after {length:.2f} {unit}"
    return Flaw(motion.name, float(motion.times[-1]), what, action, how)


def _points(motion: Take) -> np.ndarray:
    """Joints (T, eta) [rad], or positions and quaternions (T, 3 or 7) scaled so that distances are in metres."""
    if motion.is_of_joints:
        return motion.values
    # a quaternion changes by half of the angle
    return np.hstack([motion.values[:, :3], 2.0 * ROTATION_LENGTH * motion.values[:, 3:]])


def _returns(motion: Take) -> bool:
    points = _points(motion)
    # the opposite quaternion is the same orientation
    ends = [points[-1] * np.where(np.arange(points.shape[1]) < 3, 1.0, sign) for sign in (1.0, -1.0)]
    apart = min(np.linalg.norm(end - points[0]) for end in (ends[:1] if motion.is_of_joints else ends))
    return bool(apart < LOOP * np.linalg.norm(points - points[0], axis=1).max())


def _is_retraced(motion: Take) -> bool:
    points = _points(motion)
    along = arc_length(points)
    at = np.linspace(0.0, along[-1], _SAMPLES)
    places = np.stack([np.interp(at, along, column) for column in points.T], axis=1)
    apart = np.abs(at[:, None] - at[None]) > APART * along[-1]
    near = (cdist(places, places) < NEAR * along[-1]) & apart
    return bool(np.mean(near.any(axis=1)) > RETRACED)
