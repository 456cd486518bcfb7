"""LimitedTool: limits of an arm's tool, as the law of a joint path and the judge of a joint motion need them.

Along a path q(s) the tool has the velocity x'(s) and the acceleration x''(s) per s, and as much of angular velocity.
Passed at s' it moves at |x'| s' and accelerates along its tangent t with |x'| s'' + (t x'') s'^2 and across it with
|x'' - t (t x'')| s'^2: two more "joints" of a law within limits (`joint_time_law.py`), and two of the rotation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from geodesic_motion_ros.robot.kinematics import CHAIN, Robot, link_frames
from geodesic_motion_ros.trajectory.tool_limits import ToolLimits

#: Stands for a limit that is not there [m/s], [m/s^2], ...; finite: products with 0 stay 0.
_UNLIMITED = 1e9
#: Share of an acceleration that may be across the path; along it 0.6 are left at least.
_CENTRIPETAL_SHARE = 0.8
#: Motions slower than this have no tangent.
_NEGLIGIBLE = 1e-12
#: Largest speed that an acceleration of 1 adds while it fades as a quintic in a time of 1: 0.0651.
_FADING_SPEED = 0.066


@dataclass(frozen=True)
class LimitedTool:
    """The tool of a robot, with limits."""

    robot: Robot
    limits: ToolLimits

    @cached_property
    def speeds(self) -> np.ndarray:
        """Largest speed [m/s] and angular speed [rad/s] (2,); huge where there is no limit."""
        return _read_only(self.limits.speed, self.limits.angular_speed)

    @cached_property
    def accelerations(self) -> np.ndarray:
        """Largest acceleration [m/s^2] and angular acceleration [rad/s^2] (2,); huge where there is no limit."""
        return _read_only(self.limits.acceleration, self.limits.angular_acceleration)

    @cached_property
    def jerks(self) -> np.ndarray:
        """Largest jerks (2,): infinite."""
        return _read_only(math.inf, math.inf)

    def constraints(self, path: np.ndarray, speed_share: float, acceleration_share: float) -> np.ndarray:
        """First and second derivatives, largest speeds and accelerations (4, g, 4) of the "joints" of the tool.

        path : (3, g, eta) q, q', q''. The speeds and accelerations are shares of the limits.
        """
        motions = tool_motions(path, self.robot.chain)
        return _constraints(motions, speed_share * self.speeds, acceleration_share * self.accelerations)

    def mismatch(self, position: np.ndarray, mismatch: np.ndarray) -> np.ndarray:
        """Of the tool's position and orientation (3, 2), where the joints' one (3, eta) is small, at q (eta,)."""
        moved = mismatch @ self.robot.jacobian(position).T
        return np.linalg.norm(moved.reshape(3, 2, 3), axis=2)

    def limit_ratio(self, samples: np.ndarray, inherited: int, fading: float) -> np.ndarray:
        """Speeds and accelerations over their limits (2, n - 1) between knots, of the worse of both.

        Between a knot, the middle and the next knot they are taken as parabolas.

        Parameters
        ----------
        samples : (3, 2 n - 1, eta) joint positions, velocities and accelerations at knots and in the middle between.
        inherited : number of intervals in which the first knot's speeds and accelerations count as limits where they
            are larger: no motion can leave its initial state at once. fading : time [s] of these intervals.
        """
        norms = np.linalg.norm(tool_motions(samples, self.robot.chain), axis=2).reshape(2, 2, -1)
        return _limit_ratio(norms, np.stack([self.speeds, self.accelerations]), inherited, fading)


def _read_only(*limits: float) -> np.ndarray:
    values = np.array([limit or _UNLIMITED for limit in limits])
    values.setflags(write=False)
    return values


@numba.njit(cache=True, nogil=True)
def _add_cross(left: np.ndarray, right: np.ndarray, factor: float, out: np.ndarray) -> None:
    """Add factor * left x right to out (3,)."""
    out[0] += factor * (left[1] * right[2] - left[2] * right[1])
    out[1] += factor * (left[2] * right[0] - left[0] * right[2])
    out[2] += factor * (left[0] * right[1] - left[1] * right[0])


@numba.njit((numba.types.Array(numba.float64, 3, "C", readonly=True), CHAIN), cache=True, nogil=True)
def tool_motions(motion, chain):
    """Velocities, angular velocities, accelerations, angular accelerations (4, k, 3) of the tool in the base frame.

    motion : (3, k, n) joint positions and their first and second derivatives; with respect to any parameter.

    From link to link, over the arm r from one origin to the next, and the axis a of the joint there:
    v += w x r, v' += w' x r + w x (w x r); turning about a: w' += a q'' + w x a q', w += a q'; sliding along a:
    v += a q', v' += a q'' + 2 w x a q'.
    """
    axes, joint_index, prismatic = chain[2], chain[3], chain[4]
    result = np.zeros((4, motion.shape[1], 3))
    arm, moved, axis = np.empty(3), np.empty(3), np.empty(3)
    for k in range(motion.shape[1]):
        rotations, origins = link_frames(motion[0, k], chain)
        v, w, dv, dw = result[0, k], result[1, k], result[2, k], result[3, k]
        for link in range(len(joint_index)):
            for i in range(3):
                arm[i], moved[i] = origins[link + 1, i] - origins[link, i], 0.0
            _add_cross(w, arm, 1.0, moved)
            _add_cross(dw, arm, 1.0, dv)
            _add_cross(w, moved, 1.0, dv)
            for i in range(3):
                v[i] += moved[i]
            joint = joint_index[link]
            if joint < 0:
                continue
            rate, change = motion[1, k, joint], motion[2, k, joint]
            for i in range(3):
                axis[i] = 0.0
                for j in range(3):
                    axis[i] += rotations[link + 1, i, j] * axes[link, j]
            slides = prismatic[link]
            _add_cross(w, axis, 2.0 * rate if slides else rate, dv if slides else dw)
            for i in range(3):
                (dv if slides else dw)[i] += change * axis[i]
                (v if slides else w)[i] += rate * axis[i]
    return result


@numba.njit(cache=True, nogil=True)
def _constraints(motions: np.ndarray, speeds: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
    """As `LimitedTool.constraints`, of the tool's motions (4, g, 3) per s: along and across, moving and turning."""
    result = np.zeros((4, motions.shape[1], 4))
    for k in range(motions.shape[1]):
        for part in range(2):
            slope = bend = square = 0.0
            for i in range(3):
                slope += motions[part, k, i] ** 2
                bend += motions[part, k, i] * motions[2 + part, k, i]
                square += motions[2 + part, k, i] ** 2
            slope = math.sqrt(slope)
            bend = bend / slope if slope > _NEGLIGIBLE else 0.0
            across = math.sqrt(max(square - bend**2, 0.0))
            # What is left along the path is what the largest acceleration across it leaves of the norm.
            largest = _CENTRIPETAL_SHARE * accelerations[part]
            if slope > _NEGLIGIBLE:
                largest = min(largest, across * (speeds[part] / slope) ** 2)
            result[0, k, 2 * part], result[1, k, 2 * part], result[1, k, 2 * part + 1] = slope, bend, across
            result[2, k, 2 * part : 2 * part + 2] = speeds[part]
            result[3, k, 2 * part] = math.sqrt(accelerations[part] ** 2 - largest**2)
            result[3, k, 2 * part + 1] = _CENTRIPETAL_SHARE * accelerations[part]
    return result


@numba.njit(cache=True, nogil=True)
def _limit_ratio(norms: np.ndarray, limits: np.ndarray, inherited: int, fading: float) -> np.ndarray:
    """As `LimitedTool.limit_ratio`, of norms (2, 2, 2 n - 1): speeds and accelerations, moving and turning."""
    count = norms.shape[2] // 2
    result = np.zeros((2, count))
    for order in range(2):
        for part in range(2):
            first = norms[order, part, 0]
            if order == 0:
                first += _FADING_SPEED * fading * norms[1, part, 0]
            for i in range(count):
                limit = limits[order, part]
                if i < inherited and norms[order, part, 0] > limit:
                    limit = first
                largest = _parabola_maximum(norms[order, part, 2 * i : 2 * i + 3])
                result[order, i] = max(result[order, i], largest / limit)
    return result


@numba.njit(cache=True, nogil=True)
def _parabola_maximum(values: np.ndarray) -> float:
    """The largest value of the parabola through values (3,) at the begin, in the middle and at the end."""
    half, turn = 0.5 * (values[2] - values[0]), values[0] - 2.0 * values[1] + values[2]
    if abs(half) < -turn:
        return values[1] - 0.5 * half**2 / turn
    return max(values[0], values[2])
