"""Inverse kinematics by damped least squares: a velocity step for streams, and a solution for single poses.

The step solves, for the pose error e and a feed-forward twist v (both linear then angular, base frame),

    dq = J^+ (gain e + v) + (I - J^+ J) posture_gain (posture - q),    J^+ = J^T (J J^T + d^2 I)^-1.

The damping d of a step is that of Nakamura and Hanafusa (1986), d = d_0 (1 - w / w_0) where the
manipulability w = sqrt(det J J^T) falls below w_0; that of the solution is Sugihara's (2011),
d^2 = |e|^2 / 2. A joint that would leave its limits is stopped there and the others are solved again without
it, so that they take over its share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.robot.kinematics import CHAIN, MATRIX, VECTOR, Robot, contiguous, forward, jacobian
from geodesic_motion_ros.utils.checked_numbers import real_array
from geodesic_motion_ros.utils.errors import RobotError

DAMPING = 0.1
LOW_MANIPULABILITY = 0.02
SMALLEST_DAMPING = 1e-4


@dataclass(frozen=True)
class Tolerance:
    """How near to the requested pose inverse kinematics must bring the tool: position [m] and angle [rad]."""

    position: float = 1e-5
    angle: float = 1e-4


def pose_error(
    position: np.ndarray, quaternion: np.ndarray, target_position: np.ndarray, target_quaternion: np.ndarray
) -> np.ndarray:
    """Error (6,) from a pose to a target, base frame: position [m], shortest rotation vector [rad]."""
    return pose_difference(
        contiguous(position),
        contiguous(quaternion),
        contiguous(target_position),
        contiguous(target_quaternion),
    )


def differential_step(
    robot: Robot,
    joint_positions: np.ndarray,
    position: np.ndarray,
    quaternion: np.ndarray,
    dt: float,
    *,
    gain: float = 20.0,
    feed_forward: np.ndarray | None = None,
    posture: np.ndarray | None = None,
    posture_gain: float = 1.0,
) -> np.ndarray:
    """Joint velocities (n,) [rad/s] towards a target pose, inside position and velocity limits after `dt`.

    Parameters
    ----------
    joint_positions : (n,) where the arm is now [rad], inside its limits.
    position, quaternion : target (3,) [m] and (4,) unit, scalar first, base frame.
    dt : length of the step [s].
    gain : how fast the error is to vanish [1/s].
    feed_forward : (6,) velocity of the target itself [m/s, rad/s].
    posture : (n,) joint positions to which the null space is drawn; default `robot.ready`.
    posture_gain : how fast it is drawn there [1/s].

    Notes
    -----
    Velocities above a limit are scaled down together, which keeps the tool's direction of motion.
    """
    q = contiguous(joint_positions)
    reached_position, reached_quaternion = forward(q, robot.chain)
    twist = gain * pose_error(reached_position, reached_quaternion, position, quaternion)
    if feed_forward is not None:
        twist = twist + feed_forward
    return twist_step(robot, q, twist, dt, posture=posture, posture_gain=posture_gain)


def twist_step(
    robot: Robot,
    joint_positions: np.ndarray,
    twist: np.ndarray,
    dt: float,
    *,
    posture: np.ndarray | None = None,
    posture_gain: float = 1.0,
) -> np.ndarray:
    """Joint velocities (n,) [rad/s] that move the tool with a twist (6,); see `differential_step`."""
    q = contiguous(joint_positions)
    drift = posture_gain * ((robot.ready if posture is None else posture) - q)
    step = _joint_step(q, contiguous(twist * dt), drift * dt, -1.0, robot.lower, robot.upper, robot.chain)
    velocities = step / dt
    return velocities / max(1.0, float(np.max(np.abs(velocities) / robot.velocity_limits)))


def solve(
    robot: Robot,
    position: np.ndarray,
    quaternion: np.ndarray,
    start: np.ndarray | None = None,
    *,
    tolerance: Tolerance = Tolerance(),
    attempts: int = 50,
    seed: int = 0,
) -> np.ndarray:
    """Joint positions (n,) [rad] inside the limits whose tool pose is the given one.

    Parameters
    ----------
    position, quaternion : target (3,) [m] and (4,) unit, scalar first, base frame.
    start : (n,) first guess and preferred posture; default `robot.ready`.
    attempts, seed : number of first guesses; after `start` and `robot.ready` they are random, from this seed.

    Raises
    ------
    RobotError : the target is not finite, beyond reach, or no attempt came within the tolerance.
    """
    position, quaternion = checked_pose(position, quaternion)
    if not robot.within_reach(position):
        distance = np.linalg.norm(position - robot.shoulder)
        raise RobotError(
            f"position {np.round(position, 3).tolist()} m is {distance:.3f} m from the shoulder: "
            f"the tool '{robot.tool_link}' reaches {robot.reach:.3f} m"
        )
    preferred = robot.ready if start is None else robot.checked(start)
    random = robot.sample(max(attempts - 2, 0), np.random.default_rng(seed))
    best, best_error = preferred, np.full(6, np.inf)
    for guess in (preferred, robot.ready, *random):
        found, error = _iterate(
            guess, preferred, position, quaternion, robot.lower, robot.upper, robot.chain,
            tolerance.position, tolerance.angle,
        )  # fmt: skip
        if np.linalg.norm(error[:3]) <= tolerance.position and np.linalg.norm(error[3:]) <= tolerance.angle:
            return found
        if np.linalg.norm(error) < np.linalg.norm(best_error):
            best, best_error = found, error
    raise RobotError(
        f"no joint positions within the limits reach position {np.round(position, 3).tolist()} m, "
        f"quaternion {np.round(quaternion, 3).tolist()}: the best of {attempts} attempts, "
        f"{np.round(best, 3).tolist()} rad, is {1e3 * np.linalg.norm(best_error[:3]):.1f} mm "
        f"and {np.degrees(np.linalg.norm(best_error[3:])):.1f} deg away"
    )


def checked_pose(position: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A pose as float64 copies (3,), (4,), the quaternion normalised.

    Raises
    ------
    RobotError : wrong shape, not finite, or a quaternion whose length is not near one.
    """
    position = real_array("target position", position, (3,), RobotError)
    quaternion = real_array("target quaternion", quaternion, (4,), RobotError)
    if not np.all(np.isfinite(position)):
        raise RobotError(f"target position is {position.tolist()}: expected three finite numbers in metres")
    length = np.linalg.norm(quaternion)
    if not abs(length - 1.0) < 1e-2:
        raise RobotError(f"target quaternion is {quaternion.tolist()}: expected a unit quaternion (w, x, y, z)")
    return position, quaternion / length


