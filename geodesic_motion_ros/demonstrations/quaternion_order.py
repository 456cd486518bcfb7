"""The place of the scalar among a quaternion's four numbers: what a recording shows of it, and what it cannot.

Quaternions in the order (x, y, z, w), as ROS messages have them, are of unit length and as smooth as those in the order
(w, x, y, z): read in the wrong order they are other rotations, at the same angles from one another. Length, continuity
and speed say nothing. What differs is how the tool points in the world: tools of arms point down more often than up,
and tools that are level or point up in one order but down in the other were likely read in the wrong one.

That is a guess, so it only asks. Measured on four real tasks of a Panda and two simulated ones, each as from 60
mountings of base and tool: it asks of 57 to 70 % of the files in the wrong order, the others look as plausible in both
(a tool that points straight down does so in both orders at some headings), of none in the right order whose tool points
down, and of 8 to 23 % of those in the right order whose tool is level throughout.
"""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.demonstrations.demonstrations import Demonstrations

#: Share of straight down, over a whole recording, above which a tool points down, and below which it does not.
DOWN, NOT_DOWN = 0.45, 0.25


def share_down(quaternions: np.ndarray) -> np.ndarray:
    """Measure how far a tool of quaternions (..., 4) points its z axis down, (...): 1 straight down, -1 straight up."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    return x**2 + y**2 - w**2 - z**2


def mean_tilts(demonstrations: Demonstrations) -> tuple[float, float]:
    """Measure the mean angle [deg] of the tool's z axis from straight down where demonstrations begin, and end."""
    ends = np.array([[item.quaternions[0], item.quaternions[-1]] for item in demonstrations])
    first, last = np.degrees(np.arccos(np.clip(share_down(ends), -1.0, 1.0))).mean(axis=0)
    return float(first), float(last)


def is_scalar_last(demonstrations: Demonstrations) -> bool:
    """Tell whether a tool that hardly points down, its quaternions read as (w, x, y, z), does as (x, y, z, w)."""
    read = np.concatenate([item.quaternions for item in demonstrations])
    down, otherwise = (float(share_down(order).mean()) for order in (read, np.roll(read, 1, axis=1)))
    return down < NOT_DOWN and otherwise > DOWN
