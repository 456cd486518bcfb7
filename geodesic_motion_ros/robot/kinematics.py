"""Forward kinematics, Jacobians and limits of a serial arm, compiled with numba.

Symbols: n moving joints with positions q (n,) [rad]; m joints in all; frames are expressed in the base link.
"""

from __future__ import annotations

import copy
import math
from functools import cached_property
from pathlib import Path

import numba
import numpy as np

from geodesic_motion_ros.robot.description import RobotDescription
from geodesic_motion_ros.robot.position_based_velocity import PositionBasedVelocity
from geodesic_motion_ros.robot.urdf import (
    read_chain,
    read_dynamic_limits,
    read_largest_speed_scale,
    read_position_based_velocity,
    read_velocity_limits,
)
from geodesic_motion_ros.utils.checked_numbers import real_array
from geodesic_motion_ros.utils.errors import RobotError

# Written signatures: compiled at the first import, never in the middle of a run. All inputs are read only.
VECTOR = numba.types.Array(numba.float64, 1, "C", readonly=True)
MATRIX = numba.types.Array(numba.float64, 2, "C", readonly=True)
CHAIN = numba.types.Tuple(
    (
        numba.types.Array(numba.float64, 3, "C", readonly=True),
        MATRIX,
        MATRIX,
        numba.types.Array(numba.int64, 1, "C", readonly=True),
        numba.types.Array(numba.boolean, 1, "C", readonly=True),
    )
)
#: `Robot.chain`, as those types have it.
Chain = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
FOLDER = Path(__file__).parent


