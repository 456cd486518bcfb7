"""The posture in which an arm holds a path of tool poses, and every pose near that path.

Along the base path of a query the configuration q^(tau) follows from the one in which the arm stands, by steps of least
norm: along a path the posture changes no more than the poses ask for. n(tau) is the unit null vector of the tool's
Jacobian at q^(tau), with a continuous sign. Any other pose at progress tau is reached by the q that solves

    FK(q) = pose,      n(tau) . (q - q^(tau)) = 0,

seven equations for seven joints, by Newton's method from the configuration of a neighbour. With six joints there is no
null vector, and the first six equations are all. A last joint, or a swivel angle, in the place of the second equation
would jump where the arm passes a posture in which it tells nothing. An arm of fewer than six joints cannot turn its
tool as it likes: it is brought to the position, and turned as near to the orientation as it can be there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.contract.settings import SWIVELLED_AT
from geodesic_motion_ros.contract.status import Refusal, VerdictCode
from geodesic_motion_ros.robot.inverse_kinematics import pose_difference
from geodesic_motion_ros.robot.kinematics import (
    Chain,
    Robot,
    base_frames,
    contiguous,
    jacobian,
    quaternion_of,
    write_jacobian,
    write_link_frames,
)
from geodesic_motion_ros.trajectory.trajectory import interpolated

#: Newton's method ends where the pose is this near [m, rad].
_TOLERANCE = 1e-6
#: After a step in which no joint turned farther than this [rad] it is: what is left is less than the step's square
#: times the arm's length [m].
_LAST_STEP = 3e-4
#: It takes at most this many steps.
_STEPS = 8
#: In one of them no joint turns farther than this [rad]: the linearisation holds no farther.
_LARGEST_STEP = 0.6
#: With fewer than six joints it ends where besides no joint turned farther than this in the last step [rad].
_SETTLED = 1e-3
#: What a turn of a joint counts there beside that of the tool, and what is left of a position that cannot be reached.
_DAMPING, _SOFTNESS = 1e-4, 1e-8
#: The solution at a node is tried from at most this many of its neighbours.
_MOST_TRIES = 3


@dataclass(frozen=True)
class Posture:
    """The configurations with which an arm of eta joints holds the base path, as a function of progress.

    Attributes
    ----------
    progress : (m,) tau of the samples, not decreasing. configurations : (m, eta) q^ [rad].
    nulls : (m, eta) n, zeros for an arm of six joints or fewer.
    """

    progress: np.ndarray
    configurations: np.ndarray
    nulls: np.ndarray

    def at(self, progress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return q^ and n, (k, eta) each, at progress (k,)."""
        configurations, nulls = (
            interpolated(progress, self.progress, table) for table in (self.configurations, self.nulls)
        )
        lengths = np.linalg.norm(nulls, axis=1, keepdims=True)
        return configurations, nulls / np.where(lengths > 0.0, lengths, 1.0)


@dataclass(frozen=True)
class SolvedPath:
    """Configurations (m, eta) that hold a path of poses.

    Attributes
    ----------
    nulls : (m, eta) unit null vectors of the tool's Jacobian there; zeros for six joints or fewer.
    reached : (m,) whether the pose is reached, within the limits of the joints; the position, with fewer than six.
    """

    configurations: np.ndarray
    nulls: np.ndarray
    reached: np.ndarray

    def refusal(self, robot: Robot, name: str = "the path") -> Refusal | None:
        """Return where and why the arm cannot hold the path; None where it can."""
        if np.all(self.reached):
            return None
        missed = np.flatnonzero(~self.reached)
        share = 100.0 / max(1, len(self.reached) - 1)
        first, last = missed[0], missed[-1]
        place = f"from {first * share:.0f} to {last * share:.0f} %" if last > first else f"at {first * share:.0f} %"
        beyond = np.maximum(robot.lower - self.configurations[missed], self.configurations[missed] - robot.upper)
        joint = int(np.argmax(np.max(beyond, axis=0)))
        reason = "it does not reach the poses, or is stretched out"
        if np.max(beyond) > 0.0:
            reason = f"limit of joint '{robot.joint_names[joint]}', by {np.max(beyond):.2f} rad"
        return Refusal(VerdictCode.NO_FEASIBLE_PATH, f"the arm cannot hold {name} {place}: {reason}")


