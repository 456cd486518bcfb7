"""The certificate: the smallest clearance of a dense pose curve, between its samples too."""

from __future__ import annotations

import numpy as np

from geodesic_motion_ros.motion_curve import MotionCurve
from geodesic_motion_ros.obstacles import Obstacles
from geodesic_motion_ros.planning.path_clearance import rotation_allowance
from geodesic_motion_ros.swept_spheres import clearances_in_motion, clearances_until


def motion_clearances(
    points: np.ndarray,
    point_radii: np.ndarray,
    allowances: np.ndarray,
    times: np.ndarray,
    rates: np.ndarray,
    obstacles: Obstacles,
    prediction: float,
    beyond: bool = True,
) -> np.ndarray:
    """`curve_clearances` of a curve that is passed at `times` (n,) [s] among obstacles that move, (n - 1,) [m].

    Obstacles are where they are at time 0, move linearly for `prediction` [s] and then stand. Between two samples the
    square of the rate, `rates` (n,) at them, is linear in the curve's parameter: what is passed by then differs from
    what would be at a steady rate by no more than |r1 - r0| / (4 (r0 + r1)) of the segment.

    beyond : False: what moves is not counted after the prediction; until then the tool stands where it came to rest.
    """
    both = rates[1:] + rates[:-1]
    uneven = np.divide(np.abs(np.diff(rates)), 4.0 * both, out=np.zeros_like(both), where=both > 0.0)
    bulges = allowances + uneven[:, None] * np.linalg.norm(np.diff(points, axis=0), axis=2)
    # An interval without a length would have no velocity.
    times = times + 1e-9 * np.arange(len(times))
    every = np.arange(len(point_radii))
    clearances = clearances_in_motion if beyond else clearances_until
    clearance, _ = clearances(times, points, bulges, point_radii, every, obstacles, prediction)
    return clearance


def curve_allowance(curve: MotionCurve, points: np.ndarray) -> np.ndarray:
    """How far tool points (K, 3) leave the chords of a curve's n - 1 segments, (n - 1, K) [m].

    Segments bulge out by no more than `MotionCurve.bulges`; a rotation that is off by an angle moves a tool point at
    distance r by no more than r times that.
    """
    angles = np.linalg.norm(curve.chords[:, 3:], axis=1)
    shift, turn = curve.bulges()
    lever = np.linalg.norm(points, axis=1)
    return rotation_allowance(angles, points) + shift[:, None] + turn[:, None] * lever