class Robot:
    """A serial arm between a base link and a tool link.

    Attributes
    ----------
    urdf : the file it was read from.
    base_link, tool_link : names of the two ends of the chain.
    joint_names : names of the n moving joints, base first.
    link_names : names of the m + 1 links of the chain, base first, tool last.
    lower, upper : (n,) position limits [rad]; infinite for continuous joints.
    velocity_limits : (n,) [rad/s].
    acceleration_limits, jerk_limits : (n,) [rad/s^2], [rad/s^3]; infinite where no limits file was given.
    position_based_velocity : limits of the speeds towards the joints' stops; None: the arm has none.
    largest_speed_scale : share of `velocity_limits` that commands may use; less than 1 where a servo that overshoots
        the limits themselves would stop the arm.
    ready : (n,) a comfortable posture [rad], to which redundancy is drawn by default.
    inverse_kinematics : module that solves for it in closed form; None: that is done numerically (`solutions.py`).
    """

    def __init__(
        self,
        path: str | Path,
        base_link: str,
        tool_link: str,
        limits_path: str | Path | None = None,
        ready: tuple[float, ...] | None = None,
        inverse_kinematics: str | None = None,
    ) -> None:
        chain = read_chain(path, base_link, tool_link)
        self.urdf, self.base_link, self.tool_link = Path(path), base_link, tool_link
        self.joint_names, self.link_names = chain.joint_names, chain.link_names
        self.lower, self.upper, self.velocity_limits = chain.lower, chain.upper, chain.velocity
        self.acceleration_limits, self.jerk_limits = np.full((2, len(self.joint_names)), np.inf)
        self.position_based_velocity: PositionBasedVelocity | None = None
        self.largest_speed_scale = 1.0
        if limits_path is not None:
            self.acceleration_limits, self.jerk_limits = read_dynamic_limits(limits_path, self.joint_names)
            self.velocity_limits = read_velocity_limits(limits_path, self.joint_names, self.velocity_limits)
            self.position_based_velocity = read_position_based_velocity(limits_path, self.joint_names)
            self.largest_speed_scale = read_largest_speed_scale(limits_path)
        self.inverse_kinematics = inverse_kinematics
        self.chain = (chain.rotations, chain.translations, chain.axes, chain.joint_index, chain.prismatic)
        self.ready = self._middle() if ready is None else self.checked(np.asarray(ready, dtype=float))
        limits = (self.lower, self.upper, self.velocity_limits, self.acceleration_limits, self.jerk_limits)
        for array in (*limits, self.ready, *self.chain):
            array.setflags(write=False)

    @classmethod
    def named(cls, name: str | Path) -> Robot:
        """A robot that this package ships, by the name that skills give it, or that of a folder: `description.py`.

        Raises
        ------
        RobotError : there is neither, the folder lacks something, or its files do not fit each other.
        """
        described = RobotDescription.named(name)
        return cls(
            described.urdf, described.base_link, described.tool_link, described.limits, described.ready,
            described.inverse_kinematics,
        )  # fmt: skip

    @classmethod
    def from_urdf(
        cls, path: str | Path, base_link: str, tool_link: str, limits_path: str | Path | None = None
    ) -> Robot:
        """Any serial arm from its URDF, with acceleration and jerk limits from a joint_limits.yaml if given.

        Raises
        ------
        RobotError : naming the missing link, joint or limit, and what exists.
        """
        return cls(path, base_link, tool_link, limits_path)

    @property
    def takes_poses(self) -> bool:
        """Whether it has the joints to hold its tool in any pose within reach: six or more."""
        return len(self.joint_names) >= 6

    def checked(self, joint_positions: np.ndarray) -> np.ndarray:
        """Joint positions as a float64 copy (n,).

        Raises
        ------
        RobotError : wrong number of joints, not finite, or outside the position limits (the joint is named).
        """
        of_joints = f"positions of the joints {', '.join(self.joint_names)}"
        positions = real_array(of_joints, joint_positions, (len(self.joint_names),), RobotError)
        inside = np.isfinite(positions) & (positions >= self.lower) & (positions <= self.upper)
        if not inside.all():
            worst = int(np.flatnonzero(~inside)[0])
            raise RobotError(
                f"joint '{self.joint_names[worst]}' is at {positions[worst]:.4f} rad: "
                f"its limits are [{self.lower[worst]:.4f}, {self.upper[worst]:.4f}]"
            )
        return positions

    def nearest_turn(self, joint_positions: np.ndarray, reference: np.ndarray) -> np.ndarray:
        """Joint positions (..., n) with continuous joints turned by whole turns, each as near as can be to a reference
        (..., n) [rad]: the same posture, however a driver counts its turns.
        """
        turns = np.round((reference - joint_positions) / (2.0 * np.pi))
        return np.where(self.is_continuous, joint_positions + 2.0 * np.pi * turns, joint_positions)

    def unwrapped(self, path: np.ndarray) -> np.ndarray:
        """Return joint positions (m, n) with continuous joints turned by whole turns, each as near as can be to the one
        before [rad].
        """
        return np.where(self.is_continuous, np.unwrap(path, axis=0), path) if self.is_continuous.any() else path

    @cached_property
    def is_continuous(self) -> np.ndarray:
        """(n,) bool: which joints turn without an end."""
        return np.isinf(self.lower) & np.isinf(self.upper)

    def prefixed(self, prefix: str) -> Robot:
        """The same arm with a prefix before the names of its joints and links, as drivers of two arms have it."""
        other = copy.copy(self)
        other.base_link, other.tool_link = prefix + self.base_link, prefix + self.tool_link
        other.joint_names = tuple(prefix + name for name in self.joint_names)
        other.link_names = tuple(prefix + name for name in self.link_names)
        return other

    def forward(self, joint_positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tool pose in the base frame: position (3,) [m], unit quaternion (4,), scalar first, w >= 0."""
        return forward(contiguous(joint_positions), self.chain)

    def jacobian(self, joint_positions: np.ndarray) -> np.ndarray:
        """Geometric Jacobian (6, n) of the tool in the base frame: rows linear [m/rad], then angular."""
        return jacobian(contiguous(joint_positions), self.chain)

    def link_frames(self, joint_positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frames of `link_names` in the base frame: rotations (m + 1, 3, 3) and origins (m + 1, 3) [m]."""
        return link_frames(contiguous(joint_positions), self.chain)

    @cached_property
    def shoulder(self) -> np.ndarray:
        """Where the arm swings from (3,) [m]: origin of the second moving joint's frame at zero, base frame.

        It does not move in arms whose first joint turns about an axis through it.
        """
        joint_index = self.chain[3]
        second = int(np.flatnonzero(joint_index >= min(1, len(self.joint_names) - 1))[0])
        return self.link_frames(np.zeros(len(self.joint_names)))[1][second + 1]

    @cached_property
    def reach(self) -> float:
        """Largest distance [m] of the tool from the shoulder within the joint limits.

        Found by coordinate ascent from 8 seeded postures. Along one revolute joint the squared distance is
        exactly a + b cos q + c sin q, so each step takes the true maximum in the limits; along a prismatic
        one it is convex.
        """
        starts = self.sample(8, np.random.default_rng(0))
        return float(max(self._stretch(start) for start in starts))

    def within_reach(self, position: np.ndarray) -> bool:
        """Whether a position (3,) [m] is within `reach` of the shoulder: necessary, not sufficient."""
        return bool(np.linalg.norm(np.asarray(position) - self.shoulder) <= self.reach + 1e-6)

    def sample(self, count: int, generator: np.random.Generator) -> np.ndarray:
        """Uniform joint positions (count, n) [rad] inside the limits; continuous joints in [-pi, pi]."""
        return generator.uniform(*self._finite_limits(), size=(count, len(self.joint_names)))

    def _finite_limits(self) -> tuple[np.ndarray, np.ndarray]:
        unbounded = np.isinf(self.lower)
        return np.where(unbounded, -np.pi, self.lower), np.where(unbounded, np.pi, self.upper)

    def _middle(self) -> np.ndarray:
        lower, upper = self._finite_limits()
        return 0.5 * (lower + upper)

    def _stretch(self, positions: np.ndarray) -> float:
        ends = np.stack(self._finite_limits(), axis=1).tolist()
        prismatic = self.chain[4][self.chain[3] >= 0]
        positions, best = positions.copy(), self._distance(positions)
        for _ in range(200):
            previous = best
            for joint, (lower, upper) in enumerate(ends):
                farthest = self._farther_end if prismatic[joint] else self._farthest_angle
                positions[joint] = farthest(positions, joint, lower, upper)
            best = self._distance(positions)
            if best - previous < 1e-9:
                break
        return best

    def _farther_end(self, positions: np.ndarray, joint: int, lower: float, upper: float) -> float:
        return max((positions[joint], lower, upper), key=lambda value: self._distance_with(positions, joint, value))

    def _farthest_angle(self, positions: np.ndarray, joint: int, lower: float, upper: float) -> float:
        front, side, back = (self._distance_with(positions, joint, a) ** 2 for a in (0.0, 0.5 * math.pi, math.pi))
        cosine, sine = 0.5 * (front - back), side - 0.5 * (front + back)
        crest = math.atan2(sine, cosine)
        candidates = [float(positions[joint]), lower, upper, *([crest] if lower <= crest <= upper else [])]
        return max(candidates, key=lambda angle: cosine * math.cos(angle) + sine * math.sin(angle))

    def _distance_with(self, positions: np.ndarray, joint: int, value: float) -> float:
        trial = positions.copy()
        trial[joint] = value
        return self._distance(trial)

    def _distance(self, positions: np.ndarray) -> float:
        return float(np.linalg.norm(self.forward(positions)[0] - self.shoulder))


def check_takes_poses(robot: Robot) -> None:
    """Refuse an arm for skills of tool poses. RobotError: it has fewer than six joints."""
    if not robot.takes_poses:
        raise RobotError(
            f"a skill of the tool's poses needs an arm of six joints or more, to '{robot.tool_link}' there are "
            f"{len(robot.joint_names)}: teach {', '.join(robot.joint_names)} by their angles, or name another robot"
        )


def contiguous(values: np.ndarray) -> np.ndarray:
    """The same values as the kernels take them: float64 in one piece."""
    return np.ascontiguousarray(values, dtype=np.float64)


# Loops, where numpy has a word for it: its products and copies of arrays take seconds to compile.


@numba.njit(cache=True, nogil=True)
def unit(out):
    """Make a matrix (3, 3) of zeros the unit matrix."""
    for i in range(3):
        out[i, i] = 1.0


@numba.njit(cache=True, nogil=True)
def multiply(left, right, out):
    """Write the product of two matrices (3, 3) to a third one."""
    for i in range(3):
        for j in range(3):
            out[i, j] = left[i, 0] * right[0, j] + left[i, 1] * right[1, j] + left[i, 2] * right[2, j]


@numba.njit(cache=True, nogil=True)
def _axis_rotation(x, y, z, angle):
    """Rodrigues' formula: the rows of R = cos a I + sin a [axis]x + (1 - cos a) axis axis^T, for a unit axis."""
    s, c = np.sin(angle), np.cos(angle)
    t = 1.0 - c
    first = c + t * x * x, t * x * y - s * z, t * x * z + s * y
    second = t * x * y + s * z, c + t * y * y, t * y * z - s * x
    return first, second, (t * x * z - s * y, t * y * z + s * x, c + t * z * z)


@numba.njit(cache=True, nogil=True)
def base_frames(chain):
    """Rotations (m + 1, 3, 3) and origins (m + 1, 3) for `write_link_frames`: the base's are there already."""
    count = len(chain[3])
    rotations, origins = np.zeros((count + 1, 3, 3)), np.zeros((count + 1, 3))
    unit(rotations[0])
    return rotations, origins


@numba.njit(cache=True, nogil=True)
def write_link_frames(q, chain, rotations, origins):
    """Write the frames of all links but the base, as of `link_frames`, to arrays as of `base_frames`."""
    offset_rotations, offset_translations, axes, joint_index, prismatic = chain
    first = second = third = (0.0, 0.0, 0.0)
    # Numbers instead of rows: looking at a row of an array costs more than what is done with it.
    for k in range(len(joint_index)):
        turns = joint_index[k] >= 0 and not prismatic[k]
        if turns:
            first, second, third = _axis_rotation(axes[k, 0], axes[k, 1], axes[k, 2], q[joint_index[k]])
        for i in range(3):
            x, y, z = rotations[k, i, 0], rotations[k, i, 1], rotations[k, i, 2]
            origins[k + 1, i] = (
                origins[k, i] + x * offset_translations[k, 0] + y * offset_translations[k, 1]
                + z * offset_translations[k, 2]
            )  # fmt: skip
            a = x * offset_rotations[k, 0, 0] + y * offset_rotations[k, 1, 0] + z * offset_rotations[k, 2, 0]
            b = x * offset_rotations[k, 0, 1] + y * offset_rotations[k, 1, 1] + z * offset_rotations[k, 2, 1]
            c = x * offset_rotations[k, 0, 2] + y * offset_rotations[k, 1, 2] + z * offset_rotations[k, 2, 2]
            if turns:
                rotations[k + 1, i, 0] = a * first[0] + b * second[0] + c * third[0]
                rotations[k + 1, i, 1] = a * first[1] + b * second[1] + c * third[1]
                rotations[k + 1, i, 2] = a * first[2] + b * second[2] + c * third[2]
                continue
            rotations[k + 1, i, 0], rotations[k + 1, i, 1], rotations[k + 1, i, 2] = a, b, c
            if prismatic[k]:
                for j in range(3):
                    origins[k + 1, i] += rotations[k + 1, i, j] * axes[k, j] * q[joint_index[k]]


@numba.njit((VECTOR, CHAIN), cache=True, nogil=True)
def link_frames(q, chain):
    """Rotations (m + 1, 3, 3) and origins (m + 1, 3) of all links of the chain in the base frame."""
    rotations, origins = base_frames(chain)
    write_link_frames(q, chain, rotations, origins)
    return rotations, origins


@numba.njit((MATRIX,), cache=True, nogil=True)
def quaternion_of(rotation):
    """Unit quaternion (w, x, y, z), w >= 0, of a rotation matrix by its largest part (Shepperd 1978)."""
    trace = rotation[0, 0] + rotation[1, 1] + rotation[2, 2]
    out = np.empty(4)
    largest = trace
    index = 0
    for i in range(3):
        if rotation[i, i] > largest:
            largest = rotation[i, i]
            index = i + 1
    if index == 0:
        out[0] = 1.0 + trace
        out[1] = rotation[2, 1] - rotation[1, 2]
        out[2] = rotation[0, 2] - rotation[2, 0]
        out[3] = rotation[1, 0] - rotation[0, 1]
    else:
        i = index - 1
        j = (i + 1) % 3
        k = (i + 2) % 3
        out[0] = rotation[k, j] - rotation[j, k]
        out[1 + i] = 1.0 + rotation[i, i] - rotation[j, j] - rotation[k, k]
        out[1 + j] = rotation[j, i] + rotation[i, j]
        out[1 + k] = rotation[k, i] + rotation[i, k]
    scale = 1.0 / np.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    if out[0] < 0.0:
        scale = -scale
    for i in range(4):
        out[i] *= scale
    return out


@numba.njit((VECTOR, CHAIN), cache=True, nogil=True)
def forward(q, chain):
    """Tool position (3,) and quaternion (4,) of a chain."""
    rotations, origins = link_frames(q, chain)
    return origins[-1].copy(), quaternion_of(rotations[-1])


@numba.njit(cache=True, nogil=True)
def write_jacobian(rotations, origins, chain, out):
    """Write the geometric Jacobian at the frames of the links (`link_frames`) into zeros (6 or more, n)."""
    axes, joint_index, prismatic = chain[2], chain[3], chain[4]
    last = len(joint_index)
    for k in range(last):
        column = joint_index[k]
        if column < 0:
            continue
        first = 0 if prismatic[k] else 3
        for i in range(3):
            along = 0.0
            for j in range(3):
                along += rotations[k + 1, i, j] * axes[k, j]
            out[first + i, column] = along
        if not prismatic[k]:
            a, b, c = out[3, column], out[4, column], out[5, column]
            x = origins[last, 0] - origins[k + 1, 0]
            y = origins[last, 1] - origins[k + 1, 1]
            z = origins[last, 2] - origins[k + 1, 2]
            out[0, column], out[1, column], out[2, column] = b * z - c * y, c * x - a * z, a * y - b * x


@numba.njit((VECTOR, CHAIN), cache=True, nogil=True)
def jacobian(q, chain):
    """Geometric Jacobian (6, n): column of a revolute joint (a x (p - o); a), of a prismatic one (a; 0)."""
    rotations, origins = link_frames(q, chain)
    out = np.zeros((6, len(q)))
    write_jacobian(rotations, origins, chain, out)
    return out