def swivel_steps(angle: float, samples: int) -> np.ndarray:
    """Return steps (samples,) [rad] along the null vectors by which an arm that sets out swivels by an angle."""
    share = np.clip(np.linspace(0.0, 1.0, samples) / SWIVELLED_AT, 0.0, 1.0)
    turned = angle * share**2 * (3.0 - 2.0 * share)
    return np.diff(turned, prepend=0.0)


def solve_path(
    robot: Robot, positions: np.ndarray, quaternions: np.ndarray, start: np.ndarray, swivels: np.ndarray | None = None
) -> SolvedPath:
    """Hold poses (m, 3) [m], (m, 4), one near the other, from a configuration (eta,) [rad] by steps of least norm.

    swivels : (m,) [rad] the steps along the null vector besides; None: none.
    """
    steps = np.zeros(len(positions)) if swivels is None else contiguous(swivels)
    found = _solve_path(
        contiguous(positions), contiguous(quaternions), contiguous(start), steps, robot.lower, robot.upper, robot.chain
    )  # fmt: skip
    return SolvedPath(*found)


def solve_beside(
    robot: Robot, positions: np.ndarray, quaternions: np.ndarray, near: np.ndarray, posture: Posture, tau: np.ndarray
) -> SolvedPath:
    """Hold poses (m, 3), (m, 4), one near the other, at progress tau (m,), as a posture says; the first one from a
    configuration near it (eta,).
    """
    configurations, nulls = posture.at(tau)
    found, reached = _solve_beside(
        contiguous(positions), contiguous(quaternions), contiguous(near), configurations, nulls, robot.lower,
        robot.upper, robot.chain,
    )  # fmt: skip
    return SolvedPath(found, nulls, reached)


def solve_nodes(
    robot: Robot,
    positions: np.ndarray,
    quaternions: np.ndarray,
    posture: Posture,
    tau: np.ndarray,
    seeds: np.ndarray,
    first: np.ndarray,
    neighbour: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return configurations (n, eta) of a graph's nodes, and which of them (n,) hold their pose within the joints'
    limits.

    Each follows from a neighbour's, along a spanning tree that grows breadth first from the seeds (s,): nodes on the
    base path, which follow from the posture. Nodes that are not reached have the posture's own configuration.

    Parameters
    ----------
    positions, quaternions : (n, 3) [m], (n, 4) the nodes' poses; tau : (n,) their progress.
    first, neighbour : of the graph's `Adjacency`.
    """
    configurations, nulls = posture.at(tau)
    return _solve_nodes(
        contiguous(positions), contiguous(quaternions), configurations, nulls, np.asarray(seeds, dtype=np.int64),
        first, neighbour, robot.lower, robot.upper, robot.chain,
    )  # fmt: skip


@numba.njit(cache=True, nogil=True)
def lost_edges(edges: np.ndarray, configurations: np.ndarray, reached: np.ndarray, largest_step: float) -> np.ndarray:
    """Mask (m,) of the edges (m, 2) that the arm cannot follow: between nodes of which one is not reached, or whose
    configurations (n, eta) differ in a joint by more than a largest step [rad]. reached : (n,).
    """
    lost = np.zeros(len(edges), dtype=np.bool_)
    for e in range(len(edges)):
        u, v = edges[e, 0], edges[e, 1]
        lost[e] = not (reached[u] and reached[v])
        for j in range(configurations.shape[1]):
            lost[e] |= abs(configurations[u, j] - configurations[v, j]) > largest_step
    return lost


@numba.njit(cache=True, nogil=True)
def _pivot(matrix: np.ndarray, k: int) -> int:
    """The row from k on whose entry in column k is the largest by its amount."""
    pivot = k
    for i in range(k + 1, len(matrix)):
        if abs(matrix[i, k]) > abs(matrix[pivot, k]):
            pivot = i
    return pivot


@numba.njit(cache=True, nogil=True)
def _solve(matrix: np.ndarray, right: np.ndarray) -> bool:
    """Solve a square system in place by Gauss's elimination with pivots; False where it is singular."""
    count = len(right)
    for k in range(count):
        pivot = _pivot(matrix, k)
        if abs(matrix[pivot, k]) < 1e-9:
            return False
        if pivot != k:
            for j in range(k, count):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
            right[k], right[pivot] = right[pivot], right[k]
        for i in range(k + 1, count):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k + 1, count):
                matrix[i, j] -= factor * matrix[k, j]
            right[i] -= factor * right[k]
    for i in range(count - 1, -1, -1):
        for j in range(i + 1, count):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]
    return True


