"""The swivel angle: where the elbow of a seven-joint arm is on the circle that a tool pose leaves it.

Symbols: S shoulder, E elbow, W wrist: origins of the frames of the second, fourth and sixth joint, base frame;
n = (W - S) / |W - S|, e = E - S, z the vertical. The swivel angle is that of the elbow about the line from shoulder
to wrist, right-handed about n, from the vertical plane that holds the line (D. Tolani, A. Goswami, N. Badler,
"Real-time inverse kinematics techniques for anthropomorphic limbs", Graphical Models 62, 2000):

    psi = atan2(y, x),    y = e . (n x z),    x = e . z - (e . n)(z . n),

zero with the elbow above the line. Where the last three axes do not meet in W, as those of the Panda, W moves a little
with the angle, and the circle is only nearly one. It is not defined where the line is vertical or the elbow lies on it.
Together with the pose of the tool it makes seven equations for seven joints, so that their solutions are points: as
long as the determinant of the seven rows keeps its sign, a motion stays on one branch of them.
"""

from __future__ import annotations

import numba
import numpy as np

from geodesic_motion_ros.robot.inverse_kinematics import checked_pose, pose_difference
from geodesic_motion_ros.robot.kinematics import CHAIN, VECTOR, Robot, contiguous, forward, jacobian, link_frames
from geodesic_motion_ros.utils.errors import RobotError

JOINTS = 7
TOLERANCE = 1e-9
"""Solutions are this near [m, rad]."""
LARGEST_STEP = 0.2
"""No joint turns farther than this [rad] in one step of the iteration, where the linearisation can be trusted."""
STEPS = 100


def swivel_angle(robot: Robot, joint_positions: np.ndarray) -> float:
    """Swivel angle [rad] in [-pi, pi] of an arm at joint positions (7,) [rad].

    Raises
    ------
    RobotError : the arm does not have seven revolute joints.
    """
    check_swivel(robot)
    return float(_swivel(contiguous(joint_positions), robot.chain)[0])


