"""LimitedTool: limits of an arm's tool, as the law of a joint path and the judge of a joint motion need them.

Along a path q(s) the tool has the velocity x'(s) and the acceleration x''(s) per s, and as much of angular velocity.
Passed at s' it moves at |x'| s' and accelerates along its tangent t with |x'| s'' + (t x'') s'^2 and across it with
|x'' - t (t x'')| s'^2: two more "joints" of a law within limits (`time_optimal.py`), and two of the rotation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from geodesic_motion_ros.robot.body_points import joint_terms, place_joints
from geodesic_motion_ros.robot.kinematics import CHAIN, Chain, Robot, unit
from geodesic_motion_ros.trajectory.tool_limits import ToolLimits

Vector = tuple[float, float, float]

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
    """Makes the limits of the tool's speed and acceleration constraints of a path of joint configurations."""

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

    @cached_property
    def _limits(self) -> np.ndarray:
        """`speeds` and `accelerations` (2, 2)."""
        return np.stack([self.speeds, self.accelerations])

    def constraints(self, path: np.ndarray, speed_share: float, acceleration_share: float) -> np.ndarray:
        """First and second derivatives, largest speeds and accelerations (4, g, 4) of the "joints" of the tool.

        path : (3, g, eta) q, q', q''. The speeds and accelerations are shares of the limits.
        """
        motions = tool_motions(path, self.robot.chain)
        return _constraints(motions, speed_share * self.speeds, acceleration_share * self.accelerations)

    def mismatch(self, position: np.ndarray, mismatch: np.ndarray) -> np.ndarray:
        """Of the tool's position and orientation (3, 2), where the joints' one (3, eta) is small, at q (eta,)."""
        moved = mismatch @ self.robot.jacobian(position).T
        return _norms(moved.reshape(3, 2, 3))

    def limit_ratio(self, samples: np.ndarray, inherited: int, fading: float) -> np.ndarray:
        """Speeds and accelerations over their limits (2, n - 1) between knots, of the worse of both.

        Between a knot, the middle and the next knot they are taken as parabolas.

        Parameters
        ----------
        samples : (3, 2 n - 1, eta) joint positions, velocities and accelerations at knots and in the middle between.
        inherited : number of intervals in which the first knot's speeds and accelerations count as limits where they
            are larger: no motion can leave its initial state at once. fading : time [s] of these intervals.
        """
        norms = _norms(tool_motions(samples, self.robot.chain)).reshape(2, 2, -1)
        return _limit_ratio(norms, self._limits, inherited, fading)


def _read_only(*limits: float) -> np.ndarray:
    values = np.array([limit or _UNLIMITED for limit in limits])
    values.setflags(write=False)
    return values


@numba.njit(cache=True, nogil=True)
def _plus(start: Vector, factor: float, step: Vector) -> Vector:
    """start + factor * step."""
    return start[0] + factor * step[0], start[1] + factor * step[1], start[2] + factor * step[2]


@numba.njit(cache=True, nogil=True)
def _cross(left: Vector, right: Vector) -> Vector:
    """left x right."""
    return (
        left[1] * right[2] - left[2] * right[1],
        left[2] * right[0] - left[0] * right[2],
        left[0] * right[1] - left[1] * right[0],
    )


@numba.njit(cache=True, nogil=True)
def _turned(rotation: np.ndarray, vector: np.ndarray) -> Vector:
    """A vector (3,) turned by a rotation (3, 3)."""
    x, y, z = vector[0], vector[1], vector[2]
    return (
        rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
    )


@numba.njit(cache=True, nogil=True)
def _between(origins: np.ndarray, joint: int) -> Vector:
    """The arm from the origin (3,) before a joint to that joint's."""
    return (
        origins[joint + 1, 0] - origins[joint, 0],
        origins[joint + 1, 1] - origins[joint, 1],
        origins[joint + 1, 2] - origins[joint, 2],
    )


@numba.njit((numba.types.Array(numba.float64, 3, "C", readonly=True), CHAIN), cache=True, nogil=True)
def tool_motions(motion: np.ndarray, chain: Chain) -> np.ndarray:
    """Velocities, angular velocities, accelerations, angular accelerations (4, k, 3) of the tool in the base frame.

    motion : (3, k, n) joint positions and their first and second derivatives; with respect to any parameter.

    From joint to joint, over the arm r from one origin to the next, and the axis a of the joint there:
    v += w x r, v' += w' x r + w x (w x r); turning about a: w' += a q'' + w x a q', w += a q'; sliding along a:
    v += a q', v' += a q'' + 2 w x a q'. The last arm leads to the tool.
    """
    axes, joint_index, prismatic = chain[2], chain[3], chain[4]
    terms, translations, slides, _, mount_origins, _ = joint_terms(chain)
    moving = np.flatnonzero(joint_index >= 0)
    rotations, origins = np.zeros((len(terms) + 1, 3, 3)), np.zeros((len(terms) + 1, 3))
    unit(rotations[0])
    result = np.empty((4, motion.shape[1], 3))
    for k in range(motion.shape[1]):
        place_joints(motion[0, k], terms, translations, slides, rotations, origins)
        v = w = dv = dw = (0.0, 0.0, 0.0)
        for joint in range(len(terms) + 1):
            beyond = joint == len(terms)
            arm = _turned(rotations[joint], mount_origins[-1]) if beyond else _between(origins, joint)
            moved = _cross(w, arm)
            v = _plus(v, 1.0, moved)
            dv = _plus(_plus(dv, 1.0, _cross(dw, arm)), 1.0, _cross(w, moved))
            if beyond:
                break
            rate, change = motion[1, k, joint], motion[2, k, joint]
            axis = _turned(rotations[joint + 1], axes[moving[joint]])
            if prismatic[moving[joint]]:
                dv = _plus(_plus(dv, change, axis), 2.0 * rate, _cross(w, axis))
                v = _plus(v, rate, axis)
            else:
                dw = _plus(_plus(dw, change, axis), rate, _cross(w, axis))
                w = _plus(w, rate, axis)
        for i in range(3):
            result[0, k, i], result[1, k, i], result[2, k, i], result[3, k, i] = v[i], w[i], dv[i], dw[i]
    return result


@numba.njit(cache=True, nogil=True)
def _norms(vectors: np.ndarray) -> np.ndarray:
    """Norms (m, k) of vectors (m, k, 3)."""
    result = np.empty(vectors.shape[:2])
    for i in range(vectors.shape[0]):
        for k in range(vectors.shape[1]):
            result[i, k] = math.sqrt(vectors[i, k, 0] ** 2 + vectors[i, k, 1] ** 2 + vectors[i, k, 2] ** 2)
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