@numba.njit(cache=True, nogil=True)
def solve_displaced(
    position: np.ndarray,
    quaternion: np.ndarray,
    null: np.ndarray,
    posture: np.ndarray,
    offset: float,
    q: np.ndarray,
    chain: Chain,
) -> bool:
    """Solve FK(q) = pose, null . (q - posture) = offset from q (eta,), in place; whether it was found.

    For use within compiled loops: position (3,), quaternion (4,), null and posture (eta,), chain of `Robot`.
    """
    joints = len(q)
    if joints < 6:
        return _solve_with_fewer(position, quaternion, q, chain)
    matrix, right = np.empty((joints, joints)), np.empty(joints)
    rotations, origins = base_frames(chain)
    for _ in range(_STEPS):
        write_link_frames(q, chain, rotations, origins)
        error = pose_difference(origins[-1], quaternion_of(rotations[-1]), position, quaternion)
        rest = offset
        for j in range(joints):
            rest -= null[j] * (q[j] - posture[j])
        largest = abs(rest) if joints > 6 else 0.0
        for i in range(6):
            largest = max(largest, abs(error[i]))
        if largest < _TOLERANCE:
            return True
        matrix[:] = 0.0
        write_jacobian(rotations, origins, chain, matrix)
        right[:6] = error
        if joints > 6:
            matrix[6], right[6] = null, rest
        if not _solve(matrix, right):
            return False
        turned = 0.0
        for j in range(joints):
            turned = max(turned, abs(right[j]))
            q[j] += right[j]
        if not turned <= _LARGEST_STEP:
            return False
        if turned <= _LAST_STEP:
            return True
    return False


@numba.njit(cache=True, nogil=True)
def _solve_with_fewer(position: np.ndarray, quaternion: np.ndarray, q: np.ndarray, chain: Chain) -> bool:
    """Bring the tool of an arm of fewer than six joints to a position, turned as near to a quaternion as it can be
    there, from q (eta,), in place; whether it got to the position.

    Steps of Gauss and Newton: J_r^T (J_r dq - e_r) + J_p^T m = 0 and J_p dq = e_p, with multipliers m.
    """
    joints = len(q)
    matrix, right, slopes = np.empty((joints + 3, joints + 3)), np.empty(joints + 3), np.empty((6, joints))
    rotations, origins = base_frames(chain)
    turned = np.inf
    for _ in range(_STEPS):
        write_link_frames(q, chain, rotations, origins)
        error = pose_difference(origins[-1], quaternion_of(rotations[-1]), position, quaternion)
        off = max(abs(error[0]), abs(error[1]), abs(error[2]))
        if off < _TOLERANCE and turned < _SETTLED:
            return True
        slopes[:], matrix[:], right[:] = 0.0, 0.0, 0.0
        write_jacobian(rotations, origins, chain, slopes)
        for i in range(joints):
            matrix[i, i] = _DAMPING
            for axis in range(3):
                right[i] += slopes[3 + axis, i] * error[3 + axis]
                matrix[joints + axis, i] = matrix[i, joints + axis] = slopes[axis, i]
                for j in range(joints):
                    matrix[i, j] += slopes[3 + axis, i] * slopes[3 + axis, j]
        for axis in range(3):
            matrix[joints + axis, joints + axis], right[joints + axis] = -_SOFTNESS, error[axis]
        if not _solve(matrix, right):
            return False
        turned = 0.0
        for j in range(joints):
            turned = max(turned, abs(right[j]))
            q[j] += right[j]
        if not turned <= _LARGEST_STEP:
            return False
    return False