@numba.njit(cache=True, nogil=True)
def _length(vector, begin):
    """Of three entries of a vector."""
    return np.sqrt(vector[begin] ** 2 + vector[begin + 1] ** 2 + vector[begin + 2] ** 2)


@numba.njit((VECTOR, VECTOR, VECTOR, VECTOR), cache=True, nogil=True)
def pose_difference(position, quaternion, target_position, target_quaternion):
    w, x, y, z = target_quaternion[0], target_quaternion[1], target_quaternion[2], target_quaternion[3]
    a, b, c, d = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    # target * conjugate(present): the rotation that is left, in the base frame
    scalar = w * a + x * b + y * c + z * d
    error = np.empty(6)
    error[3] = -w * b + x * a - y * d + z * c
    error[4] = -w * c + x * d + y * a - z * b
    error[5] = -w * d - x * c + y * b + z * a
    length = _length(error, 3)
    factor = 2.0 * np.arctan2(length, abs(scalar)) / length if length > 1e-12 else 2.0
    for i in range(3):
        error[i] = target_position[i] - position[i]
        error[3 + i] *= -factor if scalar < 0.0 else factor
    return error


@numba.njit(cache=True, nogil=True)
def _write_factor(matrix, damping, factor):
    """Write the Cholesky factor L, L L^T = matrix + damping I, to the lower triangle of a matrix (6, 6)."""
    for i in range(6):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            if i == j:
                # rounding can push what is damped to almost nothing below zero
                factor[i, i] = np.sqrt(max(value + damping, 1e-14))
            else:
                factor[i, j] = value / factor[j, j]


@numba.njit(cache=True, nogil=True)
def _solve_factored(factor, x):
    """Solve L L^T x = right in place, from the right side (6,)."""
    for i in range(6):
        value = x[i]
        for k in range(i):
            value -= factor[i, k] * x[k]
        x[i] = value / factor[i, i]
    for i in range(5, -1, -1):
        value = x[i]
        for k in range(i + 1, 6):
            value -= factor[k, i] * x[k]
        x[i] = value / factor[i, i]


