"""Points on the arm's body: where they are, how they move with the joints, and how far they can swing.

A body point p is fixed in the frame of one link of the chain. The column of its Jacobian that belongs to a revolute
joint of axis (o, a) is a x (p - o); that of a prismatic joint is a; that of a joint beyond the point is zero.

Symbols: n configurations of eta moving joints [rad; prismatic: m]; K points; positions in the base frame [m].
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba
import numpy as np

from geodesic_motion_ros.robot.kinematics import CHAIN, MATRIX, Robot, multiply, quaternion_of, unit
from geodesic_motion_ros.utils.errors import RobotError

INDICES = numba.types.Array(numba.int64, 1, "C", readonly=True)
#: Frames and offsets of points.
PLACES = numba.types.Tuple((INDICES, MATRIX))


@dataclass(frozen=True, eq=False)
class BodyPoints:
    """K points, each fixed in the frame of one link.

    Attributes
    ----------
    names : what each point is called.
    frames : (K,) int64, the point's link as a row of `Robot.link_names`.
    offsets : (K, 3) [m], where it is in that link's frame.
    """

    names: tuple[str, ...]
    frames: np.ndarray
    offsets: np.ndarray

    @classmethod
    def of(cls, robot: Robot, extra: Mapping[str, Sequence[Sequence[float]]] | None = None) -> BodyPoints:
        """The origins of the moving joints' frames, base first, then the tool, then points along links.

        Of several origins that coincide in every configuration, as those of two joints whose axes cross there, only
        the first is a point; one that coincides with the tool is left to the tool. They are named after the joints and
        the tool link; the points of `extra`, link -> (x, y, z) [m] in that link's frame, after their link and number.

        Raises
        ------
        RobotError : a link is not in the chain, or points are not finite triples.
        """
        tool = len(robot.link_names) - 1
        carriers = [_carrier(robot, tool)]
        names: list[str] = []
        frames: list[int] = []
        for name, row in zip(robot.joint_names, np.flatnonzero(robot.chain[3] >= 0), strict=True):
            carrier = _carrier(robot, int(row) + 1)
            if not any(carrier[0] == link and np.allclose(carrier[1], place, atol=1e-9) for link, place in carriers):
                names.append(name)
                frames.append(int(row) + 1)
                carriers.append(carrier)
        names.append(robot.tool_link)
        frames.append(tool)
        offsets = np.zeros((len(frames), 3))
        for link, points in (extra or {}).items():
            given = link_points(robot, link, points)
            names += [f"{link} {number}" for number in range(len(given))]
            frames += [robot.link_names.index(link)] * len(given)
            offsets = np.concatenate([offsets, given])
        return cls(tuple(names), np.array(frames, dtype=np.int64), offsets)

    def __len__(self) -> int:
        return len(self.names)


NO_POINTS = BodyPoints((), np.empty(0, dtype=np.int64), np.empty((0, 3)))


def link_points(robot: Robot, link: str, points: Sequence[Sequence[float]]) -> np.ndarray:
    """Points (K, 3) [m] in the frame of a link of the chain, checked.

    Raises
    ------
    RobotError : the link is not in the chain, or the points are not finite triples.
    """
    if link not in robot.link_names:
        raise RobotError(f"link '{link}' is not in the chain; it has {', '.join(robot.link_names)}")
    try:
        given = np.array(points, dtype=float)
    except (TypeError, ValueError) as error:
        raise RobotError(f"points of link '{link}' are no numbers: expected (x, y, z) triples in metres") from error
    if given.ndim != 2 or given.shape[1] != 3 or not np.all(np.isfinite(given)):
        raise RobotError(
            f"points of link '{link}' have shape {given.shape}: expected (K, 3), finite, in metres in the link's frame"
        )
    return given


def points_along_links(robot: Robot, spacing: float) -> dict[str, list[list[float]]]:
    """Evenly spaced points on links that are longer than `spacing` [m] from joint to joint, as `BodyPoints.of` takes.
    """
    found: dict[str, list[list[float]]] = {}
    for link, translation in zip(robot.link_names[1:-1], robot.chain[1][1:], strict=True):
        pieces = math.ceil(float(np.linalg.norm(translation)) / spacing)
        if pieces > 1:
            found[link] = [(number / pieces * translation).tolist() for number in range(1, pieces)]
    return found


def lever_bounds(robot: Robot, frames: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """How far points can be from the joints' axes in any configuration, (eta, K) [m]: bounds of |dp / dq_j|.

    Zero where a joint does not move a point, one for a prismatic joint that does. Revolute joints may turn without end
    here; prismatic ones stay in their limits.

    Balls whose convex hull holds the point are carried from the point's link down to the base. Turning a ball of centre
    c and radius r about an axis at distance d from c keeps it in the ball of radius d + r about the foot of c on that
    axis (exact where axes cross, as in a wrist or a shoulder), and d + r is its lever; a slide puts a ball at each of
    its ends.
    """
    rotations, translations, axes, joint_index, prismatic = robot.chain
    bounds = np.zeros((len(robot.joint_names), len(frames)))
    for point, (frame, offset) in enumerate(zip(frames, offsets, strict=True)):
        centres, radii = np.array(offset, dtype=float)[None], np.zeros(1)
        for k in range(int(frame) - 1, -1, -1):
            joint = joint_index[k]
            if joint >= 0 and prismatic[k]:
                ends = (robot.lower[joint] * axes[k], robot.upper[joint] * axes[k])
                centres, radii = np.concatenate([centres + end for end in ends]), np.tile(radii, 2)
                bounds[joint, point] = 1.0
            elif joint >= 0:
                feet = np.outer(centres @ axes[k], axes[k])
                centres, radii = feet, radii + np.linalg.norm(centres - feet, axis=1)
                bounds[joint, point] = np.max(radii)
            centres = centres @ rotations[k].T + translations[k]
    return bounds


def _carrier(robot: Robot, frame: int) -> tuple[int, np.ndarray]:
    """The link nearest to the base in which a link's origin is fixed, and where: joints do not move what is on their
    axis."""
    rotations, translations, axes, joint_index, prismatic = robot.chain
    place = np.zeros(3)
    while frame > 0:
        k = frame - 1
        if joint_index[k] >= 0 and (prismatic[k] or np.linalg.norm(np.cross(axes[k], place)) > 1e-9):
            break
        frame, place = k, rotations[k] @ place + translations[k]
    return frame, place


@numba.njit(cache=True, nogil=True, inline="always")
def _place_point(rotations, origins, frame, points, k, placed):
    """Write R_f p_k + o_f (3,) [m], a point k of points (K, 3) that is given in the frame f of some of them."""
    for row in range(3):
        placed[row] = origins[frame, row]
        for column in range(3):
            placed[row] += rotations[frame, row, column] * points[k, column]


@numba.njit(cache=True, nogil=True, inline="always")
def _write_rodrigues(axis, fixed, along, across, terms):
    """Write C = F a a^T, A = F - C, B = F [a]x as terms (3, 3, 3): C + cos q A + sin q B is F, a rotation (3, 3),
    followed by that about a unit axis a (3,) by q.

    along, across : (3, 3), for a a^T and [a]x; the diagonal of the latter is zero already.
    """
    x, y, z = axis[0], axis[1], axis[2]
    across[0, 1], across[0, 2], across[1, 2] = -z, y, -x
    across[1, 0], across[2, 0], across[2, 1] = z, -y, x
    for row in range(3):
        for column in range(3):
            along[row, column] = axis[row] * axis[column]
    multiply(fixed, along, terms[0])
    multiply(fixed, across, terms[2])
    for row in range(3):
        for column in range(3):
            terms[1, row, column] = fixed[row, column] - terms[0, row, column]


@numba.njit(cache=True, nogil=True)
def joint_terms(chain):
    """What the joints' frames are made of, per moving joint j.

    Returns terms (eta, 3, 3, 3), matrices C, A, B of the rotation C + cos q A + sin q B from the frame of joint j to
    that of joint j - 1: Rodrigues' formula behind all fixed rotations between the two; translations (eta, 3) between
    their origins; slides (eta, 3), the axes of prismatic joints in the frame of joint j - 1, zero for the others;
    mounts (m + 1, 3, 3) and mount origins (m + 1, 3), every link's frame in that of the last moving joint before it;
    and carriers (m + 1,), how many moving joints there are before it.
    """
    offset_rotations, offset_translations, axes, joint_index, prismatic = chain
    links = len(joint_index) + 1
    moving = 0
    for k in range(links - 1):
        if joint_index[k] >= 0:
            moving += 1
    terms = np.zeros((moving, 3, 3, 3))
    translations = np.zeros((moving, 3))
    slides = np.zeros((moving, 3))
    mounts = np.zeros((links, 3, 3))
    mount_origins = np.zeros((links, 3))
    carriers = np.zeros(links, dtype=np.int64)
    fixed, along, across = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 3))
    unit(mounts[0])
    joint = 0
    for k in range(links - 1):
        carriers[k + 1] = joint
        moves = joint_index[k] >= 0
        origin = translations[joint] if moves else mount_origins[k + 1]
        _place_point(mounts, mount_origins, k, offset_translations, k, origin)
        multiply(mounts[k], offset_rotations[k], fixed if moves else mounts[k + 1])
        if not moves:
            continue
        if prismatic[k]:
            for row in range(3):
                for column in range(3):
                    terms[joint, 0, row, column] = fixed[row, column]
                    slides[joint, row] += fixed[row, column] * axes[k, column]
        else:
            _write_rodrigues(axes[k], fixed, along, across, terms[joint])
        joint += 1
        unit(mounts[k + 1])
        carriers[k + 1] = joint
    return terms, translations, slides, mounts, mount_origins, carriers


@numba.njit(cache=True, nogil=True)
def place_joints(q, terms, translations, slides, rotations, origins):
    """Write rotations (eta + 1, 3, 3) and origins (eta + 1, 3) of the base and of the moving joints' frames."""
    # By indices: looking at a row of an array costs more than what is done with it.
    for joint in range(len(terms)):
        c, s = np.cos(q[joint]), np.sin(q[joint])
        for column in range(3):
            x = terms[joint, 0, 0, column] + c * terms[joint, 1, 0, column] + s * terms[joint, 2, 0, column]
            y = terms[joint, 0, 1, column] + c * terms[joint, 1, 1, column] + s * terms[joint, 2, 1, column]
            z = terms[joint, 0, 2, column] + c * terms[joint, 1, 2, column] + s * terms[joint, 2, 2, column]
            for row in range(3):
                rotations[joint + 1, row, column] = (
                    rotations[joint, row, 0] * x + rotations[joint, row, 1] * y + rotations[joint, row, 2] * z
                )
        x = translations[joint, 0] + q[joint] * slides[joint, 0]
        y = translations[joint, 1] + q[joint] * slides[joint, 1]
        z = translations[joint, 2] + q[joint] * slides[joint, 2]
        for row in range(3):
            moved = rotations[joint, row, 0] * x + rotations[joint, row, 1] * y + rotations[joint, row, 2] * z
            origins[joint + 1, row] = origins[joint, row] + moved