@numba.njit(cache=True, nogil=True)
def _null_vector(q: np.ndarray, before: np.ndarray, chain: Chain) -> np.ndarray:
    """Unit null vector (7,) of the tool's Jacobian at q on the side of an earlier one; zeros for six joints or
    fewer.

    It is the solution of J n = 0, m . n = 1, scaled to length 1, with m the earlier one, or where there is none that of
    the unit vectors which lies nearest to the null space.
    """
    joints = len(q)
    null = np.zeros(joints)
    if joints < 7:
        return null
    slopes = jacobian(q, chain)
    matrix, right = np.empty((joints, joints)), np.empty(joints)
    best = 0.0
    for choice in range(0 if not np.any(before) else -1, joints):
        matrix[:6], right[:6], right[6] = slopes, 0.0, 1.0
        matrix[6] = before
        if choice >= 0:
            matrix[6] = 0.0
            matrix[6, choice] = 1.0
        if not _solve(matrix, right):
            continue
        length = np.sqrt(np.sum(right * right))
        if choice == -1:
            return right / length
        # 1 / length is the cosine between m and the null vector.
        if 1.0 / length > best:
            best, null = 1.0 / length, right / length
    return null


@numba.njit(cache=True, nogil=True)
def null_vectors(configurations: np.ndarray, chain: Chain) -> np.ndarray:
    """Return unit null vectors (n, eta) of the tool's Jacobian along a path (n, eta), each on the side of the one
    before.
    """
    result = np.zeros(configurations.shape)
    null = np.zeros(configurations.shape[1])
    for i in range(len(configurations)):
        null = _null_vector(configurations[i], null, chain)
        result[i] = null
    return result


@numba.njit(cache=True, nogil=True)
def _inside(q: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> bool:
    return bool(np.all(q >= lower) and np.all(q <= upper))


@numba.njit(cache=True, nogil=True)
def _solve_path(
    positions: np.ndarray,
    quaternions: np.ndarray,
    start: np.ndarray,
    steps: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    chain: Chain,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count, joints = len(positions), len(start)
    found, nulls, reached = np.empty((count, joints)), np.zeros((count, joints)), np.zeros(count, dtype=np.bool_)
    q = start.copy()
    null = _null_vector(q, np.zeros(joints), chain)
    for i in range(count):
        before = q.copy()
        solved = solve_displaced(positions[i], quaternions[i], null, before, steps[i], q, chain)
        if not solved:
            q[:] = before
        reached[i] = solved and _inside(q, lower, upper)
        null = _null_vector(q, null, chain)
        found[i], nulls[i] = q, null
    return found, nulls, reached


@numba.njit(cache=True, nogil=True)
def _solve_beside(
    positions: np.ndarray,
    quaternions: np.ndarray,
    near: np.ndarray,
    postures: np.ndarray,
    nulls: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    chain: Chain,
) -> tuple[np.ndarray, np.ndarray]:
    count, joints = postures.shape
    found, reached = np.empty((count, joints)), np.zeros(count, dtype=np.bool_)
    q = near.copy()
    for i in range(count):
        before = q.copy()
        solved = solve_displaced(positions[i], quaternions[i], nulls[i], postures[i], 0.0, q, chain)
        if not solved:
            q[:] = before
        reached[i] = solved and _inside(q, lower, upper)
        found[i] = q
    return found, reached


@numba.njit(cache=True, nogil=True)
def _solve_nodes(
    positions: np.ndarray,
    quaternions: np.ndarray,
    postures: np.ndarray,
    nulls: np.ndarray,
    seeds: np.ndarray,
    first: np.ndarray,
    neighbour: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    chain: Chain,
) -> tuple[np.ndarray, np.ndarray]:
    count, joints = postures.shape
    found, reached = postures.copy(), np.zeros(count, dtype=np.bool_)
    tries = np.zeros(count, dtype=np.int64)
    queue, begin, end = np.empty(count, dtype=np.int64), 0, 0
    q = np.empty(joints)
    for seed in seeds:
        if reached[seed]:
            continue
        q[:] = postures[seed]
        if solve_displaced(positions[seed], quaternions[seed], nulls[seed], postures[seed], 0.0, q, chain):
            found[seed] = q
            reached[seed] = True
            queue[end] = seed
            end += 1
    while begin < end:
        parent = queue[begin]
        begin += 1
        for slot in range(first[parent], first[parent + 1]):
            node = neighbour[slot]
            if reached[node] or tries[node] == _MOST_TRIES:
                continue
            tries[node] += 1
            q[:] = found[parent]
            if solve_displaced(positions[node], quaternions[node], nulls[node], postures[node], 0.0, q, chain):
                found[node] = q
                reached[node] = True
                queue[end] = node
                end += 1
    for node in range(count):
        reached[node] = reached[node] and _inside(found[node], lower, upper)
    return found, reached