@numba.njit(cache=True, nogil=True)
def write_damped_factor(matrix, free, damping, gram, factor):
    """Write the Cholesky factor of the free joints' damped J J^T to the lower triangle of a matrix (6, 6).

    gram (6, 6) : room to work in. A negative damping is chosen by how near the arm is to a singular posture.
    """
    for i in range(6):
        for j in range(i + 1):
            product = 0.0
            for joint in range(len(free)):
                product += matrix[i, joint] * free[joint] * matrix[j, joint]
            gram[i, j] = product
    _write_factor(gram, SMALLEST_DAMPING**2 + max(damping, 0.0), factor)
    if damping < 0.0:
        manipulability = 1.0
        for i in range(6):
            manipulability *= factor[i, i]
        if manipulability < LOW_MANIPULABILITY:
            shortage = 1.0 - manipulability / LOW_MANIPULABILITY
            _write_factor(gram, SMALLEST_DAMPING**2 + (DAMPING * shortage) ** 2, factor)


@numba.njit(cache=True, nogil=True)
def write_factored_step(matrix, free, factor, task, drift, pull, step):
    """Write `damped_step` to a step (eta,), by the factor of `write_damped_factor`. pull (6,) : room to work in."""
    for i in range(6):
        left = task[i]
        for joint in range(len(free)):
            left -= matrix[i, joint] * free[joint] * drift[joint]
        pull[i] = left
    _solve_factored(factor, pull)
    for joint in range(len(free)):
        moved = drift[joint]
        for i in range(6):
            moved += matrix[i, joint] * pull[i]
        step[joint] = moved * free[joint]


@numba.njit((MATRIX, VECTOR, VECTOR, VECTOR, numba.float64), cache=True, nogil=True)
def damped_step(matrix, free, task, drift, damping):
    """Damped least-squares step of the free joints for a displacement (6,), with drift in the null space."""
    factor, step = np.empty((6, 6)), np.empty(len(free))
    write_damped_factor(matrix, free, damping, np.empty((6, 6)), factor)
    write_factored_step(matrix, free, factor, task, drift, np.empty(6), step)
    return step


@numba.njit((VECTOR, VECTOR, VECTOR, numba.float64, VECTOR, VECTOR, CHAIN), cache=True, nogil=True)
def _joint_step(q, task, drift, damping, lower, upper, chain):
    """Step dq (n,) for a displacement (6,) with q + dq in [lower, upper]; damping < 0: by manipulability."""
    count = len(q)
    matrix = jacobian(q, chain)
    free, step, rest = np.empty(count), np.zeros(count), np.empty(6)
    for i in range(count):
        free[i] = 1.0
    for _ in range(count):
        for row in range(6):
            rest[row] = task[row]
            for i in range(count):
                rest[row] -= matrix[row, i] * step[i] * (1.0 - free[i])
        moved = damped_step(matrix, free, rest, drift, damping)
        for i in range(count):
            step[i] = step[i] * (1.0 - free[i]) + moved[i]
        worst, excess = -1, 1e-12
        for i in range(count):
            over = max(q[i] + step[i] - upper[i], lower[i] - q[i] - step[i])
            if free[i] > 0.0 and over > excess:
                worst, excess = i, over
        if worst < 0:
            break
        free[worst] = 0.0
        step[worst] = (upper[worst] if step[worst] > 0.0 else lower[worst]) - q[worst]
    for i in range(count):
        step[i] = min(max(q[i] + step[i], lower[i]), upper[i]) - q[i]
    return step


@numba.njit((*(VECTOR,) * 6, CHAIN, numba.float64, numba.float64), cache=True, nogil=True)
def _iterate(start, posture, position, quaternion, lower, upper, chain, position_tolerance, angle_tolerance):
    """Damped least-squares iteration, whose pull to the posture fades so that the pose can settle."""
    q = start.copy()
    error, task, pull = np.empty(6), np.empty(6), np.empty(len(q))
    for iteration in range(150):
        reached_position, reached_quaternion = forward(q, chain)
        error = pose_difference(reached_position, reached_quaternion, position, quaternion)
        distance, angle = _length(error, 0), _length(error, 3)
        if distance <= position_tolerance and angle <= angle_tolerance and iteration >= 30:
            break
        # steps of at most 0.1 m and 0.3 rad, where the linearisation can be trusted
        shrink = min(1.0, 0.1 / (distance + 1e-12), 0.3 / (angle + 1e-12))
        for i in range(6):
            task[i] = shrink * error[i]
        for i in range(len(q)):
            pull[i] = 0.1 * 0.93**iteration * (posture[i] - q[i])
        step = _joint_step(q, task, pull, 0.5 * (distance**2 + angle**2), lower, upper, chain)
        for i in range(len(q)):
            q[i] += step[i]
    return q, error