@numba.njit(cache=True, nogil=True)
def mounted(frames, offsets, mounts, mount_origins, carriers):
    """Number of joints (K,) that carry each point, and where it is (K, 3) in the frame of the last of them."""
    joints = np.empty(len(frames), dtype=np.int64)
    points = np.empty((len(frames), 3))
    for k in range(len(frames)):
        joints[k] = carriers[frames[k]]
        for row in range(3):
            points[k, row] = mount_origins[frames[k], row]
            for column in range(3):
                points[k, row] += mounts[frames[k], row, column] * offsets[k, column]
    return joints, points


@numba.njit(cache=True, nogil=True)
def _write_placed(joints, points, rotations, origins, placed):
    """Write the positions (K, 3) [m] of points that are `mounted` on joints which `place_joints` has placed."""
    for k in range(len(joints)):
        joint, x, y, z = joints[k], points[k, 0], points[k, 1], points[k, 2]
        for row in range(3):
            turned = rotations[joint, row, 0] * x + rotations[joint, row, 1] * y + rotations[joint, row, 2] * z
            placed[k, row] = origins[joint, row] + turned


@numba.njit((MATRIX, PLACES, PLACES, PLACES, CHAIN), cache=True, nogil=True)
def place_three_sets(configurations, first, second, third, chain):
    """`place_body_points` of three sets (frames, offsets) of points at once: to place the joints takes as long as to
    place the points.
    """
    terms, translations, slides, mounts, mount_origins, carriers = joint_terms(chain)
    joints_1, points_1 = mounted(first[0], first[1], mounts, mount_origins, carriers)
    joints_2, points_2 = mounted(second[0], second[1], mounts, mount_origins, carriers)
    joints_3, points_3 = mounted(third[0], third[1], mounts, mount_origins, carriers)
    rotations = np.zeros((len(terms) + 1, 3, 3))
    unit(rotations[0])
    origins = np.zeros((len(terms) + 1, 3))
    placed_1 = np.empty((len(configurations), len(joints_1), 3))
    placed_2 = np.empty((len(configurations), len(joints_2), 3))
    placed_3 = np.empty((len(configurations), len(joints_3), 3))
    for i in range(len(configurations)):
        place_joints(configurations[i], terms, translations, slides, rotations, origins)
        _write_placed(joints_1, points_1, rotations, origins, placed_1[i])
        _write_placed(joints_2, points_2, rotations, origins, placed_2[i])
        _write_placed(joints_3, points_3, rotations, origins, placed_3[i])
    return placed_1, placed_2, placed_3