def elbow_position(robot: Robot, joint_positions: np.ndarray) -> np.ndarray:
    """Where the elbow is (3,) [m], base frame, at joint positions (n,) [rad]: the frame of the middle joint, the fourth
    of seven, the third of six.
    """
    frame = int(np.flatnonzero(robot.chain[3] == (len(robot.joint_names) - 1) // 2)[0]) + 1
    return robot.link_frames(joint_positions)[1][frame]


def solve_with_swivel(
    robot: Robot, position: np.ndarray, quaternion: np.ndarray, swivel: float, start: np.ndarray
) -> np.ndarray:
    """Joint positions (7,) [rad] with this tool pose and swivel angle, on the branch of the start.

    Damped least squares (as `inverse_kinematics.solve`) on pose error and swivel error together. Nothing is tried
    but this one descent: a solution on another branch would be a leap of the arm.

    Parameters
    ----------
    position, quaternion : target (3,) [m] and (4,) unit, scalar first, base frame.
    swivel : target [rad]; whole turns do not count.
    start : (7,) where the descent begins [rad], near the solution: along a path, the solution before.

    Raises
    ------
    RobotError : the arm does not have seven revolute joints; the pose is not finite; the descent ended before the
        target (the remaining error is said), on another branch, or outside the position limits.
    """
    check_swivel(robot)
    position, quaternion = checked_pose(position, quaternion)
    q = robot.checked(start)
    branch = np.sign(np.linalg.det(_rows(q, robot.chain)))
    q, error = _descend(q, position, quaternion, float(swivel), robot.chain)
    if not np.max(np.abs(error)) < TOLERANCE:
        raise RobotError(
            f"no joint positions near {np.round(start, 3).tolist()} rad reach position "
            f"{np.round(position, 3).tolist()} m, quaternion {np.round(quaternion, 3).tolist()} with swivel angle "
            f"{np.degrees(swivel):.1f} deg: {1e3 * np.linalg.norm(error[:3]):.2g} mm, "
            f"{np.degrees(np.linalg.norm(error[3:6])):.2g} deg and {np.degrees(abs(error[6])):.2g} deg of swivel remain"
        )
    if np.sign(np.linalg.det(_rows(q, robot.chain))) != branch:
        raise RobotError(
            f"joint positions {np.round(q, 3).tolist()} rad lie on another branch than the start "
            f"{np.round(start, 3).tolist()} rad: a singular posture is between them; start nearer to the target"
        )
    return robot.checked(q)


def has_swivel(robot: Robot) -> bool:
    """Whether a tool pose leaves the arm a circle of elbows: it has seven joints, all of them revolute."""
    return len(robot.joint_names) == _revolute(robot) == JOINTS


def _revolute(robot: Robot) -> int:
    return int(np.sum((robot.chain[3] >= 0) & ~robot.chain[4]))


def check_swivel(robot: Robot) -> None:
    """RobotError where `has_swivel` says no."""
    if not has_swivel(robot):
        raise RobotError(
            f"the arm to '{robot.tool_link}' has {len(robot.joint_names)} joints, {_revolute(robot)} of them revolute: "
            f"a swivel angle is that of an arm with {JOINTS} revolute joints"
        )


@numba.njit((VECTOR, CHAIN), cache=True, nogil=True)
def _swivel(q, chain):
    """Swivel angle and its gradient (7,)."""
    rotations, origins = link_frames(q, chain)
    axes, joint_index = chain[2], chain[3]
    frame = np.zeros(7, np.int64)
    for k in range(len(joint_index)):
        if joint_index[k] >= 0:
            frame[joint_index[k]] = k + 1
    shoulder, elbow, wrist = origins[frame[1]], origins[frame[3]], origins[frame[5]]
    vertical = np.array([0.0, 0.0, 1.0])
    length = np.linalg.norm(wrist - shoulder)
    n = (wrist - shoulder) / length
    e = elbow - shoulder
    x = e[2] - np.dot(e, n) * n[2]
    y = np.dot(e, np.cross(n, vertical))
    gradient = np.zeros(7)
    # the shoulder moves with the first joint in arms where it does not lie on that axis
    for j in range(5):
        axis = rotations[frame[j]] @ axes[frame[j] - 1]
        origin = origins[frame[j]]
        of_shoulder = np.cross(axis, shoulder - origin) if j < 1 else np.zeros(3)
        of_elbow = np.cross(axis, elbow - origin) if j < 3 else np.zeros(3)
        de = of_elbow - of_shoulder
        along = np.cross(axis, wrist - origin) - of_shoulder
        dn = (along - np.dot(along, n) * n) / length
        dx = de[2] - (np.dot(de, n) + np.dot(e, dn)) * n[2] - np.dot(e, n) * dn[2]
        dy = np.dot(de, np.cross(n, vertical)) + np.dot(e, np.cross(dn, vertical))
        gradient[j] = (x * dy - y * dx) / (x * x + y * y)
    return np.arctan2(y, x), gradient


@numba.njit((VECTOR, CHAIN), cache=True, nogil=True)
def _rows(q, chain):
    """Derivatives (7, 7) of tool pose and swivel angle by the joints."""
    rows = np.empty((JOINTS, JOINTS))
    rows[:6] = jacobian(q, chain)
    rows[6] = _swivel(q, chain)[1]
    return rows


@numba.njit((VECTOR, VECTOR, VECTOR, numba.float64, CHAIN), cache=True, nogil=True)
def _descend(start, position, quaternion, swivel, chain):
    """Where the descent ends (7,), and what remains there of pose and swivel, along the shorter arc, in one (7,)."""
    q, error = start.copy(), np.empty(JOINTS)
    for iteration in range(STEPS + 1):
        reached_position, reached_quaternion = forward(q, chain)
        error[:6] = pose_difference(reached_position, reached_quaternion, position, quaternion)
        around = swivel - _swivel(q, chain)[0]
        error[6] = np.arctan2(np.sin(around), np.cos(around))
        largest, damping = 0.0, 0.0
        for i in range(JOINTS):
            largest = max(largest, abs(error[i]))
            damping += 0.5 * error[i] * error[i]
        if largest < TOLERANCE or iteration == STEPS:
            break
        rows, gram = _rows(q, chain), np.empty((JOINTS, JOINTS))
        for i in range(JOINTS):
            for j in range(JOINTS):
                gram[i, j] = damping if i == j else 0.0
                for k in range(JOINTS):
                    gram[i, j] += rows[i, k] * rows[j, k]
        pull, step, farthest = np.linalg.solve(gram, error), np.zeros(JOINTS), 0.0
        for i in range(JOINTS):
            for j in range(JOINTS):
                step[i] += rows[j, i] * pull[j]
            farthest = max(farthest, abs(step[i]))
        for i in range(JOINTS):
            q[i] += step[i] / max(1.0, farthest / LARGEST_STEP)
    return q, error
