"""All configurations in which a Panda holds its tool in a pose, one joint given: in closed form.

A pose leaves the seven joints one freedom; with the last joint given there are finitely many solutions (so too Y. He
and S. Liu, "Analytical inverse kinematics for Franka Emika Panda", ICMRE 2021; the derivation here is another).

Symbols: S shoulder, where the first three axes meet; W wrist, where the fifth and sixth do; O the origin of the fourth
joint's frame, the elbow, 0.0825 m beside both arms; x_i, y_i, z_i the axes of joint i's frame. The last joint and the
pose give W and the frame of joint 6 but for its turn. Then

- the triangle S O W has three known sides, which gives q4 and its angle b at W;
- z5 is across z6, and makes a known angle with W - S: cos(b + d), tan d = 0.0825 / 0.384. Two solutions for q6;
- z4 is across z5 and W - S, with the sign that puts O where the triangle has it: q5;
- the frame of joint 3 follows from that of joint 4, and q1, q2, q3 are its angles z-y-z: two solutions.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from geodesic_motion_ros.geometry.quaternions import to_rotation
from geodesic_motion_ros.robot.kinematics import MATRIX, VECTOR, Robot

#: Lengths of Franka's Denavit-Hartenberg table [m].
_SHOULDER_HEIGHT, _UPPER, _FORE, _ELBOW, _WRIST = 0.333, 0.316, 0.384, 0.0825, 0.088
#: Solutions, at most, for one pose and one angle of the last joint.
MOST = 8
#: The elbow is where the triangle has it up to this [m].
_EXACT = 1e-6


OUT = numba.types.Array(numba.float64, 2, "C")


def solutions(robot: Robot, position: np.ndarray, quaternion: np.ndarray, last: float) -> np.ndarray:
    """Configurations (n, 7) [rad] inside the limits that hold a Panda's tool in a pose, the last joint at `last` [rad].

    Parameters
    ----------
    robot : a Panda, whatever its tool link is.
    position, quaternion : (3,) [m] and (4,) unit, scalar first, base frame.
    """
    rotations, origins = wrist_frames(robot, position[None], quaternion[None])
    found = np.empty((MOST, 7))
    return found[: solutions_at(rotations[0], origins[0], float(last), robot.lower, robot.upper, found)]


def wrist_frames(robot: Robot, positions: np.ndarray, quaternions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (n, 3, 3) and origins (n, 3) [m] of the frame that the last joint turns, for poses (n, 3), (n, 4)."""
    at_zero, origins_at_zero = robot.link_frames(np.zeros(len(robot.joint_names)))
    last = int(np.flatnonzero(robot.chain[3] >= 0)[-1]) + 1
    turn, offset = at_zero[last].T @ at_zero[-1], at_zero[last].T @ (origins_at_zero[-1] - origins_at_zero[last])
    rotations = to_rotation(quaternions).as_matrix() @ turn.T
    return np.ascontiguousarray(rotations), np.ascontiguousarray(positions - rotations @ offset)


@numba.njit(numba.int64(MATRIX, VECTOR, numba.float64, VECTOR, VECTOR, OUT), cache=True, nogil=True)
def solutions_at(rotation, origin, last, lower, upper, found):
    """Write the solutions inside the limits to found (MOST, 7), and return how many there are.

    rotation (3, 3), origin (3,) [m] : as of `wrist_frames`. last : angle of the last joint [rad].
    """
    cosine, sine = math.cos(last), math.sin(last)
    # axes of joint 6: R6 = R7 Rz(-q7) Rx(-pi / 2)
    x6 = cosine * rotation[:, 0] - sine * rotation[:, 1]
    y6 = -rotation[:, 2].copy()
    z6 = sine * rotation[:, 0] + cosine * rotation[:, 1]
    wrist = origin - _WRIST * x6
    to_shoulder = -wrist
    to_shoulder[2] += _SHOULDER_HEIGHT
    upper_arm, forearm = math.hypot(_UPPER, _ELBOW), math.hypot(_FORE, _ELBOW)
    distance = np.linalg.norm(to_shoulder)
    if not abs(upper_arm - forearm) < distance < upper_arm + forearm:
        return 0
    at_elbow = math.acos((upper_arm**2 + forearm**2 - distance**2) / (2.0 * upper_arm * forearm))
    at_wrist = math.acos((distance**2 + forearm**2 - upper_arm**2) / (2.0 * distance * forearm))
    q = np.empty(7)
    q[6] = last
    count = 0
    # nearly stretched, the elbow's offset puts O on the other side of S W
    for bent in (1.0, -1.0):
        inside = at_elbow if bent > 0.0 else 2.0 * math.pi - at_elbow
        q4 = inside + math.atan(_UPPER / _ELBOW) + math.atan(_FORE / _ELBOW) - 2.0 * math.pi
        beside = math.hypot(np.dot(to_shoulder, x6), np.dot(to_shoulder, y6))
        along = -distance * math.cos(bent * at_wrist + math.atan(_ELBOW / _FORE))
        if not (lower[3] <= q4 <= upper[3] and abs(along) < beside):
            continue
        q[3] = q4
        towards, apart = math.atan2(np.dot(to_shoulder, x6), np.dot(to_shoulder, y6)), math.acos(along / beside)
        for side in (-1.0, 1.0):
            q6 = towards + side * apart
            # into the joint's limits, which lie around half a turn
            q[5] = q6 - 2.0 * math.pi * math.floor((q6 + 0.5 * math.pi) / (2.0 * math.pi))
            z5 = math.sin(q6) * x6 + math.cos(q6) * y6
            x5 = math.cos(q6) * x6 - math.sin(q6) * y6
            across = np.cross(z5, to_shoulder)
            size = np.linalg.norm(across)
            if size < _EXACT:
                continue
            for sign in (-1.0, 1.0):
                z4 = sign / size * across
                x4 = np.cross(z5, z4)
                from_shoulder = wrist - _FORE * z5 + _ELBOW * x4
                from_shoulder[2] -= _SHOULDER_HEIGHT
                # axes of joint 3: R3 = R4 Rz(-q4) Rx(-pi / 2), with y4 = z5
                x3 = math.cos(q4) * x4 - math.sin(q4) * z5
                z3 = math.sin(q4) * x4 + math.cos(q4) * z5
                if np.linalg.norm(_UPPER * z3 + _ELBOW * x3 - from_shoulder) > _EXACT:
                    continue
                # y5 = -z6
                q[4] = math.atan2(-np.dot(z4, x5), np.dot(z4, z6))
                tilt = math.acos(min(1.0, max(-1.0, z3[2])))
                for turned in (-1.0, 1.0):
                    q[1] = turned * tilt
                    q[0] = math.atan2(turned * z3[1], turned * z3[0])
                    # axes of joint 3 at q3 = 0
                    x2 = np.array([math.cos(q[0]) * math.cos(q[1]), math.sin(q[0]) * math.cos(q[1]), -math.sin(q[1])])
                    y2 = np.array([-math.sin(q[0]), math.cos(q[0]), 0.0])
                    q[2] = math.atan2(np.dot(x3, y2), np.dot(x3, x2))
                    if np.all(q >= lower) and np.all(q <= upper):
                        found[count] = q
                        count += 1
    return count