@numba.njit((MATRIX, INDICES, MATRIX, CHAIN), cache=True, nogil=True)
def place_body_points(configurations, frames, offsets, chain):
    """Positions (n, K, 3) [m] in the base frame of the points of configurations (n, eta).

    frames (K,) and offsets (K, 3) [m] are those of `BodyPoints`, chain that of `Robot`.
    """
    none = frames[:0], offsets[:0]
    return place_three_sets(configurations, (frames, offsets), none, none, chain)[0]


@numba.njit((MATRIX, INDICES, MATRIX, CHAIN), cache=True, nogil=True)
def body_point_jacobians(configurations, frames, offsets, chain):
    """Jacobians (n, K, 3, eta) [m/rad; prismatic: m/m] of the points of configurations (n, eta), base frame.

    frames (K,) and offsets (K, 3) [m] are those of `BodyPoints`, chain that of `Robot`.
    """
    axes, joint_index, prismatic = chain[2], chain[3], chain[4]
    terms, translations, slides, mounts, mount_origins, carriers = joint_terms(chain)
    joints, points = mounted(frames, offsets, mounts, mount_origins, carriers)
    moving = np.flatnonzero(joint_index >= 0)
    rotations = np.zeros((len(terms) + 1, 3, 3))
    unit(rotations[0])
    origins = np.zeros((len(terms) + 1, 3))
    directions = np.empty((len(terms), 3))
    arm = np.empty(3)
    jacobians = np.zeros((len(configurations), len(frames), 3, len(terms)))
    for i in range(len(configurations)):
        place_joints(configurations[i], terms, translations, slides, rotations, origins)
        for joint in range(len(terms)):
            for row in range(3):
                directions[joint, row] = 0.0
                for column in range(3):
                    directions[joint, row] += rotations[joint + 1, row, column] * axes[moving[joint], column]
        for k in range(len(frames)):
            _place_point(rotations, origins, joints[k], points, k, arm)
            for joint in range(joints[k]):
                a = directions[joint]
                if prismatic[moving[joint]]:
                    for row in range(3):
                        jacobians[i, k, row, joint] = a[row]
                    continue
                x, y, z = arm[0] - origins[joint + 1, 0], arm[1] - origins[joint + 1, 1], arm[2] - origins[joint + 1, 2]
                jacobians[i, k, 0, joint] = a[1] * z - a[2] * y
                jacobians[i, k, 1, joint] = a[2] * x - a[0] * z
                jacobians[i, k, 2, joint] = a[0] * y - a[1] * x
    return jacobians


def tool_orientation_jacobians(configurations: np.ndarray, robot: Robot) -> np.ndarray:
    """J_q R (n, 9, eta) [1/rad] of the tool's unit quaternion at configurations (n, eta), up to a fixed isometry R.

    |J_q dtheta|^2 is a quarter of the squared turn |omega|^2, and the tips of a unit triad fixed to the tool move,
    beside its origin, by 2 |omega|^2 together: so these are the tips' Jacobians over sqrt(8).
    """
    triad = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    tool = np.full(4, len(robot.link_names) - 1)
    origin, tips = np.split(body_point_jacobians(configurations, tool, triad, robot.chain), [1], axis=1)
    return ((tips - origin) / math.sqrt(8.0)).reshape(len(configurations), 9, -1)


@numba.njit((MATRIX, CHAIN), cache=True, nogil=True)
def end_effector_poses(configurations, chain):
    """Tool positions (n, 3) [m] and unit quaternions (n, 4), scalar first, w >= 0, of configurations (n, eta).

    `kinematics.forward` for many; successive quaternions may differ in sign.
    """
    terms, translations, slides, mounts, mount_origins, _ = joint_terms(chain)
    rotations = np.zeros((len(terms) + 1, 3, 3))
    unit(rotations[0])
    origins = np.zeros((len(terms) + 1, 3))
    tool = np.empty((3, 3))
    positions = np.empty((len(configurations), 3))
    quaternions = np.empty((len(configurations), 4))
    for i in range(len(configurations)):
        place_joints(configurations[i], terms, translations, slides, rotations, origins)
        last = rotations[-1]
        for row in range(3):
            positions[i, row] = origins[-1, row]
            for column in range(3):
                positions[i, row] += last[row, column] * mount_origins[-1, column]
                tool[row, column] = 0.0
                for inner in range(3):
                    tool[row, column] += last[row, inner] * mounts[-1, inner, column]
        turned = quaternion_of(tool)
        for part in range(4):
            quaternions[i, part] = turned[part]
    return positions, quaternions
